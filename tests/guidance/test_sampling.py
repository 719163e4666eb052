"""The sampler against data whose samples are known in closed form, and what it refuses."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from paintit.errors import PriorError
from paintit.guidance.exact import ExactPrior
from paintit.guidance.pocket import PocketPrior
from paintit.guidance.sampling import Known, noise_levels, sample, sampling_prior

START = 0.99
TEXT = torch.zeros(2, 1)


def draw(*shape: int, seed: int = 0) -> Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def gaussian_flow(x_t: Tensor, t: float, mean: Tensor, deviation: float) -> Tensor:
    """Where the probability flow takes x_t at level t down to t = 0, for data ~ N(mean, deviation^2): affine."""
    alpha, sigma = math.cos(math.pi / 2 * t), math.sin(math.pi / 2 * t)
    return mean + deviation * (x_t - alpha * mean) / math.sqrt(alpha**2 * deviation**2 + sigma**2)


def test_a_gaussian_is_sampled_along_its_known_flow():
    """DDIM is a first-order solver of that flow: half the step, half the error."""
    prior, mean, noise = ExactPrior(deviation=0.5), 0.3 * draw(2, 5, 4, 4, seed=1), draw(2, 5, 4, 4)
    wanted = gaussian_flow(noise, START, mean, 0.5)
    errors = [
        float((sample(prior, noise, TEXT, TEXT, mean, scale=1, steps=n, start=START) - wanted).abs().max())
        for n in (50, 100, 200)
    ]
    assert errors[2] < 0.015
    assert errors[0] / errors[1] == pytest.approx(2, abs=0.15)
    assert errors[1] / errors[2] == pytest.approx(2, abs=0.15)


@pytest.mark.parametrize("steps", [1, 3, 20])
def test_without_spread_every_number_of_steps_gives_the_one_picture_there_is(steps):
    mean = 0.3 * draw(2, 5, 4, 4, seed=1)
    found = sample(ExactPrior(), draw(2, 5, 4, 4), TEXT, TEXT, mean, scale=3, steps=steps)
    torch.testing.assert_close(found, mean)


def test_known_pixels_stay_free_ones_do_not_notice_and_those_between_start_late():
    prior, mean, noise = ExactPrior(deviation=0.5), 0.3 * draw(2, 5, 4, 4, seed=1), draw(2, 5, 4, 4)
    have = 0.3 * draw(2, 5, 4, 4, seed=2)
    free_below = torch.tensor([0.0, 0.3, 1.0, 0.7]).double().expand(2, 1, 4, 4)
    found = sample(prior, noise, TEXT, TEXT, mean, scale=1, steps=400, known=Known(have, free_below))
    assert torch.equal(found[..., 0], have[..., 0])
    free = sample(prior, noise, TEXT, TEXT, mean, scale=1, steps=400)
    assert torch.equal(found[..., 2], free[..., 2])
    for column, level in ((1, 0.3), (3, 0.7)):
        wanted = gaussian_flow(prior.add_noise(have, noise, level), level, mean, 0.5)[..., column]
        assert float((found[..., column] - wanted).abs().max()) < 0.02
        assert float((found[..., column] - free[..., column]).abs().max()) > 0.1


def test_a_view_that_is_only_refined_starts_at_that_level():
    prior, mean = Counting(deviation=0.5), torch.zeros(2, 5, 4, 4)
    known = Known(torch.zeros(2, 5, 4, 4), torch.full((2, 1, 4, 4), 0.5))
    sample(prior, draw(2, 5, 4, 4).float(), TEXT, TEXT, mean, scale=1, steps=10, start=1.0, known=known)
    assert prior.levels == pytest.approx([0.5, 0.4, 0.3, 0.2, 0.1])
    prior.levels.clear()
    kept = Known(torch.ones(2, 5, 4, 4), torch.zeros(2, 1, 4, 4))
    assert torch.equal(sample(prior, draw(2, 5, 4, 4).float(), TEXT, TEXT, mean, scale=1, steps=10, known=kept), kept.x)
    assert prior.levels == [], "nothing is asked where nothing is free"


class Counting(ExactPrior):
    """Remembers the noise levels that it is asked at."""

    def __init__(self, deviation: float = 0.0) -> None:
        super().__init__(deviation=deviation)
        self.levels: list[float] = []

    def predict_noise(self, x_t: Tensor, t: float, text: Tensor, geometry: Tensor | None = None) -> Tensor:
        self.levels.append(t)
        return super().predict_noise(x_t, t, text, geometry)


class Pairs(ExactPrior):
    """Pictures of two pixels, N(0, 1) each, that correlate by ``rho``.

    E[epsilon | x_t] = sigma (alpha^2 C + sigma^2)^-1 x_t.
    """

    def __init__(self, rho: float) -> None:
        super().__init__()
        self.covariance = torch.tensor([[1, rho], [rho, 1]], dtype=torch.float64)

    def predict_noise(self, x_t: Tensor, t: float, text: Tensor, geometry: Tensor | None = None) -> Tensor:
        alpha, sigma = self.alpha_sigma(t)
        spread = alpha**2 * self.covariance + sigma**2 * torch.eye(2).double()
        return sigma * x_t @ torch.linalg.inv(spread)


def test_what_is_sampled_grows_onto_what_is_known():
    """With one pixel of a correlated pair held at a, the other is N(rho a, 1 - rho^2). Putting pixels back only comes
    near it (RePaint 4.2), and nearer with new noise than without: half of the way, and two thirds."""
    rho, held = 0.9, 1.5
    known = Known(torch.full((4000, 1, 1, 2), held).double(), torch.tensor([0.0, 1.0]).double().expand(4000, 1, 1, 2))
    means, spreads = [], []
    for eta in (0.0, 1.0):
        found = sample(
            Pairs(rho), draw(4000, 1, 1, 2), torch.zeros(4000, 1), torch.zeros(4000, 1), None, scale=1, steps=100,
            known=known, eta=eta, generator=torch.Generator().manual_seed(1),
        )[..., 1]  # fmt: skip
        means.append(float(found.mean()))
        spreads.append(float(found.std()))
    assert 0.4 * rho * held < means[0] < 0.6 * rho * held
    assert 0.6 * rho * held < means[1] < rho * held
    assert math.sqrt(1 - rho**2) < spreads[1] < spreads[0] < 1


def test_new_noise_on_the_way_leaves_the_distribution_as_it_is():
    """Ancestral sampling of N(mean, s^2) gives that mean and, with many steps, that spread."""
    prior, mean, count = ExactPrior(deviation=0.5), torch.full((4000, 1, 1, 1), 0.3).double(), 4000
    text, generator = torch.zeros(count, 1), torch.Generator().manual_seed(1)
    found = sample(prior, draw(count, 1, 1, 1), text, text, mean, scale=1, steps=200, eta=1, generator=generator)
    assert float(found.mean()) == pytest.approx(0.3, abs=4 * 0.5 / math.sqrt(count))
    assert float(found.std()) == pytest.approx(0.5, abs=0.03)


class Worded(ExactPrior):
    """Data at -0.2 without a text and at +0.2 with one, without spread."""

    def predict_noise(self, x_t: Tensor, t: float, text: Tensor, geometry: Tensor | None = None) -> Tensor:
        mean = 0.4 * text.reshape(-1, 1, 1, 1) - 0.2
        return super().predict_noise(x_t, t, text, mean.to(x_t).expand_as(x_t))


@pytest.mark.parametrize(("scale", "wanted"), [(1.0, 0.2), (2.0, 0.6), (7.5, 2.8)])
def test_guidance_goes_beyond_the_text_by_the_scale(scale, wanted):
    """uncond + s (cond - uncond) = -0.2 + 0.4 s, and no further than the prior's bound."""
    prior, noise = Worded(), draw(1, 5, 2, 2)
    with_text, without = torch.ones(1, 1), torch.zeros(1, 1)
    found = sample(prior, noise, with_text, without, None, scale=scale, steps=5)
    torch.testing.assert_close(found, torch.full_like(found, wanted))
    prior.bound = 1.0
    bounded = sample(prior, noise, with_text, without, None, scale=scale, steps=5)
    torch.testing.assert_close(bounded, torch.full_like(found, min(wanted, 1.0)))


