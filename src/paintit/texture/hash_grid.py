"""Multiresolution hash grid and a small network: the feature-grid baseline (supp. B.1, after Mueller et al. 2022)."""

from __future__ import annotations

import itertools
import math
import warnings
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from paintit.config import TextureConfig
from paintit.texture.contract import TextureField

#: One factor for each coordinate in the spatial hash (Mueller et al. 2022, eq. 4).
PRIMES = (1, 2_654_435_761, 805_459_861)
#: Features start as U(-1, 1) times this (Mueller et al. 2022, section 4).
START = 1e-4


def resolutions(levels: int, base: int, finest: int) -> list[int]:
    """Cells along each side of every level, from ``base`` to ``finest`` by one factor, rounded down (eq. 2, 3)."""
    growth = (max(finest, base) / base) ** (1 / max(levels - 1, 1))
    return [int(base * growth**level + 1e-6) for level in range(levels)]


def rows(nodes: Tensor, resolution: int, table: int) -> Tensor:
    """Row of a level's table for grid nodes (..., d), whole numbers from 0 to ``resolution``: (...) int64.

    A level that has no more nodes than the table has rows gives each its own; a finer one shares them by the hash, the
    exclusive or of the coordinates times :data:`PRIMES`, modulo ``table`` (eq. 4).
    """
    coordinates = nodes.unbind(-1)
    if (resolution + 1) ** len(coordinates) <= table:
        index = torch.zeros_like(coordinates[0])
        for coordinate in coordinates:
            index = index * (resolution + 1) + coordinate
        return index
    mixed = coordinates[0] * PRIMES[0]
    for coordinate, prime in zip(coordinates[1:], PRIMES[1:], strict=False):
        mixed = mixed ^ (coordinate * prime)
    return mixed % table


def neighbours(points: Tensor, resolution: int, table: int) -> tuple[Tensor, Tensor]:
    """The corners of the cell that holds each of (n, d) points in [0, 1].

    Returns:
        (n, 2^d) rows of the level's table, and the weights of bilinear or trilinear interpolation, which sum to 1.
    """
    scaled = points.double() * resolution
    low = scaled.floor().clamp(0, resolution - 1)
    far = (scaled - low)[:, None]
    corners = torch.tensor(list(itertools.product((0, 1), repeat=points.shape[1])), device=points.device)
    weights = torch.where(corners.bool(), far, 1 - far).prod(-1)
    return rows(low.long()[:, None] + corners, resolution, table), weights.float()


def interpolate(table: Tensor, index: Tensor, weight: Tensor) -> Tensor:
    """(entries, c) -> (levels, n, c): the weighted sum of the rows in ``index``, both (levels, n, corners)."""
    return torch.stack(
        [(functional.embedding(i, table) * w[..., None]).sum(1) for i, w in zip(index, weight, strict=True)]
    )


