"""``paintit analyze`` whole, small: files, table, JSON, and one clear line for every mistake."""

from __future__ import annotations

import csv
import json
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from tests.cli.conftest import TINY, Ran

#: Everything small; ``--views`` of TINY is for painting.
FIT = ["--texture-size", "32", "--texture.widths", "8", "8", "--texture.skip-widths", "4", "4", "--steps", "4"]


@pytest.fixture
def picture(tmp_path: Path) -> Path:
    path = tmp_path / "picture.png"
    Image.fromarray(np.random.default_rng(0).integers(0, 256, (40, 40, 3)).astype(np.uint8)).save(path)
    return path


def paint_flags() -> list[str]:
    return [flag for flag in TINY if flag not in ("--preview", "none")]


def test_fitting_an_image(picture: Path, here: Path, paintit: Callable[..., Ran]) -> None:
    ran = paintit("analyze", "frequency", picture, *FIT, "--seeds", "2", "--every", "2", "-o", "out")
    assert ran.code == 0, ran.err
    assert "step from which on at most half of the target's power is wrong" in ran.out
    assert "dcpbr-no-skip, seed 1: 4 steps" in ran.err
    document = json.loads((here / "out" / "frequency.json").read_text())
    assert document["subject"]["kind"] == "fit"
    assert len(document["curves"]) == 6
    assert document["settings"]["pixels"]["texture"]["tv_weight"] == 0
    with open(here / "out" / "frequency.csv", newline="") as file:
        table = list(csv.DictReader(file))
    assert len(table) == 6 * 4 * 5  # curves, records 0 1 2 4, rings
    with Image.open(here / "out" / "frequency.png") as image:
        assert image.width == 1440
        assert image.convert("L").getextrema() == (0, 255)
    again = paintit("analyze", "frequency", picture, *FIT, "--seeds", "2", "--every", "2", "-o", "out", "--json")
    assert json.loads(again.out)["data"]["summary"] == document["summary"]
    assert "seed" not in again.err


def test_painting_a_mesh(cube: Path, here: Path, paintit: Callable[..., Ran]) -> None:
    flags = ["--variants", "pixels", "points", "--seeds", "1", "--show", "1", "3", *paint_flags()]
    ran = paintit("analyze", "frequency", cube, "red plastic", *flags, "-o", "out", "--json")
    assert ran.code == 0, ran.err
    data = json.loads(ran.out)["data"]
    assert data["subject"]["prompt"] == "red plastic"
    assert set(data["summary"]) == {"pixels", "points"}
    assert data["curves"][0]["residual"] is None
    names = sorted(path.name for path in (here / "out" / "textures").iterdir())
    assert names == [f"{kind}-seed0-step0000{step}.png" for kind in ("pixels", "points") for step in (1, 3)]


def test_coherence(cube: Path, here: Path, paintit: Callable[..., Ran]) -> None:
    flags = ["--t", "0.5", "--scale", "1", "7.5", "--seeds", "1", "--after", "0", "1", *paint_flags(), "--views", "3"]
    ran = paintit("analyze", "coherence", cube, "red plastic", *flags, "-o", "out")
    assert ran.code == 0, ran.err
    document = json.loads((here / "out" / "coherence.json").read_text())
    entries = {(e["kind"], e["after"], e["reads"], e["scale"]): e for e in document["summary"]}
    assert len(entries) == 2 * 2 * (2 + 4)
    assert entries["repeated", 0, "stack", None]["rank"] == 1
    stack, rgb = entries["guidance", 0, "stack", 1.0], entries["guidance", 0, "rgb", 1.0]
    assert len(stack["ratios"]) == 3
    assert stack["ratios"] != rgb["ratios"]
    assert ran.out.splitlines()[1].startswith("guidance       0  stack   0.5      1     3")
    assert (here / "out" / "coherence.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        ([], "error: no analysis is named; choose one of frequency, coherence"),
        (["frequency", "-o", "x"], "error: nothing to analyze is given; name an image, or a mesh and a prompt"),
        (["frequency", "m.obj", "-o", "x"], 'the prompt is empty; say what the mesh should look like: "red plastic"'),
        (["frequency", "a.png"], "error: no output is given; add -o FOLDER"),
        (["frequency", "a.png", "red", "-o", "x"], "unexpected argument 'red'; an image is fitted without a prompt"),
        (["frequency", "a.png", "-o", "x", "--every", "0"], "error: --every is 0; it must be from 1 to 1e+07"),
        (["frequency", "a.png", "-o", "x", "--show", "900"], "error: --show is 900; it must be from 0 to 300"),
        (["frequency", "a.png", "-o", "x", "--variants", "grid"], "error: there is no method 'grid'; choose one of"),
        (["frequency", "a.png", "-o", "x"], "error: cannot read a.png: no such file or directory; check the path"),
        (["frequency", "a.png", "-o", "x", "--variant", "pixels"], "unknown flag --variant; did you mean --variants?"),
        (["coherence", "m.obj", "red", "-o", "x", "--t", "2"], "error: --t is 2; it must be from 0.001 to 1"),
        (["coherence", "m.obj", "red", "-o", "x", "--views", "1"], "error: --views is 1; it must be from 2 to 256"),
        (["coherence", "m.obj", "red", "-o", "x"], "error: there is no file m.obj"),
    ],
)
def test_mistakes_are_one_line(arguments: list[str], line: str, here: Path, paintit: Callable[..., Ran]) -> None:
    ran = paintit("analyze", *arguments)
    assert (ran.code in (1, 2), ran.out, len(ran.errors)) == (True, "", 1)
    assert line in ran.err
    assert not any(here.rglob("*.json"))


@pytest.mark.parametrize("action", ["frequency", "coherence"])
def test_each_analysis_has_help(action: str, paintit: Callable[..., Ran]) -> None:
    ran = paintit("analyze", action, "--help")
    assert (ran.code, ran.err) == (0, "")
    assert f"paintit analyze {action}" in ran.out
    assert "--seeds" in ran.out


def test_matplotlib_is_asked_for_before_the_work(
    picture: Path, here: Path, paintit: Callable[..., Ran], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    ran = paintit("analyze", "frequency", picture, *FIT, "-o", "out")
    assert ran.code == 1
    assert "pip install 'paintit[analyze]'" in ran.err
    assert "seed" not in ran.err
