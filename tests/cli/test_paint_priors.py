"""``paintit paint --prior``: every family from a folder to a painted mesh, and what a dry run knows without loading."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
from tests.cli.conftest import TINY, Ran, everything
from tests.guidance.fake_hub import FakeHub, local_hub
from tests.guidance.tiny import save_tiny, save_tiny_if, save_tiny_sdxl
from tests.guidance.tiny_flow import save_tiny_flux2, save_tiny_sd3, save_tiny_z_image

from paintit.guidance.families import FAMILIES
from paintit.run import record as records

pytest.importorskip("diffusers")
#: What is saved -> how, its family, and the guidance scale that it then has of its own.
SAVED: dict[str, tuple[Callable[[Path], Path], str, float]] = {
    "sd-epsilon": (save_tiny, "stable-diffusion", 101),
    "sd-v": (partial(save_tiny, prediction_type="v_prediction"), "stable-diffusion", 101),
    "sd-depth": (partial(save_tiny, depth=True), "stable-diffusion", 101),
    "sd-turbo": (save_tiny, "stable-diffusion", 1),
    "sdxl": (save_tiny_sdxl, "sdxl", 101),
    "deepfloyd-if": (save_tiny_if, "deepfloyd-if", 21),
    "sd3": (save_tiny_sd3, "sd3", 100),
    "klein-base": (save_tiny_flux2, "flux2-klein", 100),
    "klein": (partial(save_tiny_flux2, distilled=True), "flux2-klein", 1),
    "z-image": (save_tiny_z_image, "z-image", 100),
}


def test_every_family_is_there() -> None:
    assert {family for _, family, _ in SAVED.values()} == set(FAMILIES)


@pytest.mark.parametrize("name", SAVED)
def test_every_family_paints_whole(
    name: str, assets: Path, tmp_path: Path, paintit: Callable[..., Ran], caplog: pytest.LogCaptureFixture
) -> None:
    save, family, own = SAVED[name]
    out = tmp_path / "spot.glb"
    spot = assets / "meshes/spot/spot.obj"
    ran = paintit("paint", spot, "a red cow", "--prior", save(tmp_path / name), "-o", out, *TINY, "--steps", "2")
    assert (ran.code, ran.out.strip()) == (0, str(out)), ran.err
    assert "Traceback" not in ran.err
    assert ("is distilled to few steps" in caplog.text) == (name == "sd-turbo")
    assert out.stat().st_size > 1000
    record = records.read(tmp_path / "spot.paintit/run.json")
    assert (record.prior["family"], record.prior["guidance_scale"]) == (family, own)
    assert (record.config["guidance"]["scale"], record.config["guidance"]["scale_end"]) == (own, "none")
    assert record.outcome == "finished after 2 of 2 steps"


@pytest.fixture
def hub(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    with local_hub(tmp_path / "hub-cache", monkeypatch) as served:
        yield served


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "scale 3, falling to 1.5"),
        (["--method", "projection"], "scale 2"),
        (["--prior", "klein"], "scale 1, from the prior's own"),
        (["--prior", "klein", "--guidance.scale", "4"], "scale 4"),
        (["--preset", "paper"], "scale 101"),
        (["--preset", "paper", "--prior", "deepfloyd-if"], "scale 21, from the prior's own"),
        (["--prior", "sd2-depth", "--method", "projection"], "scale 7.5, from the prior's own"),
        (["--prior", "someone/unheard-of"], "the prior's own scale"),
    ],
)
def test_a_dry_run_says_the_scale(
    hub: FakeHub, arguments: list[str], said: str, cube: Path, here: Path, paintit: Callable[..., Ran]
) -> None:
    ran = paintit("paint", cube, "red", *TINY, "--dry-run", "--json", *arguments)
    assert ran.code == 0, ran.err
    assert json.loads(ran.out)["data"]["guidance"] == said
    assert (hub.requests, everything(here)) == ([], [])


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--prior", "sd15", "--guidance.loss", "rfds"],
         "the loss 'rfds' is for flow models, and the prior 'sd15' is none; choose --guidance.loss sds, or a"),
        (["--guidance.loss", "rfds"], "the loss 'rfds' is for flow models, and the prior 'pocket' is none"),
        (["--prior", "klein", "--method", "projection"],
         "projection samples views of the mesh, but the prior 'klein' sees no geometry; choose --prior pocket"),
        (["--prior", "sd51"], "there is no prior 'sd51'"),
    ],
)  # fmt: skip
def test_a_dry_run_refuses_what_the_prior_cannot_do(
    hub: FakeHub, arguments: list[str], said: str, cube: Path, here: Path, paintit: Callable[..., Ran]
) -> None:
    ran = paintit("paint", cube, "red", *TINY, "--dry-run", *arguments)
    assert (ran.code, ran.out, len(ran.errors)) == (1, "", 1), ran
    assert said in ran.err
    assert (hub.requests, everything(here)) == ([], [])


@pytest.mark.usefixtures("hub")
def test_a_dry_run_lets_flow_models_have_their_loss(cube: Path, here: Path, paintit: Callable[..., Ran]) -> None:
    assert paintit("paint", cube, "red", *TINY, "--dry-run", "--prior", "z-image", "--guidance.loss", "rfds").code == 0
    assert everything(here) == []
