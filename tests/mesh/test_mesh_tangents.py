"""Tangents by hand, by symmetry, and against Blender's own MikkTSpace."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from paintit.mesh.mesh import Mesh
from paintit.mesh.read import read_mesh
from paintit.mesh.tangents import mikktspace


def tangents(mesh: Mesh) -> np.ndarray:
    return mikktspace(mesh.vertices, mesh.faces, mesh.uvs, mesh.face_uvs, mesh.normals)


def test_shared_vertices_average_and_others_do_not() -> None:
    """Two triangles share an edge; u runs along x in one and along y in the other; both have 45 degrees at the edge."""
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], float)
    faces = np.array([[0, 1, 2], [2, 1, 3]])
    uvs = np.array([[0, 1], [1, 1], [0, 0], [1, 0]], float)
    normals = np.tile(np.array([0, 0, 1], np.float32), (2, 3, 1))
    flat = mikktspace(vertices, faces, uvs, faces, normals)
    np.testing.assert_allclose(flat.reshape(-1, 4), [[1, 0, 0, 1]] * 6, atol=1e-6)
    uvs[3] = [2, 1]
    found = mikktspace(vertices, faces, uvs, faces, normals)
    np.testing.assert_allclose(found[0, 1, :2], np.array([1, 1]) / 2**0.5, atol=1e-6)
    np.testing.assert_allclose(found[0, 0, :2], [1, 0], atol=1e-6)
    np.testing.assert_allclose(found[1, 2, :2], [0, 1], atol=1e-6)


def test_angle_weights() -> None:
    """A 90 degree corner and a 30 degree corner meet: weights 3 to 1."""
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [-0.5, 3**0.5 / 2, 0]], float)
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    uvs = np.array([[0, 1], [1, 1], [0, 0], [-0.5, 1]], float)
    normals = np.tile(np.array([0, 0, 1], np.float32), (2, 3, 1))
    found = mikktspace(vertices, faces, uvs, faces, normals)
    assert (found[..., 3] == 1).all()
    first, second = found[0, 1, :2].astype(float), found[1, 2, :2].astype(float)
    np.testing.assert_allclose(first, [1, 0], atol=1e-6)
    np.testing.assert_allclose(second, [0.5, -(0.75**0.5)], atol=1e-6)
    mean = 3 * first + second
    np.testing.assert_allclose(found[0, 0, :2], mean / np.linalg.norm(mean), atol=1e-6)


def test_mirrored_texture_is_not_averaged() -> None:
    """A seam of mirroring through shared vertices: each side keeps its own tangent and sign."""
    vertices = np.array([[0, 0, 0], [0, 1, 0], [1, 0, 0], [-1, 0, 0]], float)
    faces = np.array([[0, 2, 1], [0, 1, 3]])
    uvs = np.array([[0, 1], [0, 0], [1, 1], [1, 1]], float)
    normals = np.tile(np.array([0, 0, 1], np.float32), (2, 3, 1))
    found = mikktspace(vertices, faces, uvs, faces, normals)
    np.testing.assert_allclose(found[0], [[1, 0, 0, 1]] * 3, atol=1e-6)
    np.testing.assert_allclose(found[1], [[-1, 0, 0, -1]] * 3, atol=1e-6)


def test_degenerate_triangles_borrow(assets: Path) -> None:
    mesh = read_mesh(assets / "meshes" / "spot_quads.obj")
    clean = tangents(mesh)
    faces = np.concatenate([mesh.faces, mesh.faces[:20, [0, 0, 1]]])
    face_uvs = np.concatenate([mesh.face_uvs, mesh.face_uvs[:20, [0, 0, 1]]])
    normals = np.concatenate([mesh.normals, mesh.normals[:20, [0, 0, 1]]])
    found = mikktspace(mesh.vertices, faces, mesh.uvs, face_uvs, normals)
    np.testing.assert_array_equal(found[: len(clean)], clean)
    assert np.isfinite(found).all()
    np.testing.assert_allclose(np.linalg.norm(found[..., :3], axis=-1), 1, atol=1e-5)


def test_order_of_faces_does_not_matter(assets: Path) -> None:
    mesh = read_mesh(assets / "meshes" / "spot" / "spot.obj")
    order = np.random.default_rng(1).permutation(len(mesh.faces))
    shuffled = mikktspace(mesh.vertices, mesh.faces[order], mesh.uvs, mesh.face_uvs[order], mesh.normals[order])
    np.testing.assert_allclose(shuffled, tangents(mesh)[order], atol=1e-5)


def mirrored_half(assets: Path) -> Mesh:
    """Spot's texture folded at u = 1/2, so that mirrored and unmirrored triangles meet at shared vertices."""
    mesh = read_mesh(assets / "meshes" / "spot" / "spot.obj")
    uvs = mesh.uvs.copy()
    uvs[:, 0] = np.abs(uvs[:, 0] - 0.5)
    return replace(mesh, uvs=uvs)


@pytest.mark.judge
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", ["spot/spot.obj", "bob/bob.obj", "teapot/teapot.obj", "fox.glb", "mirrored"])
def test_blender_agrees(assets: Path, name: str) -> None:
    bpy = pytest.importorskip("bpy")
    mesh = mirrored_half(assets) if name == "mirrored" else read_mesh(assets / "meshes" / name)
    count = len(mesh.faces)
    data = bpy.data.meshes.new("judge")
    data.vertices.add(len(mesh.vertices))
    data.vertices.foreach_set("co", mesh.vertices.astype(np.float32).ravel())
    data.loops.add(3 * count)
    data.loops.foreach_set("vertex_index", mesh.faces.astype(np.int32).ravel())
    data.polygons.add(count)
    data.polygons.foreach_set("loop_start", np.arange(0, 3 * count, 3, dtype=np.int32))
    data.update(calc_edges=True)
    layer = data.uv_layers.new(name="uv")
    upward = mesh.corner_uvs.reshape(-1, 2) * (1, -1) + (0, 1)
    layer.data.foreach_set("uv", upward.astype(np.float32).ravel())
    data.normals_split_custom_set(mesh.normals.reshape(-1, 3).tolist())
    normals, theirs, sign = (np.empty(n * count, np.float32) for n in (9, 9, 3))
    data.corner_normals.foreach_get("vector", normals)
    data.calc_tangents(uvmap="uv")
    data.loops.foreach_get("tangent", theirs)
    data.loops.foreach_get("bitangent_sign", sign)
    bpy.data.meshes.remove(data)
    # Blender stores custom normals in 2 x 16 bits; its own normals go to both sides.
    ours = mikktspace(mesh.vertices, mesh.faces, mesh.uvs, mesh.face_uvs, normals.reshape(-1, 3, 3)).reshape(-1, 4)
    close = (ours[:, :3] * theirs.reshape(-1, 3)).sum(1) > np.cos(np.radians(1))
    assert (close & (ours[:, 3] == sign)).mean() > 0.99
