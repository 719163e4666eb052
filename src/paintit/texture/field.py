"""Texture fields: modules without input whose value is a set of PBR maps (paper 3.3, eq. 4). No mesh, no rendering."""

from __future__ import annotations

import torch
from torch import Tensor

from paintit.config import TextureConfig
from paintit.errors import UsageError
from paintit.texture.contract import TextureField
from paintit.texture.dcpbr import DCPBR
from paintit.texture.hash_grid import Grid
from paintit.texture.pixels import Pixels
from paintit.texture.points import Points

__all__ = ["TextureField", "make_field"]


def make_field(
    config: TextureConfig, layers: int, generator: torch.Generator, points: Tensor | None = None
) -> TextureField:
    """The field that ``config`` describes, for ``layers`` texture sets; all randomness comes from ``generator``.

    Args:
        points: (layers, size, size, 3) where each texel lies on the surface, in [-1, 1], not finite where it lies on
            none; the kind ``points`` needs it, the others ignore it.

    Raises:
        UsageError: a size, range or width that cannot be, an unknown kind, or no points where they are needed.
    """
    if config.size < 1:
        raise UsageError("texture.size", f"texture size is {config.size}", "give a positive number such as 512")
    if not 0 <= config.min_roughness <= 1:
        raise UsageError("texture.min_roughness", f"lowest roughness is {config.min_roughness}", "give 0 to 1")
    if not 0 <= config.normal_strength < 1:
        raise UsageError(
            "texture.normal_strength", f"normal strength is {config.normal_strength}", "give at least 0 and less than 1"
        )
    if config.tv_weight < 0:
        raise UsageError("texture.tv_weight", f"total variation weight is {config.tv_weight}", "give 0 or more")
    if config.tv_weight and config.kind != "pixels":
        raise UsageError(
            "texture.tv_weight",
            f"total variation is not defined for a {config.kind} texture",
            "leave tv_weight at 0 or choose kind pixels",
        )
    if layers < 1:
        raise UsageError("texture.layers", f"{layers} texture layers", "give 1 or more")
    if config.maps not in ("pbr", "base_color"):
        raise UsageError("texture.maps", f"there are no maps '{config.maps}'", "choose pbr or base_color")
    for name in ("grid_levels", "grid_features", "grid_table", "grid_base", "hidden"):
        if (value := getattr(config, name)) < 1:
            raise UsageError("texture.grid", f"{name} is {value}", "give 1 or more")
    match config.kind:
        case "dcpbr":
            return DCPBR(config, layers, generator)
        case "pixels":
            return Pixels(config, layers, generator)
        case "hash-grid":
            return Grid(config, layers, generator)
        case "points":
            if points is None:
                raise UsageError(
                    "texture.points", "a points texture has no surface to lie on", "give the points of a mesh's texels"
                )
            return Points(config, layers, generator, points)
        case kind:
            raise UsageError(
                "texture.kind", f"there is no texture kind '{kind}'", "choose dcpbr, pixels, hash-grid or points"
            )
