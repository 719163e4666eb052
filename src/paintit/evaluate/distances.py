"""Distances between two sets of pictures, from their features (n, d). FID and KID are torchmetrics' own."""

from __future__ import annotations

import warnings
from typing import Any

import torch
from torch import Tensor, nn

from paintit.errors import PaintitError

#: Pictures in each of KID's subsets, and how many subsets, as torchmetrics' defaults.
SUBSET, SUBSETS = 1000, 100
#: Bandwidth and scale of CMMD as published.
_BANDWIDTH, _SCALE = 10.0, 1000.0


class _Given(nn.Module):
    """Hands features through where torchmetrics asks for a network."""

    def __init__(self, features: int) -> None:
        super().__init__()
        self.num_features = features

    def forward(self, features: Tensor) -> Tensor:
        return features


def fid(real: Tensor, made: Tensor) -> float:
    """Frechet distance of the Gaussians fitted to both sets (Heusel et al. 2017), by ``torchmetrics``.

    ``|m_r - m_g|^2 + tr(S_r + S_g - 2 (S_r S_g)^(1/2))``, in double precision. It is biased upward for small sets, the
    more the fewer pictures: compare only figures of equally many.

    Args:
        real, made: (n, d) and (m, d) features, at least two of each.
    """
    _check(real, made)
    _require_extra()
    from torchmetrics.image.fid import FrechetInceptionDistance

    return float(_fed(FrechetInceptionDistance(_Given(real.shape[1])), real, made))


def kid(real: Tensor, made: Tensor) -> float:
    """Unbiased squared MMD under the kernel ``(x.y / d + 1)^3`` (Binkowski et al. 2018), by ``torchmetrics``.

    The mean over random subsets of up to a thousand pictures; where both sets are one subset, exact. Expected to be 0
    for two halves of one set, whatever their size, and so slightly negative now and then.

    Args:
        real, made: (n, d) and (m, d) features, at least two of each.
    """
    _check(real, made)
    _require_extra()
    from torchmetrics.image.kid import KernelInceptionDistance

    size = min(len(real), len(made), SUBSET)
    once = len(real) == len(made) == size
    with warnings.catch_warnings(), torch.random.fork_rng(devices=[]):
        warnings.filterwarnings("ignore", message="Metric `Kernel Inception Distance` will save")
        torch.manual_seed(0)  # subsets are drawn from torch's own generator
        metric = KernelInceptionDistance(_Given(real.shape[1]), subsets=1 if once else SUBSETS, subset_size=size)
        return float(_fed(metric, real, made)[0])


def cmmd(real: Tensor, made: Tensor) -> float:
    """CLIP maximum mean discrepancy (Jayasumana et al. 2024): ``1000 MMD^2`` of unit embeddings, Gaussian kernel of
    bandwidth 10, the biased estimator that the authors use. Theirs reads CLIP ViT-L/14 at 336 pixels.

    Args:
        real, made: (n, d) and (m, d) image embeddings.
    """
    _check(real, made)
    real, made = (nn.functional.normalize(x.double(), dim=-1) for x in (real, made))
    kernel = lambda x, y: (torch.cdist(x, y).square() / (-2 * _BANDWIDTH**2)).exp().mean()  # noqa: E731
    return float(_SCALE * (kernel(real, real) + kernel(made, made) - 2 * kernel(real, made)))


def _fed(metric: Any, real: Tensor, made: Tensor) -> Any:
    metric.update(real.double(), real=True)
    metric.update(made.double(), real=False)
    return metric.compute()


def _check(real: Tensor, made: Tensor) -> None:
    if min(len(real), len(made)) < 2 or real.shape[1] != made.shape[1]:
        raise PaintitError(
            "evaluate.features", f"features of {tuple(real.shape)} and {tuple(made.shape)} cannot be compared",
            "give at least two pictures of each set, read by the same network",
        )  # fmt: skip


def _require_extra() -> None:
    try:
        import torchmetrics  # noqa: F401
    except ImportError:
        raise PaintitError(
            "evaluate.extra", "FID and KID need torchmetrics", "install it: pip install 'paintit[evaluate]'"
        ) from None
