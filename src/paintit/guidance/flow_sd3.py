"""Stable Diffusion 3 and 3.5 as a prior, with or without its third text encoder."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import torch
from torch import Tensor
from torch.nn import functional

from paintit.guidance.flow import FlowPrior


class SD3Prior(FlowPrior):
    """Stable Diffusion 3 and 3.5.

    Text: the rows of both CLIP encoders side by side, then those of T5 (zeros where there is no T5), then one row with
    the pooled CLIP embeddings, zero-padded: (n, 77 + 256 + 1, d).
    """

    family = "sd3"
    pipeline = "StableDiffusion3Pipeline"
    parts: ClassVar[Mapping[str, str]] = {
        "transformer": "SD3Transformer2DModel",
        "vae": "AutoencoderKL",
        "text_encoder": "CLIPTextModelWithProjection",
        "text_encoder_2": "CLIPTextModelWithProjection",
        "text_encoder_3": "T5EncoderModel",
        "tokenizer": "CLIPTokenizer",
        "tokenizer_2": "CLIPTokenizer",
        "tokenizer_3": "T5TokenizerFast",
        "scheduler": "FlowMatchEulerDiscreteScheduler",
    }

    def _resolution(self) -> int:
        return int(self.transformer.config.sample_size) * self.codec.factor

    def _encode(self, prompt: str) -> Tensor:
        rows, _, pooled, _ = self.pipe.encode_prompt(
            prompt, None, None, device=self.pipe.text_encoder.device, do_classifier_free_guidance=False
        )
        last = functional.pad(pooled, (0, rows.shape[-1] - pooled.shape[-1]))
        return torch.cat([rows, last[:, None]], 1)

    def velocity(self, x_s: Tensor, s: float, text: Tensor) -> Tensor:
        return self.transformer(
            hidden_states=x_s,
            timestep=torch.full((len(x_s),), s * self._schedule["num_train_timesteps"], device=x_s.device),
            encoder_hidden_states=text[:, :-1],
            pooled_projections=text[:, -1, : self.transformer.config.pooled_projection_dim],
            return_dict=False,
        )[0]
