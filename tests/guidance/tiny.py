"""Diffusion models in miniature: the real diffusers and transformers classes with small random weights."""

from __future__ import annotations

import io
import json
import string
from pathlib import Path
from typing import Any

import torch


def save_tiny(
    folder: Path, prediction_type: str = "epsilon", scaling_factor: float = 0.3, *, depth: bool = False
) -> Path:
    """A text-to-image (or depth-to-image) checkpoint of a few hundred kilobytes in ``folder``; 32 pixels, latents of
    16 x 16."""
    from diffusers import DDIMScheduler, UNet2DConditionModel
    from transformers import CLIPTextConfig, CLIPTextModel

    with torch.random.fork_rng():
        torch.manual_seed(0)
        unet = UNet2DConditionModel(
            sample_size=16,
            in_channels=5 if depth else 4,
            block_out_channels=(8, 16),
            layers_per_block=1,
            norm_num_groups=4,
            attention_head_dim=4,
            cross_attention_dim=16,
            down_block_types=("CrossAttnDownBlock2D", "DownBlock2D"),
            up_block_types=("UpBlock2D", "CrossAttnUpBlock2D"),
        )
        vae = tiny_vae(scaling_factor)
        text_encoder = CLIPTextModel(CLIPTextConfig(**CLIP))
    scheduler = DDIMScheduler(
        beta_start=0.00085, beta_end=0.012, beta_schedule="scaled_linear", prediction_type=prediction_type
    )
    parts = {"unet": unet, "vae": vae, "text_encoder": text_encoder, "scheduler": scheduler}
    save_clip_tokenizer(folder / "tokenizer")
    return _save(folder, "StableDiffusionDepth2ImgPipeline" if depth else "StableDiffusionPipeline", parts)


def save_tiny_sdxl(
    folder: Path, prediction_type: str = "epsilon", *, zeros: bool = True, vae: dict[str, Any] | None = None
) -> Path:
    """An SDXL checkpoint in ``folder``; 32 pixels, latents of 16 x 16.

    Args:
        zeros: ``force_zeros_for_empty_prompt``.
        vae: further settings of the autoencoder.
    """
    from diffusers import EulerDiscreteScheduler, UNet2DConditionModel
    from transformers import CLIPTextConfig, CLIPTextModel, CLIPTextModelWithProjection

    with torch.random.fork_rng():
        torch.manual_seed(0)
        parts = {
            "unet": UNet2DConditionModel(
                sample_size=16,
                block_out_channels=(8, 16),
                layers_per_block=1,
                norm_num_groups=4,
                attention_head_dim=(2, 4),
                use_linear_projection=True,
                transformer_layers_per_block=(1, 2),
                cross_attention_dim=16 + 24,
                addition_embed_type="text_time",
                addition_time_embed_dim=8,
                projection_class_embeddings_input_dim=6 * 8 + 20,
                down_block_types=("DownBlock2D", "CrossAttnDownBlock2D"),
                up_block_types=("CrossAttnUpBlock2D", "UpBlock2D"),
            ),
            "vae": tiny_vae(**({"scaling_factor": 0.2} | (vae or {}))),
            "text_encoder": CLIPTextModel(CLIPTextConfig(**CLIP)),
            "text_encoder_2": CLIPTextModelWithProjection(
                CLIPTextConfig(**CLIP | {"hidden_size": 24, "projection_dim": 20})
            ),
            "scheduler": EulerDiscreteScheduler(
                beta_start=0.00085,
                beta_end=0.012,
                beta_schedule="scaled_linear",
                prediction_type=prediction_type,
                timestep_spacing="leading",
                steps_offset=1,
            ),
        }
    for name in ("tokenizer", "tokenizer_2"):
        save_clip_tokenizer(folder / name)
    return _save(folder, "StableDiffusionXLPipeline", parts, force_zeros_for_empty_prompt=zeros)


def save_tiny_controlnet(folder: Path, checkpoint: Path, seed: int = 0) -> Path:
    """A ControlNet for the U-Net of the tiny ``checkpoint``, in ``folder``. Its last layers, zero in one that is not
    trained yet, are random."""
    from diffusers import ControlNetModel, UNet2DConditionModel

    with torch.random.fork_rng():
        torch.manual_seed(seed)
        unet = UNet2DConditionModel.from_pretrained(checkpoint / "unet")
        net = ControlNetModel.from_unet(unet, conditioning_embedding_out_channels=(8, 16))
        for layer in (*net.controlnet_down_blocks, net.controlnet_mid_block, net.controlnet_cond_embedding.conv_out):
            torch.nn.init.normal_(layer.weight, std=0.2)
    net.save_pretrained(folder)
    return folder


