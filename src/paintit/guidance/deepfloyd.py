"""DeepFloyd IF, stage I, as a prior: pixels of 64 x 64, no autoencoder; any diffusers checkpoint, hub id or folder."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from paintit.errors import PriorError
from paintit.guidance import hub
from paintit.guidance.autoencoder import signed, unsigned
from paintit.guidance.ddpm import DdpmPrior, prediction_of, report_cut, token_ids
from paintit.guidance.families import FAMILIES
from paintit.guidance.prior import PriorSpec

if TYPE_CHECKING:
    from diffusers.models.unets.unet_2d_condition import UNet2DConditionModel
    from diffusers.schedulers.scheduling_ddpm import DDPMScheduler
    from transformers import PreTrainedTokenizerBase, T5EncoderModel

#: Tokens that stage I was taught with. Written in no config: T5 itself reads more.
TOKENS = 77


class DeepFloydPrior(DdpmPrior):
    """A diffusion model of small pictures, told about them by T5.

    What is denoised is the rendered picture itself in [-1, 1], resampled to the network's own size, so a gradient
    reaches the texture without passing an autoencoder. The network also predicts a variance, which sampling needs and
    guidance does not: the second half of its channels is left out. Prompts are put in lower case, as in its pipeline.

    Args:
        scheduler: source of ``alphas_cumprod`` and of the prediction type.
        chunk: most pictures that go through the U-Net at once, to save memory; 0 for no limit.
    """

    bound: float = 1.0

    def __init__(
        self,
        unet: UNet2DConditionModel,
        text_encoder: T5EncoderModel,
        tokenizer: PreTrainedTokenizerBase,
        scheduler: DDPMScheduler,
        *,
        id: str,
        revision: str = "",
        licence: str = "",
        chunk: int = 0,
    ) -> None:
        self.unet, self.text_encoder, self.tokenizer = unet, text_encoder, tokenizer
        # diffusers' configs are attribute dictionaries that its annotations do not describe.
        config: Any = unet.config
        if config.in_channels != 3 or config.class_embed_type is not None:
            raise PriorError(
                "prior.kind",
                f"the U-Net of '{id}' does not paint from text alone",
                "choose a checkpoint of stage I, such as DeepFloyd/IF-I-XL-v1.0",
            )
        spec = PriorSpec(
            id=id,
            family="deepfloyd-if",
            revision=revision,
            licence=licence,
            resolution=config.sample_size,
            prediction_type=prediction_of(scheduler, id),
            # threestudio's setting for score distillation with this model, 20 in cond + s (cond - uncond).
            guidance_scale=21.0,
        )
        super().__init__(spec, scheduler, (unet, text_encoder), chunk)

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
    ) -> DeepFloydPrior:
        """The checkpoint in the folder ``source``, or with the hub id ``source``; see :func:`hub.open_checkpoint`.

        Args:
            dtype: of the U-Net and of T5, see :func:`hub.precision`.
            revision: commit, tag or branch of a hub id.
            allow_download: without it, a hub id must already be in the local cache.

        Raises:
            PriorError: the extra is not installed, the checkpoint is not there, or it is of another kind.
        """
        # T5's vocabulary comes as a SentencePiece file, written in Protocol Buffers.
        hub.require_extra("DeepFloyd IF", ("diffusers", "transformers", "sentencepiece", "google.protobuf"))
        import diffusers
        import transformers

        # Both packages fill their names in at run time.
        models: Any = diffusers
        t5: Any = transformers
        found = hub.open_checkpoint(source, FAMILIES["deepfloyd-if"], revision=revision, allow_download=allow_download)
        device = torch.device(device)
        precision = hub.precision(device, dtype)
        unet = found.part(models.UNet2DConditionModel, "unet", precision)
        text_encoder = found.part(t5.T5EncoderModel, "text_encoder", precision)
        return cls(
            unet.to(device),
            text_encoder.to(device),
            found.part(t5.T5Tokenizer, "tokenizer"),
            found.part(models.DDPMScheduler, "scheduler"),
            id=found.id,
            revision=found.revision,
            licence=licence,
            chunk=chunk,
        )

    def _encode(self, prompt: str) -> Tensor:
        """(1, 77, d) hidden states of T5."""
        prompt = prompt.lower().strip()
        report_cut(self.tokenizer, prompt, TOKENS, self.spec.id)
        tokens = token_ids(self.tokenizer, prompt, TOKENS)
        device = self.text_encoder.device
        return self.text_encoder(tokens.input_ids.to(device), attention_mask=tokens.attention_mask.to(device))[0]

    def _denoise(self, inputs: Tensor, timestep: int, text: Tensor) -> Tensor:
        predicted = self.unet(inputs.to(self.unet.dtype), timestep, text.to(self.unet.dtype)).sample
        return predicted[:, : inputs.shape[1]]

    def encode_image(self, channels: Mapping[str, Tensor]) -> Tensor:
        """``shaded`` (n, h, w, 3), sRGB-coded in [0, 1] -> (n, 3, resolution, resolution) in [-1, 1], float32."""
        return signed(channels["shaded"], self.spec.resolution).to(self.unet.device)

    def decode_image(self, x: Tensor) -> dict[str, Tensor]:
        """(n, 3, h, w) in [-1, 1] -> ``shaded`` (n, h, w, 3) in [0, 1]."""
        return {"shaded": unsigned(x)}