class SparseInterpolation:
    """:func:`interpolate` as one sparse matrix, twenty times as quick where there is a library for them.

    The transpose that the backward pass needs is kept too: every row is then summed in a fixed order.
    """

    def __init__(self, index: Tensor, weight: Tensor, entries: int) -> None:
        self.shape = index.shape[:2]
        corners = index.shape[2]
        starts = torch.arange(0, index.numel() + 1, corners, dtype=torch.int32)
        self.matrix = _csr(starts, index.flatten(), weight.flatten(), (index.numel() // corners, entries))
        turned = self.matrix.to_sparse_csc()
        self.transpose = _csr(
            turned.ccol_indices(), turned.row_indices(), turned.values(), (entries, index.numel() // corners)
        )

    def __call__(self, table: Tensor) -> Tensor:
        product: Tensor = _Product.apply(self.matrix, self.transpose, table)  # pyright: ignore[reportAssignmentType]
        return product.view(*self.shape, -1)

    @staticmethod
    def helps(device: torch.device) -> bool:
        return device.type == "cpu" and torch.backends.mkl.is_available()


class _Product(torch.autograd.Function):
    """A fixed sparse matrix times a table, given its transpose."""

    @staticmethod
    def forward(ctx: Any, matrix: Tensor, transpose: Tensor, table: Tensor) -> Tensor:
        ctx.transpose = transpose
        return matrix @ table

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[None, None, Tensor]:
        return None, None, ctx.transpose @ gradients[0].contiguous()


def _csr(starts: Tensor, columns: Tensor, values: Tensor, shape: tuple[int, int]) -> Tensor:
    with warnings.catch_warnings():
        # torch says once that the layout is in beta. What is used of it is held against a plain twin by the tests.
        warnings.filterwarnings("ignore", ".*beta state", UserWarning)
        return torch.sparse_csr_tensor(starts, columns, values, shape, check_invariants=False)


class HashGrid(nn.Module):
    """Multiresolution hash encoding of fixed points (Mueller et al. 2022, section 3), in two or three dimensions.

    Where the points lie in which cell never changes, so it is found once and left out of the state.

    Args:
        points: (n, d) in [0, 1].
        finest: cells along each side of the finest level.
        copies: independent tables for the same points.
    """

    index: Tensor
    weight: Tensor

    def __init__(
        self, points: Tensor, finest: int, config: TextureConfig, generator: torch.Generator, *, copies: int = 1
    ) -> None:
        super().__init__()
        self.copies, self.features = copies, config.grid_features
        table = 2**config.grid_table
        index, weight, entries = [], [], 0
        for resolution in resolutions(config.grid_levels, config.grid_base, finest):
            row, w = neighbours(points, resolution, table)
            index.append((row + entries).int())
            weight.append(w)
            entries += min((resolution + 1) ** points.shape[1], table)
        self.register_buffer("index", torch.stack(index), persistent=False)
        self.register_buffer("weight", torch.stack(weight), persistent=False)
        start = 2 * torch.rand(entries, copies * self.features, generator=generator) - 1
        self.table = nn.Parameter(START * start)
        self._sparse: SparseInterpolation | None = None

    @property
    def outputs(self) -> int:
        """Features of one point over all levels."""
        return len(self.index) * self.features

    def forward(self) -> Tensor:
        """(copies, n, outputs)."""
        if SparseInterpolation.helps(self.table.device):
            if self._sparse is None:
                self._sparse = SparseInterpolation(self.index, self.weight, len(self.table))
            found = self._sparse(self.table)
        else:
            found = interpolate(self.table, self.index, self.weight)
        return found.unflatten(-1, (self.copies, self.features)).permute(2, 1, 0, 3).flatten(2)


class Perceptron(nn.Module):
    """Two hidden layers with ReLU, (n, inputs) -> (n, outputs). It starts as U(-1, 1) / sqrt(fan in)."""

    def __init__(self, inputs: int, hidden: int, outputs: int, generator: torch.Generator) -> None:
        super().__init__()
        widths = (inputs, hidden, hidden, outputs)
        self.weights, self.biases = nn.ParameterList(), nn.ParameterList()
        for fan_in, fan_out in itertools.pairwise(widths):
            both = (2 * torch.rand(fan_out, fan_in + 1, generator=generator) - 1) / math.sqrt(fan_in)
            self.weights.append(nn.Parameter(both[:, :-1].clone()))
            self.biases.append(nn.Parameter(both[:, -1].clone()))

    def forward(self, x: Tensor) -> Tensor:
        *inner, last = zip(self.weights, self.biases, strict=True)
        for weight, bias in inner:
            x = functional.relu(functional.linear(x, weight, bias), inplace=True)
        return functional.linear(x, *last)


class Grid(TextureField):
    """Features on a hash grid over the texture square, one table for each layer, and one small network (supp. B.1)."""

    def __init__(self, config: TextureConfig, layers: int, generator: torch.Generator) -> None:
        super().__init__(config)
        centres = (torch.arange(config.size) + 0.5) / config.size
        self.grid = HashGrid(torch.cartesian_prod(centres, centres), config.size, config, generator, copies=layers)
        self.network = Perceptron(self.grid.outputs, config.hidden, self.channels, generator)

    def predict(self) -> Tensor:
        size = self.config.size
        logits = self.network(self.grid().flatten(0, 1))
        return logits.view(-1, size, size, self.channels).permute(0, 3, 1, 2)
