"""What each loss does to a paint by the pocket prior: colour, metalness, saturation, pattern, seconds; and a sheet.

    python benchmarks/losses.py                    paint what the folder lacks, then the table and the sheet
    python benchmarks/losses.py paint --part 1/2   half of the cells only (a process for each core)
    python benchmarks/losses.py time               what a step of each costs: all take turns in one run
    python benchmarks/losses.py table              of what is painted, nothing rerun

Every loss paints the same meshes, prompts and seeds with the preset ``pocket``, its guidance scale and as many steps;
what a loss needs besides is as published. Times are from a run of their own, since cells may be painted beside other
work. Cells are kept as they are done: stop whenever you like. ``rfds`` is not among them: the pocket prior is no flow
model.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import statistics
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image, ImageDraw, ImageFont

from paintit.config import POCKET, PaintConfig, to_dict
from paintit.export.finish import finish
from paintit.export.preview import preview
from paintit.files import atomic
from paintit.guidance.load import load_prior
from paintit.guidance.prior import Prior
from paintit.paint.painter import Painter
from paintit.settings import NEGATIVE_EXAMPLE, merge
from paintit.texture.maps import TextureMaps

ROOT = Path(__file__).parents[1]
# The material generator, which knows the truth of a prompt, is a set of scripts beside the package.
sys.path.insert(0, str(ROOT / "training" / "pocket"))

from cells import Cell, claim, grid, load, load_maps, save  # noqa: E402
from meanings import meaning  # noqa: E402
from ruler import PATTERNS, channel_figures, subject, true_maps, truth_of  # noqa: E402
from ruler_pattern import pattern_figures  # noqa: E402

MESHES = ("spot", "bob")
PROMPTS = ("glossy red plastic", "polished gold", "black rubber", "a zebra", "red brick", "leopard fur")
AWAY = {"prompt.negative": NEGATIVE_EXAMPLE.strip("'")}
#: What each row of the table changes in the preset.
ROWS: dict[str, dict[str, Any]] = {
    "sds": {},
    "csd": {"guidance.loss": "csd"},
    "nfsd": {"guidance.loss": "nfsd", **AWAY},
    "bridge": {"guidance.loss": "bridge"},
    "asd": {"guidance.loss": "asd"},
    "sds, rescale 0.7": {"guidance.rescale": 0.7},
    "sds, negative": AWAY,
    "sds, perp-neg": {"guidance.perp_neg": True, **AWAY},
    "sds, non-increasing": {"guidance.timesteps": "non-increasing"},
}
#: Columns of the table: figure -> heading.
FIGURES = {
    "delta_e": "colour error", "metallic_error": "metalness error", "roughness_error": "roughness error",
    "saturation": "saturation", "pattern": "pattern", "milliseconds": "ms per step",
}  # fmt: skip
STAGES = ("paint", "time", "table")
#: Steps of a row that are timed: so many blocks of so many steps; and the file of the result.
BLOCKS, BLOCK, TIMES = 8, 4, "milliseconds.json"
TRUTH = "true material"
SIDE, VIEWS, MARGIN, HEADER, LABEL = 112, 2, 6, 24, 150


@dataclasses.dataclass(frozen=True)
class Plan:
    """What is painted."""

    meshes: tuple[str, ...] = MESHES
    prompts: tuple[str, ...] = PROMPTS
    seeds: tuple[int, ...] = (0,)
    rows: tuple[str, ...] = tuple(ROWS)
    steps: int = POCKET.optim.steps
    size: int = 256
    """Texels along each side of the maps."""

    def config(self, row: str, seed: int = 0) -> PaintConfig:
        return merge(POCKET, {"texture.size": self.size, "optim.steps": self.steps, "seed": seed, **ROWS[row]})

    def cells(self, part: str = "1/1") -> list[Cell]:
        return grid(self.meshes, self.prompts, self.seeds, part)


def place(folder: Path, row: str) -> Path:
    """Folder of a row's cells."""
    return folder / row.replace(", ", "-").replace(" ", "-")


