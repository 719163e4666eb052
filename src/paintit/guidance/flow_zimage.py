"""Z-Image and Z-Image-Turbo as a prior."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import torch
from torch import Tensor
from torch.nn import functional

from paintit.guidance.flow import FlowPrior

#: Most text tokens that are read, as in the pipeline.
TOKENS = 512


class ZImagePrior(FlowPrior):
    """Z-Image and Z-Image-Turbo.

    Text: (n, 512, d + 1), as many rows of Qwen3's last layer but one as the prompt has tokens, then zeros; the last
    column is 1 in the rows that hold a token. The transformer tells the time backwards, 1 - s, and gives -v.
    """

    family = "z-image"
    pipeline = "ZImagePipeline"
    parts: ClassVar[Mapping[str, str]] = {
        "transformer": "ZImageTransformer2DModel",
        "vae": "AutoencoderKL",
        "text_encoder": "Qwen3Model",
        "tokenizer": "Qwen2TokenizerFast",
        "scheduler": "FlowMatchEulerDiscreteScheduler",
    }

    def _encode(self, prompt: str) -> Tensor:
        rows = self.pipe.encode_prompt(
            prompt, device=self.pipe.text_encoder.device, do_classifier_free_guidance=False, max_sequence_length=TOKENS
        )[0][0]
        marked = functional.pad(rows, (0, 1), value=1.0)
        return functional.pad(marked, (0, 0, 0, TOKENS - len(rows)))[None]

    def velocity(self, x_s: Tensor, s: float, text: Tensor) -> Tensor:
        pictures = self.transformer(
            list(x_s.unsqueeze(2)),
            torch.full((len(x_s),), 1 - s, device=x_s.device),
            [rows[rows[:, -1] > 0, :-1] for rows in text],
            return_dict=False,
        )[0]
        return -torch.stack(pictures).squeeze(2)
