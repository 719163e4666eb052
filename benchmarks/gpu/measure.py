"""Painters that differ in how they compute, and their steps timed by turns."""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import torch
from benchmarks.gpu.model import RandomDiffusion, Setting, make_pipeline, wait
from benchmarks.tuning import Row, middle, order

from paintit.api import peak_memory
from paintit.config import PaintConfig
from paintit.guidance import hub
from paintit.guidance.economy import Budget, Economy, choose
from paintit.guidance.footprint import footprint, outline
from paintit.guidance.loading import Loading
from paintit.guidance.settle import settle
from paintit.mesh.mesh import Mesh
from paintit.paint.footprint import beside
from paintit.paint.method import Step
from paintit.paint.painter import Painter

PROMPT = "a rusty iron kettle"
STAGES = ("network", "render", "encode", "predict", "guidance", "backward", "optimiser")
"""``guidance`` is what is left of it: noise, weighting, norms for the log."""


@dataclass(frozen=True)
class Kind:
    """A way of computing the same steps."""

    name: str
    changes: Mapping[str, Any]
    """Settings, over those of the :class:`~benchmarks.gpu.model.Setting`."""
    saving: bool = False
    """With what ``--memory 8`` stands for."""
    plain: bool = False
    """Nothing that saves time: no economy, no TF32."""

    def config(self, setting: Setting, device: torch.device, **changes: Any) -> PaintConfig:
        saving = setting.saving if self.saving else {}
        return setting.config(device=str(device), **self.changes, **saving, **changes)


KINDS = (
    Kind("default", {}),
    Kind("compiled", {"compute.compile": "on"}),
    Kind("memory 8", {}, saving=True),
    Kind("reference", {"dtype": "float32", "compute.compile": "off"}, plain=True),
)
"""What the settings choose by themselves; with the compiler; with ``--memory 8``; and what all is compared with."""


@dataclass
class Contender:
    """A painter at work, and what was seen of it."""

    kind: Kind
    economy: Economy
    painter: Painter
    prior: RandomDiffusion
    load_seconds: float
    """Of drawing the weights, in place of reading them."""
    first_seconds: float
    """Of the first step, with whatever is compiled and set up in it."""
    peak: int | None
    """Bytes of its tensors, at most, in its first steps; on a CPU those of the whole process so far."""
    reserved: int | None
    """Bytes that torch took from a GPU for them: with what it keeps for reuse, and what CUDA graphs keep."""
    rows: list[Row] = field(default_factory=list)

    def block(self, steps: int, staged: int) -> None:
        """``steps`` steps as they are for the median of their whole, ``staged`` more that wait after each stage."""
        with arithmetic(self.kind):
            stream = iter(self.painter)
            whole = statistics.median(timed(stream, self.painter.device)[1] for _ in range(steps))
            self.painter.profile = self.prior.timed = True
            rows = [self._stages(next(stream)) for _ in range(staged)]
            self.painter.profile = self.prior.timed = False
        self.rows.append({"step": whole, **middle(rows)})

    def _stages(self, step: Step) -> Row:
        seconds, self.prior.seconds = self.prior.seconds, {}
        rest = step.timings["guidance"] - sum(seconds.values())
        return {name: ({**step.timings, **seconds, "guidance": rest})[name] for name in STAGES}


@contextmanager
def arithmetic(kind: Kind) -> Iterator[None]:
    """float32 is float32 where nothing is to save time; else PyTorch's own choice, TF32 in convolutions."""
    if not kind.plain:
        yield
        return
    cudnn, precision = torch.backends.cudnn, torch.get_float32_matmul_precision()
    torch.set_float32_matmul_precision("highest")
    with cudnn.flags(enabled=cudnn.enabled, benchmark=cudnn.benchmark, allow_tf32=False):
        yield
    torch.set_float32_matmul_precision(precision)


def timed(stream: Iterator[Step], device: torch.device) -> tuple[Step, float]:
    """The next step, and its seconds until the device was done."""
    wait(device)
    start = time.perf_counter()
    step = next(stream)
    wait(device)
    return step, time.perf_counter() - start


def economy_of(kind: Kind, setting: Setting, mesh: Mesh, device: torch.device) -> Economy:
    """What a paint with these settings would do to save time and memory."""
    if kind.plain:
        return Economy()
    config = kind.config(setting, device)
    budget = Budget.of(config, str(device), beside(mesh, config, device))
    pipe = make_pipeline(setting, torch.device("cpu"), hub.precision(device, config.dtype), outline())
    prior = RandomDiffusion(pipe, id="outline")
    return choose(footprint(prior), budget, Economy.of(config, str(device))).economy


def enter(kind: Kind, setting: Setting, mesh: Mesh, device: torch.device, warm_up: int) -> Contender:
    """A painter that has done ``warm_up`` steps, at least one."""
    economy = economy_of(kind, setting, mesh, device)
    config = kind.config(setting, device)
    gpu = torch.cuda if device.type == "cuda" else None
    if gpu:
        gpu.empty_cache()
    before = (gpu.memory_allocated(device), gpu.memory_reserved(device)) if gpu else (0, 0)
    start = time.perf_counter()
    pipe = make_pipeline(setting, device, hub.precision(device, config.dtype))
    if economy.host_texts:
        pipe.text_encoder.cpu()
    settle(pipe, "unet", economy, device)
    prior = RandomDiffusion(pipe, id="random", loading=Loading(str(device), economy=economy))
    painter = Painter(mesh, PROMPT, config, prior)
    prior.release_texts()
    wait(device)
    loaded = time.perf_counter() - start
    if gpu:
        gpu.empty_cache()
        gpu.reset_peak_memory_stats(device)
    with arithmetic(kind):
        stream = iter(painter)
        first, *_ = [timed(stream, device)[1] for _ in range(warm_up)]
    peak = peak_memory(device)
    return Contender(
        kind, economy, painter, prior, loaded, first, None if peak is None else peak - before[0],
        gpu.max_memory_reserved(device) - before[1] if gpu else None,
    )  # fmt: skip


def measure(contenders: Sequence[Contender], rounds: int, steps: int, staged: int) -> None:
    """Fill their ``rows``: a block of each by turns, so that whatever else happens falls on all alike."""
    named = {contender.kind.name: contender for contender in contenders}
    for name in order(rounds, tuple(named)):
        named[name].block(steps, staged)


def whole_run(contender: Contender, setting: Setting, mesh: Mesh, steps: int) -> float:
    """Seconds of a paint of so many steps from its first to its last, everything being loaded and compiled."""
    device = contender.painter.device
    config = contender.kind.config(setting, device, **{"optim.steps": steps})
    painter = Painter(mesh, PROMPT, config, contender.prior)
    with arithmetic(contender.kind):
        wait(device)
        start = time.perf_counter()
        for _ in painter:
            pass
        wait(device)
    return time.perf_counter() - start