def paint(plan: Plan, folder: Path, part: str = "1/1") -> Iterator[tuple[str, Cell, float]]:
    """Paint what ``folder`` lacks, all rows of a cell one after another; yields each with its seconds."""
    prior = load_prior("pocket")
    for row in plan.rows:
        claim(place(folder, row), {"weights": prior.spec.revision, "config": to_dict(plan.config(row))})
    for cell in plan.cells(part):
        for row in plan.rows:
            if not (place(folder, row) / f"{cell.name}.json").exists():
                yield row, cell, _paint(plan, place(folder, row), row, cell, prior)


def _paint(plan: Plan, folder: Path, row: str, cell: Cell, prior: Prior) -> float:
    on = subject(cell.mesh, plan.size)
    painter = Painter(on.mesh, cell.prompt, plan.config(row, cell.seed), prior)
    seconds = sum(step.seconds for step in painter)
    save(folder, cell, finish(on.mesh, painter.maps(), painter.support), seconds, plan.steps)
    return seconds


def time_steps(plan: Plan) -> dict[str, float]:
    """Milliseconds of a step of each row: the mean over blocks of the medians in them, the rows taking turns.

    Steps are spread over the whole paint, since what a loss asks of the prior may change in the course of it.
    """
    prior, mesh = load_prior("pocket"), subject(plan.meshes[0], plan.size).mesh
    short = dataclasses.replace(plan, steps=BLOCKS * BLOCK)
    streams = {row: iter(Painter(mesh, plan.prompts[0], short.config(row), prior)) for row in plan.rows}
    blocks: dict[str, list[float]] = {row: [] for row in plan.rows}
    for index in range(BLOCKS):
        for row in plan.rows if index % 2 == 0 else reversed(plan.rows):
            blocks[row].append(statistics.median(next(streams[row]).seconds for _ in range(BLOCK)))
    return {row: 1000 * statistics.mean(found) for row, found in blocks.items()}


@torch.no_grad()
def measure(plan: Plan, folder: Path) -> tuple[dict[str, dict[str, float | None]], int]:
    """Means over the cells that every row has painted, None where a figure says nothing of any; and their number."""
    painted = [dict(load(place(folder, row))) for row in plan.rows]
    times = json.loads(file.read_text("utf-8")) if (file := folder / TIMES).exists() else {}
    common = [cell for cell in plan.cells() if all(cell in row for row in painted)]
    if not common:
        raise SystemExit(f"no cell in {folder} is painted by every loss yet: run 'paint' first")
    means: dict[str, dict[str, float | None]] = {}
    for row in plan.rows:
        found = [_figures(plan, load_maps(place(folder, row), cell), cell) for cell in common]
        for figures in found:
            figures["milliseconds"] = times.get(row, math.nan)
        means[row] = {name: _mean([figures[name] for figures in found]) for name in FIGURES}
    return means, len(common)


def _figures(plan: Plan, maps: TextureMaps, cell: Cell) -> dict[str, float]:
    on, truth = subject(cell.mesh, plan.size), truth_of(cell.prompt, cell.mesh, plan.size)
    figures = channel_figures(on, maps, truth)
    figures["metallic_error"] = abs(figures["metallic"] - truth.metallic)
    patterned = cell.prompt in PATTERNS
    figures["pattern"] = pattern_figures(cell.mesh, maps, cell.prompt)["pattern"] if patterned else math.nan
    return figures


def _mean(values: Sequence[float]) -> float | None:
    known = [value for value in values if not math.isnan(value)]
    return statistics.fmean(known) if known else None


