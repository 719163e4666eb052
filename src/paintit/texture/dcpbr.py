"""Deep convolutional re-parameterisation: the paper's way to hold a texture (3.3)."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from paintit.config import TextureConfig
from paintit.errors import UsageError
from paintit.texture.contract import TextureField
from paintit.texture.unet import UNet


class DCPBR(TextureField):
    """The paper's deep convolutional re-parameterisation: fixed noise through a U-Net (3.3, supp. A.1).

    The network runs at ``size / upsample``; its logits are upsampled, not the maps, so the ranges hold all the same.

    The noise is drawn from N(0, 1) and standardised per channel. The generator fixes it, so it is a buffer that the
    state leaves out: at 16 channels it would outweigh all else in a checkpoint.
    """

    noise: Tensor

    def __init__(self, config: TextureConfig, layers: int, generator: torch.Generator) -> None:
        super().__init__(config)
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
        self.unet = UNet(
            config.input_channels,
            self.channels,
            config.widths,
            config.skip_widths,
            generator,
            precision=config.precision,
        )
        size = config.size // upsample
        noise = torch.randn(layers, config.input_channels, size, size, generator=generator)
        noise = (noise - noise.mean((2, 3), keepdim=True)) / noise.std((2, 3), keepdim=True)
        self.register_buffer("noise", noise, persistent=False)

    def predict(self) -> Tensor:
        return enlarge(self.unet(self.noise), self.config.upsample)


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