def save_tiny_if(folder: Path) -> Path:
    """A DeepFloyd IF checkpoint (stage I) in ``folder``; 16 pixels, tokens by SentencePiece as in the real one."""
    from diffusers import DDPMScheduler, UNet2DConditionModel
    from transformers import T5Config, T5EncoderModel

    vocabulary = 36
    with torch.random.fork_rng():
        torch.manual_seed(0)
        parts = {
            "unet": UNet2DConditionModel(
                sample_size=16,
                in_channels=3,
                out_channels=6,
                block_out_channels=(8, 16),
                layers_per_block=1,
                norm_num_groups=4,
                attention_head_dim=4,
                cross_attention_dim=32,
                encoder_hid_dim=16,
                addition_embed_type="text",
                addition_embed_type_num_heads=2,
                cross_attention_norm="group_norm",
                resnet_time_scale_shift="scale_shift",
                act_fn="gelu",
                down_block_types=("ResnetDownsampleBlock2D", "SimpleCrossAttnDownBlock2D"),
                mid_block_type="UNetMidBlock2DSimpleCrossAttn",
                up_block_types=("SimpleCrossAttnUpBlock2D", "ResnetUpsampleBlock2D"),
            ),
            "text_encoder": T5EncoderModel(
                T5Config(vocab_size=vocabulary, d_model=16, d_kv=8, d_ff=32, num_layers=2, num_heads=2)
            ),
            "scheduler": DDPMScheduler(
                beta_schedule="squaredcos_cap_v2",
                variance_type="learned_range",
                prediction_type="epsilon",
                thresholding=True,
                dynamic_thresholding_ratio=0.95,
                sample_max_value=1.5,
            ),
        }
    save_t5_tokenizer(folder / "tokenizer", vocabulary)
    return _save(folder, "IFPipeline", parts)


_LETTERS = [*string.ascii_lowercase, *(letter + "</w>" for letter in string.ascii_lowercase)]
_VOCABULARY = {word: i for i, word in enumerate([*_LETTERS, "<|startoftext|>", "<|endoftext|>"])}
#: A CLIP text encoder of two layers for :func:`save_clip_tokenizer`.
CLIP: dict[str, Any] = {
    "vocab_size": len(_VOCABULARY),
    "hidden_size": 16,
    "intermediate_size": 32,
    "num_hidden_layers": 2,
    "num_attention_heads": 2,
    "max_position_embeddings": 24,
    "bos_token_id": len(_VOCABULARY) - 2,
    "eos_token_id": len(_VOCABULARY) - 1,
    "pad_token_id": len(_VOCABULARY) - 1,
}


def tiny_vae(scaling_factor: float, **config: Any) -> Any:
    """A KL autoencoder with one halving and four latent channels."""
    from diffusers import AutoencoderKL

    return AutoencoderKL(
        block_out_channels=(8, 8),
        down_block_types=("DownEncoderBlock2D",) * 2,
        up_block_types=("UpDecoderBlock2D",) * 2,
        norm_num_groups=4,
        scaling_factor=scaling_factor,
        **config,
    )


def save_tiny_autoencoder(folder: Path, channels: int = 4, levels: int = 2) -> Path:
    """An AutoencoderTiny in ``folder``, with ``levels`` - 1 halvings."""
    from diffusers import AutoencoderTiny

    widths, blocks = (8,) * levels, (1,) * levels
    with torch.random.fork_rng():
        torch.manual_seed(0)
        AutoencoderTiny(
            latent_channels=channels,
            encoder_block_out_channels=widths,
            decoder_block_out_channels=widths,
            num_encoder_blocks=blocks,
            num_decoder_blocks=blocks,
        ).save_pretrained(folder)
    return folder


def save_clip_tokenizer(folder: Path) -> None:
    """One token per letter, 24 at most."""
    from transformers import CLIPTokenizer

    folder.mkdir(parents=True)
    (folder / "vocab.json").write_text(json.dumps(_VOCABULARY))
    (folder / "merges.txt").write_text("#version: 0.2\n")
    CLIPTokenizer(str(folder / "vocab.json"), str(folder / "merges.txt"), model_max_length=24).save_pretrained(folder)


def save_t5_tokenizer(folder: Path, size: int) -> None:
    """``spiece.model`` with ``size`` pieces, trained on a pangram, and nothing that was converted from it."""
    from sentencepiece import SentencePieceTrainer

    model = io.BytesIO()
    SentencePieceTrainer.train(
        sentence_iterator=iter(["the quick brown fox jumps over the lazy dog", *string.ascii_lowercase] * 4),
        model_writer=model,
        vocab_size=size,
        pad_id=0,
        eos_id=1,
        unk_id=2,
        bos_id=-1,
        minloglevel=2,
    )
    folder.mkdir(parents=True)
    (folder / "spiece.model").write_bytes(model.getvalue())
    (folder / "tokenizer_config.json").write_text(json.dumps({"tokenizer_class": "T5Tokenizer", "extra_ids": 0}))


def _save(folder: Path, pipeline: str, parts: dict[str, Any], **index: Any) -> Path:
    for name, part in parts.items():
        part.save_pretrained(folder / name)
    (folder / "model_index.json").write_text(json.dumps({"_class_name": pipeline, **index}))
    return folder
