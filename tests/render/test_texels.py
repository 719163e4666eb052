"""Texels on the surface, and which of them a camera could see."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import torch

from paintit.mesh.mesh import Layer, Mesh
from paintit.render.geometry import Geometry
from paintit.render.texels import seen, texel_points, view_directions


def joined(*meshes: Mesh) -> Mesh:
    """Several meshes as one, a layer each."""
    vertices, faces, uvs, face_uvs, layer = [], [], [], [], []
    for index, mesh in enumerate(meshes):
        faces.append(mesh.faces + sum(map(len, vertices)))
        face_uvs.append(mesh.face_uvs + sum(map(len, uvs)))
        vertices.append(mesh.vertices)
        uvs.append(mesh.uvs)
        layer.append(np.full(len(mesh.faces), index))
    cat = np.concatenate
    normals, tangents = cat([mesh.normals for mesh in meshes]), cat([mesh.tangents for mesh in meshes])
    layers = tuple(Layer(str(index)) for index in range(len(meshes)))
    return Mesh(cat(vertices), cat(faces), cat(uvs), cat(face_uvs), normals, tangents, cat(layer), layers)


def test_points_of_a_sphere(sphere) -> None:
    mesh = sphere(32)
    covered, position, normal = texel_points(mesh, Geometry.from_mesh(mesh), 64)
    assert covered.shape == (1, 64, 64)
    assert covered.float().mean() > 0.9
    torch.testing.assert_close(position[covered].norm(dim=-1), torch.ones(int(covered.sum())), atol=6e-3, rtol=0)
    torch.testing.assert_close(position[covered], normal[covered], atol=6e-3, rtol=0)
    _, row, column = covered.nonzero(as_tuple=True)
    theta, phi = math.pi * (row + 0.5) / 64, 2 * math.pi * (column + 0.5) / 64
    expected = torch.stack([theta.sin() * phi.sin(), theta.cos(), theta.sin() * phi.cos()], -1)
    assert (position[covered] - expected).norm(dim=-1).max() < 0.02


def test_a_sphere_inside_a_sphere_is_unseen(sphere) -> None:
    outer = sphere(16)
    inner = replace(outer, vertices=outer.vertices * 0.5)
    mesh = joined(outer, inner)
    visible = seen(mesh, Geometry.from_mesh(mesh), 48)
    covered, _, _ = texel_points(mesh, Geometry.from_mesh(mesh), 48)
    assert torch.equal(visible[0], covered[0])
    assert not visible[1].any()


def test_cameras_above_do_not_see_below(sphere) -> None:
    mesh = sphere(32)
    geometry = Geometry.from_mesh(mesh)
    up = torch.tensor([[0.0, 1.0, 0.0]]).expand(4, 3)
    visible = seen(mesh, geometry, 64, directions=up)[0]
    covered, position, _ = texel_points(mesh, geometry, 64)
    # From height 3.25 the horizon of the unit sphere is at y = 1 / 3.25.
    height = position[0, ..., 1]
    assert visible[covered[0] & (height > 1 / 3.25 + 0.06)].all()
    assert not visible[covered[0] & (height < 1 / 3.25 - 0.11)].any()


def test_open_surfaces_are_seen_from_behind(plane) -> None:
    visible = seen(plane, Geometry.from_mesh(plane), 16, directions=torch.tensor([[0.0, 0.0, -1.0]] * 4))
    assert visible.all()


def test_view_directions_fill_the_band() -> None:
    directions = view_directions(64)
    torch.testing.assert_close(directions.norm(dim=-1), torch.ones(64))
    assert directions[:, 1].abs().max() <= math.sin(math.radians(60))
    # Every point of the band has a direction near, and so has every quarter of them.
    everywhere = view_directions(4000)
    for part, degrees in [(directions, 30), *((directions[16 * i : 16 * i + 16], 56) for i in range(4))]:
        nearest = (everywhere @ part.T).amax(1).clamp(-1, 1).arccos()
        assert math.degrees(float(nearest.max())) < degrees
