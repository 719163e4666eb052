"""The parts of a diffusers pipeline brought to where, and into the form in which, they are to work."""

from __future__ import annotations

from typing import Any

import torch
from torch import nn

from paintit.errors import PriorError
from paintit.guidance.economy import Economy


def settle(pipe: Any, denoiser: str, economy: Economy, device: str | torch.device) -> None:
    """Bring the parts of ``pipe`` to ``device`` as ``economy`` wants them. They are complete: nothing is added later.

    Args:
        denoiser: name of the part that denoises.

    Raises:
        PriorError: something is to be compiled, and there is no compiler.
    """
    device = torch.device(device)
    network = getattr(pipe, denoiser)
    for name, part in pipe.components.items():
        stays = (economy.offload and part is network) or (economy.host_texts and name.startswith("text_encoder"))
        if isinstance(part, nn.Module) and not stays:
            part.to(device)
    vae = getattr(pipe, "vae", None)
    for part in (network, vae):
        if part is not None and economy.channels_last:
            part.to(memory_format=torch.channels_last)
    if economy.offload:
        _fetch_layers(network, device)
    elif economy.compile:
        check_compiler(device)
        # The encoder's graph is differentiated, where CUDA graphs are of less use and keep more memory.
        graphs = economy.graphs and device.type == "cuda"
        network.compile(dynamic=False, mode="reduce-overhead" if graphs else None)
        if vae is not None:
            vae.encoder.compile(dynamic=False)


def _fetch_layers(network: nn.Module, device: torch.device) -> None:
    """Weights on the host; each layer's come to ``device`` for its turn, on CUDA while the one before it computes.

    The network is never differentiated, so nothing holds on to what has gone back.
    """
    from diffusers.hooks.group_offloading import apply_group_offloading

    ahead = device.type == "cuda"
    apply_group_offloading(
        network, device, torch.device("cpu"), "leaf_level", use_stream=ahead, record_stream=ahead, non_blocking=ahead
    )


def check_compiler(device: torch.device) -> None:
    """Compile something small.

    Raises:
        PriorError: it does not work.
    """
    try:
        torch.compile(lambda x: (x + 1).sin(), dynamic=False)(torch.zeros(8, device=device))
    except Exception as error:
        reason = next(iter(str(error).strip().splitlines()), "") or type(error).__name__
        need = "triton" if device.type == "cuda" else "a C++ compiler"
        raise PriorError(
            "prior.compile", f"torch.compile does not work here: {reason}",
            f"install {need}, or leave out --compute.compile",
        ) from error  # fmt: skip
