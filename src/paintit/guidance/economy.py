"""What is done to save memory and time with a large prior, what that takes, and the choice under a budget. No torch."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import PurePath
from typing import Self

from paintit.config import PaintConfig
from paintit.errors import PriorError

#: Steps from which torch.compile is taken to pay on CUDA: it costs about a minute once and is expected to save some ten
#: milliseconds a step, which 6000 steps earn back. Both figures are expectations, and ``make bench-gpu`` measures them.
COMPILE_STEPS = 6000
#: Bytes that a process holds before anything of ours: the CUDA context and its libraries' workspaces; or, on a CPU,
#: Python, torch and the renderer.
BASE = {"cuda": 700_000_000, "cpu": 820_000_000}
#: What the allocator cannot hand out again, as a share of what it handed out.
FRAGMENTS = 0.05
GB = 1_000_000_000


@dataclass(frozen=True)
class Economy:
    """What is done; every default does nothing."""

    channels_last: bool = False
    """Weights of the U-Net and the autoencoder lie channels last, as tensor cores want them."""
    compile: bool = False
    """torch.compile of the network that denoises, with CUDA graphs where there is CUDA, and of the encoder."""
    graphs: bool = True
    """Without, no CUDA graphs: before PyTorch 2.13 threads cannot share them, and several devices have one each."""
    chunk: int = 0
    """Most samples that go through the network at once; 0 for no limit."""
    recompute: int = 0
    """Most views whose encoder activations live at once: the backward pass computes them again; 0 keeps them all."""
    offload: bool = False
    """The network's weights stay on the host and come to the device layer by layer."""
    host_texts: bool = False
    """Texts are encoded on the host."""
    tiny: str = ""
    """Folder or hub id of a tiny autoencoder in place of the prior's own. It changes the result."""

    @classmethod
    def of(cls, config: PaintConfig, device: str = "cpu") -> Self:
        """As the settings want it on ``device``. A tiny autoencoder by the name ``auto`` is found later."""
        compute, gpu = config.compute, device.startswith("cuda")
        compile = compute.compile == "on" or (compute.compile == "auto" and gpu and _steps(config) >= COMPILE_STEPS)
        return cls(
            channels_last=gpu,
            compile=compile and not compute.offload,
            graphs="," not in config.device,
            chunk=compute.chunk,
            recompute=compute.recompute,
            offload=compute.offload and gpu,
            tiny=compute.tiny_vae,
        )

    @property
    def words(self) -> str:
        """What is done, in words, without the folders of a path; empty where it is nothing."""
        path = PurePath(self.tiny)
        tiny = path.name if path.is_absolute() or self.tiny.startswith("~") else self.tiny
        parts = {
            "texts encoded on the host": self.host_texts,
            f"{self.chunk} at a time through the network": self.chunk,
            f"encoder recomputed, {self.recompute} at a time": self.recompute,
            "network's weights from the host": self.offload,
            f"tiny autoencoder {tiny}": tiny,
            "compiled": self.compile,
        }
        return ", ".join(text for text, done in parts.items() if done)


@dataclass(frozen=True)
class EncoderCost:
    """Bytes of an autoencoder."""

    weights: int
    saved: int
    """What it keeps of one view for the backward pass."""
    forward: int
    """The most it holds of one view where it keeps nothing."""
    backward: int
    """The most it holds of one view, forward and backward passes together."""


@dataclass(frozen=True)
class Footprint:
    """Bytes of a prior."""

    network: int
    """Weights of what denoises."""
    layer: int
    """Weights of its largest layer."""
    texts: int
    """Weights of the text encoders."""
    predict: int
    """The most it holds while it denoises one sample, without gradients."""
    encoder: EncoderCost
    tiny: EncoderCost | None = None
    """A tiny autoencoder that could stand in."""
    controls: int = 0
    """Weights of ControlNets, which stay on the device."""


@dataclass(frozen=True)
class Beside:
    """Bytes of a step that the prior has no part in: the texture's network and the renderer."""

    held: int = 0
    """Kept for the backward pass while the prior works."""
    peak: int = 0
    """The most, when the prior is done."""


@dataclass(frozen=True)
class Budget:
    """What a step has to fit into."""

    limit: int = 0
    """Bytes of the device; 0 for no limit."""
    views: int = 4
    samples: int = 8
    """Of one prediction: views times texts."""
    device: str = "cuda"
    beside: Beside = Beside()
    tiny: str = ""
    """Tiny autoencoder that may be taken where nothing else fits; empty for none."""

    @classmethod
    def of(cls, config: PaintConfig, device: str, beside: Beside | None = None) -> Self:
        """As the settings of a paint have it. Of several devices each has its share of the views, and the first one,
        which has the painter too, decides."""
        projects = config.method == "projection"
        views = 1 if projects else math.ceil(config.views.count / len(config.device.split(",")))
        texts = 3 if not projects and (config.guidance.perp_neg or config.guidance.loss == "nfsd") else 2
        limit = round((config.compute.memory or 0) * GB)
        return cls(limit, views, views * texts, device.partition(":")[0], beside or Beside())


