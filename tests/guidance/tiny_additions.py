"""LoRAs and IP-Adapters in miniature, for the tiny models: made by peft and diffusers, or in the published layout."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

#: Layers of a network and of a CLIP text encoder that get a LoRA.
LAYERS = ("to_q", "to_k", "to_v", "to_out.0")
TEXT_LAYERS = ("q_proj", "k_proj", "v_proj", "out_proj", "fc1", "fc2")


def save_lora(folder: Path, pipeline: Any, *, seed: int = 1, texts: bool = True, denoiser: bool = True) -> Path:
    """A LoRA of rank 2 and alpha 3 for ``pipeline``, which is spoilt by it, saved as its class saves them.

    Args:
        texts: for its CLIP text encoders too.
        denoiser: for its network.
    """
    from peft import LoraConfig
    from peft.utils import get_peft_model_state_dict
    from transformers import CLIPTextModel, CLIPTextModelWithProjection

    network = "unet" if hasattr(pipeline, "unet") else "transformer"
    names = [network] if denoiser else []
    clips = (CLIPTextModel, CLIPTextModelWithProjection)
    names += [name for name, part in pipeline.components.items() if texts and isinstance(part, clips)]
    layers: dict[str, Any] = {}
    with torch.random.fork_rng(), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that no vocabulary was changed
        torch.manual_seed(seed)
        for name in names:
            part = getattr(pipeline, name)
            chosen = LAYERS if name == network else TEXT_LAYERS
            part.add_adapter(LoraConfig(r=2, lora_alpha=3, init_lora_weights=False, target_modules=list(chosen)))
            layers[f"{name}_lora_layers"] = get_peft_model_state_dict(part)
            layers[f"{name}_lora_adapter_metadata"] = part.peft_config["default"].to_dict()
    type(pipeline).save_lora_weights(folder, **layers)
    return folder / "pytorch_lora_weights.safetensors"


def save_kohya_lora(file: Path, pipeline: Any, alpha: float = 3.0) -> Path:
    """A LoRA of rank 2 for Stable Diffusion 1.x as most published files have it: flat names, ``text_model``, alphas."""
    from safetensors.torch import save_file

    generator = torch.Generator().manual_seed(2)
    arrays: dict[str, Tensor] = {}
    for prefix, part, layers in (("lora_unet", pipeline.unet, LAYERS), ("lora_te", pipeline.text_encoder, TEXT_LAYERS)):
        for name, module in part.named_modules():
            if name.endswith(layers):
                name = name if part is pipeline.unet else "text_model." + name.removeprefix("text_model.")
                flat = f"{prefix}_{name.replace('.', '_')}"
                rows, columns = module.weight.shape
                arrays[f"{flat}.lora_down.weight"] = torch.randn(2, columns, generator=generator)
                arrays[f"{flat}.lora_up.weight"] = torch.randn(rows, 2, generator=generator)
                arrays[f"{flat}.alpha"] = torch.tensor(alpha)
    save_file(arrays, file)
    return file


def save_ip_adapter(folder: Path, unet: Any, *, plus: bool = False) -> Path:
    """An IP-Adapter for ``unet`` in ``folder``, plain or plus, with its image encoder, as they are published."""
    from safetensors.torch import save_file
    from transformers import CLIPVisionConfig, CLIPVisionModelWithProjection

    generator = torch.Generator().manual_seed(3)
    width, seen, inner = unet.config.cross_attention_dim, 20, 24

    def made(*shape: int) -> Tensor:
        return torch.randn(*shape, generator=generator) / shape[-1] ** 0.5

    def norm(name: str, size: int) -> dict[str, Tensor]:
        return {f"{name}.weight": 1 + made(size), f"{name}.bias": made(size)}

    if plus:
        image = {"latents": made(1, 3, inner), "proj_in.weight": made(inner, 16), "proj_in.bias": made(inner)}
        image |= {"proj_out.weight": made(width, inner), "proj_out.bias": made(width)} | norm("norm_out", width)
        for layer in (f"layers.{index}" for index in range(4)):
            image |= norm(f"{layer}.0.norm1", inner) | norm(f"{layer}.0.norm2", inner) | norm(f"{layer}.1.0", inner)
            image |= {f"{layer}.0.to_q.weight": made(64, inner), f"{layer}.0.to_kv.weight": made(128, inner)}
            image |= {f"{layer}.0.to_out.weight": made(inner, 64)}
            image |= {f"{layer}.1.1.weight": made(4 * inner, inner), f"{layer}.1.3.weight": made(inner, 4 * inner)}
    else:
        image = {"proj.weight": made(4 * width, seen), "proj.bias": made(4 * width)} | norm("norm", width)
    arrays = {f"image_proj.{name}": array for name, array in image.items()}
    looking = [name for name in unet.attn_processors if name.endswith("attn2.processor")]
    for name in looking:
        index = list(unet.attn_processors).index(name)
        rows = unet.get_submodule(name.removesuffix(".processor")).to_k.weight.shape[0]
        arrays |= {f"ip_adapter.{index}.to_{kind}_ip.weight": made(rows, width) for kind in "kv"}
    folder.mkdir(parents=True)
    save_file(arrays, folder / "ip-adapter.safetensors")
    with torch.random.fork_rng():
        torch.manual_seed(4)
        encoder = CLIPVisionModelWithProjection(
            CLIPVisionConfig(
                hidden_size=16,
                intermediate_size=32,
                num_hidden_layers=2,
                num_attention_heads=2,
                image_size=16,
                patch_size=4,
                projection_dim=seen,
            )
        )
    encoder.save_pretrained(folder / "image_encoder")
    return folder


def save_picture(file: Path, seed: int = 0) -> Path:
    """24 x 20 pixels of noise."""
    import numpy as np
    from PIL import Image

    pixels = np.random.default_rng(seed).integers(0, 256, (20, 24, 3), dtype=np.uint8)
    Image.fromarray(pixels).save(file)
    return file
