"""A network of the surface point alone: the appearance stage of Fantasia3D, which the paper compares with (5.3)."""

from __future__ import annotations

import torch
from torch import Tensor

from paintit.config import TextureConfig
from paintit.errors import UsageError
from paintit.texture.contract import TextureField
from paintit.texture.hash_grid import HashGrid, Perceptron


class Points(TextureField):
    """Logits of each texel from where it lies in space: a hash grid in three dimensions and a small network.

    Texels at one place get one value, in whatever island or layer they are. Those that lie on no surface have logits 0.
    The finest level has ``size`` cells along the mesh's longest edge, about a texel each in a well filled atlas.

    Args:
        points: (layers, size, size, 3) in [-1, 1], not finite where a texel lies on no surface.

    Raises:
        UsageError: the points are of another size, or none is finite.
    """

    covered: Tensor

    def __init__(self, config: TextureConfig, layers: int, generator: torch.Generator, points: Tensor) -> None:
        super().__init__(config)
        if points.shape != (layers, config.size, config.size, 3):
            raise UsageError(
                "texture.points",
                f"points are {tuple(points.shape)}",
                f"give {(layers, config.size, config.size, 3)}, one for each texel",
            )
        covered = points.isfinite().all(-1)
        if not covered.any():
            raise UsageError("texture.points", "no texel lies on the surface", "raise texture.size or unwrap the mesh")
        self.register_buffer("covered", covered, persistent=False)
        self.grid = HashGrid((points[covered] + 1) / 2, config.size, config, generator)
        self.network = Perceptron(self.grid.outputs, config.hidden, self.channels, generator)

    def predict(self) -> Tensor:
        found = self.network(self.grid()[0])
        logits = found.new_zeros(*self.covered.shape, self.channels)
        return logits.index_put((self.covered,), found).permute(0, 3, 1, 2)
