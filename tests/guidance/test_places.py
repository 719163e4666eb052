"""Coordinates of a place: the box projection, lattices whose phases are whole at their points, waves."""

from __future__ import annotations

import math

import pytest
import torch

from paintit.guidance.places import FEATURES, PHASES, box, features, grown, lattice, phases


def unit(count: int, seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.nn.functional.normalize(torch.randn(count, 3, generator=generator), dim=-1)


@pytest.mark.parametrize(
    ("normal", "expected"),
    [((0.9, 0.3, -0.2), (3.0, 2.0)), ((0.1, -0.9, 0.3), (1.0, 3.0)), ((0.1, 0.3, -0.9), (1.0, 2.0))],
)
def test_the_box_projection_drops_the_axis_that_the_surface_faces(normal, expected) -> None:
    u, v = box(torch.tensor([1.0, 2.0, 3.0]), torch.tensor(normal))
    assert (float(u), float(v)) == expected


def test_lattice_phases_are_whole_at_its_points_and_not_between() -> None:
    spacing, height = 0.42, 0.42 * math.sqrt(3) / 2
    row, column = torch.meshgrid(torch.arange(-3, 4), torch.arange(-3, 4), indexing="ij")
    u, v = (column + 0.5 * (row % 2)) * spacing, row * height
    at = torch.stack(lattice(u, v, spacing))
    torch.testing.assert_close(at, at.round(), atol=1e-4, rtol=0)
    between = torch.stack(lattice(u + spacing / 2, v, spacing))
    assert ((between - between.round()).abs() > 0.4).any(0).all()


def test_bending_is_gentle_and_fixed() -> None:
    u, v = torch.linspace(-1, 1, 50), torch.linspace(1, -1, 50)
    one, two = grown(u, v), grown(u, v)
    assert torch.equal(one[0], two[0])
    assert (one[0] - u).abs().max() < 0.12
    assert (one[0] - u).abs().max() > 0.03


def test_features_are_waves_and_silent_off_the_surface() -> None:
    position, normal = torch.rand(64, 3) * 2 - 1, unit(64)
    normal[::4] = 0
    got = features(position, normal)
    assert got.shape == (64, FEATURES)
    assert phases(position, normal).shape == (64, PHASES)
    assert got[::4].abs().max() == 0
    shown = got[1]
    half = (FEATURES - 3) // 2
    torch.testing.assert_close(shown[3 : 3 + half] ** 2 + shown[3 + half :] ** 2, torch.ones(half))
    torch.testing.assert_close(shown[:3].sum(), torch.tensor(1.0))
    slowest = torch.sin(math.pi * position[1])  # k = 1 of x, y, z
    torch.testing.assert_close(shown[[3, 7, 11]], slowest)
