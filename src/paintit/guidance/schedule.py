"""Which noise levels are sampled when: the timestep range as a pure function of progress (supp. A.2)."""

from __future__ import annotations

import math

import torch

from paintit.errors import UsageError

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


def sample_t(bounds: Range, generator: torch.Generator) -> float:
    """One t ~ U(low, high), drawn on the CPU; shared by all views of a step (supp. A.2)."""
    low, high = bounds
    return low + (high - low) * torch.rand((), generator=generator, dtype=torch.float64).item()
