"""Energy of a texture in five rings of its spectrum, and the step at which a ring has risen (paper 4.1, supp. A.3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

#: Rings around the centre of the spectrum (supp. A.3).
RINGS = 5
#: Radius of the outermost ring in cycles per texel: the highest frequency along an axis. The corners of the spectrum,
#: which only diagonal waves reach, belong to no ring.
NYQUIST = 0.5


@dataclass(frozen=True)
class Bands:
    """What a texture holds in each ring, from the lowest frequencies to the highest.

    The transform is orthonormal, so the figures do not depend on the texture's size: white noise of variance v has a
    mean power of v in every ring.

    Attributes:
        magnitude: mean absolute value of the ring's coefficients.
        power: mean square of them.
    """

    magnitude: tuple[float, ...]
    power: tuple[float, ...]


def ring_edges(rings: int = RINGS) -> tuple[float, ...]:
    """``rings`` + 1 radii in cycles per texel, equally far apart, from 0 to :data:`NYQUIST`."""
    return tuple(NYQUIST * i / rings for i in range(rings + 1))


def ring_index(height: int, width: int, rings: int = RINGS) -> Tensor:
    """(height, width) int64: the ring of each coefficient of ``fft2``, -1 for those of none.

    A ring holds its outer edge and not its inner one. So the mean (radius 0) is in none: it is brightness, not a
    frequency, and its square would outweigh all other coefficients of the first ring together.
    """
    radius = torch.hypot(
        torch.fft.fftfreq(height, dtype=torch.float64)[:, None], torch.fft.fftfreq(width, dtype=torch.float64)
    )
    # An edge such as 0.3 is not a binary fraction: a radius this close to it is on it.
    index = (radius * (rings / NYQUIST) - 1e-9).ceil().long() - 1
    return torch.where(index < rings, index, -1)


def band_energy(image: Tensor, rings: int = RINGS) -> Bands:
    """Mean magnitude and power of each ring, over layers and channels.

    Args:
        image: (layers, h, w, c). No window is applied: a texture repeats, so its opposite borders are neighbours.
    """
    spectrum = torch.fft.fft2(image.detach().to("cpu", torch.float64), dim=(1, 2), norm="ortho").abs()
    index = ring_index(image.shape[1], image.shape[2], rings)
    found = [spectrum[:, index == ring] for ring in range(rings)]
    return Bands(tuple(float(a.mean()) for a in found), tuple(float(a.square().mean()) for a in found))


def settles(steps: Sequence[float], values: Sequence[float], level: float) -> float | None:
    """The step from which on ``values`` are never below ``level`` again, interpolated linearly between records.

    For values that only rise it is the first step on ``level``. A random network starts with energy that has nothing to
    do with what it learns, loses it, and rises anew: only the second rise counts.

    >>> settles([0, 10, 20], [0.0, 2.0, 4.0], 3.0)
    15.0
    >>> settles([0, 10, 20], [9.0, 0.0, 4.0], 2.0)
    15.0

    Returns:
        the first step where they are never below ``level``; None where the last of them is.
    """
    below = [i for i, value in enumerate(values) if value < level]
    if not below:
        return float(steps[0])
    i = below[-1]
    if i == len(values) - 1:
        return None
    share = (level - values[i]) / (values[i + 1] - values[i])
    return float(steps[i] + share * (steps[i + 1] - steps[i]))


def half_rise(steps: Sequence[float], energy: Sequence[float]) -> float | None:
    """The step from which on ``energy`` is at least half of its last value."""
    return settles(steps, energy, energy[-1] / 2)
