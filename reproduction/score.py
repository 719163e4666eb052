"""Figures of the comparison: distances of pictures from those of the true materials, and the errors of each cell.

The truth of a prompt is what the generator of the prior's data means by it, put on the very mesh that was painted. The
real set of the distances is ``DRAWS`` such materials for every mesh and prompt, seen by the same views and light.
"""

from __future__ import annotations

import json
import math
import statistics
from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from cells import Cell, grid, load_maps
from meanings import meaning
from ruler import PATTERNS, channel_figures, constant_maps, relighting_error, subject, true_maps, truth_of
from ruler_classifier import class_of
from ruler_pattern import pattern_figures
from torch import Tensor

from paintit.evaluate.classifier import load_classifier
from paintit.evaluate.distances import fid, kid
from paintit.evaluate.features import load_network, view_features
from paintit.evaluate.protocol import Protocol, light_of, surface
from paintit.evaluate.scores import flatness
from paintit.export.seams import seam_figure
from paintit.files import atomic
from paintit.texture.maps import TextureMaps
from reproduction.matrix import Plan

#: The rows that no method makes: another draw of the true material, and the mean of the true material everywhere.
TRUTH, EVEN = "truth", "even"
#: Draws of the true material in the real set, for every mesh and prompt.
DRAWS = 3
#: Pictures as small as the package's own network reads them.
PROTOCOL = Protocol(size=64)
#: Figures of a cell whose mean over cells is reported.
FIGURES = (
    "named", "delta_e", "roughness_error", "metallic_error", "relighting", "pattern", "saturation", "seam", "flatness",
)  # fmt: skip
Row = dict[str, Any]


def score(plan: Plan, folder: Path, seeds: Sequence[int], report: Callable[[str], None] = print) -> Row:
    """All figures of the methods over ``seeds``: means over cells, with the spread of the seeds' means.

    Features and figures of a cell are kept beside it, so that scoring goes on where it was broken off.
    """
    real = {seed: torch.cat([_real(plan, cell) for cell in grid(plan.meshes, plan.prompts, (seed,))]) for seed in seeds}
    methods: dict[str, Row] = {}
    for method in (TRUTH, *plan.variants, EVEN):
        by_seed = []
        for seed in seeds:
            cells = [_cell(plan, folder, method, cell) for cell in grid(plan.meshes, plan.prompts, (seed,))]
            features = torch.cat([torch.tensor(cell["features"]) for cell in cells])
            means = {name: _mean(cell[name] for cell in cells) for name in FIGURES}
            by_seed.append({"fid_pocket": fid(real[seed], features), "kid_pocket": kid(real[seed], features), **means})
        methods[method] = {name: _spread([row[name] for row in by_seed]) for name in by_seed[0]}
        report(f"{method:14s}" + "".join(f"  {name} {value['mean']:.3g}" for name, value in methods[method].items()))
    return methods


def _cell(plan: Plan, folder: Path, method: str, cell: Cell) -> Row:
    file = folder / "scores" / method / f"{cell.name}.json"
    if file.exists():
        return json.loads(file.read_text("utf-8"))
    row = _measured(plan, maps_of_method(plan, folder, method, cell), cell)
    file.parent.mkdir(parents=True, exist_ok=True)
    with atomic(file) as temporary:
        temporary.write_text(json.dumps(row), "utf-8")
    return row


def maps_of_method(plan: Plan, folder: Path, method: str, cell: Cell) -> TextureMaps:
    """Finished maps of a method, or of one of the rows that no method makes."""
    if method == TRUTH:
        return _drawn(plan, cell, DRAWS)
    if method == EVEN:
        on = subject(cell.mesh, plan.size)
        return constant_maps(truth_of(cell.prompt, cell.mesh, plan.size).value, on.seen)
    return load_maps(folder / method, cell)


def _drawn(plan: Plan, cell: Cell, draw: int) -> TextureMaps:
    rng = np.random.default_rng([cell.seed, draw, 31])
    return true_maps(subject(cell.mesh, plan.size), meaning(cell.prompt, rng), rng)


@lru_cache(maxsize=1024)
def _real(plan: Plan, cell: Cell) -> Tensor:
    """(DRAWS * views, features) of the true material on a mesh; another set for every seed."""
    mesh, network = subject(cell.mesh, plan.size).mesh, load_network("pocket")
    return torch.cat([view_features(mesh, _drawn(plan, cell, draw), PROTOCOL, network) for draw in range(DRAWS)])


@torch.no_grad()
def _measured(plan: Plan, maps: TextureMaps, cell: Cell) -> Row:
    on, truth = subject(cell.mesh, plan.size), truth_of(cell.prompt, cell.mesh, plan.size)
    features = view_features(on.mesh, maps, PROTOCOL, load_network("pocket"))
    classifier = load_classifier()
    likely = classifier.net.head(features).log_softmax(1).mean(0)
    channels, seam = channel_figures(on, maps, truth), seam_figure(on.mesh, maps)
    seen = surface(on.mesh, maps, PROTOCOL)
    plain = cell.prompt not in PATTERNS
    row: Row = {
        "named": float(classifier.classes[int(likely.argmax())] == class_of(cell.prompt)),
        "delta_e": channels["delta_e"],
        "roughness_error": channels["roughness_error"],
        "metallic_error": abs(channels["metallic"] - truth.metallic),
        "relighting": relighting_error(on, maps, truth) if plain else None,
        "pattern": None if plain else pattern_figures(cell.mesh, maps, cell.prompt)["pattern"],
        "saturation": channels["saturation"],
        "seam": seam.ratio if seam else None,
        "flatness": abs(flatness(seen, light_of(PROTOCOL.light, PROTOCOL.exposure))),
    }
    row = {name: None if value is None or math.isnan(value) else round(value, 5) for name, value in row.items()}
    return row | {"features": [[round(x, 4) for x in view] for view in features.tolist()]}


def _mean(values: Any) -> float:
    found = [value for value in values if value is not None]
    return statistics.fmean(found) if found else math.nan


def _spread(values: Sequence[float]) -> dict[str, float]:
    """Mean and sample standard deviation over seeds; 0 for one seed, which shows no spread."""
    return {"mean": statistics.fmean(values), "sd": statistics.stdev(values) if len(values) > 1 else 0.0}
