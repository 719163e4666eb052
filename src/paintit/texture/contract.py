"""What every parameterisation of the maps shares: logits for each texel, and the ranges they decode to (paper 3.3)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor, nn

from paintit.color import decode_srgb
from paintit.config import TextureConfig
from paintit.texture.maps import TextureMaps

#: Logits per texel (paper 3.3): 3 base colour, 1 roughness, 1 metalness, 3 normal.
CHANNELS = 8
#: The first of them, all that there are where only the base colour is learned (5.4).
BASE_COLOR = 3


def decode(logits: Tensor, min_roughness: float, normal_strength: float) -> TextureMaps:
    """(layers, 8 or 3, h, w) logits -> maps, whose ranges hold by construction.

    With s = sigmoid(logits): base colour is s, sRGB-coded, handed on linear; roughness is
    ``min_roughness`` + (1 - ``min_roughness``) s; metalness is s; the normal is the unit vector along
    (0, 0, 1) + ``normal_strength`` (2 s - 1).

    Three channels are base colour alone. The rest is then what glTF has for a matte surface: roughness 1, metalness 0,
    a flat normal.
    """
    if logits.shape[1] == BASE_COLOR:
        base_color = decode_srgb(torch.sigmoid(logits).permute(0, 2, 3, 1))
        matte = base_color.new_tensor([1.0, 0.0, 0.0, 0.0, 1.0]).expand(*base_color.shape[:-1], -1)
        return TextureMaps.unpacked(torch.cat([base_color, matte], -1))
    return TextureMaps.unpacked(_Decode.apply(logits, min_roughness, normal_strength))


class _Decode(torch.autograd.Function):
    """:func:`decode` of 8 channels to packed maps, plane by plane, with its derivative written out.

    On a CPU this was a sixth of a step, most of it spent on carrying intermediate results to memory and back; like this
    it takes half as long.
    """

    @staticmethod
    def forward(ctx: Any, logits: Tensor, min_roughness: float, normal_strength: float) -> Tensor:
        s = torch.sigmoid(logits.contiguous())
        packed = torch.empty_like(s)
        packed[:, :3] = decode_srgb(s[:, :3])
        packed[:, 3] = min_roughness + (1 - min_roughness) * s[:, 3]
        packed[:, 4] = s[:, 4]
        direction = normal_strength * (2 * s[:, 5:] - 1)
        direction[:, 2] += 1
        shrink = direction.square().sum(1, keepdim=True).rsqrt()
        packed[:, 5:] = direction * shrink
        ctx.save_for_backward(s, packed, shrink)
        ctx.constants = min_roughness, normal_strength
        return packed.permute(0, 2, 3, 1).contiguous()

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None, None]:
        s, packed, shrink = ctx.saved_tensors
        min_roughness, normal_strength = ctx.constants
        gradient = gradients[0].permute(0, 3, 1, 2).clone(memory_format=torch.contiguous_format)
        coded, linear, normal = s[:, :3], packed[:, :3], packed[:, 5:]
        gradient[:, :3] *= torch.where(coded <= 0.04045, 1 / 12.92, 2.4 * linear / (coded + 0.055))
        gradient[:, 3] *= 1 - min_roughness
        # Of n = a / |a|: the gradient without its component along n, over |a|.
        gradient[:, 5:] -= normal * (normal * gradient[:, 5:]).sum(1, keepdim=True)
        gradient[:, 5:] *= 2 * normal_strength * shrink
        # As a convolution's output lies in memory, which is how what comes before takes it best.
        return (gradient * s * (1 - s)).contiguous(memory_format=torch.channels_last), None, None


class TextureField(nn.Module, ABC):
    """A parameterisation of the maps: calling it gives them, with gradients to its parameters."""

    __call__: Callable[[], TextureMaps]

    def __init__(self, config: TextureConfig) -> None:
        super().__init__()
        self.config = config
        self.channels = CHANNELS if config.maps == "pbr" else BASE_COLOR

    @abstractmethod
    def predict(self) -> Tensor:
        """(layers, channels, h, w) logits."""

    def forward(self) -> TextureMaps:
        return decode(self.predict(), self.config.min_roughness, self.config.normal_strength)

    def regularization(self) -> Tensor:
        """What is added to the guidance loss, already weighted: a scalar, 0 unless the kind has a regulariser."""
        return torch.zeros((), device=next(self.parameters()).device)
