"""Priors by name: what is known, what is refused, and that nothing is downloaded unasked."""

from __future__ import annotations

import socket
import subprocess
import sys
from pathlib import Path

import pytest
from tests.guidance.tiny import save_tiny

from paintit.config import PRESETS
from paintit.errors import PriorError
from paintit.guidance.load import KNOWN, load_prior, prior_info


@pytest.fixture
def no_network(monkeypatch: pytest.MonkeyPatch) -> None:
    def connect(*_: object) -> None:
        raise AssertionError("a connection was tried")

    monkeypatch.setattr(socket.socket, "connect", connect)
    monkeypatch.setattr(socket, "getaddrinfo", connect)


def test_table_is_torch_free() -> None:
    script = "import sys, paintit.guidance.load; assert not {'torch', 'diffusers'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", script], check=True)


def test_known_names() -> None:
    assert set(KNOWN) == {"pocket", "sd21-base", "sd21", "sd2-depth", "sd15"}
    for name, info in KNOWN.items():
        assert prior_info(name) == info
        assert info.name == name
        assert info.licence
        assert info.note
        assert (info.size_mb > 0) == (info.source != "package")
    named = set(KNOWN) | {info.source for info in KNOWN.values()}
    assert {config.guidance.prior for config in PRESETS.values()} <= named


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
        load_prior(name, revision="abc123")
    assert caught.value.code == "prior.not_cached"
    assert (KNOWN[name].source if name in KNOWN else name) in caught.value.message
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
        prior = load_prior("someone/tiny", revision=revision)
        assert prior.spec.id == "someone/tiny"
        assert prior.spec.revision == commit
    with pytest.raises(PriorError) as caught:
        load_prior("someone/tiny", revision="fedcba9876543210fedcba9876543210fedcba98")
    assert caught.value.code == "prior.not_cached"
    (snapshot / "unet/diffusion_pytorch_model.safetensors").unlink()
    with pytest.raises(PriorError) as caught:
        load_prior("someone/tiny")
    assert caught.value.code == "prior.not_cached", "a half-fetched checkpoint is not on this machine either"
