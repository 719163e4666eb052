"""Pictures to latents and back, scaled as the autoencoder's own configuration says."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor
from torch.nn import functional

if TYPE_CHECKING:
    from diffusers.models.autoencoders.autoencoder_kl import AutoencoderKL


class LatentCodec:
    """A KL autoencoder whose latents have about unit variance.

    latents = (mean of the posterior - shift) * scale, channel by channel, without sampling noise. ``shift`` is the
    config's ``shift_factor`` or ``latents_mean``, ``scale`` its ``scaling_factor`` over ``latents_std``.

    Attributes:
        channels: of the latents.
        factor: pixels per latent, a side.
    """

    def __init__(self, vae: AutoencoderKL) -> None:
        config: Any = vae.config
        self.vae = vae
        self.channels = int(config.latent_channels)
        self.factor = 2 ** (len(config.block_out_channels) - 1)
        mean, std = config.get("latents_mean"), config.get("latents_std")
        scale = torch.tensor(float(config.scaling_factor))
        self.shift = torch.tensor(float(config.get("shift_factor") or 0.0))
        self.scale = scale
        if mean is not None and std is not None:
            self.shift = torch.tensor(mean).view(1, -1, 1, 1)
            self.scale = scale / torch.tensor(std).view(1, -1, 1, 1)

    def encode(self, shaded: Tensor, side: int) -> Tensor:
        """(n, h, w, 3), sRGB-coded in [0, 1] -> latents (n, c, side / factor, side / factor), at least float32."""
        image = signed(shaded, side).to(self.vae.device, self.vae.dtype)
        encoded: Any = self.vae.encode(image)
        mean = encoded.latent_dist.mean
        mean = mean.to(torch.promote_types(mean.dtype, torch.float32))
        return (mean - self.shift.to(mean)) * self.scale.to(mean)

    @torch.no_grad()
    def decode(self, x: Tensor) -> Tensor:
        """Latents (n, c, h, w) -> ``shaded`` (n, factor h, factor w, 3) in [0, 1]; one picture at a time."""
        latents: Any = (x / self.scale.to(x) + self.shift.to(x)).to(self.vae.device, self.vae.dtype)
        image = torch.cat([self.vae.decode(part, return_dict=False)[0] for part in latents.split(1)])
        return unsigned(image).to(x)


def signed(shaded: Tensor, side: int) -> Tensor:
    """(n, h, w, c) in [0, 1] -> (n, c, side, side) in [-1, 1], resampled where it has another size."""
    image = shaded.permute(0, 3, 1, 2)
    if image.shape[-2:] != (side, side):
        image = functional.interpolate(image, (side, side), mode="bilinear", antialias=True)
    return 2 * image - 1


def unsigned(image: Tensor) -> Tensor:
    """(n, c, h, w) in [-1, 1] -> (n, h, w, c) in [0, 1]; what lies outside is clipped."""
    return ((image.movedim(1, -1) + 1) / 2).clamp(0, 1)
