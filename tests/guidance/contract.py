"""What every prior must do, whatever its family: `check_prior` is called by each family's own test."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from paintit.guidance.prior import Prior

WIDTHS = {"shaded": 3, "base_color": 3, "roughness": 1, "metallic": 1}
WIDTHS |= {"normal": 3, "depth": 1, "mask": 1, "position": 3, "normal_object": 3}


def make_channels(names: tuple[str, ...], count: int, size: int, seed: int = 0) -> dict[str, Tensor]:
    """Random channels (count, size, size, c) in [0, 1], all of them inside the mask."""
    generator = torch.Generator().manual_seed(seed)
    channels = {name: torch.rand(count, size, size, WIDTHS[name], generator=generator) for name in names}
    return channels | {"mask": torch.ones(count, size, size, 1)}


def check_prior(prior: Prior, *, text_matters: bool = True, size: int = 48) -> None:
    """Shapes, types, determinism, consistency of noise and gradient, at several noise levels."""
    assert isinstance(prior, Prior)
    images = {k: v.requires_grad_() for k, v in make_channels(prior.reads, 2, size).items()}
    x = prior.encode_image(images)
    assert x.shape[0] == 2
    assert x.dtype == torch.float32
    assert x.requires_grad

    gradients = torch.autograd.grad(x.square().sum(), [images[name] for name in prior.reads])
    for name, gradient in zip(prior.reads, gradients, strict=True):
        assert gradient.abs().max() > 0, f"{name} gets no gradient"
    x = x.detach()
    geometry = prior.encode_geometry(make_channels(prior.sees, 2, size, seed=1))
    assert (geometry is None) == (not prior.sees)

    text = prior.encode_text(["a red ball", "a blue cube"])
    assert len(text) == 2
    assert not text.requires_grad
    assert torch.equal(prior.encode_text(["a blue cube"]), text[1:]), "a prompt means the same in every batch"
    assert prior.encode_text([""]).shape == text[:1].shape, "the unconditional prompt has the shape of any other"

    noise = torch.randn(x.shape, generator=torch.Generator().manual_seed(2))
    weights = []
    for t in (0.02, 0.4, 0.98):
        alpha, sigma = _levels(prior, x, t)
        power = 1 if prior.spec.prediction_type == "flow" else 2
        assert abs(alpha**power + sigma**power - 1) < 1e-4
        x_t = prior.add_noise(x, noise, t)
        assert torch.allclose(x_t, alpha * x + sigma * noise, atol=1e-4)
        assert torch.allclose((x_t - sigma * noise) / alpha, x, atol=1e-3), "x is got back from x_t and epsilon"
        predicted = prior.predict_noise(x_t, t, text, geometry)
        assert predicted.shape == x.shape
        assert predicted.dtype == x.dtype
        assert not predicted.requires_grad
        assert predicted.isfinite().all()
        assert torch.equal(predicted, prior.predict_noise(x_t, t, text, geometry)), "the same twice"
        one = prior.predict_noise(x_t[:1], t, text[:1], None if geometry is None else geometry[:1])
        assert torch.allclose(predicted[:1], one, atol=1e-4), "a view does not depend on the others"
        other = prior.predict_noise(x_t, t, text.flip(0), geometry)
        assert torch.equal(predicted, other) != text_matters
        assert abs(prior.weight(t) - sigma**2 / (alpha**2 + sigma**2)) < 1e-4
        weights.append(prior.weight(t))
    assert weights == sorted(weights)
    assert 0 < weights[0] < weights[-1] <= 1


def check_gradient(prior: Prior, size: int) -> None:
    """The gradient through ``encode_image`` against central differences along random directions.

    Args:
        prior: in float64, reading ``shaded`` alone.
        size: side of the picture, in pixels.
    """
    generator = torch.Generator().manual_seed(0)
    image = (0.1 + 0.8 * torch.rand(1, size, size, 3, generator=generator, dtype=torch.float64)).requires_grad_()
    x = prior.encode_image({"shaded": image})
    assert x.dtype == torch.float64
    injected = torch.randn(x.shape, generator=generator, dtype=torch.float64)
    x.backward(injected)
    assert image.grad is not None
    for _ in range(4):
        direction = torch.randn(image.shape, generator=generator, dtype=torch.float64)
        with torch.no_grad():
            up, down = (prior.encode_image({"shaded": image + h * direction}) for h in (1e-5, -1e-5))
        numeric = ((up - down) * injected).sum() / 2e-5
        assert abs(numeric) > 1e-3
        assert (image.grad * direction).sum().item() == pytest.approx(numeric.item(), rel=1e-6)


def _levels(prior: Prior, x: Tensor, t: float) -> tuple[float, float]:
    """alpha(t), sigma(t), found by noising ones and zeros."""
    zero, one = torch.zeros_like(x), torch.ones_like(x)
    return prior.add_noise(one, zero, t).mean().item(), prior.add_noise(zero, one, t).mean().item()
