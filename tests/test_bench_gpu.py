"""``make bench-gpu`` from end to end at its smallest, and the arithmetic that it counts."""

from __future__ import annotations

import contextlib
import io
import json
from typing import Any

import pytest

pytest.importorskip("diffusers")
FLAGS = ["--blocks", "1", "--block-steps", "1", "--staged", "1", "--warm-up", "1", "--device", "cpu"]


@pytest.fixture(scope="module")
def ran() -> dict[str, Any]:
    from benchmarks.gpu.__main__ import main

    with contextlib.redirect_stdout(io.StringIO()) as out:
        main(["--only", "memory 8", "reference", "--steps", "2", "--json", *FLAGS])
    return json.loads(out.getvalue())


def test_every_way_is_measured_stage_by_stage(ran: dict[str, Any]) -> None:
    memory, reference = ran["rows"]
    assert (memory["name"], memory["done"]) == ("memory 8", "encoder recomputed, 1 at a time")
    assert (reference["name"], reference["done"], reference["speed_up"]) == ("reference", "nothing", 1.0)
    for row in ran["rows"]:
        assert sum(stage["share"] for stage in row["stages"].values()) == pytest.approx(1)
        assert all(stage["ms"] > 0 for stage in row["stages"].values())
        assert row["tflop_per_s"] == pytest.approx(1e3 * sum(ran["tflop"].values()) / row["step_ms"])
        assert row["of_ceiling"] == pytest.approx(row["tflop_per_s"] / ran["ceiling_tflop_per_s"])
    assert memory["steps"] == 2
    assert memory["steps_s"] > 0
    assert reference["steps"] is None


def test_nothing_is_said_of_a_gpu_that_is_not_there(ran: dict[str, Any]) -> None:
    assert ran["gpu"] is None
    assert len(ran["verdicts"]) == 5
    for verdict in ran["verdicts"]:
        assert (verdict["value"], verdict["met"], verdict["why_not"]) == (None, None, "no GPU")
    assert {row["reserved_gb"] for row in ran["rows"]} == {None}


def test_bounds_are_judged_by_what_was_measured() -> None:
    from benchmarks.gpu.report import verdicts

    row = {"name": "default", "step_ms": 49.0, "speed_up": 7.9, "peak_gb": 16.0, "thousand_s": None}
    found = verdicts([row], None)
    assert [verdict["met"] for verdict in found] == [True, False, True, None, None]
    assert [verdict["why_not"] for verdict in found] == ["", "", "", "left out", "--steps 1000 measures it"]


def test_the_model_is_the_published_one_and_its_arithmetic_is_counted() -> None:
    import torch
    from benchmarks.gpu.count import META, count
    from benchmarks.gpu.model import FULL, make_pipeline

    pipe = make_pipeline(FULL, META, torch.bfloat16)
    sizes = [sum(p.numel() for p in part.parameters()) for part in (pipe.unet, pipe.vae, pipe.text_encoder)]
    assert sizes == [865_910_724, 83_653_863, 340_387_840]
    flop = count(FULL)
    assert flop["predict"] == pytest.approx(6.434e12, rel=1e-3)
    assert flop["encode"] == pytest.approx(4.467e12, rel=1e-3)
    assert flop["backward"] == pytest.approx(flop["encode"] + 2 * flop["network"], rel=0.05)
