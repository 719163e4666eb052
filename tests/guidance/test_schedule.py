"""The range of t as a function of progress."""

from __future__ import annotations

import math

import pytest
import torch

from paintit.config import PAPER, POCKET, GuidanceConfig, with_prior
from paintit.errors import UsageError
from paintit.guidance.schedule import PUBLISHED, choose_scale, sample_t, timestep_range, with_scales


@pytest.mark.parametrize("schedule", ["paper", "official"])
@pytest.mark.parametrize("ends", [*PUBLISHED.values(), ((0.03, 0.5), (0.29, 0.5)), ((0.01, 0.5), (0.02, 0.04))])
def test_both_ends_are_exact(schedule: str, ends: tuple) -> None:
    assert timestep_range(schedule, 0.0, *ends) == ends[0]
    assert timestep_range(schedule, 1.0, *ends) == ends[1]


def test_published_numbers() -> None:
    assert PUBLISHED["paper"] == ((0.2, 0.98), (0.3, 0.5))
    assert PUBLISHED["official"] == ((0.3, 0.98), (0.2, 0.5))
    assert (GuidanceConfig().t_start, GuidanceConfig().t_end) == PUBLISHED["paper"]


def test_middle_of_each() -> None:
    assert timestep_range("paper", 0.5, *PUBLISHED["paper"]) == pytest.approx((0.25, 0.74))
    f = math.sqrt(0.5)
    expected = (0.3 - 0.1 * f, 0.98 - 0.48 * f)
    assert timestep_range("official", 0.5, *PUBLISHED["official"]) == pytest.approx(expected)


def test_sampled_t_fills_its_range_and_repeats() -> None:
    draws = [[sample_t((0.3, 0.5), g) for _ in range(2000)] for g in (torch.Generator().manual_seed(1),) * 1]
    again = torch.Generator().manual_seed(1)
    assert draws[0] == [sample_t((0.3, 0.5), again) for _ in range(2000)]
    assert 0.3 <= min(draws[0]) < 0.301
    assert 0.499 < max(draws[0]) <= 0.5
    assert sum(draws[0]) / 2000 == pytest.approx(0.4, abs=0.005)


@pytest.mark.parametrize(
    ("arguments", "value"),
    [
        (("cosine", 0.0, (0.2, 0.9), (0.2, 0.9)), "cosine"),
        (("paper", 1.01, (0.2, 0.9), (0.2, 0.9)), "1.01"),
        (("paper", math.nan, (0.2, 0.9), (0.2, 0.9)), "nan"),
        (("paper", 0.5, (0.9, 0.2), (0.2, 0.9)), "(0.9, 0.2)"),
        (("paper", 0.5, (0.2, 0.9), (0.0, 0.9)), "(0.0, 0.9)"),
        (("paper", 0.5, (0.2, 980.0), (0.2, 0.9)), "980.0"),
    ],
)
def test_refusals_name_the_value(arguments: tuple, value: str) -> None:
    with pytest.raises(UsageError) as caught:
        timestep_range(*arguments)
    assert value in caught.value.message
    assert caught.value.hint


def test_scale_goes_linearly_to_its_end() -> None:
    assert [choose_scale(GuidanceConfig(scale=3.0, scale_end=1.5), p) for p in (0.0, 0.5, 1.0)] == [3.0, 2.25, 1.5]
    assert [choose_scale(GuidanceConfig(scale=101.0), p) for p in (0.0, 1.0)] == [101.0, 101.0]
    with pytest.raises(ValueError, match="auto"):
        choose_scale(GuidanceConfig(), 0.0)


@pytest.mark.parametrize(("own", "sampling"), [(1.0, 1.0), (101.0, 7.5), (21.0, 7.5), (3.0, 3.0)])
def test_auto_is_the_priors_own(own: float, sampling: float) -> None:
    used = with_scales(with_prior(POCKET, "another"), own)
    assert (used.guidance.scale, used.guidance.scale_end, used.projection.scale) == (own, None, sampling)
    assert choose_scale(used.guidance, 0.0) == choose_scale(used.guidance, 1.0) == own


@pytest.mark.parametrize("preset", [POCKET, PAPER])
def test_a_number_stays(preset) -> None:
    assert with_scales(preset, 55.0) == preset
