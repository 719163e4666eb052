"""Stable Diffusion XL as a prior, from any diffusers checkpoint of its base model: hub id or local folder."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import torch
from torch import Tensor
from torch.nn import functional

from paintit.errors import PriorError
from paintit.guidance.autoencoder import LatentCodec
from paintit.guidance.ddpm import DdpmPrior, prediction_of
from paintit.guidance.diffusers_prior import report_cut, token_ids
from paintit.guidance.prior import PriorSpec


class SDXLPrior(DdpmPrior):
    """A latent diffusion model with two text encoders and size conditioning, epsilon or v (Podell 2023).

    A text is one tensor (1, tokens + 1, d): the penultimate hidden states of both encoders side by side, and in the
    last row the second encoder's pooled embedding, filled up with zeros. The unconditional text is zeros where the
    checkpoint's ``force_zeros_for_empty_prompt`` says so, else the embedding of ``""``. Latents as in
    :class:`LatentCodec`. The network is told that the picture had its own resolution and was not cropped, the
    pipeline's default.
    """

    family = "sdxl"
    pipeline = "StableDiffusionXLPipeline"
    parts: ClassVar[Mapping[str, str]] = {
        "unet": "UNet2DConditionModel",
        "vae": "AutoencoderKL",
        "text_encoder": "CLIPTextModel",
        "text_encoder_2": "CLIPTextModelWithProjection",
        "tokenizer": "CLIPTokenizer",
        "tokenizer_2": "CLIPTokenizer",
        "scheduler": "DDIMScheduler",
    }
    settings: ClassVar[Mapping[str, Any]] = {"add_watermarker": False}
    from_index = ("force_zeros_for_empty_prompt",)

    def _spec(self, id: str, revision: str, licence: str) -> PriorSpec:
        # diffusers' configs are attribute dictionaries that its annotations do not describe.
        config: Any = self.unet.config
        self._pooled = int(self.pipe.text_encoder_2.config.projection_dim)
        """Width of the pooled embedding."""
        _check_network(config, LatentCodec(self.pipe.vae).channels, self._pooled, id)
        return PriorSpec(
            id=id,
            family=self.family,
            revision=revision,
            licence=licence,
            resolution=config.sample_size * self.codec.factor,
            prediction_type=prediction_of(self.pipe.scheduler, id),
            guidance_scale=101.0,
        )

    def _encode(self, prompt: str) -> Tensor:
        """(1, tokens + 1, d): hidden states, then the pooled embedding."""
        pipe = self.pipe
        report_cut(pipe.tokenizer, prompt, pipe.tokenizer.model_max_length, self.spec.id)
        hidden: list[Tensor] = []
        pooled = torch.empty(0)
        for encoder, tokenizer in ((pipe.text_encoder, pipe.tokenizer), (pipe.text_encoder_2, pipe.tokenizer_2)):
            ids = token_ids(tokenizer, prompt, tokenizer.model_max_length).input_ids
            encoded: Any = encoder(ids.to(encoder.device), output_hidden_states=True)
            hidden.append(encoded.hidden_states[-2])
            pooled = encoded[0]
        words = torch.cat(hidden, -1)
        packed = torch.cat([words, functional.pad(pooled, (0, words.shape[-1] - self._pooled))[:, None]], 1)
        return torch.zeros_like(packed) if pipe.config.force_zeros_for_empty_prompt and not prompt else packed

    def _denoise(self, x_t: Tensor, timestep: Tensor, text: Tensor, geometry: Tensor | None) -> Tensor:
        side = self.spec.resolution
        x_t = x_t.to(self.unet.dtype)
        packed, pictures = self._unpack(text.to(self.unet.dtype))
        words, pooled = packed[:, :-1], packed[:, -1, : self._pooled]
        # Original height and width, top and left of the crop, target height and width.
        sizes = torch.tensor([[side, side, 0, 0, side, side]], dtype=packed.dtype, device=packed.device)
        more: dict[str, Any] = {"added_cond_kwargs": {"text_embeds": pooled, "time_ids": sizes.expand(len(packed), -1)}}
        if geometry is not None and self.controls:
            more |= self.controls(x_t, timestep, words, geometry, **more)
        return self.unet(x_t, timestep, (words, pictures) if pictures else words, **more).sample


def _check_network(config: Any, latent: int, pooled: int, id: str) -> None:
    """That the U-Net takes the latents alone, a pooled text and six numbers about the size, as the base model does.

    Raises:
        PriorError: it is made for inpainting or editing (more channels), or it is the refiner (five numbers).
    """
    hint = "choose an SDXL base checkpoint, not its refiner and not one for inpainting"
    if config.in_channels != latent:
        raise PriorError("prior.kind", f"the U-Net of '{id}' takes {config.in_channels} channels, not {latent}", hint)
    wanted = pooled + 6 * (config.addition_time_embed_dim or 0)
    if config.addition_embed_type != "text_time" or config.projection_class_embeddings_input_dim != wanted:
        raise PriorError("prior.kind", f"the U-Net of '{id}' is not told sizes as SDXL's base model is", hint)
