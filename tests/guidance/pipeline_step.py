"""What a diffusers pipeline itself computes in its steps: the authority that a family's prediction is held to."""

from __future__ import annotations

import types
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from paintit.guidance.prior import Prior


@dataclass(frozen=True)
class Step:
    """One step of a pipeline."""

    timestep: int
    x_t: Tensor
    """What the network was given, of one half of the guidance batch."""
    guided: Tensor
    """What the scheduler was given: uncond + s (cond - uncond), in the network's own terms."""


def pipeline_steps(pipeline: Any, run: Callable[[], Any]) -> list[Step]:
    """The steps of ``run()``, which calls ``pipeline``: its U-Net is listened to, and its scheduler."""
    seen: list[Tensor] = []
    steps: list[Step] = []
    step = pipeline.scheduler.step

    def spy(scheduler: Any, guided: Tensor, timestep: Tensor, *args: Any, **options: Any) -> Any:
        steps.append(Step(int(timestep), seen[-1], guided))
        return step(guided, timestep, *args, **options)

    pipeline.scheduler.step = types.MethodType(spy, pipeline.scheduler)
    hook = pipeline.unet.register_forward_pre_hook(lambda _, args: seen.append(args[0].chunk(2)[0]))
    pipeline.set_progress_bar_config(disable=True)
    try:
        run()
    finally:
        hook.remove()
        del pipeline.scheduler.step
    return steps


def guided_noise(
    prior: Prior, x_t: Tensor, t: float, text: Tensor, uncond: Tensor, scale: float, geometry: Tensor | None = None
) -> Tensor:
    """uncond + scale (cond - uncond) as the painter asks for it."""
    seen = None if geometry is None else torch.cat([geometry, geometry])
    both = prior.predict_noise(torch.cat([x_t, x_t]), t, torch.cat([uncond.expand_as(text), text]), seen)
    without, with_text = both.chunk(2)
    return without + scale * (with_text - without)
