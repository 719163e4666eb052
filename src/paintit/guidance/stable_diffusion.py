"""Stable Diffusion 1.x and 2.x as a prior, also conditioned on depth, from any diffusers checkpoint: hub id or local
folder, safetensors only."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from paintit.errors import PriorError
from paintit.guidance import hub
from paintit.guidance.autoencoder import LatentCodec
from paintit.guidance.ddpm import DdpmPrior, prediction_of, report_cut, token_ids
from paintit.guidance.depth import relative_disparity
from paintit.guidance.families import FAMILIES
from paintit.guidance.prior import PriorSpec

if TYPE_CHECKING:
    from diffusers.models.autoencoders.autoencoder_kl import AutoencoderKL
    from diffusers.models.unets.unet_2d_condition import UNet2DConditionModel
    from diffusers.schedulers.scheduling_ddim import DDIMScheduler
    from transformers import CLIPTextModel, CLIPTokenizer


class StableDiffusionPrior(DdpmPrior):
    """A latent diffusion model behind the :class:`~paintit.guidance.prior.Prior` contract.

    Reads ``shaded`` alone; sees no geometry, or, where the U-Net takes one channel more than the latents have (the
    depth-to-image family), the depth. Latents are the mean of the autoencoder's posterior, without sampling
    noise, times the autoencoder's own scaling factor. t is rounded to the nearest of the model's training timesteps.

    Args:
        scheduler: source of ``alphas_cumprod`` and of the prediction type (epsilon, v_prediction or sample).
        chunk: most latents that go through the U-Net at once, to save memory; 0 for no limit.
    """

    bound: float = math.inf

    def __init__(
        self,
        unet: UNet2DConditionModel,
        vae: AutoencoderKL,
        text_encoder: CLIPTextModel,
        tokenizer: CLIPTokenizer,
        scheduler: DDIMScheduler,
        *,
        id: str,
        revision: str = "",
        licence: str = "",
        chunk: int = 0,
    ) -> None:
        # diffusers' configs are attribute dictionaries that its annotations do not describe.
        config: Any = unet.config
        self.codec = LatentCodec(vae)
        latent = self.codec.channels
        if config.in_channels not in (latent, latent + 1):
            raise PriorError(
                "prior.kind",
                f"the U-Net of '{id}' takes {config.in_channels} channels, not {latent} (or {latent + 1}: depth)",
                "choose a text-to-image or depth-to-image checkpoint, not one for inpainting",
            )
        if config.in_channels > latent:
            self.sees = ("depth", "mask")
        self.unet, self.vae, self.text_encoder, self.tokenizer = unet, vae, text_encoder, tokenizer
        spec = PriorSpec(
            id=id,
            family="stable-diffusion",
            revision=revision,
            licence=licence,
            resolution=_side(config.sample_size) * self.codec.factor,
            prediction_type=prediction_of(scheduler, id),
            guidance_scale=101.0,
        )
        super().__init__(spec, scheduler, (unet, vae, text_encoder), chunk)

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
    ) -> StableDiffusionPrior:
        """The checkpoint in the folder ``source``, or with the hub id ``source``.

        Args:
            dtype: ``auto`` is float32 on a CPU or MPS and, on CUDA, bfloat16 or, where the card has none, float16. The
                autoencoder keeps float32 beside a float16 U-Net: its gradients overflow otherwise.
            revision: commit, tag or branch of a hub id.
            allow_download: without it, a hub id must already be in the local cache.

        Raises:
            PriorError: the extra is not installed, the checkpoint is not there, or it is of another kind.
        """
        hub.require_extra("Stable Diffusion")
        import diffusers
        import transformers

        family = FAMILIES["stable-diffusion"]
        found = hub.open_checkpoint(source, family, revision=revision, allow_download=allow_download)
        place = torch.device(device)
        precision = hub.precision(place, dtype)
        parts: Any = diffusers
        texts: Any = transformers
        return cls(
            found.part(parts.UNet2DConditionModel, "unet", precision).to(place),
            found.part(parts.AutoencoderKL, "vae", hub.vae_precision(precision)).to(place),
            found.part(texts.CLIPTextModel, "text_encoder", precision).to(place),
            found.part(texts.CLIPTokenizer, "tokenizer"),
            found.part(parts.DDIMScheduler, "scheduler"),
            id=found.id,
            revision=found.revision,
            licence=licence,
            chunk=chunk,
        )

    def _encode(self, prompt: str) -> Tensor:
        """(1, 77, d) hidden states of CLIP."""
        limit = self.tokenizer.model_max_length
        report_cut(self.tokenizer, prompt, limit, self.spec.id)
        ids = token_ids(self.tokenizer, prompt, limit).input_ids
        return self.text_encoder(ids.to(self.text_encoder.device))[0]

    def _denoise(self, inputs: Tensor, timestep: int, text: Tensor) -> Tensor:
        return self.unet(inputs.to(self.unet.dtype), timestep, text.to(self.unet.dtype)).sample

    def encode_image(self, channels: Mapping[str, Tensor]) -> Tensor:
        """``shaded`` (n, h, w, 3), sRGB-coded in [0, 1] -> latents (n, 4, resolution / 8, resolution / 8) float32."""
        return self.codec.encode(channels["shaded"], self.spec.resolution)

    def decode_image(self, x: Tensor) -> dict[str, Tensor]:
        """Latents (n, 4, h, w) -> ``shaded`` (n, 8 h, 8 w, 3) in [0, 1]."""
        return {"shaded": self.codec.decode(x)}

    @torch.no_grad()
    def encode_geometry(self, channels: Mapping[str, Tensor]) -> Tensor | None:
        """None, or inverse depth (n, 1, resolution / 8, resolution / 8), see :func:`depth.relative_disparity`."""
        if not self.sees:
            return None
        return relative_disparity(channels["depth"], channels["mask"], self.spec.resolution // self.codec.factor)


def _side(sample_size: int | Sequence[int]) -> int:
    return sample_size if isinstance(sample_size, int) else int(sample_size[0])
