"""Stable Diffusion XL as a prior, from any diffusers checkpoint of its base model: hub id or local folder."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor
from torch.nn import functional

from paintit.errors import PriorError
from paintit.guidance import hub
from paintit.guidance.autoencoder import LatentCodec
from paintit.guidance.ddpm import DdpmPrior, prediction_of, report_cut, token_ids
from paintit.guidance.families import FAMILIES
from paintit.guidance.prior import PriorSpec

if TYPE_CHECKING:
    from diffusers.models.autoencoders.autoencoder_kl import AutoencoderKL
    from diffusers.models.unets.unet_2d_condition import UNet2DConditionModel
    from diffusers.schedulers.scheduling_ddim import DDIMScheduler
    from transformers import CLIPTextModel, CLIPTextModelWithProjection, CLIPTokenizer


class SDXLPrior(DdpmPrior):
    """A latent diffusion model with two text encoders and size conditioning, epsilon or v (Podell 2023).

    A text is one tensor (1, tokens + 1, d): the penultimate hidden states of both encoders side by side, and in the
    last row the second encoder's pooled embedding, filled up with zeros. Latents as in :class:`LatentCodec`. The
    network is told that the picture had its own resolution and was not cropped, the pipeline's default.

    Args:
        scheduler: source of ``alphas_cumprod`` and of the prediction type (epsilon, v_prediction or sample).
        zeros_for_empty: the unconditional text is zeros, not the embedding of ``""``; the pipeline's
            ``force_zeros_for_empty_prompt``.
        chunk: most latents that go through the U-Net at once, to save memory; 0 for no limit.
    """

    bound: float = math.inf

    def __init__(
        self,
        unet: UNet2DConditionModel,
        vae: AutoencoderKL,
        text_encoders: tuple[CLIPTextModel, CLIPTextModelWithProjection],
        tokenizers: tuple[CLIPTokenizer, CLIPTokenizer],
        scheduler: DDIMScheduler,
        *,
        id: str,
        revision: str = "",
        licence: str = "",
        zeros_for_empty: bool = True,
        chunk: int = 0,
    ) -> None:
        self.unet, self.text_encoders, self.tokenizers = unet, text_encoders, tokenizers
        self.codec = LatentCodec(vae)
        self.zeros_for_empty = zeros_for_empty
        # diffusers' configs are attribute dictionaries that its annotations do not describe.
        config: Any = unet.config
        second: Any = text_encoders[1].config
        self._pooled = int(second.projection_dim)
        _check_network(config, self.codec.channels, self._pooled, id)
        spec = PriorSpec(
            id=id,
            family="sdxl",
            revision=revision,
            licence=licence,
            resolution=config.sample_size * self.codec.factor,
            prediction_type=prediction_of(scheduler, id),
            guidance_scale=101.0,
        )
        super().__init__(spec, scheduler, (unet, vae, *text_encoders), chunk)

    @classmethod
    def load(
        cls,
        source: str | Path,
        *,
        device: str | torch.device = "cpu",
        dtype: str = "auto",
        revision: str = "",
        allow_download: bool = False,
        licence: str = "",
        chunk: int = 0,
    ) -> SDXLPrior:
        """The checkpoint in the folder ``source``, or with the hub id ``source``; see :func:`hub.open_checkpoint`.

        Args:
            dtype: of the U-Net and the text encoders, see :func:`hub.precision`. The autoencoder keeps float32 beside
                float16, in which SDXL's own overflows (``force_upcast``) and the gradients of any may; bfloat16 has
                the range.
            revision: commit, tag or branch of a hub id.
            allow_download: without it, a hub id must already be in the local cache.

        Raises:
            PriorError: the extra is not installed, the checkpoint is not there, or it is of another kind.
        """
        hub.require_extra("SDXL")
        import diffusers
        import transformers

        # Both packages fill their names in at run time.
        models: Any = diffusers
        clip: Any = transformers
        found = hub.open_checkpoint(source, FAMILIES["sdxl"], revision=revision, allow_download=allow_download)
        device = torch.device(device)
        precision = hub.precision(device, dtype)
        unet = found.part(models.UNet2DConditionModel, "unet", precision)
        vae = found.part(models.AutoencoderKL, "vae", hub.vae_precision(precision))
        first = found.part(clip.CLIPTextModel, "text_encoder", precision)
        second = found.part(clip.CLIPTextModelWithProjection, "text_encoder_2", precision)
        return cls(
            unet.to(device),
            vae.to(device),
            (first.to(device), second.to(device)),
            (found.part(clip.CLIPTokenizer, "tokenizer"), found.part(clip.CLIPTokenizer, "tokenizer_2")),
            found.part(models.DDIMScheduler, "scheduler"),
            id=found.id,
            revision=found.revision,
            licence=licence,
            zeros_for_empty=found.index.get("force_zeros_for_empty_prompt", True),
            chunk=chunk,
        )

    def _encode(self, prompt: str) -> Tensor:
        """(1, tokens + 1, d): hidden states, then the pooled embedding."""
        report_cut(self.tokenizers[0], prompt, self.tokenizers[0].model_max_length, self.spec.id)
        hidden: list[Tensor] = []
        pooled = torch.empty(0)
        for encoder, tokenizer in zip(self.text_encoders, self.tokenizers, strict=True):
            ids = token_ids(tokenizer, prompt, tokenizer.model_max_length).input_ids
            encoded: Any = encoder(ids.to(encoder.device), output_hidden_states=True)
            hidden.append(encoded.hidden_states[-2])
            pooled = encoded[0]
        words = torch.cat(hidden, -1)
        packed = torch.cat([words, functional.pad(pooled, (0, words.shape[-1] - self._pooled))[:, None]], 1)
        return torch.zeros_like(packed) if self.zeros_for_empty and not prompt else packed

    def _denoise(self, inputs: Tensor, timestep: int, text: Tensor) -> Tensor:
        side = self.spec.resolution
        text = text.to(self.unet.dtype)
        # Original height and width, top and left of the crop, target height and width.
        sizes = torch.tensor([[side, side, 0, 0, side, side]], dtype=text.dtype, device=text.device)
        added = {"text_embeds": text[:, -1, : self._pooled], "time_ids": sizes.expand(len(text), -1)}
        return self.unet(inputs.to(self.unet.dtype), timestep, text[:, :-1], added_cond_kwargs=added).sample

    def encode_image(self, channels: Mapping[str, Tensor]) -> Tensor:
        """``shaded`` (n, h, w, 3), sRGB-coded in [0, 1] -> latents (n, 4, resolution / 8, resolution / 8) float32."""
        return self.codec.encode(channels["shaded"], self.spec.resolution)

    def decode_image(self, x: Tensor) -> dict[str, Tensor]:
        """Latents (n, 4, h, w) -> ``shaded`` (n, 8 h, 8 w, 3) in [0, 1]."""
        return {"shaded": self.codec.decode(x)}


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
