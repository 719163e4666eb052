"""Flow models in miniature: the real diffusers and transformers classes with small random weights, 32 pixels."""

from __future__ import annotations

import string
from pathlib import Path
from typing import Any

import torch

#: Qwen's way of marking who speaks, as its tokenizers carry it; short.
CHAT = "{% for message in messages %}<|im_start|>{{ message.role }} {{ message.content }}<|im_end|>{% endfor %}"


def save_tiny_sd3(folder: Path, *, t5: bool = True, **schedule: Any) -> Path:
    """A StableDiffusion3Pipeline of about a megabyte in ``folder``; latents of 16 x 16, 4 channels."""
    return _save(folder, sd3_parts(t5=t5, **schedule), "StableDiffusion3Pipeline")


def save_tiny_flux2(folder: Path, *, distilled: bool = False, **schedule: Any) -> Path:
    """A Flux2KleinPipeline in ``folder``; patches of latents, 8 x 8, 16 channels."""
    return _save(folder, flux2_parts(**schedule) | {"is_distilled": distilled}, "Flux2KleinPipeline")


def save_tiny_z_image(folder: Path, **schedule: Any) -> Path:
    """A ZImagePipeline in ``folder``; latents of 16 x 16, 4 channels."""
    return _save(folder, z_image_parts(**schedule), "ZImagePipeline")


def _save(folder: Path, parts: dict[str, Any], pipeline: str) -> Path:
    import diffusers

    getattr(diffusers, pipeline)(**parts).save_pretrained(folder)
    return folder


def sd3_parts(*, t5: bool = True, **schedule: Any) -> dict[str, Any]:
    from diffusers import FlowMatchEulerDiscreteScheduler, SD3Transformer2DModel
    from transformers import T5Config, T5EncoderModel, T5Tokenizer

    with torch.random.fork_rng():
        torch.manual_seed(0)
        transformer = SD3Transformer2DModel(
            sample_size=16,
            in_channels=4,
            out_channels=4,
            num_layers=2,
            attention_head_dim=8,
            num_attention_heads=2,
            joint_attention_dim=40,
            caption_projection_dim=16,
            pooled_projection_dim=24,
            pos_embed_max_size=16,
        )
        pieces = ["<pad>", "</s>", "<unk>", "▁", *string.ascii_lowercase]
        t5_config = T5Config(vocab_size=len(pieces), d_model=40, d_kv=8, d_ff=16, num_layers=2, num_heads=2)
        third: Any = T5EncoderModel(t5_config).eval() if t5 else None
        return {
            "transformer": transformer,
            "vae": _autoencoder(),
            "text_encoder": _clip(12),
            "text_encoder_2": _clip(12),
            "text_encoder_3": third,
            "tokenizer": clip_tokenizer(),
            "tokenizer_2": clip_tokenizer(),
            "tokenizer_3": T5Tokenizer([(piece, 0.0) for piece in pieces], extra_ids=0) if t5 else None,
            "scheduler": FlowMatchEulerDiscreteScheduler(**({"shift": 3.0} | schedule)),
        }


def flux2_parts(**schedule: Any) -> dict[str, Any]:
    from diffusers import AutoencoderKLFlux2, FlowMatchEulerDiscreteScheduler, Flux2Transformer2DModel

    with torch.random.fork_rng():
        torch.manual_seed(0)
        vae = AutoencoderKLFlux2(
            block_out_channels=(8, 8),
            down_block_types=("DownEncoderBlock2D",) * 2,
            up_block_types=("UpDecoderBlock2D",) * 2,
            layers_per_block=1,
            norm_num_groups=4,
            latent_channels=4,
            sample_size=32,
        )
        vae.bn.running_mean.normal_()
        vae.bn.running_var.uniform_(0.3, 3)
        transformer = Flux2Transformer2DModel(
            in_channels=16,
            num_layers=1,
            num_single_layers=1,
            attention_head_dim=16,
            num_attention_heads=2,
            joint_attention_dim=3 * 16,
            axes_dims_rope=(4, 4, 4, 4),
            guidance_embeds=False,
        )
        return {
            "transformer": transformer,
            "vae": vae,
            # The pipeline reads the layers 9, 18 and 27.
            "text_encoder": _qwen(layers=28, head=True),
            "tokenizer": _qwen_tokenizer(),
            "scheduler": FlowMatchEulerDiscreteScheduler(**({"use_dynamic_shifting": True} | schedule)),
        }


