"""Physically based texture maps: the only thing that texture fields, the renderer and the exporters share."""

from __future__ import annotations

from dataclasses import dataclass, field

import torch
from torch import Tensor


@dataclass(frozen=True)
class TextureMaps:
    """PBR channels of every layer (paper 3.2: K^d, K^rm, K^n), channels last, row 0 at the top (v = 0).

    Attributes:
        base_color: (layers, h, w, 3) LINEAR in [0, 1].
        roughness: (layers, h, w, 1) perceptual, in [0, 1]; microfacet width is its square.
        metallic: (layers, h, w, 1) in [0, 1].
        normal: (layers, h, w, 3) unit, tangent space, +Y up (OpenGL), +Z out of the surface.
    """

    base_color: Tensor
    roughness: Tensor
    metallic: Tensor
    normal: Tensor
    _whole: Tensor | None = field(default=None, init=False, repr=False, compare=False)
    """The tensor that these are parts of, where :meth:`unpacked` made them, so that packing costs nothing."""

    @property
    def layers(self) -> int:
        return self.base_color.shape[0]

    @property
    def size(self) -> tuple[int, int]:
        """(height, width) in texels."""
        return self.base_color.shape[1], self.base_color.shape[2]

    def packed(self) -> Tensor:
        """(layers, h, w, 8): base colour, roughness, metallic, normal. For sampling all channels in one lookup."""
        if self._whole is not None:
            return self._whole
        return torch.cat([self.base_color, self.roughness, self.metallic, self.normal], -1)

    @classmethod
    def unpacked(cls, packed: Tensor) -> TextureMaps:
        """Inverse of :meth:`packed`."""
        base_color, roughness, metallic, normal = packed.split([3, 1, 1, 3], -1)
        maps = cls(base_color, roughness, metallic, normal)
        object.__setattr__(maps, "_whole", packed)  # frozen
        return maps

    def detach(self) -> TextureMaps:
        return TextureMaps.unpacked(self.packed().detach())
