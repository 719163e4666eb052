"""Where to compute: one choice, with its reason in words."""

from __future__ import annotations

import torch

from paintit.errors import UsageError


def choose_device(name: str) -> tuple[torch.device, str]:
    """The device called ``name`` (``auto``, ``cpu``, ``cuda``, ``cuda:N``, ``mps``) and why it was taken.

    Raises:
        UsageError: the name is not a device, or this machine has no such device.
    """
    if name == "auto":
        if torch.cuda.is_available():
            return torch.device("cuda"), f"auto: {torch.cuda.get_device_name()} was found"
        if torch.backends.mps.is_available():
            return torch.device("mps"), "auto: Apple Metal was found"
        return torch.device("cpu"), "auto: no GPU was found"
    try:
        device = torch.device(name)
    except RuntimeError:
        raise UsageError(
            "device.unknown", f"there is no device '{name}'", "use auto, cpu, cuda, cuda:N or mps"
        ) from None
    if device.type == "cuda" and (device.index or 0) >= torch.cuda.device_count():
        raise UsageError(
            "device.absent",
            f"device '{name}' was asked for, but {torch.cuda.device_count()} CUDA devices are here",
            "use --device auto",
        )
    if device.type == "mps" and not torch.backends.mps.is_available():
        raise UsageError("device.absent", "device 'mps' was asked for, but Metal is not available", "use --device auto")
    if device.type not in ("cpu", "cuda", "mps"):
        raise UsageError("device.unknown", f"device '{name}' is not supported", "use auto, cpu, cuda, cuda:N or mps")
    return device, "asked for"


def native_bfloat16(device: torch.device) -> bool:
    """Whether ``device`` multiplies in bfloat16 by itself, and is quicker for it."""
    if device.type == "cuda":
        return torch.cuda.is_bf16_supported()
    questions = ("_is_avx512_bf16_supported", "_is_amx_tile_supported")
    return device.type == "cpu" and any(getattr(torch.cpu, name, bool)() for name in questions)
