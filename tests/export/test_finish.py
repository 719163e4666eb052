"""Texels nobody sees, gutters, and what mip levels make of them."""

import dataclasses

import numpy as np
import torch
from tests.export.exporting import asset, known_maps

from paintit.export.finish import blend_nearest, fill_unseen, filled, finish, visibility
from paintit.mesh.mesh import Layer
from paintit.mesh.uv import rasterize_uv
from paintit.render.geometry import Geometry
from paintit.render.texels import seen
from paintit.texture.maps import TextureMaps

SIZE = 64


def flat(layers: int, color: tuple[float, float, float], size: int = SIZE) -> TextureMaps:
    one = torch.ones(layers, size, size, 1)
    return TextureMaps(one * torch.tensor(color), 0.5 * one, 0.25 * one, one * torch.tensor([0.0, 0.0, 1.0]))


def test_mips_do_not_bleed() -> None:
    """Islands red, gutters black before: after finishing, every level of the pyramid is red wherever it is sampled."""
    mesh = asset("koala.ply")
    covered = torch.from_numpy(rasterize_uv(mesh, SIZE).face >= 0)
    maps = flat(1, (0.9, 0.1, 0.1))
    black = dataclasses.replace(maps, base_color=maps.base_color * covered[..., None])
    done = finish(mesh, black).base_color.movedim(-1, 1)
    red = torch.tensor([0.9, 0.1, 0.1])
    for level in range(6):
        mip = torch.nn.functional.avg_pool2d(done, 2**level)
        assert (mip - red[None, :, None, None]).abs().max() < 1e-5


def test_gutters_hold_island_values() -> None:
    """Every texel outside the islands holds, bit for bit, the value of some texel inside one."""
    mesh = asset("koala.ply")
    texels = rasterize_uv(mesh, SIZE)
    maps = known_maps(mesh, SIZE)
    done = filled(mesh, maps)
    covered = texels.face >= 0
    outside = done[~covered]
    inside = {row.tobytes() for row in done[covered]}
    assert all(row.tobytes() in inside for row in outside)


def test_unseen_takes_only_seen_values() -> None:
    """A small copy inside the mesh is never seen: its garbage (1, 0, 1) must not survive or spread."""
    mesh = asset("spot/spot.obj")
    inner = dataclasses.replace(
        mesh,
        vertices=np.concatenate([mesh.vertices, mesh.center + 0.02 * (mesh.vertices - mesh.center)]),
        faces=np.concatenate([mesh.faces, mesh.faces + len(mesh.vertices)]),
        face_uvs=np.concatenate([mesh.face_uvs, mesh.face_uvs]),
        normals=np.concatenate([mesh.normals, mesh.normals]),
        tangents=np.concatenate([mesh.tangents, mesh.tangents]),
        face_layer=np.concatenate([mesh.face_layer, mesh.face_layer + 1]),
        layers=(Layer("skin"), Layer("inside")),
    )
    visible = torch.as_tensor(seen(inner, Geometry.from_mesh(inner), SIZE))
    assert not visible[1].any()
    assert visible[0].any()
    maps = flat(2, (0.2, 0.6, 0.2))
    garbage = torch.where(visible[..., None], maps.base_color, torch.tensor([1.0, 0.0, 1.0]))
    done = finish(inner, dataclasses.replace(maps, base_color=garbage))
    assert (done.base_color - torch.tensor([0.2, 0.6, 0.2])).abs().max() < 1e-5


def test_seen_texels_do_not_change_and_twice_is_the_same() -> None:
    mesh = asset("spot/spot.obj")
    maps = known_maps(mesh, SIZE)
    visible = torch.as_tensor(visibility(mesh, Geometry.from_mesh(mesh), SIZE))
    first, second = finish(mesh, maps), finish(mesh, maps)
    assert torch.equal(first.packed(), second.packed())
    before_seams = torch.from_numpy(filled(mesh, maps))
    assert torch.equal(before_seams[visible], maps.packed()[visible])
    assert not torch.equal(before_seams[~visible], maps.packed()[~visible])
    assert not first.base_color.requires_grad
    np.testing.assert_allclose(first.normal.norm(dim=-1).numpy(), 1, atol=1e-5)


def test_fill_unseen_on_a_line() -> None:
    """Texels along a line, the middle hidden: each end takes after its own side, and nothing leaves the seen range."""
    n = 41
    position = np.stack([np.linspace(0, 1, n), np.zeros(n), np.zeros(n)], -1).astype(np.float32)[None, None]
    values = np.linspace(0, 1, n, dtype=np.float32)[None, None, :, None]
    visible = np.ones((1, 1, n), bool)
    visible[..., 10:31] = False
    spoiled = np.where(visible[..., None], values, 7.0).astype(np.float32)
    filled = fill_unseen(spoiled, np.ones_like(visible), visible, position)[0, 0, :, 0]
    assert (filled[10:31] >= 0.0).all()
    assert (filled[10:31] <= 1.0).all()
    assert abs(filled[10] - 0.225) < 0.05
    assert abs(filled[30] - 0.775) < 0.05
    assert abs(filled[20] - 0.5) < 1e-3
    assert np.abs(np.diff(filled)).max() < 0.25


def test_blend_by_hand() -> None:
    """At distances 1 and 2 only the nearer value counts; at equal distances the mean does."""
    points = np.array([[0, 0, 0], [3, 0, 0]], np.float32)
    values = np.array([[1.0], [5.0]], np.float32)
    at = np.array([[1, 0, 0], [1.5, 0, 0]], np.float32)
    blended = blend_nearest(points, values, at, 2)
    assert abs(blended[0, 0] - 1.0) < 1e-4
    assert abs(blended[1, 0] - 3.0) < 1e-4


def test_texels_that_were_hardly_painted_take_after_their_neighbours() -> None:
    """Garbage where support is next to none vanishes; where support is ordinary, values stay bit for bit."""
    mesh = asset("spot/spot.obj")
    maps = flat(1, (0.2, 0.6, 0.2))
    visible = torch.as_tensor(visibility(mesh, Geometry.from_mesh(mesh), SIZE))
    corner = torch.zeros(1, SIZE, SIZE, dtype=torch.bool)
    corner[:, : SIZE // 4, : SIZE // 4] = True
    assert (corner & visible).any()
    garbage = torch.where(corner[..., None], torch.tensor([1.0, 0.0, 1.0]), maps.base_color)
    support = torch.where(corner, 0.1, 3.0)
    spoiled = dataclasses.replace(maps, base_color=garbage)
    done = finish(mesh, spoiled, support)
    assert (done.base_color - torch.tensor([0.2, 0.6, 0.2])).abs().max() < 1e-5
    assert torch.equal(done.base_color[visible & ~corner], maps.base_color[visible & ~corner])
    assert (filled(mesh, spoiled)[(visible & corner).numpy(), :3] == [1.0, 0.0, 1.0]).all()