def markdown(means: dict[str, dict[str, float | None]]) -> str:
    """The table as docs/losses.md has it."""
    lines = ["| loss | " + " | ".join(FIGURES.values()) + " |", "|---|" + "---|" * len(FIGURES)]
    digits = {"delta_e": 1, "milliseconds": 0}
    for row, figures in means.items():
        cells = ["-" if v is None else f"{v:.{digits.get(k, 2)}f}" for k, v in figures.items()]
        lines.append(f"| {row} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def sheet(plan: Plan, folder: Path) -> Image.Image:
    """All cells of the first seed, one below the other; a column for each loss, the true material first."""
    columns, cells = (TRUTH, *plan.rows), grid(plan.meshes, plan.prompts, plan.seeds[:1])
    wide, high = VIEWS * SIDE + MARGIN, SIDE + MARGIN
    out = Image.new("RGB", (LABEL + len(columns) * wide, HEADER + len(cells) * high), "white")
    pen, font = ImageDraw.Draw(out), ImageFont.load_default(14)
    for i, column in enumerate(columns):
        pen.text((LABEL + i * wide + 4, 4), column, "black", font)
    for j, cell in enumerate(cells):
        pen.text((4, HEADER + j * high + 6), f"{cell.prompt}\n{cell.mesh}", "black", font)
        on = subject(cell.mesh, plan.size)
        for i, column in enumerate(columns):
            if column == TRUTH:
                rng = np.random.default_rng([cell.seed, 4242])
                maps = true_maps(on, meaning(cell.prompt, rng), rng)
            elif (place(folder, column) / f"{cell.name}.json").exists():
                maps = load_maps(place(folder, column), cell)
            else:
                continue
            out.paste(preview(on.mesh, maps, size=SIDE, views=VIEWS), (LABEL + i * wide, HEADER + j * high))
    return out


def parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("stages", nargs="*", metavar="STAGE", help="paint, time, table; all by default")
    parser.add_argument("--folder", type=Path, default=ROOT / "outputs" / "losses", help="(default: %(default)s)")
    parser.add_argument("--part", default="1/1", help="i/n: of the cells, the i-th of n parts")
    parser.add_argument("--meshes", nargs="+", default=MESHES)
    parser.add_argument("--prompts", nargs="+", default=PROMPTS)
    parser.add_argument("--seeds", nargs="+", type=int, default=Plan.seeds)
    parser.add_argument("--losses", nargs="+", choices=ROWS, default=tuple(ROWS), metavar="LOSS", help="rows to paint")
    parser.add_argument("--steps", type=int, default=Plan.steps)
    parser.add_argument("--size", type=int, default=Plan.size, help="texels a side (default: %(default)s)")
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args()
    if unknown := set(options.stages) - set(STAGES):
        parser.error(f"no stage is called {', '.join(sorted(unknown))}: choose from {', '.join(STAGES)}")
    return options


def main() -> None:
    options = parse()
    torch.set_num_threads(options.threads)
    seeds, rows = tuple(options.seeds), tuple(options.losses)
    plan = Plan(tuple(options.meshes), tuple(options.prompts), seeds, rows, options.steps, options.size)
    stages = options.stages or STAGES
    if "paint" in stages:
        for row, cell, seconds in paint(plan, options.folder, options.part):
            print(f"{row:22s}{cell.name}: {seconds:.1f} s", file=sys.stderr, flush=True)
    if "time" in stages:
        options.folder.mkdir(parents=True, exist_ok=True)
        with atomic(options.folder / TIMES) as temporary:
            temporary.write_text(json.dumps(time_steps(plan), indent=1) + "\n", "utf-8")
    if "table" in stages:
        means, cells = measure(plan, options.folder)
        record = {"plan": dataclasses.asdict(plan), "cells": cells, "means": means}
        with atomic(options.folder / "losses.json") as temporary:
            temporary.write_text(json.dumps(record, indent=1) + "\n", "utf-8")
        with atomic(options.folder / "losses.jpg") as temporary:
            sheet(plan, options.folder).save(temporary, "JPEG", quality=88)
        print(markdown(means))


if __name__ == "__main__":
    main()
