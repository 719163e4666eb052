"""Where an overlay lies: ``cover(split, surface, noise)``, by the split's kind.

Most patterns are functions of the place in normalised object space alone, with one fixed phase: the prior is told the
place of every pixel, so what it learns is sharp, and agrees between views and between UV islands. Regular patterns lie
on the axis-aligned plane that the surface faces most, as a box projection would put them; an animal's lie across the
body. Only specks and the decoys' blotches are random. Lengths are in units of half the object's longest edge;
``Split.scale`` divides them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from shapes import ACCENT, HEAD, LIMB, TOP
from surfaces import Split
from torch import Tensor

from paintit.guidance.places import across, agate, box, cloud, grown, ring

#: Channels of the noise volume; CELL, EDGE and ID are no longer read, and stay so that a data seed gives the same data.
COARSE, FINE, CELL, EDGE, ID, BROAD, OTHER = range(7)


@dataclass
class Surface:
    """Points of one sample: position and smooth normal (n, 3), part and curvature (n,), turn about +Y in radians (n,)."""

    position: Tensor
    normal: Tensor
    part: Tensor
    curvature: Tensor
    turn: Tensor


def ramp(value: Tensor, share: float | Tensor, soft: float) -> Tensor:
    """1 where ``value`` is below ``share``, with an edge of width ``soft``."""
    return ((share - value) / max(soft, 1e-3) + 0.5).clamp(0, 1)


def frac(x: Tensor) -> Tensor:
    """Distance to the middle of the unit period, in [0, 1]: 0 in the middle, 1 at its ends."""
    return (x - x.floor() - 0.5).abs() * 2


def wave(phase: Tensor, share: float | Tensor, soft: float = 0.1) -> Tensor:
    """1 over a ``share`` of each unit period."""
    return ramp(frac(phase), share, soft)


def plane(s: Surface) -> tuple[Tensor, Tensor]:
    """(n,) coordinates of the box projection."""
    return box(s.position, s.normal)


def hexagonal(u: Tensor, v: Tensor, spacing: float) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Distance to the nearest and the second nearest point of a triangular lattice, and the offset to the nearest."""
    height = spacing * math.sqrt(3) / 2
    row = (v / height).round()
    found = []
    for r in (row - 1, row, row + 1):
        shift = 0.5 * spacing * (r % 2)
        column = ((u - shift) / spacing).floor()
        for c in (column, column + 1):
            found.append((u - c * spacing - shift, v - r * height))
    du, dv = (torch.stack(x) for x in zip(*found, strict=True))
    distance = torch.hypot(du, dv)
    two = distance.topk(2, 0, largest=False)
    nearest = two.indices[:1]
    return two.values[0], two.values[1], du.gather(0, nearest)[0], dv.gather(0, nearest)[0]


def _checks(s: Surface, split: Split) -> Tensor:
    u, v = (x * split.scale / 0.25 for x in plane(s))
    return (u.floor() + v.floor()) % 2


def _diamonds(s: Surface, split: Split) -> Tensor:
    u, v = plane(s)
    u, v = u * split.scale / 0.4, v * split.scale / 0.6
    return ((u + v).floor() + (u - v).floor()) % 2


def _dots(s: Surface, split: Split) -> Tensor:
    spacing = 0.42 / split.scale
    radius = spacing * math.sqrt(split.share * math.sqrt(3) / (2 * math.pi))
    return ramp(hexagonal(*plane(s), spacing)[0], radius, 0.02)


def _bricks(s: Surface, split: Split) -> Tensor:
    height, length = 0.3 / split.scale, 0.66 / split.scale
    mortar = max(split.share * height * length / (height + length), 0.05 / split.scale)
    u, v = plane(s)
    row = (v / height).floor()
    along = (u / length + 0.5 * (row % 2)) % 1 * length
    up = v - row * height
    return ((up < mortar) | (along < mortar)).float()


def _tiles(s: Surface, split: Split) -> Tensor:
    side = 0.4 / split.scale
    u, v = (x % side for x in plane(s))
    return (torch.minimum(u, v) < max(split.share * side / 2, 0.05 / split.scale)).float()


def _mosaic(s: Surface, split: Split) -> Tensor:
    i, j = ((x * split.scale / 0.16).floor() for x in plane(s))
    noise = torch.sin(i * 12.9898 + j * 78.233) * 43758.5453
    return (noise - noise.floor() < split.share).float()


def _plaid(s: Surface, split: Split) -> Tensor:
    u, v = (x * split.scale / 0.4 for x in plane(s))
    return 0.5 * (wave(u, split.share) + wave(v, split.share))


