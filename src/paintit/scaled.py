"""``NAME[:scale]``, the way in which additions to a prior are written: LoRAs, pictures, ControlNets. No torch."""

from __future__ import annotations

import math

from paintit.errors import UsageError


def scaled(text: str, setting: str) -> tuple[str, float]:
    """The name and the scale, 1 where none is written. What follows the last colon is the scale, unless it is a path.

    Args:
        text: such as ``style.safetensors:0.8``.
        setting: dotted name of the setting, for the error.

    Raises:
        UsageError: no name, or a scale that is not a finite number.
    """
    name, colon, tail = text.rpartition(":")
    if not colon or "/" in tail or "\\" in tail:
        name, tail = text, "1"
    try:
        scale = float(tail)
    except ValueError:
        scale = math.nan
    if not name.strip() or not math.isfinite(scale):
        raise UsageError("config.value", f'{setting} is "{text}"', "write NAME or NAME:SCALE, the scale a number")
    return name, scale
