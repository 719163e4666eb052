"""What a step takes in memory apart from the prior, and how a prior is therefore to be loaded."""

from __future__ import annotations

import dataclasses

import torch

from paintit.config import PaintConfig, TextureConfig
from paintit.device import native_bfloat16
from paintit.guidance.economy import Beside
from paintit.guidance.footprint import Live, outline
from paintit.guidance.loading import Loading
from paintit.mesh.mesh import Mesh
from paintit.rng import Streams
from paintit.texture.field import make_field

#: Bytes for each texel: around the texture's own network, the maps, gutters and the mip pyramid; and for each pixel of
#: each view: g-buffer, samples, shading. (Kept for the backward pass, the most in it), counted by ``Live`` on spot.
TEXEL, PIXEL = (80, 150), (370, 480)
#: Of a grid, for each corner of the cell that a texel lies in: row and weight in a matrix and its transpose, held twice
#: while they are made; and for each feature and hidden value of a texel. (Kept, the most.)
CORNER, VALUE = (16, 32), (4, 16)
#: Share of the texels that lie on the surface, in most layouts: ``points`` keeps only those.
COVERED = 0.7
#: A projection has a view and the maps, without gradients.
MAPS = 60


def loading_for(mesh: Mesh, config: PaintConfig, device: torch.device, allow_download: bool = False) -> Loading:
    """How the prior of a paint is to be loaded, so that the whole keeps to ``compute.memory``."""
    around = beside(mesh, config, device) if config.compute.memory is not None else Beside()
    return Loading.of(config, device, allow_download, around)


def beside(mesh: Mesh, config: PaintConfig, device: torch.device) -> Beside:
    """Bytes of one step on ``device``."""
    layers = sum(layer.painted for layer in mesh.layers)
    texels, size = len(mesh.layers) * config.texture.size**2, config.views.size**2
    if config.method == "projection":
        bytes = MAPS * texels + PIXEL[0] * size
        return Beside(bytes, bytes)
    kept, most = _field(config.texture, layers, device)
    pixels = config.views.count * size
    return Beside(kept + TEXEL[0] * texels + PIXEL[0] * pixels, most + TEXEL[1] * texels + PIXEL[1] * pixels)


def _field(texture: TextureConfig, layers: int, device: torch.device) -> tuple[int, int]:
    """Bytes of the field: kept for the backward pass, and the most in it."""
    if texture.kind in ("hash-grid", "points"):  # sparse matrices, which cannot be outlined
        return _grid(texture, layers)
    if texture.precision == "auto":
        precision = "bfloat16" if native_bfloat16(device) else "float32"
        texture = dataclasses.replace(texture, precision=precision)
    with outline():
        field = make_field(texture, layers, Streams(0)["field"])
        with Live([*field.parameters(), *field.buffers()]) as live:
            maps = field().packed()
            kept = live.now
            maps.backward(torch.empty_like(maps))
    return kept, live.peak


def _grid(texture: TextureConfig, layers: int) -> tuple[int, int]:
    """As :func:`_field`."""
    flat = texture.kind == "hash-grid"
    texels = layers * texture.size**2 * (1 if flat else COVERED)
    corners = texture.grid_levels * (4 if flat else 8)
    values = texture.grid_levels * texture.grid_features + 2 * texture.hidden
    kept, most = (
        int(texels * (corner * corners + value * values)) for corner, value in zip(CORNER, VALUE, strict=True)
    )
    return kept, most
