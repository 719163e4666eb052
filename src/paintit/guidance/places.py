"""Coordinates on a surface in normalised object space, and waves along them: what the pocket prior sees of a place.

The same few coordinate systems carry the patterns of its training data and the features of its network, so a pattern is
a simple function of the features: a box projection for what is laid in courses, that projection bent for what has
grown, distance along the body for coats, growth rings for wood. Which pattern, in which colours, the text decides.
All functions take position and unit normal (..., 3) and return (...,).
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

#: Waves along x, y and z, and along the two coordinates of the box projection: half-waves per unit of length.
COARSE, FINE = range(1, 5), range(1, 13)


def box(position: Tensor, normal: Tensor) -> tuple[Tensor, Tensor]:
    """Coordinates along and up the axis-aligned plane that the surface faces most."""
    x, y, z = position.unbind(-1)
    side, up, front = normal.abs().unbind(-1)
    along = torch.where((side >= up) & (side >= front), z, x)
    return along, torch.where((up > side) & (up >= front), z, y)


def grown(u: Tensor, v: Tensor) -> tuple[Tensor, Tensor]:
    """A plane bent by a few fixed waves, so that a lattice on it looks grown."""
    return (
        u + 0.07 * torch.sin(4.1 * v + 1.0) + 0.045 * torch.sin(9.7 * v - 5.3 * u + 2.0),
        v + 0.07 * torch.sin(4.7 * u + 2.4) + 0.045 * torch.sin(8.9 * u + 6.1 * v + 0.7),
    )


def across(position: Tensor, normal: Tensor) -> Tensor:
    """Along the body, bent; the height instead on legs and on what faces front or back."""
    x, y, z = position.unbind(-1)
    bent = z + 0.10 * torch.sin(2.6 * y + 0.5) + 0.04 * torch.sin(6.3 * y + 2.1 * x.abs() + 1.0)
    level = y + 0.06 * torch.sin(4.0 * x.abs() + 0.4)
    legs = ((-0.3 - y) / 0.2).clamp(0, 1)
    ends = ((normal[..., 2].abs() - 0.72) / 0.1).clamp(0, 1)
    return torch.lerp(bent, level, torch.maximum(legs, ends).round())


def ring(position: Tensor) -> Tensor:
    """Distance from the axis of a trunk that lies along z below the object."""
    x, y, z = position.unbind(-1)
    sway = 0.05 * torch.sin(2.2 * z + 0.4) + 0.02 * torch.sin(5.1 * z + 3.0 * y)
    return torch.hypot(x * 0.8 + 0.2 + sway, y + 1.3 + sway)


def agate(position: Tensor) -> Tensor:
    """Distance from a wavering upright axis."""
    x, y, z = position.unbind(-1)
    return torch.hypot(x + 0.15 * torch.sin(3 * y), (z * 0.7) + 0.2 * torch.sin(2.3 * y + 1))


def lattice(p: Tensor, q: Tensor, spacing: float) -> list[Tensor]:
    """Three phases, in turns, that are whole at the points of a triangular lattice with rows along ``p``."""
    half = q / math.sqrt(3)
    return [(p - half) / spacing, (p + half) / spacing, 2 * half / spacing]


def oblique(position: Tensor, quick: bool) -> Tensor:
    """(..., 8) in turns: plane waves in eight directions spread over the sphere, about 1 or 0.6 long."""
    index = torch.arange(8, dtype=position.dtype, device=position.device)
    height, turn = (index + 0.5) / 8, index * math.pi * (3 - math.sqrt(5)) + (0.9 if quick else 0.0)
    flat = (1 - height.square()).sqrt()
    direction = torch.stack([flat * turn.cos(), height, flat * turn.sin()], -1)
    length = (0.62 if quick else 1.05) * (0.85 + 0.3 * (index * 0.618 % 1))
    return position @ (direction / length[:, None]).T


def cloud(position: Tensor, quick: bool, shift: float = 0.0) -> Tensor:
    """(...,) a smooth field of mean 0, variance about 1, for patches, veins, flowers; ``shift`` makes another."""
    index = torch.arange(8, dtype=position.dtype, device=position.device)
    return torch.sin(2 * math.pi * (oblique(position, quick) + index * (0.37 + shift) + shift)).sum(-1) / 2


def phases(position: Tensor, normal: Tensor) -> Tensor:
    """(..., PHASES) in turns: along the coordinates above at the spacings that the training patterns have."""
    u, v = box(position, normal)
    bent = grown(u, v)
    twice = grown(*bent)
    body, height = across(position, normal), position[..., 1]
    rows = [
        *(v / d for d in (0.5, 0.6, 0.28, 0.4, 0.3, 0.16, 0.12, 0.22, 0.64)),
        *(u / d for d in (0.5, 0.66, 0.34, 0.4, 0.33, 0.16, 0.18, 0.24, 0.6, 1.3)),
        (u / 0.4 + v / 0.6) / 2, (u / 0.4 - v / 0.6) / 2, (u + v) / 0.4, (u + v) / 0.5, (u - v) / 0.5,
        u / 0.66 + v / 0.6, u / 0.66 - v / 0.6, u / 0.24 + v / 0.32, u / 0.24 - v / 0.32,
        *lattice(u, v, 0.42), *lattice(u, v, 0.28), *lattice(*bent, 0.3), *lattice(*bent, 0.34), *lattice(*twice, 0.46),
        *lattice(*bent, 0.1875),
        body / 0.3, body / 0.27, ring(position) / 0.17, agate(position) / 0.22 + 0.4 * height,
        height / 0.3, height / 0.6, (v + 0.06 * torch.sin(4 * math.pi * u)) / 0.28,
        height / 0.15, body / 0.15,
    ]  # fmt: skip
    return torch.cat([torch.stack(rows, -1), oblique(position, False), oblique(position, True)], -1)


def features(position: Tensor, normal: Tensor) -> Tensor:
    """(..., FEATURES): which axis the surface faces, and sines and cosines of all phases; zero where normal is zero."""
    known = (normal.abs().sum(-1, keepdim=True) > 0.05).to(position.dtype)
    wave = lambda numbers: math.pi * torch.tensor([*numbers], dtype=position.dtype, device=position.device)  # noqa: E731
    slow = (position[..., None] * wave(COARSE)).flatten(-2)
    quick = (torch.stack(box(position, normal), -1)[..., None] * wave(FINE)).flatten(-2)
    angle = torch.cat([slow, quick, 2 * math.pi * phases(position, normal)], -1)
    sharp = normal**4
    facing = sharp / sharp.sum(-1, keepdim=True).clamp_min(1e-6)
    return torch.cat([facing, angle.sin(), angle.cos()], -1) * known


PHASES = 71
FEATURES = 3 + 2 * (3 * len(COARSE) + 2 * len(FINE) + PHASES)
