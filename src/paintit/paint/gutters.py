"""Between the islands of the UV layout: during painting as in the exported file."""

from __future__ import annotations

import torch
from torch import Tensor

from paintit.mesh.mesh import Mesh
from paintit.mesh.uv import nearest_covered, rasterize_uv
from paintit.render.sample import take_rows
from paintit.texture.maps import TextureMaps


class Gutters:
    """Gives texels outside the islands the value of the nearest texel inside, differentiably.

    A mip level averages over an island's edge. Without this, what the network leaves in the gutters, where nothing is
    ever asked of it, would bleed into every view that is painted, and an edge would learn to make up for it: the seam
    then shows in the exported file, whose gutters are filled.

    Args:
        mesh: with texture coordinates.
        size: texels along each side.
        device: where the maps are.
    """

    def __init__(self, mesh: Mesh, size: int, device: torch.device) -> None:
        covered = rasterize_uv(mesh, size).covered
        nearest = torch.from_numpy(nearest_covered(covered)).to(device).flatten()
        self._outside = (nearest != torch.arange(len(nearest), device=device)).nonzero()[:, 0]
        self._nearest = nearest[self._outside]

    def __call__(self, maps: TextureMaps) -> TextureMaps:
        return TextureMaps.unpacked(self.filled(maps.packed()))

    def filled(self, image: Tensor) -> Tensor:
        """The same for any (layers, size, size, c)."""
        flat = image.reshape(-1, image.shape[-1])
        return flat.index_copy(0, self._outside, take_rows(flat, self._nearest)).view(image.shape)
