"""Texture lookup: a mip pyramid and trilinear filtering over all layers at once, wrap = repeat.

Differentiable in the texels (and in uv). The backward pass is deterministic whatever the thread count, see
:func:`take_rows`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
import torch.nn.functional as F
from torch import Tensor

#: Rows whose gradients are added at once, so that their indices take little memory.
_BLOCK = 1 << 18


@dataclass(frozen=True)
class Pyramid:
    """All mip levels of all layers as one table of texels.

    Attributes:
        texels: (t, c), levels from fine to coarse, in each the layers, in each the rows.
        sizes: (height, width) of each level.
        layers: number of layers.
    """

    texels: Tensor
    sizes: tuple[tuple[int, int], ...]
    layers: int


class _TakeRows(torch.autograd.Function):
    """Rows of a table, whose gradient is summed in the order of the indices by one thread: on the CPU that is several
    times quicker than ``embedding``, whose threads each walk through all indices."""

    @staticmethod
    def forward(ctx: Any, table: Tensor, index: Tensor) -> Tensor:
        ctx.save_for_backward(index)
        ctx.shape = table.shape
        return F.embedding(index, table)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        (index,), (gradient,) = ctx.saved_tensors, gradients
        count, width = ctx.shape
        total = gradient.new_zeros(count * width)
        # Along one axis index_add is a plain loop; along the rows of a matrix it is a call for each row.
        for at, values in zip(index.flatten().split(_BLOCK), gradient.reshape(-1, width).split(_BLOCK), strict=True):
            total.index_add_(0, (at[:, None] * width + torch.arange(width)).flatten(), values.flatten())
        return total.view(count, width), None


def take_rows(table: Tensor, index: Tensor) -> Tensor:
    """``table[index]``, (t, c) and (...) -> (..., c), with a deterministic backward pass on every device."""
    if index.device.type == "cpu":
        return _TakeRows.apply(table, index)  # type: ignore[return-value]
    return F.embedding(index, table)


def mip_levels(maps: Tensor) -> list[Tensor]:
    """(layers, h, w, c) -> every level from the map itself to a single row or column, each averaged 2 x 2.

    An odd side is halved and rounded down by equal windows that share texels, so that a constant stays constant.
    """
    level = maps.movedim(-1, 1)
    levels = [level]
    while min(level.shape[-2:]) > 1:
        height, width = level.shape[-2:]
        even = height % 2 == 0 and width % 2 == 0
        level = F.avg_pool2d(level, 2) if even else F.adaptive_avg_pool2d(level, (height // 2, width // 2))
        levels.append(level)
    return [level.movedim(1, -1) for level in levels]


def build_pyramid(maps: Tensor) -> Pyramid:
    """The pyramid of (layers, h, w, c) maps; build once where several lookups read the same maps."""
    levels = mip_levels(maps)
    texels = torch.cat([level.reshape(-1, maps.shape[-1]) for level in levels])
    return Pyramid(texels, tuple((level.shape[1], level.shape[2]) for level in levels), maps.shape[0])


def level_of_detail(footprint: Tensor, size: tuple[int, int]) -> Tensor:
    """(...) mip level, not clamped: log2 of the longer side of the footprint (..., 2, 2), in texels of level 0."""
    height, width = size
    texels = footprint * footprint.new_tensor([width, height])
    return 0.5 * torch.log2(texels.square().sum(-1).amax(-1).clamp_min(1e-20))


def lookup(pyramid: Pyramid, layer: Tensor, uv: Tensor, footprint: Tensor) -> Tensor:
    """Trilinear (..., c) values.

    Args:
        pyramid: of c channels.
        layer: (...) int64.
        uv: (..., 2), origin top left; texel centres are at half-integers over the size.
        footprint: (..., 2, 2) uv steps per pixel, see :class:`paintit.render.gbuffer.GBuffer`.
    """
    count, device = len(pyramid.sizes), uv.device
    heights, widths = torch.tensor(pyramid.sizes, device=device).T
    starts = F.pad((heights * widths * pyramid.layers).cumsum(0), (1, -1))
    lod = level_of_detail(footprint, pyramid.sizes[0]).clamp(0, count - 1)
    fine = lod.floor().long().clamp_max(max(count - 2, 0))
    level = torch.stack([fine, (fine + 1).clamp_max(count - 1)], -1)
    share = (lod - fine)[..., None].to(uv)
    level_weight = torch.cat([1 - share, share], -1)

    height, width = heights[level], widths[level]
    x = uv[..., :1] * width - 0.5
    y = uv[..., 1:] * height - 0.5
    left, top = x.detach().floor(), y.detach().floor()
    columns = torch.stack([left, left + 1], -1).long() % width[..., None]
    rows = torch.stack([top, top + 1], -1).long() % height[..., None]
    column_weight = torch.stack([left + 1 - x, x - left], -1)
    row_weight = torch.stack([top + 1 - y, y - top], -1) * level_weight[..., None]
    base = starts[level] + layer[..., None] * height * width
    index = base[..., None, None] + rows[..., :, None] * width[..., None, None] + columns[..., None, :]
    weight = row_weight[..., :, None] * column_weight[..., None, :]
    shape = uv.shape[:-1]
    texels = take_rows(pyramid.texels, index.reshape(*shape, 8))
    return (texels * weight.reshape(*shape, 8, 1).to(texels)).sum(-2)


def sample(maps: Tensor, layer: Tensor, uv: Tensor, footprint: Tensor) -> Tensor:
    """:func:`lookup` in the pyramid of ``maps`` (layers, h, w, c)."""
    return lookup(build_pyramid(maps), layer, uv, footprint)


def contributions(size: tuple[int, int, int], layer: Tensor, uv: Tensor, footprint: Tensor) -> Tensor:
    """(layers, h, w) the weight of each texel in all lookups together: their transpose applied to ones.

    Every lookup hands out a weight of 1 in all, spread over a mip level's texels where the footprint is large.

    Args:
        size: (layers, h, w) of the maps that would be sampled.
        layer, uv, footprint: as in :func:`lookup`.
    """
    with torch.enable_grad():
        maps = torch.zeros(*size, 1, device=uv.device, requires_grad=True)
        (weight,) = torch.autograd.grad(sample(maps, layer, uv, footprint).sum(), maps)
    return weight[..., 0]
