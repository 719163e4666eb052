"""Patterns of the training data: where they lie, what they cover, and that they depend on the place alone."""

from __future__ import annotations

import pytest
import torch
from patterns import CANONICAL, Surface, cover, hexagonal
from surfaces import Split
from vocabulary import SHARES


def surface(position: torch.Tensor, normal: torch.Tensor) -> Surface:
    n = len(position)
    return Surface(position, normal.expand(n, 3), torch.zeros(n, dtype=torch.uint8), torch.zeros(n), torch.zeros(n))


def front(side: int = 64) -> Surface:
    """A square of the plane z = 0.3 that faces +Z."""
    axis = torch.linspace(-1, 1, side)
    y, x = torch.meshgrid(axis, axis, indexing="ij")
    return surface(torch.stack([x, y, torch.full_like(x, 0.3)], -1).reshape(-1, 3), torch.tensor([0.0, 0, 1]))


def ball(count: int = 4000) -> Surface:
    """Points spread over the unit sphere."""
    normal = torch.nn.functional.normalize(torch.randn(count, 3, generator=torch.Generator().manual_seed(0)), dim=-1)
    return surface(normal, normal)


@pytest.mark.parametrize("kind", sorted(CANONICAL))
def test_a_pattern_depends_on_the_place_alone(kind: str) -> None:
    split, s = Split(kind, SHARES.get(kind, 0.4)), ball()
    got = cover(split, s, torch.rand(len(s.position), 7))
    assert got.shape == (len(s.position),)
    assert got.min() >= 0
    assert got.max() <= 1
    assert 0.02 < float(got.mean()) < 0.85, "neither nothing nor all"
    order = torch.randperm(len(got))
    again = cover(split, surface(s.position[order], s.normal[order]), torch.rand(len(got), 7))
    torch.testing.assert_close(again, got[order])


@pytest.mark.parametrize("kind", sorted(CANONICAL))
def test_one_side_shows_the_pattern(kind: str) -> None:
    got = cover(Split(kind, SHARES.get(kind, 0.4)), front(), torch.zeros(64 * 64, 7))
    assert 0.02 < float(got.mean()) < 0.85, "neither nothing nor all"


def test_checks_alternate_every_quarter() -> None:
    x = torch.tensor([-0.4, -0.1, 0.1, 0.3, 0.6])
    position = torch.stack([x, torch.full_like(x, 0.1), torch.zeros_like(x)], -1)
    got = cover(Split("checks"), surface(position, torch.tensor([0.0, 0, 1])), torch.zeros(5, 7))
    assert got.tolist() == [0, 1, 0, 1, 0]


def test_finer_words_make_finer_patterns() -> None:
    def edges(scale: float) -> int:
        y = torch.linspace(-1, 1, 400)
        line = surface(torch.stack([torch.zeros(400), y, torch.zeros(400)], -1), torch.tensor([0.0, 0, 1]))
        return int((cover(Split("bands", 0.5, scale), line, torch.zeros(400, 7)) > 0.5).int().diff().abs().sum())

    assert edges(0.62) < edges(1.0) < edges(1.6)
    assert edges(1.0) in (13, 14)  # a period of 0.3 over a length of 2


def test_bricks_are_laid_in_bond() -> None:
    """Joints between the bricks of one course lie over the middles of the course below."""
    x = torch.linspace(-1, 1, 1000)
    courses = []
    for y in (0.15, 0.45):  # mid-height of two courses
        line = torch.stack([x, torch.full_like(x, y), torch.zeros_like(x)], -1)
        courses.append(cover(Split("bricks", 0.12), surface(line, torch.tensor([0.0, 0, 1])), torch.zeros(1000, 7)))
    joints = [x[c > 0.5].remainder(0.66).mean() for c in courses]
    assert abs(abs(float(joints[0] - joints[1])) - 0.33) < 0.02


def test_the_nearest_lattice_point_is_the_nearest() -> None:
    u, v = torch.rand(2, 2000, generator=torch.Generator().manual_seed(0)) * 2 - 1
    near, second, _, _ = hexagonal(u, v, 0.3)
    row, column = torch.meshgrid(torch.arange(-12, 13), torch.arange(-12, 13), indexing="ij")
    points = torch.stack([(column + 0.5 * (row % 2)) * 0.3, row * 0.3 * 3**0.5 / 2], -1).reshape(-1, 2)
    offsets = torch.stack([u, v], -1)[:, None] - points  # torch.cdist of this many loses digits near zero
    distance = offsets.norm(dim=-1).sort(1).values
    torch.testing.assert_close(near, distance[:, 0], atol=1e-5, rtol=0)
    torch.testing.assert_close(second, distance[:, 1], atol=1e-5, rtol=0)


def test_an_unknown_kind_is_named() -> None:
    with pytest.raises(KeyError, match="paisley"):
        cover(Split("paisley"), front(4), torch.zeros(16, 7))
