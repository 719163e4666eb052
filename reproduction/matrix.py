"""The comparison of table S1: every method on the same meshes, prompts and seeds, for the same time each.

Time is made equal once: each method is timed on a quiet machine, on one thread, and gets as many steps as fill the
budget (:func:`calibrate`). The steps are written down; so a cell that is painted beside other work, or another day, is
the same, byte for byte, as one that is painted alone.
"""

from __future__ import annotations

import dataclasses
import itertools
import json
import statistics
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from cells import Cell, claim, grid, save
from ruler import subject

from paintit.config import PaintConfig, preset, to_dict
from paintit.export.finish import finish
from paintit.files import atomic
from paintit.guidance.load import load_prior
from paintit.guidance.prior import Prior
from paintit.paint.make import make_painter
from paintit.variants import VARIANTS, apply

#: Five plain materials and five patterns, whose truth the generator of the prior's data knows.
PROMPTS = (
    "glossy red plastic", "matte blue plastic", "polished gold", "white porcelain", "black rubber",
    "a zebra", "red brick", "black and white checkered plastic", "leopard fur", "oak wood with visible grain",
)  # fmt: skip
#: Two meshes with their makers' UVs, and two that have to be unwrapped.
MESHES = ("spot", "bob", "koala", "wingnut")
#: Steps of a method that are timed: so many blocks of so many steps, the methods taking turns.
BLOCKS, BLOCK = 12, 5


@dataclass(frozen=True)
class Plan:
    """What is painted, and how long each paint takes."""

    meshes: tuple[str, ...] = MESHES
    prompts: tuple[str, ...] = PROMPTS
    seeds: tuple[int, ...] = (0, 1, 2)
    variants: tuple[str, ...] = tuple(VARIANTS)
    seconds: float = 24.0
    """Of steps, on one thread of a quiet machine; reading, unwrapping and finishing come on top."""
    size: int = 256
    """Texels along each side of the maps."""

    def config(self, variant: str, steps: int, seed: int = 0) -> PaintConfig:
        """The pocket preset as the method has it, for that many steps (``projection``: views)."""
        base = dataclasses.replace(preset("pocket"), seed=seed)
        base = dataclasses.replace(base, texture=dataclasses.replace(base.texture, size=self.size))
        config = apply(base, variant)
        if config.method == "projection":
            return dataclasses.replace(config, projection=dataclasses.replace(config.projection, views=steps))
        return dataclasses.replace(config, optim=dataclasses.replace(config.optim, steps=steps))

    def cells(self, part: str = "1/1") -> list[Cell]:
        """All of one seed before the next, so that an unfinished matrix is a whole one of fewer seeds."""
        return grid(self.meshes, self.prompts, self.seeds, part)


def calibrate(plan: Plan, folder: Path, prior: Prior | None = None) -> dict[str, int]:
    """Steps of each method that fill ``plan.seconds``; timed where ``folder`` does not say already."""
    file = folder / "steps.json"
    if file.exists():
        known = json.loads(file.read_text("utf-8"))
        if known["seconds"] != plan.seconds or known["size"] != plan.size or set(plan.variants) - set(known["steps"]):
            raise ValueError(f"{file} holds another budget: choose another folder, or remove it to time anew")
        return known["steps"]
    prior = prior or load_prior("pocket")
    timed = _seconds_per_step(plan, prior)
    steps = {variant: max(2, round(plan.seconds / each)) for variant, each in timed.items()}
    folder.mkdir(parents=True, exist_ok=True)
    with atomic(file) as temporary:
        record = {"seconds": plan.seconds, "size": plan.size, "steps": steps, "seconds_per_step": timed}
        temporary.write_text(json.dumps(record, indent=1) + "\n", "utf-8")
    return steps


def _seconds_per_step(plan: Plan, prior: Prior) -> dict[str, float]:
    """Of a short paint by each method, a block each in turn, the quickest block's median: what else runs only adds.

    The first half is left out: projection's first views, once round the mesh, are not chosen and cost less.
    """
    on = subject(plan.meshes[0], plan.size)
    count = 1 + BLOCKS * BLOCK
    painters = {v: iter(make_painter(on.mesh, plan.prompts[0], plan.config(v, count), prior)) for v in plan.variants}
    for painter in painters.values():
        next(painter)  # the first step builds what the others find built
    seconds: dict[str, list[float]] = {variant: [] for variant in plan.variants}
    for _ in range(BLOCKS):
        for variant, painter in painters.items():
            seconds[variant].append(statistics.median(step.seconds for step in itertools.islice(painter, BLOCK)))
    return {variant: min(blocks[BLOCKS // 2 :]) for variant, blocks in seconds.items()}


def paint(plan: Plan, folder: Path, part: str = "1/1") -> Iterator[tuple[str, Cell, float]]:
    """Paint the cells that ``folder`` lacks, all methods of a cell one after another; yields each with its seconds.

    Cells are kept as they are done: stop whenever you like. Several processes may each take a ``part`` ("1/2").
    """
    prior = load_prior("pocket")
    steps = calibrate(plan, folder, prior)
    for variant in plan.variants:
        record = {
            "variant": variant,
            "weights": prior.spec.revision,
            "config": to_dict(plan.config(variant, steps[variant])),
        }
        claim(folder / variant, record)
    for cell in plan.cells(part):
        for variant in plan.variants:
            if not (folder / variant / f"{cell.name}.json").exists():
                yield variant, cell, _paint(plan, folder / variant, variant, steps[variant], cell, prior)


def _paint(plan: Plan, folder: Path, variant: str, steps: int, cell: Cell, prior: Prior) -> float:
    on = subject(cell.mesh, plan.size)
    began = time.perf_counter()
    painter = make_painter(on.mesh, cell.prompt, plan.config(variant, steps, cell.seed), prior)
    for _ in painter:
        pass
    maps = finish(on.mesh, painter.maps(), painter.support)
    seconds = time.perf_counter() - began
    save(folder, cell, maps, seconds, steps)
    return seconds


def whole_seeds(plan: Plan, folder: Path) -> tuple[int, ...]:
    """Seeds of which every method has painted every cell."""

    def done(cells: Sequence[Cell]) -> bool:
        return all((folder / v / f"{cell.name}.json").exists() for cell in cells for v in plan.variants)

    return tuple(s for s in plan.seeds if done(grid(plan.meshes, plan.prompts, (s,))))
