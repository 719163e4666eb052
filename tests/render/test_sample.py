"""Mip pyramid and trilinear lookup."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from paintit.render import sample as sampling
from paintit.render.camera import look_at
from paintit.render.gbuffer import rasterize
from paintit.render.geometry import Geometry
from paintit.render.sample import (
    Pyramid,
    build_pyramid,
    contributions,
    level_of_detail,
    lookup,
    mip_levels,
    sample,
    take_rows,
)


def random_lookup(count: int, layers: int, seed: int = 0, dtype: torch.dtype = torch.float32):
    g = torch.Generator().manual_seed(seed)
    layer = torch.randint(layers, (count,), generator=g)
    uv = torch.rand(count, 2, generator=g, dtype=dtype) * 3 - 1
    footprint = torch.randn(count, 2, 2, generator=g, dtype=dtype) * torch.exp(
        torch.rand(count, 1, 1, generator=g, dtype=dtype) * 6 - 6
    )
    return layer, uv, footprint


@pytest.mark.parametrize("size", [(64, 64), (32, 64), (33, 50), (1, 1)])
def test_constant_texture_is_constant_at_every_level(size: tuple[int, int]) -> None:
    color = torch.tensor([0.2, 0.7, 0.5])
    maps = color.expand(2, *size, 3)
    for level in mip_levels(maps):
        torch.testing.assert_close(level, color.expand_as(level))
    found = sample(maps, *random_lookup(500, 2))
    torch.testing.assert_close(found, color.expand_as(found))


def test_levels_are_box_averages() -> None:
    maps = torch.rand(2, 16, 32, 4, generator=torch.Generator().manual_seed(0))
    levels = mip_levels(maps)
    assert [tuple(level.shape[1:3]) for level in levels] == [(16, 32), (8, 16), (4, 8), (2, 4), (1, 2)]
    torch.testing.assert_close(levels[2][1, 1, 3], maps[1, 4:8, 12:16].mean((0, 1)))


def ramp(layers: int = 1, size: int = 64) -> Pyramid:
    """A pyramid whose value is the level itself."""
    sizes = [(size >> i, size >> i) for i in range(size.bit_length())]
    texels = torch.cat([torch.full((layers * h * w, 1), float(i)) for i, (h, w) in enumerate(sizes)])
    return Pyramid(texels, tuple(sizes), layers)


@pytest.mark.parametrize("distance", [2.0, 3.25, 7.0, 20.0])
def test_level_on_a_plane_of_known_scale(plane, distance: float) -> None:
    geometry = Geometry.from_mesh(plane)
    fov, pixels, size = math.radians(45), 32, 64
    gbuffer = rasterize(geometry, look_at(torch.zeros(1), torch.zeros(1), distance, fov), pixels)
    found = lookup(ramp(size=size), gbuffer.layer, gbuffer.uv, gbuffer.footprint)[gbuffer.mask]
    # One pixel is 2 tan(fov/2) distance / pixels long; the square of edge 2 holds 64 texels.
    texels_per_pixel = 2 * math.tan(fov / 2) * distance / pixels / 2 * size
    expected = max(math.log2(texels_per_pixel), 0.0)
    assert expected < 6
    torch.testing.assert_close(found, torch.full_like(found, expected), atol=1e-3, rtol=0)


def test_longer_axis_decides() -> None:
    footprint = torch.tensor([[[4.0 / 64, 0], [0, 1.0 / 64]], [[0, 0.5 / 64], [0, 8.0 / 64]]])
    torch.testing.assert_close(level_of_detail(footprint, (64, 64)), torch.tensor([2.0, 3.0]))
    torch.testing.assert_close(level_of_detail(footprint, (64, 128)), torch.tensor([3.0, 3.0]))


def test_texel_centres_and_wrap() -> None:
    maps = torch.rand(3, 4, 8, 2, generator=torch.Generator().manual_seed(0))
    sharp = torch.zeros(1, 2, 2)
    row, column = 3, 6
    uv = torch.tensor([[(column + 0.5) / 8, (row + 0.5) / 4]])
    for shift in ([0.0, 0.0], [1.0, -2.0], [-3.0, 5.0]):
        found = sample(maps, torch.tensor([2]), uv + torch.tensor(shift), sharp)
        torch.testing.assert_close(found[0], maps[2, row, column])
    across = sample(maps, torch.tensor([1]), torch.tensor([[0.0, 0.5 / 4]]), sharp)
    torch.testing.assert_close(across[0], (maps[1, 0, 0] + maps[1, 0, 7]) / 2)


def test_against_a_plain_loop() -> None:
    maps = torch.rand(2, 16, 16, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    layer, uv, footprint = random_lookup(60, 2, dtype=torch.float64)
    levels = mip_levels(maps)

    def bilinear(image: Tensor, u: float, v: float) -> Tensor:
        height, width, _ = image.shape
        x, y = u * width - 0.5, v * height - 0.5
        total = torch.zeros(3, dtype=torch.float64)
        for i in (math.floor(y), math.floor(y) + 1):
            for j in (math.floor(x), math.floor(x) + 1):
                total += (1 - abs(x - j)) * (1 - abs(y - i)) * image[i % height, j % width]
        return total

    found = sample(maps, layer, uv, footprint)
    for k in range(60):
        longest = max((footprint[k, axis] * 16).norm().item() for axis in (0, 1))
        lod = min(max(math.log2(longest), 0), len(levels) - 1)
        low = min(int(lod), len(levels) - 2)
        u, v = uv[k].tolist()
        ends = [bilinear(levels[i][layer[k]], u, v) for i in (low, low + 1)]
        torch.testing.assert_close(found[k], torch.lerp(ends[0], ends[1], lod - low))


def test_gradients_against_finite_differences() -> None:
    maps = torch.rand(2, 8, 8, 2, generator=torch.Generator().manual_seed(0), dtype=torch.float64).requires_grad_()
    layer, uv, footprint = random_lookup(20, 2, dtype=torch.float64)
    assert torch.autograd.gradcheck(lambda m: sample(m, layer, uv, footprint), (maps,))
    assert torch.autograd.gradcheck(lambda x: sample(maps.detach(), layer, x, footprint), (uv.requires_grad_(),))


def test_gradient_of_rows_is_the_embeddings(monkeypatch: pytest.MonkeyPatch) -> None:
    """Taken twice or never, in more blocks than one, the last one short."""
    monkeypatch.setattr(sampling, "_BLOCK", 7)
    generator = torch.Generator().manual_seed(0)
    index = torch.randint(9, (4, 5), generator=generator)
    weight = torch.randn(4, 5, 3, generator=generator)
    gradients = []
    for take in (take_rows, lambda table, index: torch.nn.functional.embedding(index, table)):
        table = torch.rand(12, 3, generator=torch.Generator().manual_seed(1)).requires_grad_()
        taken = take(table, index)
        assert torch.equal(taken, table[index])
        gradients.append(torch.autograd.grad((taken * weight).sum(), table)[0])
    torch.testing.assert_close(*gradients)


def test_backward_is_deterministic_with_threads() -> None:
    layer, uv, footprint = random_lookup(60_000, 2)
    weight = torch.randn(60_000, 8, generator=torch.Generator().manual_seed(1))

    def gradient() -> Tensor:
        maps = torch.rand(2, 128, 128, 8, generator=torch.Generator().manual_seed(0)).requires_grad_()
        (sample(maps, layer, uv, footprint) * weight).sum().backward()
        assert maps.grad is not None
        return maps.grad

    threads = torch.get_num_threads()
    try:
        torch.set_num_threads(2)
        first, second = gradient(), gradient()
        torch.set_num_threads(1)
        single = gradient()
    finally:
        torch.set_num_threads(threads)
    assert torch.equal(first, second)
    assert torch.equal(first, single)


def test_one_pyramid_serves_many_lookups() -> None:
    maps = torch.rand(2, 8, 8, 2)
    request = random_lookup(10, 2)
    assert torch.equal(lookup(build_pyramid(maps), *request), sample(maps, *request))


def test_contributions_are_the_transposed_lookup() -> None:
    """Each lookup hands out a weight of 1; a sharp one to four texels, a blurred one to a block; layers stay apart."""
    layer = torch.tensor([0, 1])
    uv = torch.tensor([[0.25, 0.5], [0.25, 0.5]])
    footprint = torch.eye(2).expand(2, 2, 2) * torch.tensor([1 / 32, 4 / 16])[:, None, None]
    weight = contributions((2, 16, 16), layer, uv, footprint)
    torch.testing.assert_close(weight.sum((1, 2)), torch.ones(2))
    assert int((weight[0] > 0).sum()) == 4
    assert int((weight[1] > 0).sum()) == 64
    maps = torch.rand(2, 16, 16, 1, generator=torch.Generator().manual_seed(0))
    torch.testing.assert_close((maps[..., 0] * weight).sum(), sample(maps, layer, uv, footprint).sum())