def z_image_parts(**schedule: Any) -> dict[str, Any]:
    from diffusers import FlowMatchEulerDiscreteScheduler, ZImageTransformer2DModel

    with torch.random.fork_rng():
        torch.manual_seed(0)
        transformer = ZImageTransformer2DModel(
            in_channels=4,
            dim=32,
            n_layers=2,
            n_refiner_layers=1,
            n_heads=2,
            n_kv_heads=2,
            cap_feat_dim=16,
            axes_dims=[8, 4, 4],
            axes_lens=[1024, 64, 64],
        )
        for token in (transformer.x_pad_token, transformer.cap_pad_token):
            torch.nn.init.normal_(token)
        return {
            "transformer": transformer,
            "vae": _autoencoder(),
            "text_encoder": _qwen(layers=3, head=False),
            "tokenizer": _qwen_tokenizer(),
            "scheduler": FlowMatchEulerDiscreteScheduler(**({"shift": 3.0} | schedule)),
        }


def _autoencoder() -> Any:
    from diffusers import AutoencoderKL

    return AutoencoderKL(
        block_out_channels=(8, 8),
        down_block_types=("DownEncoderBlock2D",) * 2,
        up_block_types=("UpDecoderBlock2D",) * 2,
        norm_num_groups=4,
        latent_channels=4,
        sample_size=32,
        scaling_factor=1.7,
        shift_factor=0.06,
        use_quant_conv=False,
        use_post_quant_conv=False,
    )


def _clip(width: int) -> Any:
    from transformers import CLIPTextConfig, CLIPTextModelWithProjection

    size = 2 * len(string.ascii_lowercase) + 2
    config = CLIPTextConfig(
        vocab_size=size,
        hidden_size=width,
        projection_dim=width,
        intermediate_size=16,
        num_hidden_layers=3,
        num_attention_heads=2,
        max_position_embeddings=24,
        bos_token_id=size - 2,
        eos_token_id=size - 1,
        pad_token_id=size - 1,
    )
    return CLIPTextModelWithProjection(config).eval()


def clip_tokenizer() -> Any:
    """Lower-case letters, one token each; 24 at most."""
    from transformers import CLIPTokenizer

    letters = [*string.ascii_lowercase, *(f"{letter}</w>" for letter in string.ascii_lowercase)]
    vocabulary = {word: i for i, word in enumerate([*letters, "<|startoftext|>", "<|endoftext|>"])}
    return CLIPTokenizer(vocabulary, [], model_max_length=24)


def _qwen(layers: int, *, head: bool) -> Any:
    from transformers import Qwen3Config, Qwen3ForCausalLM, Qwen3Model

    config = Qwen3Config(
        vocab_size=len(_qwen_vocabulary()),
        hidden_size=16,
        intermediate_size=16,
        num_hidden_layers=layers,
        num_attention_heads=2,
        num_key_value_heads=1,
        head_dim=8,
    )
    return (Qwen3ForCausalLM if head else Qwen3Model)(config).eval()


def _qwen_tokenizer() -> Any:
    from transformers import Qwen2TokenizerFast

    return Qwen2TokenizerFast(_qwen_vocabulary(), [], chat_template=CHAT, model_max_length=512)


def _qwen_vocabulary() -> dict[str, int]:
    words = [*string.ascii_lowercase, "Ġ", "<|endoftext|>", "<|im_start|>", "<|im_end|>"]
    return {word: i for i, word in enumerate(words)}
