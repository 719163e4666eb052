"""From the figures of each cell to the tests that a result is judged by, tables, and one number.

Tests of a plain prompt: ``colour`` (CIEDE2000 of the mean base colour at most 12), ``metal`` (mean metalness on the right
side of 0.5), ``rough`` (mean roughness within 0.2), ``hit`` (recognised by the retrieval ruler). Of a pattern: ``hit``,
and ``pattern``, its score in [0, 1]. A cell's score is the mean of its tests, the total the mean of the plain and of the
pattern cells' mean scores, each kind weighing a half.
"""

from __future__ import annotations

import json
import math
import statistics
from collections.abc import Iterable, Sequence
from pathlib import Path

from cells import Cell, load, load_maps
from ruler import PLAIN, PROMPTS, channel_figures, light_of, relighting_error, stacks, subject, truth_of
from ruler_classifier import Recogniser, class_of
from ruler_pattern import pattern_figures

DELTA_E, ROUGHNESS = 12.0, 0.2
Row = dict[str, float | str]


def measure_cell(folder: Path, cell: Cell, seconds: float, recogniser: Recogniser) -> Row:
    """All figures of one painted cell, its tests and its score."""
    maps = load_maps(folder, cell)
    size = maps.size[0]
    on, truth = subject(cell.mesh, size), truth_of(cell.prompt, cell.mesh, size)
    named = recogniser.recognise(stacks(on, maps, light_of("default")))
    row: Row = {
        "mesh": cell.mesh, "prompt": cell.prompt, "seed": cell.seed, "seconds": seconds, "named": named,
        **channel_figures(on, maps, truth),
    }  # fmt: skip
    if cell.prompt in PLAIN:
        row["relighting"] = relighting_error(on, maps, truth)
    else:
        row |= pattern_figures(cell.mesh, maps, cell.prompt)
    return row | judged(row, truth.metallic, named == class_of(cell.prompt))


def judged(row: Row, true_metallic: float, recognised: bool) -> dict[str, float]:
    """Tests (1 passed, 0 failed) and ``score``, their mean over those that count for the kind of prompt."""
    tests = {
        "colour": float(row["delta_e"]) <= DELTA_E,
        "metal": (float(row["metallic"]) > 0.5) == (true_metallic > 0.5),
        "rough": float(row["roughness_error"]) <= ROUGHNESS,
        "hit": recognised,
    }
    passed = {name: float(value) for name, value in tests.items()}
    counted = list(passed.values()) if "pattern" not in row else [passed["hit"], float(row["pattern"])]
    return {**passed, "score": statistics.mean(counted)}


def measure(folder: Path, recogniser: Recogniser) -> list[Row]:
    """Rows of all cells in a folder that have one of ``PROMPTS``, in that order."""
    found = [(cell, seconds) for cell, seconds in load(folder) if cell.prompt in PROMPTS]
    rows = [measure_cell(folder, cell, seconds, recogniser) for cell, seconds in found]
    return sorted(rows, key=lambda r: (PROMPTS.index(str(r["prompt"])), str(r["mesh"]), float(r["seed"])))


def mean(rows: Sequence[Row], name: str) -> float:
    """Mean of a figure over the rows that have it; NaN where none has."""
    values = [float(row[name]) for row in rows if name in row and not math.isnan(float(row[name]))]
    return statistics.mean(values) if values else math.nan


def total(rows: Sequence[Row]) -> float:
    """Half the mean score of plain cells and half that of patterns; of one kind where the other is absent."""
    kinds = [[r for r in rows if "pattern" not in r], [r for r in rows if "pattern" in r]]
    return statistics.mean(mean(kind, "score") for kind in kinds if kind)


def spread(values: Iterable[float]) -> tuple[float, float]:
    """Mean and standard deviation (of the sample; 0 for one value), without those that are NaN; NaN for none."""
    found = [value for value in values if not math.isnan(value)]
    if not found:
        return math.nan, 0.0
    return statistics.mean(found), statistics.stdev(found) if len(found) > 1 else 0.0


def summary(rows: Sequence[Row]) -> dict[str, dict[str, float]]:
    """Of plain cells, of patterns and of all: mean and standard deviation over seeds of each figure's mean."""
    seeds = sorted({float(r["seed"]) for r in rows})
    by_seed = [[r for r in rows if r["seed"] == seed] for seed in seeds]
    out: dict[str, dict[str, float]] = {}
    for kind, names in (
        (
            "plain",
            ("colour", "metal", "rough", "hit", "score", "delta_e", "roughness_error", "saturation", "relighting"),
        ),
        ("pattern", ("hit", "pattern", "decoy", "score", "delta_e", "saturation", "metal", "rough")),
    ):
        chosen = [[r for r in some if ("pattern" in r) == (kind == "pattern")] for some in by_seed]
        if not any(chosen):
            continue
        for name in names:
            average, deviation = spread(mean(some, name) for some in chosen if some)
            out.setdefault(kind, {})[name] = average
            out[kind][f"{name}_sd"] = deviation
    average, deviation = spread(total(some) for some in by_seed)
    out["all"] = {"total": average, "total_sd": deviation, "cells": len(rows), "seconds": mean(rows, "seconds")}
    return out


COLUMNS = (
    ("delta_e", "dE00", 6, 1), ("colour", "ok", 5, 2), ("metallic", "metal", 6, 2), ("metal", "ok", 5, 2),
    ("roughness", "rough", 6, 2), ("roughness_error", "err", 5, 2), ("rough", "ok", 5, 2), ("hit", "hit", 5, 2),
    ("pattern", "patt", 5, 2), ("decoy", "decoy", 6, 2), ("saturation", "sat", 5, 2), ("chroma", "dC", 6, 1),
    ("relighting", "relit", 6, 3), ("score", "score", 6, 2),
)  # fmt: skip


def table(rows: Sequence[Row]) -> str:
    """One line per prompt, means over its cells, and the classes that it was taken for."""
    lines = [f"{'prompt':36s}" + "".join(f"{title:>{width}s}" for _, title, width, _ in COLUMNS) + "  named"]
    for prompt in dict.fromkeys(str(r["prompt"]) for r in rows):
        own = [r for r in rows if r["prompt"] == prompt]
        cells = "".join(
            f"{'-':>{width}s}" if math.isnan(mean(own, name)) else f"{mean(own, name):{width}.{digits}f}"
            for name, _, width, digits in COLUMNS
        )
        names = ", ".join(dict.fromkeys(str(r["named"]) for r in own))
        lines.append(f"{prompt[:35]:36s}{cells}  {names}")
    return "\n".join(lines)


def report(name: str, rows: Sequence[Row], file: Path) -> str:
    """The table and the totals in words; rows and totals also go to ``file``."""
    totals = summary(rows)
    plain_json = json.dumps({"totals": totals, "cells": rows}, indent=1).replace("NaN", "null")
    file.write_text(plain_json)
    lines = [f"== {name}: {len(rows)} cells", table(rows)]
    for kind, figures in totals.items():
        pairs = [
            f"{k} {v:.3f}" + (f" ±{figures[f'{k}_sd']:.3f}" if f"{k}_sd" in figures else "")
            for k, v in figures.items()
            if not k.endswith("_sd")
        ]
        lines.append(f"{kind:8s}" + "  ".join(pairs))
    return "\n".join(lines)
