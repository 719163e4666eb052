"""Hash grids: the encoding by hand, its twin, gradients, and what the two kinds made of it can hold."""

from __future__ import annotations

import dataclasses
import math

import pytest
import torch
from torch import Tensor

from paintit.color import encode_srgb
from paintit.config import TextureConfig
from paintit.errors import UsageError
from paintit.texture.field import make_field
from paintit.texture.hash_grid import (
    Grid,
    HashGrid,
    SparseInterpolation,
    interpolate,
    neighbours,
    resolutions,
    rows,
)
from paintit.texture.points import Points

SMALL = TextureConfig(kind="hash-grid", size=32, grid_levels=6, grid_table=8, grid_base=4, hidden=16)


def seeded(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def sphere(size: int) -> Tensor:
    """(1, size, size, 3) points of a unit sphere by longitude and latitude; the corner texels are off the surface."""
    v, u = torch.meshgrid(*2 * [(torch.arange(size) + 0.5) / size], indexing="ij")
    longitude, latitude = 2 * math.pi * u, math.pi * (v - 0.5)
    ring = latitude.cos()
    points = torch.stack([ring * longitude.sin(), latitude.sin(), ring * longitude.cos()], -1)[None]
    points[:, :2, :2] = math.nan
    return points


def test_levels_grow_by_one_factor_to_the_finest() -> None:
    assert resolutions(5, 16, 256) == [16, 32, 64, 128, 256]
    found = resolutions(16, 16, 512)
    assert (found[0], found[1], found[-1], len(found)) == (16, 20, 512, 16)  # 16 * 32^(1/15) = 20.16
    assert resolutions(1, 16, 512) == [16]
    assert resolutions(3, 16, 8) == [16, 16, 16]


def test_rows_by_hand() -> None:
    nodes = torch.tensor([[0, 0], [2, 3], [3, 3]])
    assert rows(nodes, 3, 16).tolist() == [0, 2 * 4 + 3, 15]
    # 4^2 nodes are too many for 8 rows: 2 xor 3 * 2654435761, modulo 8, is 2 xor 3 (2654435761 mod 8 is 1).
    assert rows(nodes, 3, 8).tolist() == [0, 2 ^ 3, 3 ^ 3]
    # 805459861 mod 8 is 5
    assert rows(torch.tensor([[1, 2, 3]]), 3, 8).tolist() == [1 ^ 2 ^ (3 * 5 % 8)]


def test_interpolation_by_hand() -> None:
    index, weight = neighbours(torch.tensor([[0.375, 0.8], [1.0, 0.0]]), 2, 16)  # 0.75 and 1.6 of cells
    assert index.tolist() == [[1, 2, 4, 5], [3, 4, 6, 7]]  # 3 x 3 nodes, row by row
    assert weight[0].tolist() == pytest.approx([0.25 * 0.4, 0.25 * 0.6, 0.75 * 0.4, 0.75 * 0.6])
    assert weight[1].tolist() == [0, 0, 1, 0], "the end of the square is the last node"
    table = torch.arange(9.0)[:, None] ** 2
    found = interpolate(table, index[None], weight[None])
    assert found[0, 0, 0].item() == pytest.approx(0.1 * 1 + 0.15 * 4 + 0.3 * 16 + 0.45 * 25)


def test_three_dimensions_by_hand() -> None:
    index, weight = neighbours(torch.tensor([[0.25, 0.5, 1.0]]), 1, 16)
    assert index.tolist() == [[0, 1, 2, 3, 4, 5, 6, 7]]
    assert weight[0].tolist() == pytest.approx([0, 0.375, 0, 0.375, 0, 0.125, 0, 0.125])


def test_a_linear_function_is_interpolated_exactly() -> None:
    points = torch.rand(200, 2, generator=seeded())
    index, weight = neighbours(points, 5, 64)
    nodes = torch.cartesian_prod(torch.arange(6), torch.arange(6)) / 5
    plane = (nodes @ torch.tensor([2.0, -3.0]))[:, None]
    found = interpolate(plane, index[None], weight[None])[0, :, 0]
    torch.testing.assert_close(found, points @ torch.tensor([2.0, -3.0]))


@pytest.mark.skipif(not SparseInterpolation.helps(torch.device("cpu")), reason="torch has no sparse library here")
def test_the_sparse_product_is_the_interpolation() -> None:
    grid = HashGrid(torch.rand(300, 3, generator=seeded()), 32, SMALL, seeded(1), copies=2)
    table = torch.randn(grid.table.shape, generator=seeded(2), requires_grad=True)
    sparse = SparseInterpolation(grid.index, grid.weight, len(table))(table)
    plain = interpolate(table, grid.index, grid.weight)
    torch.testing.assert_close(sparse, plain)
    direction = torch.randn(plain.shape, generator=seeded(3))
    wanted, got = (torch.autograd.grad((x * direction).sum(), table)[0] for x in (plain, sparse))
    torch.testing.assert_close(got, wanted)


@pytest.mark.parametrize("kind", ["hash-grid", "points"])
def test_gradients_are_finite_differences(kind: str) -> None:
    config = dataclasses.replace(SMALL, kind=kind, size=8, grid_levels=3, grid_table=6)
    field = make_field(config, 1, seeded(), sphere(8)).double()
    assert isinstance(field, Grid | Points)
    field.grid.table.data *= 1e4  # features of order 1
    direction = torch.randn(1, 8, 8, 8, generator=seeded(1), dtype=torch.float64)

    def value() -> Tensor:
        return (field().packed() * direction).sum()

    value().backward()
    for parameter in field.parameters():
        assert parameter.grad is not None
        at = tuple((parameter.grad.abs() == parameter.grad.abs().max()).nonzero()[0].tolist())
        with torch.no_grad():
            here, step = parameter[at].item(), 1e-6
            parameter[at] = here + step
            above = value().item()
            parameter[at] = here - step
            below = value().item()
            parameter[at] = here
        assert parameter.grad[at].item() == pytest.approx((above - below) / (2 * step), rel=1e-5)


@pytest.mark.parametrize("kind", ["hash-grid", "points"])
def test_gradients_are_the_same_twice(kind: str) -> None:
    grads = []
    for _ in range(2):
        field = make_field(dataclasses.replace(SMALL, kind=kind), 1, seeded(), sphere(32))
        field().packed().square().sum().backward()
        grads.append([p.grad for p in field.parameters()])
    assert all(p.abs().max() > 0 for p in grads[0])
    assert all(torch.equal(p, q) for p, q in zip(*grads, strict=True))


def fitted(kind: str, table: int) -> float:
    """PSNR in dB over covered texels after fitting waves in space, with 2 to ``table`` rows at each level."""
    points = sphere(32)
    covered = points.isfinite().all(-1)
    target = 0.5 + 0.4 * torch.sin(3 * points + torch.tensor([0.0, 1.0, 2.0]))
    field = make_field(dataclasses.replace(SMALL, kind=kind, grid_table=table), 1, seeded(), points)
    optimizer = torch.optim.Adam(field.parameters(), lr=0.02)
    error = torch.tensor(math.nan)
    for _ in range(80):
        error = (encode_srgb(field().base_color) - target)[covered].square().mean()
        optimizer.zero_grad()
        error.backward()
        optimizer.step()
    return -10 * math.log10(error.item())


@pytest.mark.parametrize("kind", ["hash-grid", "points"])
def test_a_smooth_texture_is_fitted(kind: str) -> None:
    assert fitted(kind, 12) > 30


def test_a_table_too_small_fits_worse() -> None:
    """16 rows for over a thousand texels: shared features must show, or the table is not what holds the picture."""
    assert fitted("hash-grid", 4) < 22


def test_layers_have_tables_of_their_own() -> None:
    field = make_field(SMALL, 2, seeded())
    assert isinstance(field, Grid)
    with torch.no_grad():
        field.grid.table.mul_(1e4)
    first, second = field().packed()
    assert not torch.allclose(first, second, atol=1e-3)
    with torch.no_grad():
        field.grid.table[:, SMALL.grid_features :] += 1.0
    assert torch.equal(field().packed()[0], first)


def test_texels_at_one_place_agree_across_a_seam() -> None:
    """Two islands that show the same surface, one mirrored, and a second layer that shows it too."""
    half = sphere(32)[0, :, :16].nan_to_num(0.5)
    points = torch.stack([torch.cat([half, half.flip(1)], 1), torch.cat([half, half], 1)])
    field = make_field(dataclasses.replace(SMALL, kind="points"), 2, seeded(), points)
    assert isinstance(field, Points)
    with torch.no_grad():
        field.grid.table.mul_(1e4)
    maps = field().packed()
    assert maps[0, :, :16, 0].std() > 0.001
    torch.testing.assert_close(maps[0, :, :16], maps[0, :, 16:].flip(1))
    torch.testing.assert_close(maps[0, :, :16], maps[1, :, 16:])


def test_texels_off_the_surface_are_mid_grey_and_get_no_gradient() -> None:
    field = make_field(dataclasses.replace(SMALL, kind="points"), 1, seeded(), sphere(32))
    maps = field()
    assert maps.metallic[0, :2, :2].tolist() == [[[0.5], [0.5]]] * 2
    assert (maps.metallic[0, 2:] != 0.5).all()
    maps.packed()[0, :2, :2].sum().backward()
    assert all(p.grad is not None and p.grad.abs().max() == 0 for p in field.parameters())


@pytest.mark.parametrize("kind", ["hash-grid", "points"])
def test_what_never_changes_is_left_out_of_the_state(kind: str) -> None:
    field = make_field(dataclasses.replace(SMALL, kind=kind), 1, seeded(), sphere(32))
    assert set(field.state_dict()) == {name for name, _ in field.named_parameters()}


@pytest.mark.parametrize(
    ("change", "points", "code", "value"),
    [
        ({"grid_levels": 0}, sphere(32), "texture.grid", "grid_levels is 0"),
        ({"hidden": -1}, sphere(32), "texture.grid", "hidden is -1"),
        ({"kind": "points"}, None, "texture.points", "no surface"),
        ({"kind": "points"}, sphere(16), "texture.points", "(1, 16, 16, 3)"),
        ({"kind": "points"}, torch.full((1, 32, 32, 3), math.nan), "texture.points", "no texel"),
    ],
)
def test_refusals_name_the_value(change: dict, points: Tensor | None, code: str, value: str) -> None:
    with pytest.raises(UsageError) as caught:
        make_field(dataclasses.replace(SMALL, **change), 1, seeded(), points)
    assert caught.value.code == code
    assert value in caught.value.message
    assert caught.value.hint
