"""How far a handful of vectors agree: singular values of the matrix that they are the rows of (supp. A.2)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor


@dataclass(frozen=True)
class Agreement:
    """Of n vectors.

    Attributes:
        singular: n singular values, the largest first.
        ratios: each over the smallest, as the paper gives them; empty where the rank is less than n, since the smallest
            is then rounding alone.
        rank: how many are above rounding.
        effective_rank: (sum s^2)^2 / sum s^4: 1 where all vectors are multiples of one, n where they are orthogonal and
            equally long. Unlike the ratios it does not hang on the smallest value.
        cosine: mean cosine over all pairs.
    """

    singular: tuple[float, ...]
    ratios: tuple[float, ...]
    rank: int
    effective_rank: float
    cosine: float


def agreement(rows: Tensor) -> Agreement:
    """The agreement of ``rows`` (n, f), float32, n at least 2.

    Raises:
        ValueError: all are zero.
    """
    exact = rows.double()
    singular = torch.linalg.svdvals(exact)
    if not singular[0] > 0:
        raise ValueError("all rows are zero")
    # The entries are float32: differences below their rounding say nothing.
    rank = int((singular > singular[0] * len(rows) * torch.finfo(torch.float32).eps).sum())
    power = singular.square()
    unit = F.normalize(exact, dim=1)
    above = torch.ones(len(rows), len(rows)).triu(1).bool()
    return Agreement(
        singular=tuple(singular.tolist()),
        ratios=tuple((singular / singular[-1]).tolist()) if rank == len(rows) else (),
        rank=rank,
        effective_rank=float(power.sum().square() / power.square().sum()),
        cosine=float((unit @ unit.T)[above].mean()),
    )
