"""DeepFloyd IF, stage I, as a prior: pixels of 64 x 64, no autoencoder; any diffusers checkpoint, hub id or folder."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from torch import Tensor

from paintit.errors import PriorError
from paintit.guidance.autoencoder import signed, unsigned
from paintit.guidance.ddpm import DdpmPrior, prediction_of
from paintit.guidance.diffusers_prior import report_cut, token_ids
from paintit.guidance.prior import PriorSpec

#: Tokens that stage I was taught with. Written in no config: T5 itself reads more.
TOKENS = 77


class DeepFloydPrior(DdpmPrior):
    """A diffusion model of small pictures, told about them by T5.

    What is denoised is the rendered picture itself in [-1, 1], resampled to the network's own size, so a gradient
    reaches the texture without passing an autoencoder. The network also predicts a variance, which sampling needs and
    guidance does not: the second half of its channels is left out. Prompts are put in lower case, as in its pipeline.
    """

    family = "deepfloyd-if"
    pipeline = "IFPipeline"
    parts: ClassVar[Mapping[str, str]] = {
        "unet": "UNet2DConditionModel",
        "text_encoder": "T5EncoderModel",
        "tokenizer": "T5Tokenizer",
        "scheduler": "DDPMScheduler",
    }
    settings: ClassVar[Mapping[str, Any]] = {
        "safety_checker": None, "feature_extractor": None, "watermarker": None, "requires_safety_checker": False,
    }  # fmt: skip
    # T5's vocabulary comes as a SentencePiece file, written in Protocol Buffers.
    packages = ("diffusers", "transformers", "sentencepiece", "google.protobuf")
    bound: float = 1.0

    def _spec(self, id: str, revision: str, licence: str) -> PriorSpec:
        # diffusers' configs are attribute dictionaries that its annotations do not describe.
        config: Any = self.unet.config
        if config.in_channels != 3 or config.class_embed_type is not None:
            raise PriorError(
                "prior.kind",
                f"the U-Net of '{id}' does not paint from text alone",
                "choose a checkpoint of stage I, such as DeepFloyd/IF-I-XL-v1.0",
            )
        return PriorSpec(
            id=id,
            family=self.family,
            revision=revision,
            licence=licence,
            resolution=config.sample_size,
            prediction_type=prediction_of(self.pipe.scheduler, id),
            # threestudio's setting for score distillation with this model, 20 in cond + s (cond - uncond).
            guidance_scale=21.0,
        )

    def _codec(self) -> PixelCodec:
        return PixelCodec(self.unet)

    def _encode(self, prompt: str) -> Tensor:
        """(1, 77, d) hidden states of T5."""
        prompt = prompt.lower().strip()
        report_cut(self.pipe.tokenizer, prompt, TOKENS, self.spec.id)
        tokens = token_ids(self.pipe.tokenizer, prompt, TOKENS)
        device = self.pipe.text_encoder.device
        return self.pipe.text_encoder(tokens.input_ids.to(device), attention_mask=tokens.attention_mask.to(device))[0]

    def _denoise(self, x_t: Tensor, timestep: Tensor, text: Tensor, geometry: Tensor | None) -> Tensor:
        predicted = self.unet(x_t.to(self.unet.dtype), timestep, text.to(self.unet.dtype)).sample
        return predicted[:, : x_t.shape[1]]


class PixelCodec:
    """The picture itself in [-1, 1], for a model without an autoencoder."""

    factor = 1

    def __init__(self, unet: Any) -> None:
        self._unet = unet

    def encode(self, shaded: Tensor, side: int) -> Tensor:
        """(n, h, w, 3), sRGB-coded in [0, 1] -> (n, 3, side, side) in [-1, 1], float32, where the network works."""
        return signed(shaded, side).to(self._unet.device)

    def decode(self, x: Tensor) -> Tensor:
        """(n, 3, h, w) in [-1, 1] -> (n, h, w, 3) in [0, 1]."""
        return unsigned(x)
