"""Rings of the spectrum against waves of known frequency and noise of known variance; half-way steps by hand."""

from __future__ import annotations

import math

import pytest
import torch

from paintit.analyze.bands import RINGS, band_energy, half_rise, ring_edges, ring_index, settles


def wave(size: int, across: int, down: int, amplitude: float = 0.3) -> torch.Tensor:
    """(1, size, size, 1) of 0.5 plus a cosine with so many periods across and down."""
    y, x = torch.meshgrid(torch.arange(size), torch.arange(size), indexing="ij")
    return 0.5 + amplitude * torch.cos(2 * math.pi * (across * x + down * y).double() / size)[None, ..., None]


def test_edges_are_equally_far_apart_up_to_nyquist() -> None:
    assert ring_edges() == pytest.approx((0, 0.1, 0.2, 0.3, 0.4, 0.5))


@pytest.mark.parametrize(
    ("across", "down", "ring"),
    [(1, 0, 0), (6, 0, 0), (0, 7, 1), (12, 0, 1), (13, 0, 2), (0, 32, 4), (18, 24, 4), (20, 24, 4), (9, 12, 2)],
)
def test_a_wave_is_in_its_ring_and_in_no_other(across: int, down: int, ring: int) -> None:
    """64 texels: a ring is 6.4 periods wide; (18, 24) has radius 30, (20, 24) 31.2, (9, 12) 15."""
    power = band_energy(wave(64, across, down)).power
    assert [i for i in range(RINGS) if power[i] > 1e-12] == [ring]


def test_edges_belong_to_the_inner_ring() -> None:
    """40 texels: 12 periods are 0.3 cycles per texel, which in binary comes out a little above."""
    for periods, ring in ((4, 0), (8, 1), (12, 2), (16, 3), (20, 4)):
        assert ring_index(40, 40)[0, periods] == ring_index(40, 40)[periods, 0] == ring


def test_mean_and_corners_are_in_no_ring() -> None:
    index = ring_index(64, 64)
    assert index[0, 0] == index[32, 32] == index[24, 24] == -1
    assert band_energy(torch.full((2, 32, 32, 3), 0.7)).power == pytest.approx((0.0,) * RINGS, abs=1e-20)
    assert band_energy(wave(64, 28, 28)).power == pytest.approx((0.0,) * RINGS, abs=1e-20)


def test_power_is_parsevals() -> None:
    """A wave's energy, a^2 / 2 per texel, is all in its ring: mean power x coefficients of the ring."""
    count = int((ring_index(64, 64) == 2).sum())
    assert band_energy(wave(64, 15, 0, 0.3)).power[2] * count == pytest.approx(0.3**2 / 2 * 64 * 64)


@pytest.mark.parametrize("size", [64, 256])
def test_white_noise_has_its_variance_in_every_ring_at_every_size(size: int) -> None:
    noise = 0.2 * torch.randn(4, size, size, 3, generator=torch.Generator().manual_seed(5), dtype=torch.float64)
    found = band_energy(noise)
    assert found.power == pytest.approx((0.04,) * RINGS, rel=0.06)
    # The magnitude of a complex normal coefficient is Rayleigh: its mean is sqrt(pi) / 2 of its root mean square.
    assert found.magnitude == pytest.approx((0.2 * math.sqrt(math.pi) / 2,) * RINGS, rel=0.04)


def test_half_rise_is_interpolated() -> None:
    assert half_rise([0, 10, 30], [0.0, 1.0, 4.0]) == pytest.approx(10 + 20 / 3)
    assert half_rise([0, 1, 2], [3.0, 4.0, 4.0]) == 0.0


def test_what_a_random_start_loses_does_not_count() -> None:
    assert half_rise([0, 2, 4, 6], [9.0, 1.0, 2.0, 6.0]) == pytest.approx(4.5)


def test_settling_may_never_come() -> None:
    assert settles([0, 1, 2], [-1.0, -0.4, -0.6], -0.5) is None
    assert settles([0, 1, 2], [-1.0, -0.6, -0.2], -0.5) == pytest.approx(1.25)
