"""Which edges are seams, on shapes whose seams are known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.mesh.test_mesh_uv import mesh_of

from paintit.mesh.mesh import Layer, Mesh
from paintit.mesh.read import read_mesh
from paintit.mesh.seams import EdgePoints, surface_edges

#: Two triangles over a rectangle of 2 x 1, joined along its diagonal of length sqrt(5).
PLACES = np.array([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]], float)
FACES = np.array([[0, 1, 2], [0, 2, 3]])


def rectangle(uvs: np.ndarray, face_uvs: np.ndarray, layer: list[int] | None = None) -> Mesh:
    return mesh_of(PLACES, FACES, uvs, face_uvs, layer or [0, 0])


def cylinder(columns: int = 12, wrap: bool = False) -> Mesh:
    """An open tube unrolled on the square, of one row of quads. Its seam runs up one side; with ``wrap`` the texture is
    closed: u = 1 where it meets u = 0."""
    angle = 2 * np.pi * np.arange(columns + 1) / columns
    ring = np.stack([np.cos(angle), np.zeros(columns + 1), np.sin(angle)], 1)
    ring[-1] = ring[0]
    vertices = np.concatenate([ring, ring + np.array([0, 1, 0])])
    u = np.linspace(0, 1, columns + 1) if wrap else np.linspace(0.1, 0.9, columns + 1)
    uvs = np.concatenate([np.stack([u, np.full_like(u, 0.8)], 1), np.stack([u, np.full_like(u, 0.2)], 1)])
    a = np.arange(columns)
    b = a + columns + 1
    faces = np.concatenate([np.stack([a, a + 1, b + 1], 1), np.stack([a, b + 1, b], 1)])
    return mesh_of(vertices, faces, uvs, faces, [0] * len(faces))


def test_a_shared_edge_is_interior() -> None:
    edges = surface_edges(rectangle(PLACES[:, :2] / 2, FACES))
    assert len(edges) == 1
    assert edges.interior.tolist() == [True]
    assert edges.seam.tolist() == [False]
    assert edges.length[0] == pytest.approx(5**0.5)
    np.testing.assert_array_equal(edges.faces, [[0, 1]])


def test_a_cut_edge_is_a_seam() -> None:
    """Each side keeps its own place in the texture; the ends stay in one order though the faces run against it."""
    uvs = np.array([[0, 0], [0.4, 0], [0.4, 0.2], [0.5, 0.5], [0.9, 0.7], [0.5, 0.7]])
    edges = surface_edges(rectangle(uvs, np.array([[0, 1, 2], [3, 4, 5]])))
    assert edges.seam.tolist() == [True]
    assert not edges.interior.any()
    for side, corners in enumerate(((0, 2), (3, 4))):
        end = [int(np.flatnonzero((uvs == uv).all(1))[0]) for uv in edges.uv[0, side]]
        assert end == list(corners) or end == list(corners[::-1])
    first = [PLACES[FACES[edges.faces[0, side], edges.corners[0, side]]] for side in (0, 1)]
    np.testing.assert_array_equal(first[0], first[1])
    np.testing.assert_array_equal(first[0], edges.points[0])


def test_inward_is_one_unit_into_the_face() -> None:
    """On a texture at a fifth of the rectangle's scale, a step of h lands at height h above the edge, inside."""
    uvs = PLACES[:, :2] / 5
    edges = surface_edges(rectangle(uvs, FACES))
    middle = edges.uv[0].mean(1) * 5
    for side in (0, 1):
        point = middle[side] + 0.2 * edges.inward[0, side] * 5
        offset = point - middle[side]
        assert np.linalg.norm(offset) == pytest.approx(0.2)
        assert offset @ (edges.points[0, 1] - edges.points[0, 0])[:2] == pytest.approx(0, abs=1e-12)
        apex = PLACES[[1, 3][int(edges.faces[0, side])], :2]
        assert offset @ (apex - middle[side]) > 0


def test_whole_textures_apart_is_no_seam() -> None:
    open_, closed = surface_edges(cylinder()), surface_edges(cylinder(wrap=True))
    assert open_.seam.sum() == 1
    assert open_.length[open_.seam] == pytest.approx(1.0)
    assert not closed.seam.any()
    assert closed.interior.all()
    assert len(open_) == len(closed) == 24


def test_a_folded_edge_is_neither() -> None:
    """A mirrored half on top of the other: both sides read the same texels, so nothing can be learnt there."""
    uvs = np.array([[0, 0], [0.4, 0], [0.4, 0.2]])
    edges = surface_edges(rectangle(uvs, np.array([[0, 1, 2], [0, 2, 1]])))
    assert len(edges) == 1
    assert not edges.seam.any()
    assert not edges.interior.any()


def test_borders_of_materials_and_unpainted_layers_are_left_out() -> None:
    uvs = PLACES[:, :2] / 2
    assert len(surface_edges(rectangle(uvs, FACES, [0, 1]))) == 0
    mesh = rectangle(uvs, FACES)
    assert len(surface_edges(replace(mesh, layers=(Layer("kept", painted=False),)))) == 0


def test_welding_and_winding() -> None:
    """Doubled vertices are one edge; a neighbour wound the wrong way round still is a neighbour."""
    vertices, faces = PLACES[FACES].reshape(-1, 3), np.arange(6).reshape(2, 3)
    uvs = PLACES[:, :2][FACES].reshape(-1, 2) / 2
    assert surface_edges(mesh_of(vertices, faces, uvs, faces, [0, 0])).interior.tolist() == [True]
    turned = faces[:, ::-1].copy()
    turned[0] = faces[0]
    edges = surface_edges(mesh_of(vertices, turned, uvs, turned, [0, 0]))
    assert edges.interior.tolist() == [True]


def test_faces_without_area_or_coordinates_are_left_out() -> None:
    uvs = PLACES[:, :2] / 2
    flat = uvs.copy()
    flat[3] = uvs[0]
    assert len(surface_edges(rectangle(flat, FACES))) == 0
    assert len(surface_edges(rectangle(uvs, np.array([[0, 1, 2], [-1, -1, -1]])))) == 0


def test_real_meshes(assets: Path) -> None:
    """Spot's seams, counted by an independent walk over its file; none on its mirror plane by chance."""
    mesh = read_mesh(assets / "meshes" / "spot" / "spot.obj")
    edges = surface_edges(mesh)
    by_edge: dict[frozenset[int], set[frozenset[int]]] = {}
    for face, uv in zip(mesh.faces.tolist(), mesh.face_uvs.tolist(), strict=True):
        for k in range(3):
            key = frozenset((face[k], face[(k + 1) % 3]))
            by_edge.setdefault(key, set()).add(frozenset((uv[k], uv[(k + 1) % 3])))
    assert edges.seam.sum() == sum(len(found) == 2 for found in by_edge.values()) > 100


def test_points_are_in_the_middle_of_equal_pieces() -> None:
    points = EdgePoints.spread(np.array([2, 0, 1]))
    assert points.edge.tolist() == [0, 0, 2]
    assert points.share.tolist() == [0.25, 0.75, 0.5]
    ends = np.array([[[0.0], [4.0]], [[0.0], [1.0]], [[2.0], [4.0]]])
    assert points.along(ends).tolist() == [[1.0], [3.0], [3.0]]
