"""Texture coordinates: the rasteriser against its slow twin, decisions on cases with a known answer, unwraps."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.mesh.glb_builder import quad

from paintit.mesh.coverage import rasterize_uv
from paintit.mesh.mesh import Layer, Mesh
from paintit.mesh.normals import flat_normals, smooth_normals
from paintit.mesh.read import read_mesh
from paintit.mesh.triangulate import triangulate
from paintit.mesh.uv import check, fill_gutters, unwrap
from paintit.mesh.weld import edge_pairs, row_ids


def mesh_of(vertices: np.ndarray, faces: np.ndarray, uvs: np.ndarray, face_uvs: np.ndarray, layer: list[int]) -> Mesh:
    layers = tuple(Layer(f"m{k}") for k in range(max(layer) + 1))
    normals = flat_normals(vertices, faces)
    tangents = np.zeros((len(faces), 3, 4), np.float32)
    return Mesh(vertices, faces, uvs, face_uvs, normals, tangents, np.array(layer), layers)


def twin(mesh: Mesh, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Slow and plain: each texel of three tiles in each direction against each triangle."""
    face = np.full((len(mesh.layers), size, size), -1)
    count = np.zeros((len(mesh.layers), size, size), int)
    for f in range(len(mesh.faces)):
        a, b, c = mesh.corner_uvs[f] * size
        for row in range(-2 * size, 3 * size):
            for column in range(-2 * size, 3 * size):
                p = np.array([column + 0.5, row + 0.5])
                edges = [
                    (q[0] - o[0]) * (p[1] - o[1]) - (q[1] - o[1]) * (p[0] - o[0]) for o, q in ((a, b), (b, c), (c, a))
                ]
                if min(edges) > 0 or max(edges) < 0:
                    at = mesh.face_layer[f], row % size, column % size
                    count[at] += 1
                    face[at] = f if face[at] < 0 else face[at]
    return face, count


def test_rasterizer_against_its_twin() -> None:
    generator = np.random.default_rng(3)
    corners = generator.uniform(-1.2, 2.2, (12, 1, 2)) + generator.uniform(-0.3, 0.3, (12, 3, 2))
    corners[0] = [[0.1, 0.1], [0.9, 0.12], [0.5, 0.11]]  # thin
    corners[1] = [[0.4, 0.4], [0.4, 0.4], [0.6, 0.4]]  # without area
    corners[2] = [[-0.3, 0.2], [1.7, 0.4], [0.1, 1.9]]  # wider than the square: some texels twice
    faces = np.arange(36).reshape(12, 3)
    mesh = mesh_of(generator.normal(size=(36, 3)), faces, corners.reshape(-1, 2), faces, [0, 1] * 6)
    found = rasterize_uv(mesh, 12)
    face, count = twin(mesh, 12)
    np.testing.assert_array_equal(found.face, face)
    np.testing.assert_array_equal(found.count, count)
    np.testing.assert_allclose(found.barycentric.sum(-1), face >= 0, atol=1e-6)
    layer, row, column = np.nonzero(face >= 0)
    uv = (found.barycentric[layer, row, column][..., None] * mesh.corner_uvs[face[layer, row, column]]).sum(1)
    difference = uv * 12 - np.stack([column, row], 1) - 0.5
    np.testing.assert_allclose(difference / 12, np.round(difference / 12), atol=1e-5)


def test_shared_edges_leave_no_hole_and_no_overlap() -> None:
    """Two triangles over the whole square, their diagonal exactly through texel centres."""
    vertices = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    mesh = mesh_of(vertices, faces, vertices[:, :2], faces, [0, 0])
    for size in (1, 7, 64):
        found = rasterize_uv(mesh, size)
        assert found.covered.all()
        assert (found.count == 1).all()


def test_gutters_take_the_nearest_texel_across_the_border() -> None:
    generator = np.random.default_rng(0)
    covered = generator.random((2, 9, 14)) < 0.06
    covered[1] = False
    image = generator.random((2, 9, 14, 3)).astype(np.float32)
    filled = fill_gutters(image, covered)
    rows, columns = np.nonzero(covered[0])
    for y in range(9):
        for x in range(14):
            dy, dx = np.abs(rows - y), np.abs(columns - x)
            distance = np.minimum(dy, 9 - dy) ** 2 + np.minimum(dx, 14 - dx) ** 2
            nearest = image[0, rows[distance == distance.min()], columns[distance == distance.min()]]
            assert (filled[0, y, x] == nearest).all(-1).any()
    np.testing.assert_array_equal(filled[1], image[1])


