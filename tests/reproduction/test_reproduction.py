"""The parts of ``make reproduce`` that its smoke run does not judge: bookkeeping and the page."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest
from reproduction.matrix import Plan, calibrate, whole_seeds

import reproduction  # noqa: F401  (puts the material generator on the path)
from reproduction import document

PLAN = Plan(meshes=("spot",), prompts=("red brick",), seeds=(0, 1), variants=("dcpbr", "pixels"), seconds=3.0, size=128)


def test_every_method_keeps_its_steps_and_projection_counts_views():
    assert PLAN.config("pixels", 7, seed=5).optim.steps == 7
    assert PLAN.config("pixels", 7, seed=5).seed == 5
    projection = PLAN.config("projection", 7)
    assert (projection.projection.views, projection.method) == (7, "projection")
    assert projection.optim.steps == PLAN.config("dcpbr", projection.optim.steps).optim.steps


def test_a_folder_with_another_budget_is_refused(tmp_path: Path):
    known = {"seconds": 3.0, "size": 128, "steps": {"dcpbr": 5, "pixels": 6}}
    (tmp_path / "steps.json").write_text(json.dumps(known))
    assert calibrate(PLAN, tmp_path) == known["steps"]
    for other in (
        dataclasses.replace(PLAN, seconds=4.0),
        dataclasses.replace(PLAN, size=256),
        dataclasses.replace(PLAN, variants=("dcpbr", "points")),
    ):
        with pytest.raises(ValueError, match="another budget"):
            calibrate(other, tmp_path)


def test_a_seed_counts_once_every_method_has_painted_it(tmp_path: Path):
    assert whole_seeds(PLAN, tmp_path) == ()
    for variant in PLAN.variants:
        (tmp_path / variant).mkdir()
    for variant, seed in (("dcpbr", 0), ("dcpbr", 1), ("pixels", 1)):
        (tmp_path / variant / f"spot-red-brick-{seed}.json").write_text("{}")
    assert whole_seeds(PLAN, tmp_path) == (1,)


def results(seeds: list[int]) -> dict:
    figures = {name: {"mean": 1.25, "sd": 0.5 if len(seeds) > 1 else 0.0} for name in document.COLUMNS}
    rings = [{"mean": 10.0, "low": 8.0, "high": 12.0}] * 4 + [{"mean": None, "low": None, "high": None}]
    flat = [{"mean": 0.5, "low": 0.4, "high": 0.6}] * 5
    frequency = {"size": 128, "steps": 9, "seeds": [0], "seconds": 3.2}
    return {
        "date": "2026-01-01",
        "machine": {"processor": "a processor", "cores": 2, "torch": "2.13.0"},
        "comparison": {
            "meshes": ["spot"], "prompts": ["red brick"], "seeds": seeds, "size": 128, "cells": 4, "hours": 0.1,
            "budget": {"seconds": 3.0, "steps": {"dcpbr": 5, "pixels": 6}},
            "methods": dict.fromkeys(("truth", "dcpbr", "pixels", "even"), figures),
        },
        "fitting": frequency | {
            "subject": {"image": "x.png"},
            "summary": {"dcpbr": {"half_fitted_step": rings, "final_residual": flat}},
        },
        "coherence": {
            "size": 128, "steps": 9, "seeds": [0], "views": 5, "within_degrees": 2, "mesh": "spot.obj", "prompt": "x",
            "summary": [
                {"kind": "repeated", "after": 0, "reads": "rgb", "t": None, "scale": None, "ratios": [], "rank": 1,
                 "effective_rank": 1.0, "cosine": 1.0},
            ],
        },
    }  # fmt: skip


def test_the_page_says_what_was_measured_and_how_often():
    page = document.page(results([0, 1]))
    assert "1 prompt x 1 mesh (spot) x 2 seeds; each method for the same 3 s" in page
    assert "| DC-PBR | 5 | 1.25 ± 0.50 |" in page
    assert "| 216.60 |" in page
    assert "10 (8 to 12)" in page
    assert "never" in page
    assert "none: rank 1" in page
    assert page.index("What differs") < page.index("Tables 1 and S1")


def test_one_seed_shows_no_spread():
    page = document.page(results([0]))
    assert "one seed, so no spread is known" in page
    assert "±" not in page.partition("## Figures")[0].partition("Tables 1")[2]
