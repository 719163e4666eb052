"""Stable Diffusion 1.x and 2.x as a prior, also conditioned on depth, from any diffusers checkpoint: hub id or local
folder, safetensors only."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import torch
from torch import Tensor

from paintit.errors import PriorError
from paintit.guidance.autoencoder import LatentCodec
from paintit.guidance.ddpm import DdpmPrior, prediction_of
from paintit.guidance.depth import relative_disparity
from paintit.guidance.diffusers_prior import report_cut, token_ids
from paintit.guidance.prior import PriorSpec


class StableDiffusionPrior(DdpmPrior):
    """A latent diffusion model with one CLIP text encoder (Rombach 2022).

    Sees no geometry, or, where the U-Net takes one channel more than the latents have (the depth-to-image family), the
    depth. Latents are the mean of the autoencoder's posterior, without sampling noise, times the autoencoder's own
    scaling factor.
    """

    family = "stable-diffusion"
    pipeline = "StableDiffusionPipeline"
    parts: ClassVar[Mapping[str, str]] = {
        "unet": "UNet2DConditionModel",
        "vae": "AutoencoderKL",
        "text_encoder": "CLIPTextModel",
        "tokenizer": "CLIPTokenizer",
        "scheduler": "DDIMScheduler",
    }
    settings: ClassVar[Mapping[str, Any]] = {
        "safety_checker": None, "feature_extractor": None, "requires_safety_checker": False,
    }  # fmt: skip

    def _spec(self, id: str, revision: str, licence: str) -> PriorSpec:
        # diffusers' configs are attribute dictionaries that its annotations do not describe.
        config: Any = self.unet.config
        latent = LatentCodec(self.pipe.vae).channels
        if config.in_channels not in (latent, latent + 1):
            raise PriorError(
                "prior.kind",
                f"the U-Net of '{id}' takes {config.in_channels} channels, not {latent} (or {latent + 1}: depth)",
                "choose a text-to-image or depth-to-image checkpoint, not one for inpainting",
            )
        if config.in_channels > latent:
            self.sees = ("depth", "mask")
        return PriorSpec(
            id=id,
            family=self.family,
            revision=revision,
            licence=licence,
            resolution=_side(config.sample_size) * self.codec.factor,
            prediction_type=prediction_of(self.pipe.scheduler, id),
            guidance_scale=101.0,
        )

    def _encode(self, prompt: str) -> Tensor:
        """(1, 77, d) hidden states of CLIP."""
        tokenizer, encoder = self.pipe.tokenizer, self.pipe.text_encoder
        report_cut(tokenizer, prompt, tokenizer.model_max_length, self.spec.id)
        ids = token_ids(tokenizer, prompt, tokenizer.model_max_length).input_ids
        return encoder(ids.to(encoder.device))[0]

    def _denoise(self, x_t: Tensor, timestep: Tensor, text: Tensor, geometry: Tensor | None) -> Tensor:
        inputs = x_t.to(self.unet.dtype)
        words, pictures = self._unpack(text.to(self.unet.dtype))
        added: dict[str, Any] = {}
        if geometry is not None and self.controls:
            added = self.controls(inputs, timestep, words, geometry)
        elif geometry is not None:
            inputs = torch.cat([inputs, geometry.to(inputs)], 1)
        return self.unet(inputs, timestep, (words, pictures) if pictures else words, **added).sample

    @torch.no_grad()
    def encode_geometry(self, channels: Mapping[str, Tensor]) -> Tensor | None:
        """None, or inverse depth (n, 1, resolution / 8, resolution / 8), see :func:`depth.relative_disparity`, or what
        ControlNets look at."""
        if self.controls or not self.sees:
            return super().encode_geometry(channels)
        return relative_disparity(channels["depth"], channels["mask"], self.spec.resolution // self.codec.factor)


def _side(sample_size: int | Sequence[int]) -> int:
    return sample_size if isinstance(sample_size, int) else int(sample_size[0])
