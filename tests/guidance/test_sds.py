"""Score distillation against numbers worked by hand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pytest
import torch
from torch import Tensor

from paintit.guidance.exact import ExactPrior
from paintit.guidance.prior import Prior, PriorSpec
from paintit.guidance.sds import sds_gradient


class LinearPrior:
    """A prior small enough for mental arithmetic: epsilon-hat = text times x_t; alpha = 0.6, sigma = 0.8 at every t."""

    spec = PriorSpec(id="linear", family="exact")
    reads = ("shaded",)
    sees = ()

    def __init__(self) -> None:
        self.batches: list[int] = []

    def encode_text(self, prompts: Sequence[str]) -> Tensor:
        return torch.tensor([[float(prompt or "0.25")] for prompt in prompts])

    def encode_image(self, channels: Mapping[str, Tensor]) -> Tensor:
        return channels["shaded"].permute(0, 3, 1, 2)

    def encode_geometry(self, channels: Mapping[str, Tensor]) -> Tensor | None:
        return None

    def add_noise(self, x: Tensor, noise: Tensor, t: float) -> Tensor:
        return 0.6 * x + 0.8 * noise

    def predict_noise(self, x_t: Tensor, t: float, text: Tensor, geometry: Tensor | None = None) -> Tensor:
        self.batches.append(len(x_t))
        return text[:, :, None, None] * x_t

    def weight(self, t: float) -> float:
        return 0.64


def call(x: float = 1.0, scale: float = 3.0, views: int = 1, text: str = "0.5") -> tuple[Tensor, object, LinearPrior]:
    prior = LinearPrior()
    image = torch.full((views, 1, 1, 1), x)
    words = prior.encode_text([text] * views)
    noise = torch.full((1, 1, 1, 1), 0.5)
    gradient, record = sds_gradient(prior, image, words, prior.encode_text([""]), 0.5, noise, scale)
    return gradient, record, prior


def test_hand_worked_number() -> None:
    # x_t = 0.6 * 1 + 0.8 * 0.5 = 1; uncond 0.25, cond 0.5; guided 0.25 + 3 * 0.25 = 1; 0.64 * (1 - 0.5) = 0.32
    gradient, record, prior = call()
    assert gradient.item() == pytest.approx(0.32)
    assert record.t == 0.5
    assert record.weight == 0.64
    assert record.gradient_norm == pytest.approx(0.32)
    assert record.text_norm == pytest.approx(0.25)
    assert record.nonfinite == 0
    assert prior.batches == [2], "both halves of the guidance go through together"
    assert isinstance(prior, Prior)


def test_scale_one_needs_no_unconditional_half() -> None:
    gradient, record, prior = call(scale=1.0)
    assert gradient.item() == pytest.approx(0.64 * (0.5 - 0.5), abs=1e-7)
    assert prior.batches == [1]
    assert record.text_norm == 0
    assert call(scale=1.0 + 1e-6)[0].item() == pytest.approx(gradient.item(), abs=1e-5)


def test_scale_zero_is_the_unconditional_prediction() -> None:
    assert call(scale=0.0)[0].item() == pytest.approx(0.64 * (0.25 - 0.5))


def test_noise_is_shared_and_views_are_summed_not_averaged() -> None:
    one, record_one, _ = call()
    four, record_four, prior = call(views=4)
    assert torch.equal(four, one.expand(4, 1, 1, 1))
    assert record_four.gradient_norm == pytest.approx(2 * record_one.gradient_norm)
    assert prior.batches == [8]


def test_gradient_flows_only_where_it_is_injected() -> None:
    x = torch.ones(1, 1, 2, 2, requires_grad=True)
    prior = LinearPrior()
    gradient, _ = sds_gradient(
        prior, 2 * x, prior.encode_text(["0.5"]), prior.encode_text([""]), 0.5, torch.zeros(1, 1, 2, 2), 3.0
    )
    assert not gradient.requires_grad
    assert x.grad is None
    (2 * x).backward(gradient)
    torch.testing.assert_close(x.grad, 2 * gradient)


def test_what_is_not_finite_is_left_out_and_counted() -> None:
    prior = LinearPrior()
    x = torch.tensor([1.0, float("nan"), float("inf"), 1.0]).reshape(1, 1, 2, 2)
    gradient, record = sds_gradient(
        prior, x, prior.encode_text(["0.5"]), prior.encode_text([""]), 0.5, torch.full((1, 1, 2, 2), 0.5), 3.0
    )
    assert gradient.flatten().tolist() == pytest.approx([0.32, 0, 0, 0.32])
    assert record.nonfinite == 2
    assert record.gradient_norm == pytest.approx(0.32 * 2**0.5)


def test_geometry_reaches_both_halves() -> None:
    prior = ExactPrior()
    mu = torch.tensor([0.5, -0.5]).reshape(2, 1, 1, 1).expand(2, 5, 1, 1)
    text = prior.encode_text(["a", "b"])
    gradient, _ = sds_gradient(prior, mu.clone(), text, text[:1], 0.3, torch.randn(1, 5, 1, 1), 7.5, mu)
    torch.testing.assert_close(gradient, torch.zeros(2, 5, 1, 1), atol=1e-5, rtol=0)
