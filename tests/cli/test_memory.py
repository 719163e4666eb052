"""``--memory`` and its kin, from the command line to the run's record."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.cli.conftest import TINY, Ran
from tests.guidance.tiny import save_tiny, save_tiny_autoencoder

from paintit.api import load_mesh
from paintit.cli.paint_command import parse_arguments
from paintit.guidance.load import load_prior
from paintit.paint.painter import Painter
from paintit.run.paint import prepare
from paintit.run.request import Request

pytest.importorskip("diffusers")
Command = Callable[..., Ran]


@pytest.fixture(scope="session")
def prior(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_tiny(tmp_path_factory.mktemp("tiny") / "sd")


def test_what_was_chosen_is_said_and_recorded(
    cube: Path, here: Path, prior: Path, paintit: Command, caplog: pytest.LogCaptureFixture
) -> None:
    ran = paintit("paint", cube, "red", "--prior", prior, "--memory", "4", *TINY, "-o", here / "a.glb")
    assert ran.code == 0, ran.err
    assert re.search(r"to keep to 4 GB: about [0-9.]+ GB; nothing needs to be saved", caplog.text)
    record = json.loads((here / "a.paintit" / "run.json").read_text())
    assert record["config"]["compute"]["memory"] == 4


def test_a_budget_that_cannot_be_kept(cube: Path, here: Path, prior: Path, paintit: Command) -> None:
    for more in ((), ("--dry-run",)):
        ran = paintit("paint", cube, "red", "--prior", prior, "--memory", "0.5", *TINY, *more)
        assert ran.code == 1
        assert len(ran.errors) == 1
        assert re.search(r"does not fit into 0.5 GB, whatever is saved; give --memory [0-9.]+ or more", ran.err)
    assert not list(here.iterdir())


def test_a_dry_run_shows_it(cube: Path, here: Path, prior: Path, paintit: Command) -> None:
    ran = paintit("paint", cube, "red", "--prior", prior, "--compute.recompute", "1", "--dry-run", "--json", *TINY)
    data = json.loads(ran.out)["data"]
    assert data["economy"] == "encoder recomputed, 1 at a time"
    assert 0.8e9 < data["memory"] < 1.5e9
    assert "economy" not in json.loads(paintit("paint", cube, "red", "--dry-run", "--json", *TINY).out)["data"]


def test_a_dry_run_says_that_a_prior_which_is_not_here_is_not_counted(cube: Path, here: Path, paintit: Command) -> None:
    ran = paintit("paint", cube, "red", "--prior", "sdxl", "--memory", "12", "--dry-run", "--json", *TINY)
    assert json.loads(ran.out)["data"]["economy"].endswith("the memory above is without it")


def test_everything_at_once(cube: Path, here: Path, prior: Path, tmp_path: Path, paintit: Command) -> None:
    small = save_tiny_autoencoder(tmp_path / "taesd")
    saving = ("--compute.chunk", "1", "--compute.recompute", "1", "--compute.tiny-vae", small)
    ran = paintit("paint", cube, "red", "--prior", prior, *saving, *TINY, "-o", here / "a.glb")
    assert ran.code == 0, ran.err
    record = json.loads((here / "a.paintit" / "run.json").read_text())
    assert record["prior"]["economy"] == (
        "1 at a time through the network, encoder recomputed, 1 at a time, tiny autoencoder taesd"
    )


def test_text_encoders_go_unless_the_prior_is_the_callers(cube: Path, here: Path, prior: Path) -> None:
    config = parse_arguments([str(cube), "red", "--prior", str(prior), *TINY]).settings
    mesh = load_mesh(cube)
    own: Any = Painter(mesh, "red", config).prior
    ours: Any = prepare(Request(cube, "red", config, output=str(here / "a.glb"))).painter.prior
    assert own.pipe.text_encoder is None
    assert ours.pipe.text_encoder is None
    handed: Any = load_prior(str(prior))
    Painter(mesh, "red", config, handed)
    prepare(Request(cube, "red", config, output=str(here / "a.glb")), handed)
    assert handed.pipe.text_encoder is not None
    assert len(handed.encode_text(["blue"])) == 1


@pytest.mark.parametrize(
    ("flags", "complaint"),
    [
        (("--memory", "much"), "--memory"),
        (("--memory", "0"), "compute.memory is 0"),
        (("--compute.chunk", "-1"), "compute.chunk is -1"),
        (("--compute.compile", "yes"), "--compute.compile is 'yes'"),
        (("--compute.compile", "on", "--compute.offload"), 'compute.compile is "on"; with compute.offload it must be'),
    ],
)
def test_bad_values(cube: Path, here: Path, paintit: Command, flags: tuple[str, ...], complaint: str) -> None:
    ran = paintit("paint", cube, "red", *flags)
    assert ran.code == 2
    assert len(ran.errors) == 1
    assert complaint in ran.err
