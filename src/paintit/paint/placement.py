"""Where a prior that knows places is told that the object lies.

The pocket prior draws a pattern where it lay in training. So that another seed is another pattern, each seed tells it
of the object in a frame of its own: mirrored or not, and moved a little along and across. Nothing else sees that frame.
"""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor

from paintit.rng import uniform

#: Largest move along x and z, in units of half the object's longest edge. The height stays, since feet are below.
REACH = 0.15


class Placement:
    """A mirror in x and a shift, drawn once.

    Args:
        generator: draws them; None leaves everything where it is.
    """

    def __init__(self, generator: torch.Generator | None) -> None:
        self.flip, self.shift = torch.ones(3), torch.zeros(3)
        if generator is not None:
            if float(torch.rand((), generator=generator)) < 0.5:
                self.flip[0] = -1
            self.shift[[0, 2]] = uniform(-REACH, REACH, 2, generator)

    def __call__(self, channels: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """The geometry channels with ``position`` and ``normal_object`` (n, h, w, 3) in the seed's frame."""
        placed = dict(channels)
        if "position" in placed:
            position = placed["position"]
            placed["position"] = (position * self.flip.to(position) + self.shift.to(position)) * placed["mask"]
            placed["normal_object"] = placed["normal_object"] * self.flip.to(position)
        return placed
