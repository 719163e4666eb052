"""Pictures to latents and back, scaled as the autoencoder's own configuration says."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor
from torch.nn import functional
from torch.utils.checkpoint import checkpoint

if TYPE_CHECKING:
    from diffusers.models.autoencoders.autoencoder_kl import AutoencoderKL
    from diffusers.models.autoencoders.autoencoder_tiny import AutoencoderTiny


class LatentCodec:
    """A KL autoencoder whose latents have about unit variance.

    latents = (mean of the posterior - shift) * scale, channel by channel, without sampling noise. ``shift`` is the
    config's ``shift_factor`` or ``latents_mean``, ``scale`` its ``scaling_factor`` over ``latents_std``. A tiny
    autoencoder (TAESD) says the mean itself, and its latents are scaled already: its configuration has 1 and 0.

    Args:
        recompute: most pictures whose activations live at once, see :func:`by_pictures`.

    Attributes:
        channels: of the latents.
        factor: pixels per latent, a side.
    """

    def __init__(self, vae: AutoencoderKL | AutoencoderTiny, recompute: int = 0) -> None:
        config: Any = vae.config
        self.vae = vae
        self.recompute = recompute
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
        mean = by_pictures(self._mean, image, self.recompute)
        mean = mean.to(torch.promote_types(mean.dtype, torch.float32))
        return (mean - self.shift.to(mean)) * self.scale.to(mean)

    def _mean(self, image: Tensor) -> Tensor:
        encoded: Any = self.vae.encode(image)
        return encoded.latents if hasattr(encoded, "latents") else encoded.latent_dist.mean

    @torch.no_grad()
    def decode(self, x: Tensor) -> Tensor:
        """Latents (n, c, h, w) -> ``shaded`` (n, factor h, factor w, 3) in [0, 1]; one picture at a time."""
        latents: Any = (x / self.scale.to(x) + self.shift.to(x)).to(self.vae.device, self.vae.dtype)
        image = torch.cat([self.vae.decode(part, return_dict=False)[0] for part in latents.split(1)])
        return unsigned(image).to(x)


def by_pictures(encode: Callable[[Tensor], Tensor], image: Tensor, size: int) -> Tensor:
    """``encode`` of (n, ...) pictures, ``size`` at a time, of which the activations of no more than those are kept.

    The backward pass computes them again, one chunk after the other (Chen 2016, 1604.06174). 0 keeps all, as usual.
    """
    if not size:
        return encode(image)
    parts = [checkpoint(encode, part, use_reentrant=False, preserve_rng_state=False) for part in image.split(size)]
    return torch.cat(parts)


def signed(shaded: Tensor, side: int) -> Tensor:
    """(n, h, w, c) in [0, 1] -> (n, c, side, side) in [-1, 1], resampled where it has another size."""
    image = shaded.permute(0, 3, 1, 2)
    if image.shape[-2:] != (side, side):
        image = functional.interpolate(image, (side, side), mode="bilinear", antialias=True)
    return 2 * image - 1


def unsigned(image: Tensor) -> Tensor:
    """(n, c, h, w) in [-1, 1] -> (n, h, w, c) in [0, 1]; what lies outside is clipped."""
    return ((image.movedim(1, -1) + 1) / 2).clamp(0, 1)