@dataclass(frozen=True)
class Choice:
    """An economy, and what a step is estimated to take with it."""

    economy: Economy
    bytes: int

    @property
    def words(self) -> str:
        return f"about {self.bytes / GB:.1f} GB; {self.economy.words or 'nothing needs to be saved'}"


def estimate(footprint: Footprint, budget: Budget, economy: Economy) -> int:
    """Bytes at the peak of a paint.

    The peak is the greatest of four moments: the texts are encoded, with all weights there; the network denoises, with
    the encoder's activations and the painter's kept; the encoder's backward pass, with the painter's kept; the
    painter's own backward pass. CUDA graphs keep the network's activations to themselves at all times.
    """
    encoder = footprint.tiny if economy.tiny and footprint.tiny else footprint.encoder
    # Layers are fetched while the one before them computes.
    weights = encoder.weights + footprint.controls + (2 * footprint.layer if economy.offload else footprint.network)
    predict = footprint.predict * min(economy.chunk or budget.samples, budget.samples)
    graphs = predict if economy.compile and economy.graphs and budget.device == "cuda" else 0
    if economy.recompute:
        views = min(economy.recompute, budget.views)
        kept, encode, backward = 0, views * encoder.forward, views * encoder.backward
    else:
        kept, encode, backward = (budget.views * size for size in (encoder.saved, encoder.saved, encoder.backward))
    held = budget.beside.held
    moments = (
        0 if economy.host_texts else footprint.texts,
        held + max(encode + graphs, kept + predict),
        held + backward + graphs,
        budget.beside.peak + graphs,
    )
    return round(BASE.get(budget.device, BASE["cpu"]) + (1 + FRAGMENTS) * (weights + max(moments)))


def choose(footprint: Footprint, budget: Budget, economy: Economy) -> Choice:
    """The cheapest way to stay within the budget; ``economy`` itself where there is none, or where it fits.

    In the order of what they cost, so that each is only taken where all before it do not do:

    1. the texts on the host: seconds, once;
    2. the network in smaller batches: the same arithmetic in more, smaller calls;
    3. the encoder's activations computed again in the backward pass: one more forward pass of the encoder, about a
       quarter of a step more;
    4. the network's weights from the host, at every prediction: as long as the bus takes;
    5. a tiny autoencoder: quicker, but another result.

    What ``economy`` does already stays.

    Raises:
        PriorError: nothing fits; the least that would is named.
    """
    if not budget.limit:
        return Choice(economy, estimate(footprint, budget, economy))
    choices = [Choice(one, estimate(footprint, budget, one)) for one in _choices(footprint, budget, economy)]
    for choice in choices:
        if choice.bytes <= budget.limit:
            return choice
    least = math.ceil(10 * min(choice.bytes for choice in choices) / GB) / 10
    raise PriorError(
        "prior.memory",
        f"a paint like this does not fit into {budget.limit / GB:g} GB, whatever is saved",
        f"give --memory {least:g} or more; or fewer --views, a smaller --texture-size or another --prior",
    )


def _choices(footprint: Footprint, budget: Budget, given: Economy) -> Iterator[Economy]:
    """All that can be done, the cheapest first: of two neighbours the last difference costs least."""
    gpu = budget.device == "cuda"
    tinies = [given.tiny] if given.tiny else ["", budget.tiny] if budget.tiny and footprint.tiny else [""]
    offloads = [True] if given.offload else [False, True] if gpu else [False]
    recomputes = [given.recompute] if given.recompute else [0, *_halves(budget.views)]
    chunks = [given.chunk] if given.chunk else [0, *_halves(budget.samples)[1:]]
    hosts = [False, True] if gpu and not given.host_texts else [given.host_texts]
    for tiny, offload, recompute, chunk, host in itertools.product(tinies, offloads, recomputes, chunks, hosts):
        yield replace(
            given, tiny=tiny, offload=offload, recompute=recompute, chunk=chunk, host_texts=host,
            compile=given.compile and not offload,
        )  # fmt: skip


def _halves(count: int) -> list[int]:
    """``count``, half of it, and so on to 1."""
    return [count, *_halves((count + 1) // 2)] if count > 1 else [1]


def _steps(config: PaintConfig) -> int:
    """Predictions of the whole paint."""
    return config.optim.steps if config.method == "distillation" else config.projection.views * config.projection.steps
