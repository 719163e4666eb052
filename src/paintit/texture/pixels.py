"""Texels without a network: the baseline that the paper's analysis is held against (4.1, eq. 4)."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from paintit.config import TextureConfig
from paintit.texture.contract import BASE_COLOR, TextureField


class Pixels(TextureField):
    """The baseline without a network: one logit per texel and channel, total variation on the base colour (eq. 4).

    It starts as mid grey with faint noise, logits ~ N(0, 0.01^2).
    """

    def __init__(self, config: TextureConfig, layers: int, generator: torch.Generator) -> None:
        super().__init__(config)
        self.logits = nn.Parameter(
            0.01 * torch.randn(layers, self.channels, config.size, config.size, generator=generator)
        )

    def predict(self) -> Tensor:
        return self.logits

    def regularization(self) -> Tensor:
        """``tv_weight`` times the total variation of the (sRGB-coded) base colour, eq. 4."""
        if not self.config.tv_weight:
            return super().regularization()
        return self.config.tv_weight * total_variation(torch.sigmoid(self.logits[:, :BASE_COLOR]))


def total_variation(image: Tensor) -> Tensor:
    """Mean absolute difference of horizontal plus of vertical neighbours of (n, c, h, w): a scalar."""
    return (image[..., 1:] - image[..., :-1]).abs().mean() + (image[..., 1:, :] - image[..., :-1, :]).abs().mean()
