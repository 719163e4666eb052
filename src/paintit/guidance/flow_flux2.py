"""FLUX.2-klein as a prior, distilled or base."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import torch
from torch import Tensor
from torch.nn import functional

from paintit.guidance.autoencoder import by_pictures, signed, unsigned
from paintit.guidance.flow import FlowPrior

#: Text tokens: what the pipeline pads and cuts to.
TOKENS = 512


class Flux2KleinPrior(FlowPrior):
    """FLUX.2-klein, distilled or base.

    Text: (n, 512, 3 d), three layers of Qwen3 side by side.
    """

    family = "flux2-klein"
    pipeline = "Flux2KleinPipeline"
    parts: ClassVar[Mapping[str, str]] = {
        "transformer": "Flux2Transformer2DModel",
        "vae": "AutoencoderKLFlux2",
        "text_encoder": "Qwen3ForCausalLM",
        "tokenizer": "Qwen2TokenizerFast",
        "scheduler": "FlowMatchEulerDiscreteScheduler",
    }

    def _codec(self) -> PatchCodec:
        return PatchCodec(self.pipe.vae, self.economy.recompute)

    def _encode(self, prompt: str) -> Tensor:
        return self.pipe.encode_prompt(prompt, device=self.pipe.text_encoder.device, max_sequence_length=TOKENS)[0]

    def velocity(self, x_s: Tensor, s: float, text: Tensor) -> Tensor:
        zero, device = torch.arange(1), x_s.device
        height, width = x_s.shape[-2:]
        # Positions in time, row, column and text.
        image_ids = torch.cartesian_prod(zero, torch.arange(height), torch.arange(width), zero).to(device)
        text_ids = torch.cartesian_prod(zero, zero, zero, torch.arange(text.shape[1])).to(device)
        tokens = self.transformer(
            hidden_states=x_s.flatten(2).transpose(1, 2),
            timestep=torch.full((len(x_s),), s, device=device),
            encoder_hidden_states=text,
            img_ids=image_ids,
            txt_ids=text_ids,
            return_dict=False,
        )[0]
        return tokens.transpose(1, 2).unflatten(2, (height, width))

    def _mu(self, tokens: int) -> float:
        """The pipeline's rule for 200 steps: with fewer it raises mu, to spend the few where there is much noise."""
        from diffusers.pipelines.flux2.pipeline_flux2_klein import compute_empirical_mu

        return compute_empirical_mu(tokens, 200)


class PatchCodec:
    """FLUX.2's autoencoder: :class:`~paintit.guidance.autoencoder.LatentCodec` for latents that come in patches.

    Latents are the mean of the posterior; their 2 x 2 patches are joined, each to one pixel of four times the channels,
    and normalised by the running statistics of the autoencoder's batch norm.
    """

    def __init__(self, vae: Any, recompute: int = 0) -> None:
        self.vae = vae
        self.recompute = recompute
        self.factor = 2 ** (len(vae.config.block_out_channels) - 1)
        """Pixels per latent, before they are joined, a side."""

    def encode(self, shaded: Tensor, side: int) -> Tensor:
        """(n, h, w, 3) in [0, 1] -> (n, 4 c, h', w'), h' = w' = ``side`` / (2 ``factor``), at least float32."""
        image = signed(shaded, side).to(self.vae.device, self.vae.dtype)
        posterior = by_pictures(lambda part: self.vae.encode(part).latent_dist.mean, image, self.recompute)
        mean, std = self._statistics()
        patches = functional.pixel_unshuffle(posterior.to(mean.dtype), 2)
        return (patches - mean) / std

    @torch.no_grad()
    def decode(self, x: Tensor) -> Tensor:
        """(n, 4 c, h', w') -> ``shaded`` (n, h, w, 3) in [0, 1]; one picture at a time."""
        mean, std = self._statistics()
        latents = functional.pixel_shuffle(x * std + mean, 2).to(self.vae.dtype)
        image = torch.cat([self.vae.decode(part, return_dict=False)[0] for part in latents.split(1)])
        return unsigned(image).to(x)

    def _statistics(self) -> tuple[Tensor, Tensor]:
        """Mean and standard deviation (4 c, 1, 1) of the patches, at least float32."""
        norm = self.vae.bn
        dtype = torch.promote_types(norm.running_var.dtype, torch.float32)
        variance = norm.running_var.to(dtype) + self.vae.config.batch_norm_eps
        return norm.running_mean.to(dtype)[:, None, None], variance.sqrt()[:, None, None]
