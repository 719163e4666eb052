"""Noise schedules that end in noise alone (Lin 2305.08891): nothing may be divided by the share of the picture, 0."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import torch
from tests.guidance.contract import make_channels
from tests.guidance.tiny import save_tiny, save_tiny_sdxl
from torch import Tensor

from paintit.config import GuidanceConfig
from paintit.guidance.ddpm import DdpmPrior
from paintit.guidance.load import load_prior
from paintit.guidance.losses import LOSSES, Words, distil
from paintit.guidance.sds import sds_gradient

pytest.importorskip("diffusers")


def load(folder: Path) -> DdpmPrior:
    file = folder / "scheduler/scheduler_config.json"
    zero = {"rescale_betas_zero_snr": True, "timestep_spacing": "trailing"}
    file.write_text(json.dumps(json.loads(file.read_text()) | zero))
    prior = load_prior(str(folder))
    assert isinstance(prior, DdpmPrior)
    assert prior.alpha_sigma(1.0) == (0, 1)
    return prior


@pytest.fixture(scope="module", params=["epsilon", "v_prediction", "sample", "sdxl"])
def prior(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> DdpmPrior:
    folder = tmp_path_factory.mktemp("zero") / request.param
    return load(save_tiny_sdxl(folder, "v_prediction") if request.param == "sdxl" else save_tiny(folder, request.param))


def draw(prior: DdpmPrior) -> tuple[Tensor, Tensor]:
    x = prior.encode_image(make_channels(("shaded",), 2, 32)).detach()
    return x, torch.randn(x.shape, generator=torch.Generator().manual_seed(0))


def test_all_is_finite_at_the_end(prior: DdpmPrior) -> None:
    x, noise = draw(prior)
    x_t = prior.add_noise(x, noise, 1.0)
    assert torch.equal(x_t, noise)
    text = prior.encode_text(["a", "b"])
    for t in (0.98, 0.999, 1.0):
        assert prior.predict_noise(x_t, t, text).isfinite().all()
        assert 0 < prior.weight(t) <= 1


def test_a_perfect_model_gives_no_gradient_at_the_end(prior: DdpmPrior, monkeypatch: pytest.MonkeyPatch) -> None:
    x, noise = draw(prior)

    def perfect(_: Tensor, timestep: int, *__: Any) -> Tensor:
        alpha, sigma = prior.alphas_cumprod[timestep] ** 0.5, (1 - prior.alphas_cumprod[timestep]) ** 0.5
        return {"epsilon": noise, "sample": x, "v_prediction": alpha * noise - sigma * x}[prior.spec.prediction_type]

    monkeypatch.setattr(prior, "_denoise", perfect)
    text = prior.encode_text(["a", "b"])
    for t in (0.5, 0.999, 1.0):
        gradient, record = sds_gradient(prior, x, text, text, t, noise, 1.0)
        assert gradient.abs().max() < 1e-5
        assert record.nonfinite == 0


@pytest.mark.parametrize("loss", sorted(set(LOSSES) - {"rfds"}))
def test_every_loss_is_finite_at_the_end(prior: DdpmPrior, loss: str) -> None:
    x, noise = draw(prior)
    text, other = prior.encode_text(["a", "b"]), prior.encode_text(["", ""])
    guidance = GuidanceConfig(loss=loss)  # type: ignore[arg-type]
    for progress in (0.0, 1.0):
        gradient, record = distil(guidance, prior, x, Words(text, other, other, other), 1.0, noise, 7.5, progress)
        assert record.nonfinite == 0
        assert gradient.isfinite().all()