def test_the_pocket_priors_samples_are_pictures_of_what_was_asked():
    prior = PocketPrior()
    text = prior.encode_text(["red plastic", "polished gold"])
    ones = torch.ones(2, 32, 32, 1)
    toward = torch.tensor([0.0, 0.0, 1.0]).expand(2, 32, 32, 3)
    geometry = prior.encode_geometry(
        {"normal": toward, "mask": ones, "position": 0.3 * toward, "normal_object": toward}
    )
    noise = draw(2, 8, 32, 32).float()
    x = sample(prior, noise, text, prior.encode_text([""]), geometry, scale=2, steps=6)
    assert torch.equal(x, sample(prior, noise, text, prior.encode_text([""]), geometry, scale=2, steps=6))
    image = prior.decode_image(x)
    assert {name: tuple(value.shape) for name, value in image.items()} == {
        "shaded": (2, 32, 32, 3), "base_color": (2, 32, 32, 3), "roughness": (2, 32, 32, 1), "metallic": (2, 32, 32, 1)
    }  # fmt: skip
    torch.testing.assert_close(prior.encode_image(image), x)
    red, green, blue = image["base_color"][0].mean((0, 1)).tolist()
    assert red > 0.5 > max(green, blue)
    plastic, gold = image["metallic"].mean((1, 2, 3)).tolist()
    assert plastic < 0.2
    assert gold > 0.8


def test_levels_go_evenly_down_to_nothing():
    assert noise_levels(0.9, 3) == pytest.approx([0.9, 0.6, 0.3, 0.0])
    assert noise_levels(0.9, 1) == [0.9, 0.0]


class Blind(ExactPrior):
    sees = ()


class Mute:
    """No decoder."""

    def __init__(self) -> None:
        self.spec, self.sees, self.reads = ExactPrior().spec, ("depth",), ("shaded",)


@pytest.mark.parametrize(
    ("prior", "code", "words"),
    [(Blind(), "prior.no_geometry", "sees no geometry"), (Mute(), "prior.no_decoder", "into pictures")],
)
def test_a_prior_that_cannot_be_sampled_on_a_mesh_is_refused_by_name(prior, code, words):
    with pytest.raises(PriorError, match=words) as caught:
        sampling_prior(prior, "projection")
    assert caught.value.code == code
    assert "'exact'" in caught.value.message
    assert "pocket" in caught.value.hint
    exact = ExactPrior()
    assert sampling_prior(exact, "projection") is exact
