"""Depth as the models that see it were taught: from pictures, whose depth is known up to scale and shift."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional


def relative_disparity(depth: Tensor, mask: Tensor, size: int) -> Tensor:
    """(n, 1, size, size): 1 / depth of (n, h, w, 1), per view from 0 (farthest) to 1 (nearest) on the mask, -1 off it.

    The mesh takes the upper half of [-1, 1], so that it stands out from what is behind it. Even depth counts as nearest
    throughout. Resampled with area weights, so that an edge of the mask is soft.
    """
    on = mask > 0
    disparity = 1 / depth.clamp_min(1e-6)
    low = torch.where(on, disparity, torch.inf).amin((1, 2, 3), keepdim=True)
    high = torch.where(on, disparity, 0.0).amax((1, 2, 3), keepdim=True)
    share = torch.where(high - low > 1e-6, (disparity - low) / (high - low).clamp_min(1e-6), 1.0)
    image = torch.where(on, share, -1.0).permute(0, 3, 1, 2)
    return functional.interpolate(image, (size, size), mode="bilinear", antialias=True)
