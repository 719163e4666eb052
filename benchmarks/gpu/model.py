"""Stable Diffusion 2.1-base as published but for its weights, which are random; and the same model in miniature."""

from __future__ import annotations

import time
import zlib
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from paintit.config import PAPER, PaintConfig
from paintit.guidance import hub
from paintit.guidance.stable_diffusion import StableDiffusionPrior
from paintit.settings import merge

#: Of the checkpoint's ``unet/config.json``, but for what is diffusers' own default.
UNET: dict[str, Any] = {
    "sample_size": 64,
    "block_out_channels": (320, 640, 1280, 1280),
    "attention_head_dim": (5, 10, 20, 20),
    "cross_attention_dim": 1024,
    "use_linear_projection": True,
}
#: Of its ``vae/config.json``.
VAE: dict[str, Any] = {
    "block_out_channels": (128, 256, 512, 512),
    "down_block_types": ("DownEncoderBlock2D",) * 4,
    "up_block_types": ("UpDecoderBlock2D",) * 4,
    "layers_per_block": 2,
    "latent_channels": 4,
    "sample_size": 768,
    "scaling_factor": 0.18215,
}
#: Of its ``text_encoder/config.json``: OpenCLIP's ViT-H without the last layer.
TEXT: dict[str, Any] = {
    "vocab_size": 49408,
    "hidden_size": 1024,
    "intermediate_size": 4096,
    "num_hidden_layers": 23,
    "num_attention_heads": 16,
    "projection_dim": 512,
    "hidden_act": "gelu",
}
#: Of its ``scheduler/scheduler_config.json``.
SCHEDULER: dict[str, Any] = {
    "beta_start": 0.00085, "beta_end": 0.012, "beta_schedule": "scaled_linear", "clip_sample": False,
    "set_alpha_to_one": False, "steps_offset": 1,
}  # fmt: skip


@dataclass(frozen=True)
class Setting:
    """How large everything is."""

    name: str
    unet: Mapping[str, Any]
    vae: Mapping[str, Any]
    text: Mapping[str, Any]
    changes: Mapping[str, Any]
    """Settings of the preset ``paper`` that are replaced."""
    saving: Mapping[str, Any]
    """What ``--memory 8`` stands for: in miniature, where all fits, what it chooses at full size."""

    def config(self, **changes: Any) -> PaintConfig:
        """The preset ``paper``, with the setting's changes and these."""
        return merge(PAPER, {**self.changes, **changes})


FULL = Setting("the paper's setting", UNET, VAE, TEXT, {}, {"compute.memory": 8.0})
SMALL = Setting(
    "reduced",
    {**UNET, "sample_size": 8, "block_out_channels": (32, 64, 64, 64), "attention_head_dim": (1, 2, 2, 2),
     "cross_attention_dim": 32},
    {**VAE, "block_out_channels": (32, 32, 64, 64)},
    {**TEXT, "hidden_size": 32, "intermediate_size": 64, "num_hidden_layers": 2, "num_attention_heads": 2},
    {"views.size": 64, "views.count": 2, "texture.size": 64, "texture.widths": [32, 32],
     "texture.skip_widths": [32, 32]},
    {"compute.recompute": 1},
)  # fmt: skip


def make_pipeline(
    setting: Setting, device: torch.device, dtype: torch.dtype, inside: AbstractContextManager[None] | None = None
) -> Any:
    """A diffusers pipeline of the family, its weights drawn on ``device`` in ``dtype``, the same at every call.

    It has no tokenizer: words are random tokens (:class:`RandomDiffusion`).

    Args:
        inside: where the weights are made, such as ``footprint.outline()``.
    """
    from diffusers import AutoencoderKL, DDIMScheduler, StableDiffusionPipeline, UNet2DConditionModel
    from transformers import CLIPTextConfig, CLIPTextModel

    gpus = [device] if device.type == "cuda" else []
    with torch.random.fork_rng(gpus), torch.device(device), inside or nullcontext():
        torch.manual_seed(0)
        with _default(dtype):
            unet = UNet2DConditionModel(**setting.unet)
            text_encoder = CLIPTextModel(CLIPTextConfig(**setting.text))
        with _default(hub.vae_precision(dtype)):
            vae = AutoencoderKL(**setting.vae)
    parts: dict[str, Any] = {
        "vae": vae, "text_encoder": text_encoder, "tokenizer": None, "unet": unet, "safety_checker": None,
        "scheduler": DDIMScheduler(**SCHEDULER), "feature_extractor": None,
    }  # fmt: skip
    return StableDiffusionPipeline(**parts, requires_safety_checker=False)


@contextmanager
def _default(dtype: torch.dtype) -> Iterator[None]:
    before = torch.get_default_dtype()
    torch.set_default_dtype(dtype)
    try:
        yield
    finally:
        torch.set_default_dtype(before)


class RandomDiffusion(StableDiffusionPrior):
    """The family's own prior; each text is 77 random tokens that follow from its letters.

    Attributes:
        timed: whether ``seconds`` is filled, which waits for the device around every call.
        seconds: of ``encode`` and ``predict`` since it was last emptied.
    """

    def __init__(self, pipeline: Any, **rest: Any) -> None:
        super().__init__(pipeline, **rest)
        self.timed = False
        self.seconds: dict[str, float] = {}

    def _encode(self, prompt: str) -> Tensor:
        encoder = self.pipe.text_encoder
        generator = torch.Generator().manual_seed(zlib.crc32(prompt.encode()))
        tokens = torch.randint(
            encoder.config.vocab_size, (1, encoder.config.max_position_embeddings), generator=generator
        )
        return encoder(tokens.to(encoder.device))[0]

    def encode_image(self, channels: Mapping[str, Tensor]) -> Tensor:
        with self._clock("encode", channels["shaded"].device):
            return super().encode_image(channels)

    def predict_noise(self, x_t: Tensor, t: float, text: Tensor, geometry: Tensor | None = None) -> Tensor:
        with self._clock("predict", x_t.device):
            return super().predict_noise(x_t, t, text, geometry)

    @contextmanager
    def _clock(self, stage: str, device: torch.device) -> Iterator[None]:
        if not self.timed:
            yield
            return
        wait(device)
        start = time.perf_counter()
        yield
        wait(device)
        self.seconds[stage] = self.seconds.get(stage, 0.0) + time.perf_counter() - start


def wait(device: torch.device) -> None:
    """Until a GPU has done all that it was given."""
    if device.type == "cuda":
        torch.cuda.synchronize(device)
