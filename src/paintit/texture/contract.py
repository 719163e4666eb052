"""What every parameterisation of the maps shares: logits for each texel, and the ranges they decode to (paper 3.3)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable

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
    values = torch.sigmoid(logits).permute(0, 2, 3, 1)
    if values.shape[-1] == BASE_COLOR:
        matte = values.new_tensor([1.0, 0.0, 0.0, 0.0, 1.0]).expand(*values.shape[:-1], -1)
        return TextureMaps.unpacked(torch.cat([decode_srgb(values), matte], -1))
    base_color, roughness, metallic, tilt = values.split([3, 1, 1, 3], -1)
    normal = normal_strength * (2 * tilt - 1) + tilt.new_tensor([0.0, 0.0, 1.0])
    return TextureMaps(
        base_color=decode_srgb(base_color),
        roughness=min_roughness + (1 - min_roughness) * roughness,
        metallic=metallic,
        normal=normal / normal.norm(dim=-1, keepdim=True),
    )


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