def sheet(
    offset: tuple[float, float, float], flip: bool = False, n: int = 6
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A bumpy sheet over the unit square, moved; vertices, faces and texture coordinates that fill the square."""
    grid = np.stack(np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n), indexing="ij"), -1).reshape(-1, 2)
    vertices = np.column_stack([grid, 0.1 * np.sin(3 * grid[:, 0] + grid[:, 1])])
    cell = np.arange(n * n).reshape(n, n)[:-1, :-1].reshape(-1, 1)
    faces = np.concatenate([cell + np.array([0, n, n + 1]), cell + np.array([0, n + 1, 1])])
    if flip:
        vertices[:, 0], faces = -vertices[:, 0], faces[:, ::-1]
    return vertices + offset, faces, 0.02 + 0.96 * grid


def two(second: tuple[float, float, float], flip: bool) -> Mesh:
    a, b = sheet((0.5, 0, 0)), sheet(second, flip)
    faces = np.concatenate([a[1], b[1] + len(a[0])])
    return mesh_of(np.concatenate([a[0], b[0]]), faces, np.concatenate([a[2], b[2]]), faces, [0] * len(faces))


@pytest.mark.parametrize(
    ("second", "flip", "paintable", "mirrored", "distant"),
    [
        ((-0.5, 0, 0), True, True, 1.0, 0.0),
        ((-0.5, 2, 0), True, False, 0.0, 1.0),
        ((3.0, 0, 0), False, False, 0.0, 1.0),
        ((0.5, 0, 0), False, True, 0.0, 0.0),
    ],
    ids=["mirror image", "mirror image moved away", "copy elsewhere", "the same place twice"],
)
def test_overlap(
    second: tuple[float, float, float], flip: bool, paintable: bool, mirrored: float, distant: float
) -> None:
    found = check(two(second, flip), 128)
    assert found.paintable == paintable
    assert found.mirrored_overlap == pytest.approx(mirrored, abs=0.05)
    assert found.distant_overlap == pytest.approx(distant, abs=0.05)
    assert found.overlap == pytest.approx(2.0, abs=0.05)  # centres exactly on an edge count once


def test_numbers_of_a_known_sheet() -> None:
    vertices, faces, uvs = sheet((0, 0, 0))
    vertices[:, 2] = 0
    mesh = mesh_of(vertices * 5, faces, uvs, faces, [0] * len(faces))
    found = check(mesh, 200)
    assert (found.has_uvs, found.islands, found.zero_area_faces) == (True, 1, 0)
    assert found.coverage == pytest.approx(0.96**2, abs=1e-3)
    assert found.overlap == pytest.approx(1.0)
    assert found.texel_density == pytest.approx(0.96 * 200 / 5)
    assert found.density_spread == pytest.approx(1.0)
    assert found.mirrored_share == 1.0  # y is up in space and down in the texture
    assert check(replace(mesh, uvs=uvs * (1, -1) + (0, 1)), 200).mirrored_share == 0.0
    assert check(replace(mesh, uvs=uvs + 0.5), 200).paintable  # reaches outside, but repeats without overlap
    assert check(replace(mesh, uvs=uvs + 0.5), 200).outside_unit > 0.4


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda uvs: uvs * 4, "the texture repeats: the surface covers it 14.7 times"),
        (lambda uvs: uvs * 0 + 0.5, "100% of the surface has no area in the texture"),
        (lambda uvs: uvs * 0.01, "the surface covers only 0.02% of the texture"),
        (lambda uvs: np.where(uvs > 0.9, np.nan, uvs), "some texture coordinates are not finite"),
    ],
    ids=["tiling", "one point", "tiny", "nan"],
)
def test_reasons(change: object, reason: str) -> None:
    vertices, faces, uvs = sheet((0, 0, 0))
    found = check(mesh_of(vertices, faces, change(uvs), faces, [0] * len(faces)), 64)  # type: ignore[operator]
    assert (found.paintable, found.reason) == (False, reason)


def test_only_the_layers_that_need_it_are_unwrapped(tmp_path: Path) -> None:
    b = quad()
    first = b.json["meshes"][0]["primitives"][0]
    bare = {k: v for k, v in first["attributes"].items() if k != "TEXCOORD_0"}
    b.json["materials"] = [{"name": "kept"}, {"name": "new"}]
    second = {"attributes": bare, "indices": first["indices"], "material": 1}
    b.json["meshes"][0]["primitives"] = [{**first, "material": 0}, second]
    mesh = read_mesh(b.glb(tmp_path / "a.glb"))
    np.testing.assert_allclose(mesh.corner_uvs[:2].reshape(-1, 2), [[0, 1], [1, 1], [1, 0], [0, 1], [1, 0], [0, 0]])
    assert mesh.report.unwrapped_layers == (1,)
    assert mesh.report.notes[0] == "new texture coordinates for 'new': there are no texture coordinates"
    assert check(mesh, 128).paintable


def test_nodes_that_show_one_primitive_share_its_unwrap(tmp_path: Path) -> None:
    b = quad()
    del b.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"]
    b.json["nodes"] += [{"mesh": 0, "translation": [9, 0, 0]}, {"mesh": 0, "scale": [-1, 1, 1]}]
    b.json["scenes"] = [{"nodes": [0, 1, 2]}]
    mesh = read_mesh(b.glb(tmp_path / "a.glb"))
    assert mesh.source is not None
    assert mesh.source.corner_vertex is not None
    by_vertex = [
        {
            int(v): tuple(uv)
            for v, uv in zip(mesh.source.corner_vertex[s].flat, mesh.corner_uvs[s].reshape(-1, 2), strict=True)
        }
        for s in (slice(0, 2), slice(2, 4), slice(4, 6))
    ]
    assert by_vertex[0] == by_vertex[1] == by_vertex[2]
    assert len(set(by_vertex[0].values())) == 4
    assert check(mesh, 128).paintable


@pytest.mark.parametrize("name", ["koala.ply", "wingnut.stl", "chair/chair.obj", "fox.glb"])
def test_unwrap_quality(assets: Path, name: str) -> None:
    mesh = read_mesh(assets / "meshes" / name, unwrap="always")
    assert mesh.report.uv_origin == "unwrapped"
    found = check(mesh)
    assert found.paintable
    assert (found.mirrored_share, found.zero_area_faces, found.outside_unit) == (0, 0, 0)
    for layer in found.layers:
        assert layer.overlap < 1.005
        assert layer.coverage > 0.40
    # Every face of the texture is also a face in space: corners at one texture place are at one place in space.
    ids, _ = row_ids(np.column_stack([mesh.uvs[mesh.face_uvs].reshape(-1, 2), np.repeat(mesh.face_layer, 3)]))
    places = mesh.vertices[mesh.faces].reshape(-1, 3)
    spread = np.zeros(ids.max() + 1)
    first = np.full(ids.max() + 1, -1)
    first[ids[::-1]] = np.arange(len(ids))[::-1]
    np.maximum.at(spread, ids, np.linalg.norm(places - places[first[ids]], axis=1))
    assert spread.max() < 1e-6 * mesh.extent


def test_unwrap_with_degenerate_triangles_and_far_origin(assets: Path) -> None:
    mesh = read_mesh(assets / "meshes" / "spot_quads.obj")
    faces = np.concatenate([mesh.faces, mesh.faces[:100, [0, 0, 1]], mesh.faces[:100, [0, 1, 1]]])
    again = [mesh.normals, mesh.normals[:100], mesh.normals[:100]]
    far = replace(
        mesh,
        vertices=mesh.vertices + 1e6,
        faces=faces,
        face_uvs=np.full_like(faces, -1),
        normals=np.concatenate(again),
        face_layer=np.zeros(len(faces), np.int64),
        parts=(),
    )
    found = check(unwrap(far), 256)
    assert found.paintable
    assert found.zero_area_faces == 200
    assert found.flat_area == 0


def test_smooth_normals_of_a_sphere_and_a_cube() -> None:
    cube = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    sides = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    corners = triangulate(cube[np.ravel(sides)], np.arange(0, 25, 4))
    faces = np.ravel(sides)[corners]
    normals = smooth_normals(cube, faces)
    np.testing.assert_allclose(normals, flat_normals(cube, faces), atol=1e-6)  # 90 degrees stay sharp
    everywhere = smooth_normals(cube, faces, crease_degrees=100)
    np.testing.assert_allclose(everywhere, cube[faces] / 3**0.5, atol=1e-6)  # angle weights: no bias by the diagonal
    soup = cube[faces].reshape(-1, 3)
    np.testing.assert_array_equal(smooth_normals(soup, np.arange(36).reshape(12, 3), 100), everywhere)


def test_normals_of_organic_and_hard_meshes(assets: Path) -> None:
    koala, wingnut = (read_mesh(assets / "meshes" / n) for n in ("koala.ply", "wingnut.stl"))

    def sharp(mesh: Mesh) -> float:
        ids, _ = row_ids(mesh.vertices)
        pairs = edge_pairs(ids[mesh.faces])
        a = mesh.normals.reshape(-1, 3)[pairs[:, 0]]
        b = mesh.normals.reshape(-1, 3)[pairs[:, 1] // 3 * 3 + (pairs[:, 1] + 1) % 3]
        return float(((a * b).sum(1) < np.cos(np.radians(20))).mean())

    assert sharp(koala) < 0.015
    assert sharp(wingnut) > 0.03


def test_row_ids() -> None:
    generator = np.random.default_rng(0)
    rows = generator.integers(-2, 3, (500, 3)).astype(float)
    rows[rows == 0] *= generator.choice([-1.0, 1.0], (rows == 0).sum())
    ids, count = row_ids(rows)
    assert count == len(np.unique(rows + 0, axis=0))
    np.testing.assert_array_equal(ids[:, None] == ids, (rows[:, None] == rows).all(-1))
