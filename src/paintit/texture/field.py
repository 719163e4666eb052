"""Texture fields: modules without input whose value is a set of PBR maps (paper 3.3, eq. 4). No mesh, no rendering."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable

import torch
from torch import Tensor, nn
from torch.nn import functional

from paintit.color import decode_srgb
from paintit.config import TextureConfig
from paintit.errors import UsageError
from paintit.texture.maps import TextureMaps
from paintit.texture.unet import UNet

#: Logits per texel (paper 3.3): 3 base colour, 1 roughness, 1 metalness, 3 normal.
CHANNELS = 8


def decode(logits: Tensor, min_roughness: float, normal_strength: float) -> TextureMaps:
    """(layers, 8, h, w) logits -> maps, whose ranges hold by construction.

    With s = sigmoid(logits): base colour is s, sRGB-coded, handed on linear; roughness is
    ``min_roughness`` + (1 - ``min_roughness``) s; metalness is s; the normal is the unit vector along
    (0, 0, 1) + ``normal_strength`` (2 s - 1).
    """
    base_color, roughness, metallic, tilt = torch.sigmoid(logits).permute(0, 2, 3, 1).split([3, 1, 1, 3], -1)
    normal = normal_strength * (2 * tilt - 1) + tilt.new_tensor([0.0, 0.0, 1.0])
    return TextureMaps(
        base_color=decode_srgb(base_color),
        roughness=min_roughness + (1 - min_roughness) * roughness,
        metallic=metallic,
        normal=normal / normal.norm(dim=-1, keepdim=True),
    )


def total_variation(image: Tensor) -> Tensor:
    """Mean absolute difference of horizontal plus of vertical neighbours of (n, c, h, w): a scalar."""
    return (image[..., 1:] - image[..., :-1]).abs().mean() + (image[..., 1:, :] - image[..., :-1, :]).abs().mean()


def enlarge(x: Tensor, factor: int) -> Tensor:
    """Bilinear upsampling with align_corners=False: (n, c, h, w) -> (n, c, ``factor`` h, ``factor`` w)."""
    if factor == 1:
        return x
    # Elsewhere than on the CPU the backward pass of torch's own upsampling adds in no fixed order.
    if x.device.type == "cpu":
        return functional.interpolate(x, scale_factor=factor, mode="bilinear", align_corners=False)
    return enlarge_slices(x, factor)


def enlarge_slices(x: Tensor, factor: int) -> Tensor:
    """:func:`enlarge` from joined slices: slower, but its gradient is the same at every run on every device."""
    for axis in (2, 3):
        size = x.shape[axis]
        wide = torch.cat([x.narrow(axis, 0, 1), x, x.narrow(axis, size - 1, 1)], axis)
        # Centres of the fine pixels inside a coarse one, from the centre of the coarse pixel before it, in coarse ones.
        places = [0.5 + (place + 0.5) / factor for place in range(factor)]
        phases = [
            torch.lerp(wide.narrow(axis, int(at), size), wide.narrow(axis, int(at) + 1, size), at % 1) for at in places
        ]
        x = torch.stack(phases, axis + 1).flatten(axis, axis + 1)
    return x


class TextureField(nn.Module, ABC):
    """A parameterisation of the maps: calling it gives them, with gradients to its parameters."""

    __call__: Callable[[], TextureMaps]

    @abstractmethod
    def forward(self) -> TextureMaps: ...

    def regularization(self) -> Tensor:
        """What is added to the guidance loss, already weighted: a scalar, 0 unless the kind has a regulariser."""
        return torch.zeros((), device=next(self.parameters()).device)


class DCPBR(TextureField):
    """The paper's deep convolutional re-parameterisation: fixed noise through a U-Net (3.3, supp. A.1).

    The network runs at ``size / upsample``; its logits are upsampled, not the maps, so the ranges hold all the same.

    The noise is drawn from N(0, 1) and standardised per channel. The generator fixes it, so it is a buffer that the
    state leaves out: at 16 channels it would outweigh all else in a checkpoint.
    """

    noise: Tensor

    def __init__(self, config: TextureConfig, layers: int, generator: torch.Generator) -> None:
        super().__init__()
        upsample = config.upsample
        if upsample < 1 or upsample & (upsample - 1):
            raise UsageError("texture.upsample", f"texture upsampling is {upsample}", "give a power of two such as 2")
        unit = upsample * 2 ** len(config.widths)
        if config.size % unit or config.size < 2 * unit:
            network = f"a U-Net of {len(config.widths)} levels" + (f" at 1/{upsample} of it" if upsample > 1 else "")
            raise UsageError(
                "texture.size",
                f"texture size {config.size} does not suit {network}",
                f"choose a multiple of {unit}, at least {2 * unit}" + (", or upsample less" if upsample > 1 else ""),
            )
        self.config = config
        self.unet = UNet(
            config.input_channels,
            CHANNELS,
            config.widths,
            config.skip_widths,
            generator,
            precision=config.precision,
        )
        size = config.size // upsample
        noise = torch.randn(layers, config.input_channels, size, size, generator=generator)
        noise = (noise - noise.mean((2, 3), keepdim=True)) / noise.std((2, 3), keepdim=True)
        self.register_buffer("noise", noise, persistent=False)

    def forward(self) -> TextureMaps:
        logits = enlarge(self.unet(self.noise), self.config.upsample)
        return decode(logits, self.config.min_roughness, self.config.normal_strength)


class Pixels(TextureField):
    """The baseline without a network: one logit per texel and channel, total variation on the base colour (eq. 4).

    It starts as mid grey with faint noise, logits ~ N(0, 0.01^2).
    """

    def __init__(self, config: TextureConfig, layers: int, generator: torch.Generator) -> None:
        super().__init__()
        self.config = config
        self.logits = nn.Parameter(0.01 * torch.randn(layers, CHANNELS, config.size, config.size, generator=generator))

    def forward(self) -> TextureMaps:
        return decode(self.logits, self.config.min_roughness, self.config.normal_strength)

    def regularization(self) -> Tensor:
        """``tv_weight`` times the total variation of the (sRGB-coded) base colour, eq. 4."""
        if not self.config.tv_weight:
            return super().regularization()
        return self.config.tv_weight * total_variation(torch.sigmoid(self.logits[:, :3]))


def make_field(config: TextureConfig, layers: int, generator: torch.Generator) -> TextureField:
    """The field that ``config`` describes, for ``layers`` texture sets; all randomness comes from ``generator``.

    Raises:
        UsageError: a size, range or width that cannot be, or an unknown kind.
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
    match config.kind:
        case "dcpbr":
            return DCPBR(config, layers, generator)
        case "pixels":
            return Pixels(config, layers, generator)
        case kind:
            raise UsageError("texture.kind", f"there is no texture kind '{kind}'", "choose dcpbr or pixels")
