"""TAESD's kind in place of a prior's own autoencoder."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from tests.guidance.contract import check_prior, make_channels
from tests.guidance.fake_hub import FakeHub
from tests.guidance.test_economy import PAINT, SD21
from tests.guidance.tiny import save_tiny, save_tiny_autoencoder, save_tiny_if
from tests.guidance.tiny_flow import save_tiny_flux2, save_tiny_z_image

from paintit.cli.main import main
from paintit.errors import PriorError
from paintit.guidance.deepfloyd import DeepFloydPrior
from paintit.guidance.economy import GB, Economy
from paintit.guidance.flow_flux2 import Flux2KleinPrior
from paintit.guidance.flow_zimage import ZImagePrior
from paintit.guidance.load import load_prior
from paintit.guidance.loading import Loading
from paintit.guidance.stable_diffusion import StableDiffusionPrior

pytest.importorskip("diffusers")


@pytest.fixture(scope="session")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_tiny(tmp_path_factory.mktemp("tiny") / "sd")


@pytest.fixture(scope="session")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_tiny_autoencoder(tmp_path_factory.mktemp("tiny") / "taesd")


def test_contract(checkpoint: Path, small: Path) -> None:
    prior = StableDiffusionPrior.load(checkpoint, Loading(economy=Economy(tiny=str(small))))
    check_prior(prior)
    assert type(prior.pipe.vae).__name__ == "AutoencoderTiny"
    assert prior.decode_image(torch.zeros(2, 4, 16, 16))["shaded"].shape == (2, 32, 32, 3)


def test_a_flow_model_keeps_its_picture_size(small: Path, tmp_path: Path) -> None:
    folder = save_tiny_z_image(tmp_path / "z")
    own = ZImagePrior.load(folder)
    prior = ZImagePrior.load(folder, Loading(economy=Economy(tiny=str(small))))
    assert prior.spec.resolution == own.spec.resolution
    shape = prior.encode_image(make_channels(("shaded",), 1, 32)).shape
    assert shape == own.encode_image(make_channels(("shaded",), 1, 32)).shape


def test_latents_are_those_of_the_autoencoder_itself(checkpoint: Path, small: Path) -> None:
    """They are scaled already, and pictures go in from -1 to 1."""
    from diffusers import AutoencoderTiny

    prior = StableDiffusionPrior.load(checkpoint, Loading(economy=Economy(tiny=str(small))))
    shaded = make_channels(("shaded",), 2, 32)["shaded"]
    vae: Any = AutoencoderTiny.from_pretrained(small)
    expected = vae.encode(2 * shaded.permute(0, 3, 1, 2) - 1).latents
    torch.testing.assert_close(prior.encode_image({"shaded": shaded}), expected)


def test_gradient_against_finite_differences(checkpoint: Path, small: Path) -> None:
    prior = StableDiffusionPrior.load(checkpoint, Loading(dtype="float64", economy=Economy(tiny=str(small))))
    generator = torch.Generator().manual_seed(3)
    image = torch.rand(1, 32, 32, 3, generator=generator, dtype=torch.float64).requires_grad_()
    cotangent = torch.randn(1, 4, 16, 16, generator=generator, dtype=torch.float64)
    along = torch.randn(image.shape, generator=generator, dtype=torch.float64)

    def value(picture: torch.Tensor) -> torch.Tensor:
        return (prior.encode_image({"shaded": picture}) * cotangent).sum()

    (gradient,) = torch.autograd.grad(value(image), image)
    h = 1e-7
    numeric = (value(image + h * along) - value(image - h * along)) / (2 * h)
    assert (gradient * along).sum().item() == pytest.approx(numeric.item(), rel=1e-5)


@pytest.mark.parametrize(("channels", "levels"), [(16, 2), (4, 4)])
def test_one_for_other_latents_is_refused(checkpoint: Path, tmp_path: Path, channels: int, levels: int) -> None:
    other = save_tiny_autoencoder(tmp_path / "other", channels, levels)
    with pytest.raises(PriorError, match=f"latents of {channels} channels") as caught:
        StableDiffusionPrior.load(checkpoint, Loading(economy=Economy(tiny=str(other))))
    assert caught.value.code == "prior.tiny"


@pytest.mark.parametrize(("save", "cls"), [(save_tiny_flux2, Flux2KleinPrior), (save_tiny_if, DeepFloydPrior)])
def test_a_family_that_can_have_none_refuses(
    save: Callable[[Path], Path], cls: type, small: Path, tmp_path: Path
) -> None:
    with pytest.raises(PriorError, match="no tiny autoencoder that diffusers reads"):
        cls.load(save(tmp_path / "it"), Loading(economy=Economy(tiny=str(small))))


def test_auto_needs_a_prior_that_is_known(checkpoint: Path) -> None:
    with pytest.raises(PriorError, match=r"no tiny autoencoder is known.*--compute.tiny-vae FOLDER_OR_ID"):
        load_prior(str(checkpoint), Loading(economy=Economy(tiny="auto")))


def test_auto_takes_the_one_of_the_table_once_it_was_pulled(checkpoint: Path, small: Path, hub: FakeHub) -> None:
    hub.folders["madebyollin/taesd"] = small
    wants = Loading(tiny="madebyollin/taesd", economy=Economy(tiny="auto"))
    with pytest.raises(PriorError, match="'madebyollin/taesd' is not on this machine"):
        StableDiffusionPrior.load(checkpoint, wants)
    assert main(["priors", "pull", "madebyollin/taesd"]) == 0
    prior = StableDiffusionPrior.load(checkpoint, wants)
    assert prior.spec.economy == "tiny autoencoder madebyollin/taesd"
    assert type(prior.pipe.vae).__name__ == "AutoencoderTiny"


def test_a_budget_takes_one_only_in_need_and_says_so(
    checkpoint: Path, small: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """The figures are those of the real model, which is too large to be here."""
    monkeypatch.setattr(StableDiffusionPrior, "footprint", lambda found, loading: SD21)
    for gigabytes, needs in ((6, False), (4, True)):
        budget = dataclasses.replace(PAINT, limit=gigabytes * GB, tiny="")
        prior = StableDiffusionPrior.load(checkpoint, Loading(budget=budget, tiny=str(small)))
        assert bool(prior.economy.tiny) == needs
        assert ("changes the result" in caplog.text) == needs
        check_prior(prior)


def test_it_is_no_prior(small: Path) -> None:
    with pytest.raises(PriorError, match=r"is one of tiny autoencoders, not a prior; --compute\.tiny-vae"):
        load_prior(str(small))
