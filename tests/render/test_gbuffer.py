"""The g-buffer on shapes whose every value is known."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import torch

from paintit.render.camera import fitted, look_at, orbit
from paintit.render.gbuffer import rasterize, uv_footprint
from paintit.render.geometry import Geometry

FOV = math.radians(45)


def angles(*degrees: float) -> torch.Tensor:
    return torch.tensor([math.radians(d) for d in degrees])


def test_sphere_values(sphere) -> None:
    geometry = Geometry.from_mesh(sphere(64))
    gbuffer = rasterize(geometry, orbit(3), (40, 60))
    mask = gbuffer.mask
    assert mask.shape == (3, 40, 60)
    position, normal = gbuffer.position[mask], gbuffer.normal[mask]
    torch.testing.assert_close(position, normal, atol=3e-3, rtol=0)
    expected_u = torch.remainder(torch.atan2(position[:, 0], position[:, 2]) / (2 * math.pi), 1)
    away = (gbuffer.uv[mask][:, 0] - expected_u).abs()
    assert torch.minimum(away, 1 - away).max() < 5e-3
    torch.testing.assert_close(gbuffer.view.norm(dim=-1), torch.ones(3, 40, 60))
    assert ((normal * gbuffer.view[mask]).sum(-1) > -0.1).all()
    assert (gbuffer.face[~mask] == -1).all()
    assert (gbuffer.normal[~mask] == 0).all()


def test_view_normal_and_depth(sphere) -> None:
    gbuffer = rasterize(Geometry.from_mesh(sphere(64)), look_at(angles(70), angles(30), 3.0, FOV), 41)
    centre = (0, 20, 20)
    torch.testing.assert_close(gbuffer.normal_view()[centre], torch.tensor([0.0, 0, 1]), atol=1e-2, rtol=0)
    torch.testing.assert_close(gbuffer.depth[centre], torch.tensor(2.0), atol=2e-3, rtol=0)
    mask = gbuffer.mask[0]
    right, top = mask.clone(), mask.clone()
    right[:, :28], top[13:] = False, False
    assert (gbuffer.normal_view()[0][right][:, 0] > 0.1).all()
    assert (gbuffer.normal_view()[0][top][:, 1] > 0.1).all()


def test_image_is_upright_and_texture_is_not_mirrored(plane) -> None:
    gbuffer = rasterize(Geometry.from_mesh(plane), look_at(angles(0), angles(0), 3.25, FOV), 32)
    u, v = gbuffer.uv[0, 16, :, 0][gbuffer.mask[0, 16]], gbuffer.uv[0, :, 16, 1][gbuffer.mask[0, :, 16]]
    assert (u.diff() > 0).all()
    assert (v.diff() > 0).all()


def test_a_fitted_camera_nearly_fills_the_frame_and_cuts_nothing_off(plane) -> None:
    tilted = look_at(angles(0, 40), angles(0, -35), 3.0, FOV)
    for fill in (0.5, 0.92):
        gbuffer = rasterize(Geometry.from_mesh(plane), fitted(tilted, Geometry.from_mesh(plane).corners, fill), 200)
        rows, columns = gbuffer.mask.any(2).nonzero()[:, 1], gbuffer.mask.any(1).nonzero()[:, 1]
        reach = torch.cat([rows, columns]) + 0.5
        assert abs(float((reach - 100).abs().max()) / 100 - fill) < 0.01


def test_faces_are_two_sided(plane) -> None:
    gbuffer = rasterize(Geometry.from_mesh(plane), look_at(angles(0, 180), angles(0, 0), 3.0, FOV), 16)
    front, back = gbuffer.normal[0][gbuffer.mask[0]], gbuffer.normal[1][gbuffer.mask[1]]
    torch.testing.assert_close(front, torch.tensor([0.0, 0, 1]).expand_as(front))
    torch.testing.assert_close(back, torch.tensor([0.0, 0, -1]).expand_as(back))
    assert (gbuffer.tangent[0][gbuffer.mask[0]] == torch.tensor([1.0, 0, 0, 1])).all()
    assert (gbuffer.tangent[1][gbuffer.mask[1]] == torch.tensor([-1.0, 0, 0, -1])).all()


def test_winding_does_not_matter_where_normals_are_given(sphere) -> None:
    mesh = sphere(16)
    flipped = replace(mesh, faces=mesh.faces[:, ::-1].copy(), face_uvs=mesh.face_uvs[:, ::-1].copy(),
                      normals=mesh.normals[:, ::-1].copy(), tangents=mesh.tangents[:, ::-1].copy())  # fmt: skip
    a, b = (rasterize(Geometry.from_mesh(m), orbit(1), 24) for m in (mesh, flipped))
    torch.testing.assert_close(a.normal, b.normal, atol=1e-5, rtol=0)


def test_footprint_against_neighbouring_pixels(plane) -> None:
    """On an oblique plane the analytic derivative is the central difference of uv over pixels."""
    gbuffer = rasterize(Geometry.from_mesh(plane), look_at(angles(40), angles(25), 3.25, FOV), 128)
    uv, footprint = gbuffer.uv[0], gbuffer.footprint[0]
    inner = gbuffer.mask[0].clone()
    for shift, axis in ((1, 0), (-1, 0), (1, 1), (-1, 1)):
        inner &= gbuffer.mask[0].roll(shift, axis)
    across = (uv.roll(-1, 1) - uv.roll(1, 1)) / 2
    down = (uv.roll(-1, 0) - uv.roll(1, 0)) / 2
    assert int(inner.sum()) > 1000
    torch.testing.assert_close(footprint[inner][:, 0], across[inner], atol=2e-5, rtol=5e-3)
    torch.testing.assert_close(footprint[inner][:, 1], down[inner], atol=2e-5, rtol=5e-3)


def test_degenerate_faces_have_finite_footprints() -> None:
    corners = torch.tensor([[[0.0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])
    uvs = torch.tensor([[[0.0, 0], [1, 0], [0, 1]], [[0.3, 0.3], [0.3, 0.3], [0.3, 0.3]]])
    origin, direction = torch.tensor([[0.2, 0.2, 2.0]] * 2), torch.tensor([[0.0, 0, -1]] * 2)
    steps = torch.eye(3)[:2].expand(2, 2, 3) * 0.01
    footprint = uv_footprint(corners, uvs, origin, direction, steps)
    assert footprint.isfinite().all()
    assert (footprint[1] == 0).all()
    edge_on = uv_footprint(corners[1:], torch.tensor([[[0.0, 0], [1, 0], [0, 1]]]), origin[1:],
                           torch.tensor([[1.0, 0, 0]]), steps[1:])  # fmt: skip
    assert edge_on.isfinite().all()


def test_layers_and_far_repeats(plane) -> None:
    mesh = replace(plane, face_layer=np.array([0, 1]), uvs=plane.uvs + np.array([7000.0, -3000.0]))
    gbuffer = rasterize(Geometry.from_mesh(mesh), orbit(1, elevation_deg=0.0), 32)
    plain = rasterize(Geometry.from_mesh(plane), orbit(1, elevation_deg=0.0), 32)
    assert sorted(gbuffer.layer[gbuffer.mask].unique().tolist()) == [0, 1]
    torch.testing.assert_close(gbuffer.uv, plain.uv, atol=1e-6, rtol=0)
