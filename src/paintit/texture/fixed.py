"""Layers that are not painted: they keep their look beside the painted ones."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from paintit.texture.maps import TextureMaps

#: Linear base colour, roughness, metalness and normal of a layer whose look is not known.
GREY = (0.5, 0.5, 0.5, 0.8, 0.0, 0.0, 0.0, 1.0)


def grey(layers: int, size: int) -> TextureMaps:
    """Neutral maps for ``layers`` layers of ``size`` texels along each side."""
    return TextureMaps.unpacked(torch.tensor(GREY).expand(layers, size, size, len(GREY)))


def with_fixed(maps: TextureMaps, fixed: TextureMaps, painted: Sequence[bool]) -> TextureMaps:
    """``maps`` of the painted layers and ``fixed`` of the others as one set, in the order that ``painted`` says.

    Raises:
        ValueError: there are more or fewer maps than ``painted`` asks for, or their sizes differ.
    """
    if (maps.layers, fixed.layers) != (sum(painted), len(painted) - sum(painted)):
        raise ValueError(f"{maps.layers} painted and {fixed.layers} fixed layers for {list(painted)}")
    if all(painted):
        return maps
    if maps.size != fixed.size:
        raise ValueError(f"painted maps are {maps.size}, fixed ones {fixed.size}")
    ours, theirs = iter(maps.packed()), iter(fixed.packed())
    return TextureMaps.unpacked(torch.stack([next(ours if mine else theirs) for mine in painted]))
