"""A picture from noise: diffusion sampling under guidance, around what is known already.

Steps as in DDIM (Song 2021, eq. 12 and 16). Known pixels are put back, noised, before every step, as in RePaint
(Lugmayr 2022, algorithm 1) without its jumps: what is sampled grows onto what is there. It does so the better the more
noise is drawn anew on the way (eta): of two pixels that correlate by 0.9, one held at 1.5, the other should come out at
1.35 on average, and comes out at 0.66 without and at 0.9 with new noise.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

from paintit.errors import PriorError
from paintit.guidance.prior import Decoder, Prior, signal_and_noise


class SamplingPrior(Prior, Decoder, Protocol):
    """A prior that can be sampled and whose samples can be read: the type of what :func:`sampling_prior` lets pass."""


@dataclass(frozen=True)
class Known:
    """What a picture holds before it is sampled.

    Attributes:
        x: (n, c, h, w), encoded by the prior.
        free_below: (n, 1, h, w) the noise level from which on a pixel is left to the prior: 1 for one that is not known
            at all, 0 for one that stays as it is, between them for one that keeps its coarse look and gets new detail.
    """

    x: Tensor
    free_below: Tensor


def sampling_prior(prior: Prior, why: str) -> SamplingPrior:
    """``prior`` itself, if its samples can be put on a surface: it sees geometry, and can be decoded.

    Args:
        why: what needs it, for the message.

    Raises:
        PriorError: ``"prior.no_geometry"`` or ``"prior.no_decoder"``.
    """
    require_geometry(prior.spec.id, bool(prior.sees), why)
    if not isinstance(prior, Decoder):
        need = f"{why} samples views of the mesh, but the prior '{prior.spec.id}'"
        raise PriorError("prior.no_decoder", f"{need} cannot turn its samples into pictures", "choose --prior pocket")
    return prior  # type: ignore[return-value]


def require_geometry(id: str, sees: bool, why: str) -> None:
    """
    Args:
        id: of a prior, which need not be loaded.
        sees: whether it is shown the mesh.
        why: what needs that, for the message.

    Raises:
        PriorError: ``"prior.no_geometry"``.
    """
    if not sees:
        raise PriorError(
            "prior.no_geometry", f"{why} samples views of the mesh, but the prior '{id}' sees no geometry",
            "choose --prior pocket or sd2-depth, or show it the depth: --control depth",
        )  # fmt: skip


def noise_levels(start: float, steps: int) -> list[float]:
    """``steps`` + 1 levels of t, evenly from ``start`` to 0.

    >>> noise_levels(1.0, 4)
    [1.0, 0.75, 0.5, 0.25, 0.0]
    """
    return [start * (steps - index) / steps for index in range(steps)] + [0.0]


@torch.no_grad()
def sample(
    prior: SamplingPrior,
    noise: Tensor,
    text: Tensor,
    uncond: Tensor,
    geometry: Tensor | None,
    *,
    scale: float,
    steps: int,
    start: float = 0.99,
    known: Known | None = None,
    eta: float = 0.0,
    generator: torch.Generator | None = None,
) -> Tensor:
    """(n, c, h, w): a sample for each of n views.

    At each level t > 0, with x_t from the level before (``noise`` at first):

        x_t <- alpha x_known + sigma noise                        where t > free_below
        e   =  uncond + scale (cond - uncond)                     classifier-free guidance
        x_0 =  (x_t - sigma e) / alpha                            kept within the prior's bound
        x_t' = alpha' x_0 + (sigma'^2 - s^2)^1/2 e + s noise'     with e of that x_0
        s   =  eta sigma' / sigma (1 - alpha^2 / alpha'^2)^1/2

    Args:
        noise: (n, c, h, w) standard normal; with ``eta`` 0 it alone decides the sample.
        text: (n, ...) embeddings. uncond: (1, ...) or (n, ...) embeddings of the negative prompt.
        geometry: (n, ...) from ``prior.encode_geometry``.
        scale: s in uncond + s (cond - uncond); 1 asks for the conditional half alone.
        steps: noise levels, evenly spaced in t.
        start: the first of them, in (0, 1].
        known: what is there already; nothing where None.
        eta: share, 0 to 1, of the noise of ancestral sampling (DDPM) that is drawn anew at every step.
        generator: draws it, on the CPU; may be left out where ``eta`` is 0.
    """
    x = noise
    levels = noise_levels(start, steps)
    if known is not None:
        # What nobody wants changed above some level is not sampled there.
        highest = float(known.free_below.max())
        levels = [t for t in levels if t <= highest] or [0.0]
        if levels[0] < start:
            x = prior.add_noise(known.x, noise, levels[0])
    for t, following in itertools.pairwise(levels):
        if known is not None:
            x = torch.where(t > known.free_below, prior.add_noise(known.x, noise, t), x)
        epsilon = _guided(prior, x, t, text, uncond, geometry, scale)
        alpha, sigma = signal_and_noise(prior, x, t)
        clean = (x - sigma * epsilon) / alpha
        if math.isfinite(prior.bound):
            clean = clean.clamp(-prior.bound, prior.bound)
            epsilon = (x - alpha * clean) / sigma
        if following == 0:
            x = clean
            break
        ahead, rest = signal_and_noise(prior, x, following)
        fresh = eta * rest / sigma * math.sqrt(max(1 - (alpha / ahead) ** 2, 0))
        if fresh:
            noise = torch.randn(x.shape, generator=generator).to(x)
        x = ahead * clean + math.sqrt(rest**2 - fresh**2) * epsilon + fresh * noise
    return x if known is None else torch.where(known.free_below > 0, x, known.x)


def _guided(
    prior: Prior, x: Tensor, t: float, text: Tensor, uncond: Tensor, geometry: Tensor | None, scale: float
) -> Tensor:
    if scale == 1:
        return prior.predict_noise(x, t, text, geometry)
    both = prior.predict_noise(
        torch.cat([x, x]),
        t,
        torch.cat([uncond.expand_as(text), text]),
        None if geometry is None else torch.cat([geometry, geometry]),
    )
    without, with_text = both.chunk(2)
    return without + scale * (with_text - without)
