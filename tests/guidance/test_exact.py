"""The analytic prior: the contract, its closed form, its optimum."""

from __future__ import annotations

import math

import pytest
import torch
from tests.guidance.contract import check_prior, make_channels

from paintit.guidance.exact import ExactPrior, smooth_target
from paintit.guidance.sds import sds_gradient


@pytest.mark.parametrize("deviation", [0.0, 0.3])
def test_contract(deviation: float) -> None:
    check_prior(ExactPrior(deviation=deviation), text_matters=False)


@pytest.mark.parametrize("t", [0.1, 0.5, 0.9])
def test_gradient_points_from_the_target(t: float) -> None:
    # With s = 0 the gradient is m alpha / sigma (x - mu), whatever the noise.
    prior = ExactPrior()
    generator = torch.Generator().manual_seed(0)
    x, mu, noise = (torch.randn(3, 5, 8, 8, generator=generator) for _ in range(3))
    text = prior.encode_text(["", "", ""])
    gradient, _ = sds_gradient(prior, x, text, text, t, noise[:1], 100.0, mu)
    alpha, sigma = math.cos(math.pi / 2 * t), math.sin(math.pi / 2 * t)
    torch.testing.assert_close(gradient, sigma * alpha * (x - mu), atol=1e-4, rtol=1e-4)


def test_prediction_is_the_posterior_mean() -> None:
    # For draws of (x, epsilon): the error is unbiased, uncorrelated with x_t, and of the known variance.
    prior, s, t = ExactPrior(deviation=0.5), 0.5, 0.4
    generator = torch.Generator().manual_seed(0)
    mu = torch.full((1, 5, 200, 200), 0.3)
    x = mu + s * torch.randn(mu.shape, generator=generator)
    noise = torch.randn(mu.shape, generator=generator)
    x_t = prior.add_noise(x, noise, t)
    error = noise - prior.predict_noise(x_t, t, torch.zeros(1, 1), mu)
    alpha, sigma = prior.alpha_sigma(t)
    assert error.mean().abs() < 0.01
    assert (error * (x_t - x_t.mean())).mean().abs() < 0.01
    assert error.square().mean().item() == pytest.approx(alpha**2 * s**2 / (alpha**2 * s**2 + sigma**2), rel=0.02)


def test_geometry_is_the_target_inside_and_grey_outside_the_mask() -> None:
    prior = ExactPrior()
    channels = make_channels(("position",), 1, 4)
    channels["mask"][:, :2] = 0
    channels["position"][:, :2] = float("nan")
    mu = prior.encode_geometry(channels)
    assert mu[:, :, :2].abs().max() == 0
    inside = smooth_target(channels["position"])[:, 2:].permute(0, 3, 1, 2)
    torch.testing.assert_close(mu[:, :, 2:], 2 * inside - 1)


def test_target_stays_in_range_and_varies() -> None:
    values = smooth_target(2 * torch.rand(10000, 3, generator=torch.Generator().manual_seed(0)) - 1)
    assert values.shape == (10000, 5)
    assert values.min() >= 0.15
    assert values.max() <= 0.85
    assert values.std(0).min() > 0.05


@pytest.mark.parametrize("deviation", [0.0, 0.1])
def test_descent_ends_at_the_target(deviation: float) -> None:
    prior = ExactPrior(deviation=deviation)
    generator = torch.Generator().manual_seed(0)
    geometry = prior.encode_geometry(make_channels(prior.sees, 2, 8))
    x = torch.zeros_like(geometry)
    text = prior.encode_text(["anything", "at all"])
    for step in range(300):
        noise = torch.randn(1, 5, 8, 8, generator=generator)
        t = 0.2 + 0.6 * torch.rand((), generator=generator).item()
        x -= 0.2 * (1 - step / 300) * sds_gradient(prior, x, text, text[:1], t, noise, 7.5, geometry)[0]
    assert (x - geometry).square().mean().sqrt() < (1e-4 if deviation == 0 else 0.02)
