"""``python -m reproduction``: each table and figure of the paper that can be rerun here, then the page.

    python -m reproduction                    all stages; whatever was done before is kept
    python -m reproduction paint --part 1/2   cells of the comparison only, half of them (a process for each core)
    python -m reproduction document           the page from results.json, nothing rerun
    python -m reproduction --smoke            all stages, tiny, into another folder; the page goes there too

An interrupted run goes on where it was: cells, curves and scores are kept one by one.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from cells import grid

from paintit.files import atomic
from reproduction import ROOT, document, sheet
from reproduction.machine import machine
from reproduction.matrix import Plan, calibrate, paint, whole_seeds
from reproduction.score import score

RESULTS = Path(__file__).parent / "results.json"
SMOKE = Plan(
    meshes=("spot",), prompts=("red brick", "polished gold"), seeds=(0,), variants=("dcpbr", "pixels", "projection"),
    seconds=3.0, size=128,
)  # fmt: skip
FITTED = ROOT / "assets" / "meshes" / "chicken" / "chicken.jpg"
PAINTED = ROOT / "assets" / "meshes" / "spot" / "spot.obj"


@dataclass(frozen=True)
class Run:
    """One reproduction: what, where, and where its results go."""

    plan: Plan
    folder: Path
    smoke: bool = False
    part: str = "1/1"

    @property
    def matrix(self) -> Path:
        return self.folder / "matrix"

    @property
    def results(self) -> Path:
        return self.folder / "results.json" if self.smoke else RESULTS

    @property
    def page(self) -> Path:
        return self.folder / "reproduction.md" if self.smoke else ROOT / "docs" / "reproduction.md"

    @property
    def images(self) -> Path:
        return self.folder / "img" if self.smoke else ROOT / "docs" / "img"


def analyses(smoke: bool) -> dict[str, list[str]]:
    """Stage -> arguments of ``paintit``: figure 4 (a, b) with S5, figure 4 (c, d) with S6, ratios of supp. A.2."""
    size = ["--texture.size", "128" if smoke else "256"]
    few = ["--seeds", "1", "--every", "5"] if smoke else ["--seeds", "3", "--every", "10"]
    steps = lambda full: ["--optim.steps", "20" if smoke else str(full)]  # noqa: E731
    coherence = ["--seeds", "1", "--t", "0.5"] if smoke else ["--seeds", "5", "--after", "0", "100"]
    return {
        "fitting": ["analyze", "frequency", str(FITTED), *size, *few, *steps(1000)],
        "painting": ["analyze", "frequency", str(PAINTED), "red brick", *size, *few, *steps(300)],
        "coherence": ["analyze", "coherence", str(PAINTED), "red brick", *size, *coherence],
    }


def stage_paint(run: Run) -> None:
    steps = calibrate(run.plan, run.matrix)
    print(f"steps in {run.plan.seconds:g} s each: {steps}", flush=True)
    for variant, cell, seconds in paint(run.plan, run.matrix, run.part):
        print(f"{variant:14s}{cell.name}: {seconds:.1f} s", flush=True)


def stage_analyze(run: Run) -> None:
    for name, arguments in analyses(run.smoke).items():
        subprocess.run([sys.executable, "-m", "paintit", *arguments, "-o", str(run.folder / name)], check=True)


def stage_score(run: Run) -> None:
    """Score the seeds that are whole, and gather everything that the page says into one file."""
    seeds = whole_seeds(run.plan, run.matrix)
    if not seeds:
        raise SystemExit("no seed of the comparison is painted by every method yet: run the stage 'paint' first")
    methods = score(run.plan, run.matrix, seeds)
    cells = grid(run.plan.meshes, run.plan.prompts, seeds)
    seconds = [_seconds(run.matrix / variant / f"{cell.name}.json") for variant in run.plan.variants for cell in cells]
    found: dict[str, Any] = {
        "date": time.strftime("%Y-%m-%d", time.gmtime()),
        "machine": machine(),
        "comparison": {
            "meshes": run.plan.meshes, "prompts": run.plan.prompts, "seeds": seeds, "size": run.plan.size,
            "budget": json.loads((run.matrix / "steps.json").read_text()), "methods": methods,
            "cells": len(seconds), "hours": round(sum(seconds) / 3600, 2),
        },
    }  # fmt: skip
    for name, arguments in analyses(run.smoke).items():
        file = run.folder / name / f"{arguments[1]}.json"
        if file.exists():
            found[name] = document.digest(json.loads(file.read_text("utf-8")))
    with atomic(run.results) as temporary:
        temporary.write_text(json.dumps(found, indent=1) + "\n", "utf-8")


def _seconds(file: Path) -> float:
    return json.loads(file.read_text("utf-8"))["seconds"]


def stage_document(run: Run) -> None:
    run.images.mkdir(parents=True, exist_ok=True)
    for name, arguments in analyses(run.smoke).items():
        figure = run.folder / name / f"{arguments[1]}.png"
        if figure.exists():
            shutil.copy(figure, run.images / f"reproduction-{name}.png")
    results = json.loads(run.results.read_text("utf-8"))
    if run.matrix.exists():
        seed = results["comparison"]["seeds"][0]
        with atomic(run.images / "reproduction-methods.jpg") as temporary:
            sheet.contact_sheet(run.plan, run.matrix, seed).save(temporary, "JPEG", quality=88)
    with atomic(run.page) as temporary:
        temporary.write_text(document.page(results), "utf-8")
    print(run.page)


STAGES: dict[str, Callable[[Run], None]] = {
    "paint": stage_paint, "analyze": stage_analyze, "score": stage_score, "document": stage_document,
}  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m reproduction", description=__doc__.partition("\n")[0])
    parser.add_argument("stages", nargs="*", metavar="STAGE", help=f"{', '.join(STAGES)}; all by default")
    parser.add_argument("--smoke", action="store_true", help="tiny, to see that everything runs")
    parser.add_argument("--part", default="1/1", help="i/n: of the cells of 'paint', the i-th of n parts")
    parser.add_argument("--meshes", nargs="+", default=Plan.meshes, help="of the comparison, fewer than all")
    parser.add_argument("--seeds", nargs="+", type=int, default=Plan.seeds, help="of the comparison, likewise")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--folder", type=Path, default=ROOT / "outputs" / "reproduction")
    options = parser.parse_args()
    if unknown := set(options.stages) - set(STAGES):
        parser.error(f"no stage is called {', '.join(sorted(unknown))}: choose from {', '.join(STAGES)}")
    torch.set_num_threads(options.threads)
    whole = Plan(meshes=tuple(options.meshes), seeds=tuple(options.seeds))
    plan, folder = (SMOKE, options.folder / "smoke") if options.smoke else (whole, options.folder)
    run = Run(plan, folder, options.smoke, options.part)
    for stage in options.stages or STAGES:
        STAGES[stage](run)


if __name__ == "__main__":
    main()
