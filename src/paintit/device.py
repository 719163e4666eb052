"""Where to compute: one choice, with its reason in words."""

from __future__ import annotations

import torch

from paintit.errors import UsageError

#: What to write instead.
_NAMES = "use auto, cpu, cuda, cuda:N, mps, or several as cuda:0,cuda:1"


def choose_device(name: str) -> tuple[torch.device, str]:
    """The device called ``name`` (``auto``, ``cpu``, ``cuda``, ``cuda:N``, ``mps``) and why it was taken.

    Of several, joined by commas, the first one: the others only have copies of the prior (``guidance.replicas``).

    Raises:
        UsageError: the name is not a device, or this machine has no such device; or several do not go together.
    """
    if "," in name:
        devices = _devices(name)
        return devices[0], f"asked for; the prior works on {' and '.join(map(str, devices))} at once"
    if name == "auto":
        if torch.cuda.is_available():
            return torch.device("cuda"), f"auto: {torch.cuda.get_device_name()} was found"
        if torch.backends.mps.is_available():
            return torch.device("mps"), "auto: Apple Metal was found"
        return torch.device("cpu"), "auto: no GPU was found"
    try:
        device = torch.device(name)
    except RuntimeError:
        raise UsageError("device.unknown", f"there is no device '{name}'", _NAMES) from None
    if device.type == "cuda" and not 0 <= (device.index or 0) < torch.cuda.device_count():  # torch wraps large numbers
        raise UsageError(
            "device.absent",
            f"device '{name}' was asked for, but {torch.cuda.device_count()} CUDA devices are here",
            "use --device auto",
        )
    if device.type == "mps" and not torch.backends.mps.is_available():
        raise UsageError("device.absent", "device 'mps' was asked for, but Metal is not available", "use --device auto")
    if device.type not in ("cpu", "cuda", "mps"):
        raise UsageError("device.unknown", f"device '{name}' is not supported", _NAMES)
    return device, "asked for"


def _devices(text: str) -> list[torch.device]:
    names = text.split(",")
    kinds = {name.partition(":")[0] for name in names}
    if len(kinds) > 1:
        raise UsageError("device.list", f"devices '{text}' are not of one kind", "name GPUs only: cuda:0,cuda:1")
    if kinds != {"cpu"} and len({name if ":" in name else f"{name}:0" for name in names}) < len(names):
        raise UsageError("device.list", f"devices '{text}' name one twice", "name each GPU once: cuda:0,cuda:1")
    return [choose_device(name)[0] for name in names]


def native_bfloat16(device: torch.device) -> bool:
    """Whether ``device`` multiplies in bfloat16 by itself, and is quicker for it."""
    if device.type == "cuda":
        return torch.cuda.is_bf16_supported()
    questions = ("_is_avx512_bf16_supported", "_is_amx_tile_supported")
    return device.type == "cpu" and any(getattr(torch.cpu, name, bool)() for name in questions)