def _weave(s: Surface, split: Split) -> Tensor:
    u, v = (x * split.scale / 0.16 for x in plane(s))
    across = torch.where((u.floor() + v.floor()) % 2 == 0, v, u)
    return 1 - wave(across, 1 - split.share, 0.2)


def _scales(s: Surface, split: Split) -> Tensor:
    width, height = 0.24 / split.scale, 0.16 / split.scale
    u, v = plane(s)
    row = (v / height).floor()
    du = ((u / width + 0.5 * (row % 2)) % 1 - 0.5) * 2
    arc = 1 - (1 - du * du).clamp_min(0).sqrt()
    return ((v / height - row - arc).abs() < max(split.share, 0.15)).float()


def _knit(s: Surface, split: Split) -> Tensor:
    u, v = (x * split.scale for x in plane(s))
    lean = frac(u / 0.18)
    return torch.maximum(1 - wave(v / 0.12 + 0.6 * lean, 1 - split.share, 0.2), 1 - wave(u / 0.18, 0.88, 0.1))


def _hexagons(s: Surface, split: Split) -> Tensor:
    one, two, _, _ = hexagonal(*plane(s), 0.28 / split.scale)
    return ramp(two - one, max(split.share * 0.28, 0.05) / split.scale, 0.02)


def _herringbone(s: Surface, split: Split) -> Tensor:
    u, v = (x * split.scale for x in plane(s))
    return torch.maximum(
        1 - wave((v + 0.3 * frac(u / 0.6)) / 0.16, 1 - split.share, 0.15), 1 - wave(u / 0.3, 0.93, 0.05)
    )


def _planks(s: Surface, split: Split) -> Tensor:
    u, v = (x * split.scale for x in plane(s))
    row = (v / 0.28).floor()
    joint = (u / 1.3 + 0.37 * row) % 1 * 1.3
    return ((v - row * 0.28 < 0.035) | (joint < 0.03)).float()


def _stripes(s: Surface, split: Split) -> Tensor:
    return wave(across(s.position, s.normal) * split.scale / 0.3, split.share, 0.12)


def _tiger(s: Surface, split: Split) -> Tensor:
    x, y, z = s.position.unbind(-1)
    thin = split.share * (0.75 + 0.7 * torch.sin(5.2 * y + 2.6 * z + 1.4 * x.abs() + 0.6))
    return wave(across(s.position, s.normal) * split.scale / 0.27, thin.clamp(0, 1), 0.12)


def _spots(s: Surface, split: Split) -> Tensor:
    spacing = 0.3 / split.scale
    u, v = grown(*plane(s))
    size = 1 + 0.3 * torch.sin(5.0 * u + 3.0) * torch.sin(4.3 * v + 1.0)
    radius = spacing * math.sqrt(split.share * math.sqrt(3) / (2 * math.pi))
    return ramp(hexagonal(u, v, spacing)[0], radius * size, 0.02)


def _rosettes(s: Surface, split: Split) -> Tensor:
    spacing = 0.34 / split.scale
    u, v = grown(*plane(s))
    near, _, du, dv = hexagonal(u, v, spacing)
    angle = torch.atan2(dv, du)
    broken = torch.sin(3 * angle + 9.0 * u + 7.0 * v) > -0.55
    return (ramp((near / spacing - 0.3).abs(), 0.115, 0.04)) * broken


def _cells(s: Surface, split: Split) -> Tensor:
    spacing = 0.46 / split.scale
    one, two, _, _ = hexagonal(*grown(*grown(*plane(s))), spacing)
    return ramp(two - one, max(split.share * 0.3, 0.06) * spacing / 0.46, 0.03)


def _grain(s: Surface, split: Split) -> Tensor:
    """Growth rings: lines along the trunk, arcs on the ends."""
    rings = ring(s.position) * split.scale / 0.17
    thick = split.share * (1 + 0.5 * torch.sin(1.9 * rings.floor() + 0.3))
    return wave(rings, thick, 0.45)


def _rings(s: Surface, split: Split) -> Tensor:
    return wave(agate(s.position) * split.scale / 0.22 + 0.4 * s.position[:, 1], split.share, 0.3)


def _waves(s: Surface, split: Split) -> Tensor:
    u, v = plane(s)
    return wave((v + 0.06 * torch.sin(2 * math.pi * u * split.scale / 0.5)) * split.scale / 0.28, split.share)


