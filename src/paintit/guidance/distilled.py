"""Models distilled to few steps: the guidance that their teachers were sampled with is in their one prediction."""

from __future__ import annotations

import re
from typing import Any

#: What makers call them: SD and SDXL Turbo, SDXL Lightning, Hyper-SD, LCM, DMD2, Flash Diffusion.
_NAMES = re.compile(r"(?<![a-z])(turbo|lightning|hyper|lcm|dmd2?|flash)(?![a-z])")
#: Schedulers made for such models alone.
_SCHEDULERS = ("LCMScheduler", "TCDScheduler")


def distillation(id: str, scheduler: str, network: Any) -> str:
    """What says that a checkpoint is distilled, in words; empty where nothing does.

    ``timestep_spacing`` says nothing: the Turbo models have ``trailing``, and so have others, with zero-SNR schedules.

    Args:
        id: hub id or folder.
        scheduler: name of its class.
        network: configuration of the network that denoises. One with ``time_cond_proj_dim`` is told the scale of its
            teacher's guidance, as latent consistency models are.

    >>> distillation("ByteDance/SDXL-Lightning", "EulerDiscreteScheduler", {})
    "its name has 'lightning'"
    >>> distillation("SG161222/Hyperrealistic", "EulerDiscreteScheduler", {})
    ''
    """
    if scheduler in _SCHEDULERS:
        return f"its scheduler is {scheduler}"
    if network.get("time_cond_proj_dim"):
        return "its network is told a guidance scale"
    found = _NAMES.search(id.lower())
    return f"its name has '{found[1]}'" if found else ""
