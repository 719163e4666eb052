"""Which noise levels are sampled when, and with which scale of guidance: pure functions of progress (supp. A.2)."""

from __future__ import annotations

import dataclasses
import math

import torch

from paintit.config import GuidanceConfig, PaintConfig
from paintit.errors import UsageError

#: The scale at which diffusion models are usually sampled; distillation wants far more of most.
SAMPLING_SCALE = 7.5
#: Lowest and highest t, fractions of the prior's training schedule.
Range = tuple[float, float]

#: Published (t_start, t_end) of each schedule: the paper's text (supp. A.2) and the official script's numbers.
PUBLISHED: dict[str, tuple[Range, Range]] = {
    "paper": ((0.2, 0.98), (0.3, 0.5)),
    "official": ((0.3, 0.98), (0.2, 0.5)),
}


def timestep_range(schedule: str, progress: float, t_start: Range, t_end: Range) -> Range:
    """Range of t at ``progress``: ``t_start`` at 0, the first step, ``t_end`` at 1, the last; exact at both.

    ``paper`` moves both ends linearly in progress, ``official`` linearly in its square root.

    >>> timestep_range("paper", 0.0, (0.2, 0.98), (0.3, 0.5)), timestep_range("paper", 1.0, (0.2, 0.98), (0.3, 0.5))
    ((0.2, 0.98), (0.3, 0.5))
    >>> [round(t, 3) for t in timestep_range("paper", 0.25, (0.2, 0.98), (0.3, 0.5))]
    [0.225, 0.86]
    >>> [round(t, 3) for t in timestep_range("official", 0.25, (0.3, 0.98), (0.2, 0.5))]
    [0.25, 0.74]

    Raises:
        UsageError: an unknown schedule, progress outside [0, 1], or a range that is not 0 < low <= high <= 1.
    """
    if schedule not in PUBLISHED:
        raise UsageError(
            "schedule.unknown", f"there is no schedule '{schedule}'", f"choose one of {', '.join(PUBLISHED)}"
        )
    if not 0 <= progress <= 1:
        raise UsageError("schedule.progress", f"progress is {progress}", "give 0 to 1")
    for name, (low, high) in (("t_start", t_start), ("t_end", t_end)):
        if not 0 < low <= high <= 1:
            raise UsageError("schedule.range", f"{name} is ({low}, {high})", "give two numbers, 0 < low <= high <= 1")
    f = math.sqrt(progress) if schedule == "official" else progress
    low, high = ((1 - f) * start + f * end for start, end in zip(t_start, t_end, strict=True))
    return low, high


def falling_t(schedule: str, progress: float, t_start: Range, t_end: Range) -> float:
    """t that never rises: the top of ``t_start`` at progress 0, the bottom of ``t_end`` at 1 (DreamTime 2306.12422).

    ``paper`` moves it linearly; ``official`` linearly in the square root of progress, which is HiFA's annealing
    (2305.18766). DreamTime's own pace weighs the levels by constants found for one model's training schedule; here
    the range says how far, and the schedule how fast.

    >>> [round(falling_t("paper", p, (0.2, 0.98), (0.3, 0.5)), 3) for p in (0.0, 0.25, 1.0)]
    [0.98, 0.81, 0.3]

    Raises:
        UsageError: as :func:`timestep_range`.
    """
    timestep_range(schedule, progress, t_start, t_end)
    highest, lowest = t_start[1], t_end[0]
    return timestep_range(schedule, progress, (highest, highest), (lowest, lowest))[0]


def sample_t(bounds: Range, generator: torch.Generator) -> float:
    """One t ~ U(low, high), drawn on the CPU; shared by all views of a step (supp. A.2)."""
    low, high = bounds
    return low + (high - low) * torch.rand((), generator=generator, dtype=torch.float64).item()


def choose_t(guidance: GuidanceConfig, progress: float, generator: torch.Generator) -> float:
    """t of the step at ``progress``; ``generator`` is drawn from only where timesteps are random."""
    settings = guidance.schedule, progress, guidance.t_start, guidance.t_end
    if guidance.timesteps == "non-increasing":
        return falling_t(*settings)
    return sample_t(timestep_range(*settings), generator)


def with_scales(config: PaintConfig, own: float) -> PaintConfig:
    """``config`` with numbers where a scale is ``auto``: ``own``, the prior's, and for sampling at most 7.5 of it."""
    guidance, projection = config.guidance, config.projection
    if guidance.scale is None:
        guidance = dataclasses.replace(guidance, scale=own)
    if projection.scale is None:
        projection = dataclasses.replace(projection, scale=min(own, SAMPLING_SCALE))
    return dataclasses.replace(config, guidance=guidance, projection=projection)


def settled(scale: float | None) -> float:
    """``scale``, once :func:`with_scales` has seen to it that there is one."""
    if scale is None:
        raise ValueError("the scale is auto still")
    return scale


def choose_scale(guidance: GuidanceConfig, progress: float) -> float:
    """s of the step at ``progress``."""
    scale, end = settled(guidance.scale), guidance.scale_end
    return scale if end is None else scale + progress * (end - scale)