def _patches(s: Surface, split: Split, shift: float = 0.0) -> Tensor:
    """Even patches, or small ones where the split is fine."""
    return ramp(torch.special.ndtr(cloud(s.position, split.scale > 1.2, shift)), split.share, split.soft)


def _veins(s: Surface, split: Split) -> Tensor:
    """Thin lines where a cloud changes sign."""
    return ramp(cloud(s.position, False, 0.21).abs(), split.share * 0.8, 0.12)


def _cracks(s: Surface, split: Split) -> Tensor:
    """Lines between cells, wider where the split covers more."""
    one, two, _, _ = hexagonal(*grown(*grown(*plane(s))), 0.46)
    return ramp(two - one, max(split.share * 0.35, 0.05), split.soft)


def _florals(s: Surface, split: Split) -> Tensor:
    """Petals and stems: quick contour lines, on most of the surface."""
    line = ramp(cloud(s.position, True, 0.13).abs(), split.share * 1.1, 0.15)
    return line * (cloud(s.position, False, 0.13) < 0.8)


def _belly(s: Surface, warp: Tensor) -> Tensor:
    """Under and in front, whichever way the shape was turned."""
    forward = s.normal[:, 0] * s.turn.sin() + s.normal[:, 2] * s.turn.cos()
    return ramp(0.5 + 0.5 * (s.normal[:, 1] * 0.75 - forward * 0.45) + warp * 0.15, 0.3, 0.12)


#: Functions of the place alone.
CANONICAL: dict[str, Callable[[Surface, Split], Tensor]] = {
    "checks": _checks,
    "diamonds": _diamonds,
    "dots": _dots,
    "bricks": _bricks,
    "tiles": _tiles,
    "mosaic": _mosaic,
    "plaid": _plaid,
    "weave": _weave,
    "scales": _scales,
    "knit": _knit,
    "hexagons": _hexagons,
    "herringbone": _herringbone,
    "planks": _planks,
    "stripes": _stripes,
    "tiger": _tiger,
    "spots": _spots,
    "rosettes": _rosettes,
    "cells": _cells,
    "grain": _grain,
    "rings": _rings,
    "waves": _waves,
    "patches": _patches,
    "streaks": _patches,
    "camouflage": lambda s, p: _patches(s, p, 0.29),
    "veins": _veins,
    "cracks": _cracks,
    "florals": _florals,
    "vertical_stripes": lambda s, p: wave(plane(s)[0] * p.scale / 0.34, p.share),
    "bands": lambda s, p: wave(s.position[:, 1] * p.scale / 0.3 + 0.25, p.share),
    "diagonal_stripes": lambda s, p: wave(sum(plane(s), torch.zeros(1)) * p.scale / 0.4, p.share),
}
PARTS = {
    "limbs": (LIMB,),
    "head": (HEAD,),
    "accent": (ACCENT,),
    "top": (TOP,),
    "limbs_accent": (LIMB, ACCENT),
}


#: Every kind of split, "none" first.
KINDS = (
    "none", *CANONICAL, *PARTS, "blotches", "specks", "below", "up", "belly", "edges", "crevices",
)  # fmt: skip


def cover(split: Split, s: Surface, noise: Tensor) -> Tensor:
    """Coverage (n,) in [0, 1] of an overlay; ``noise`` (n, 7) at the split's own scale and place.

    Raises:
        KeyError: the kind is unknown.
    """
    kind, share, soft = split.kind, split.share, split.soft
    if kind in CANONICAL:
        return CANONICAL[kind](s, split)
    if kind in PARTS:
        return sum((s.part == part).float() for part in PARTS[kind])  # type: ignore[return-value]
    warp = (noise[:, BROAD] - 0.5) * 0.6
    y = s.position[:, 1]
    random: dict[str, Callable[[], Tensor]] = {
        "none": lambda: torch.zeros_like(y),
        "blotches": lambda: ramp(noise[:, BROAD], share, soft),
        "specks": lambda: ramp(noise[:, FINE], share, 0.15),
        "below": lambda: ramp((y + 1) / 2 + warp * 0.05, share, soft),
        "up": lambda: ramp(0.5 - 0.5 * s.normal[:, 1] + warp * 0.3, share, 0.15),
        "belly": lambda: _belly(s, warp),
        "edges": lambda: ramp(-s.curvature + warp * 0.3, -0.45 + 0.3 * share, 0.15),
        "crevices": lambda: ramp(s.curvature + warp * 0.2, -0.22 + 0.3 * share, 0.15),
    }
    return random[kind]()
