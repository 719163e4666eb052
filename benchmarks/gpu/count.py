"""The arithmetic of one step, counted on PyTorch's meta device, where nothing is computed; and what a device can do."""

from __future__ import annotations

import time
from collections.abc import Callable

import torch
from benchmarks.gpu.model import Setting, make_pipeline, wait
from torch import Tensor
from torch.utils.flop_counter import FlopCounterMode

from paintit.guidance.autoencoder import LatentCodec
from paintit.guidance.footprint import outline
from paintit.texture.field import make_field

META = torch.device("meta")


def count(setting: Setting) -> dict[str, float]:
    """FLOP of one step by stage: matrix products, convolutions and attention; a multiply-add counts as two.

    ``network`` and ``encode`` forward; ``predict`` with and without the words; ``backward`` through the encoder to the
    pixels, its own weights being frozen, and through the network to its weights. The renderer has no matrix product.
    """
    views, side = setting.config().views.count, setting.unet["sample_size"]
    pipe = make_pipeline(setting, META, torch.float32)
    for part in (pipe.unet, pipe.vae):
        part.requires_grad_(False)
    codec = LatentCodec(pipe.vae)
    picture = torch.empty(views, side * codec.factor, side * codec.factor, 3, device=META, requires_grad=True)
    noisy = torch.empty(2 * views, codec.channels, side, side, device=META)
    words = torch.empty(2 * views, 77, setting.unet["cross_attention_dim"], device=META)
    encode, to_pixels = _forward_and_backward(lambda: codec.encode(picture, side * codec.factor))
    with FlopCounterMode(display=False) as predict, torch.no_grad():
        pipe.unet(noisy, torch.zeros((), dtype=torch.int64, device=META), words)
    with outline():  # autocast, which the network asks for, knows no meta device
        field = make_field(setting.config().texture, 1, torch.Generator())
        network, to_weights = _forward_and_backward(lambda: field().packed())
    return {
        "network": network,
        "encode": encode,
        "predict": float(predict.get_total_flops()),
        "backward": to_pixels + to_weights,
    }


def _forward_and_backward(call: Callable[[], Tensor]) -> tuple[float, float]:
    with FlopCounterMode(display=False) as forward:
        result = call()
    with FlopCounterMode(display=False) as backward:
        result.backward(torch.empty_like(result))
    return float(forward.get_total_flops()), float(backward.get_total_flops())


def ceiling(device: torch.device) -> tuple[str, float]:
    """What was multiplied, in words, and FLOP/s of it: square matrices, bfloat16 on a GPU, float32 on a CPU."""
    dtype, side, times = (torch.bfloat16, 8192, 20) if device.type == "cuda" else (torch.float32, 1024, 3)
    generator = torch.Generator(device).manual_seed(0)
    a, b = (torch.randn(side, side, generator=generator, device=device).to(dtype) for _ in range(2))
    best = min(_seconds(lambda: a @ b, device, times) for _ in range(5))
    return f"{str(dtype).removeprefix('torch.')} {side} x {side}", 2 * side**3 / best


def _seconds(call: Callable[[], Tensor], device: torch.device, times: int) -> float:
    """Seconds of one call, of ``times`` in a row."""
    call()
    wait(device)
    start = time.perf_counter()
    for _ in range(times):
        call()
    wait(device)
    return (time.perf_counter() - start) / times
