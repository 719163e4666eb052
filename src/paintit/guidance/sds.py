"""Score distillation sampling (eq. 1 and 3): a rendered image in, a gradient out. No mesh, no optimizer."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from paintit.guidance.prior import Prior


@dataclass(frozen=True)
class SdsRecord:
    """What one call did, for the log. There is no loss to show: the gradient is injected."""

    t: float
    """Noise level, the fraction of the prior's training schedule."""
    weight: float
    """m(t) of eq. 1."""
    gradient_norm: float
    """L2 norm of the gradient over all views."""
    text_norm: float
    """L2 norm of cond - uncond over all views; 0 where the scale is 1 and the unconditional half is not computed."""
    nonfinite: int
    """Entries of the prediction that were NaN or infinite; their gradient is 0. Many: the prior overflows."""


@torch.no_grad()
def sds_gradient(
    prior: Prior,
    x: Tensor,
    text: Tensor,
    uncond: Tensor,
    t: float,
    noise: Tensor,
    scale: float,
    geometry: Tensor | None = None,
) -> tuple[Tensor, SdsRecord]:
    """m(t) (epsilon-hat - epsilon), the gradient of eq. 1 on the encoded image ``x``.

    Classifier-free guidance is epsilon-hat = uncond + ``scale`` (cond - uncond). The gradient is that of the sum over
    views, as in the official script: it is not divided by their number or by the pixels.

    Args:
        x: (n, c, h, w) from ``prior.encode_image``; its own gradient is not touched.
        text: (n, ...) embeddings, one per view.
        uncond: (1, ...) or (n, ...) embeddings of the negative prompt.
        t: noise level in (0, 1], one for all views.
        noise: epsilon, (1, c, h, w) shared by all views (supp. A.2) or (n, c, h, w).
        geometry: (n, ...) from ``prior.encode_geometry``.

    Returns:
        (n, c, h, w) gradient, to be handed to ``x.backward``; and the record.
    """
    noise = noise.to(x).expand_as(x)
    x_t = prior.add_noise(x.detach(), noise, t)
    if scale == 1:
        predicted, text_norm = prior.predict_noise(x_t, t, text, geometry), 0.0
    else:
        both = prior.predict_noise(
            torch.cat([x_t, x_t]),
            t,
            torch.cat([uncond.expand_as(text), text]),
            None if geometry is None else torch.cat([geometry, geometry]),
        )
        without, with_text = both.chunk(2)
        direction = with_text - without
        predicted, text_norm = without + scale * direction, norm(direction)
    finite = predicted.isfinite()
    weight = prior.weight(t)
    gradient = torch.where(finite, weight * (predicted - noise), 0.0)
    record = SdsRecord(t, weight, norm(gradient), text_norm, int((~finite).sum()))
    return gradient, record


def norm(x: Tensor) -> float:
    """L2 norm, summed in float64; NaN and infinite entries count as 0."""
    return torch.nan_to_num(x.double(), nan=0.0, posinf=0.0, neginf=0.0).norm().item()
