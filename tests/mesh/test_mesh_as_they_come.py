"""Meshes that are not tidy: repaired in the shading copy, or said plainly; the file's own vertices stay."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from paintit.errors import MeshError
from paintit.mesh.inspect import summarize
from paintit.mesh.mesh import Floats, Ints, Mesh
from paintit.mesh.read import read_mesh

CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
FACES = np.array([[s[0], s[k], s[k + 1]] for s in SIDES for k in (1, 2)])


def mesh_of(tmp_path: Path, vertices: Floats, faces: Ints) -> Mesh:
    path = tmp_path / "mesh.obj"
    rows = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()] + [f"f {a} {b} {c}" for a, b, c in faces + 1]
    path.write_text("\n".join(rows))
    return read_mesh(path)


def test_a_cube_is_whole(tmp_path: Path) -> None:
    summary = summarize(mesh_of(tmp_path, CUBE, FACES))
    assert (summary.watertight, summary.inside_out) == (True, 0)


@pytest.mark.parametrize("scale", [1e-6, 1e-3, 1.0, 1e6])
def test_units_do_not_matter(tmp_path: Path, scale: float) -> None:
    mesh, plain = mesh_of(tmp_path, CUBE * scale, FACES), mesh_of(tmp_path, CUBE, FACES)
    np.testing.assert_allclose(mesh.corner_uvs, plain.corner_uvs, atol=1e-6)
    np.testing.assert_allclose(mesh.normals, plain.normals, atol=1e-6)


def test_details_far_from_the_origin(tmp_path: Path) -> None:
    """1e7 units away with 0.01 of size: float32 steps there are 1 unit wide."""
    mesh = mesh_of(tmp_path, CUBE * 0.01 + 1e7, FACES)
    plain = mesh_of(tmp_path, CUBE, FACES)
    np.testing.assert_allclose(mesh.normals, plain.normals, atol=1e-5)
    assert summarize(mesh).degenerate_faces == 0
    assert summarize(mesh).uv.distant_overlap == 0
    np.testing.assert_allclose(mesh.vertices, CUBE * 0.01 + 1e7, atol=1e-8)


def test_a_stray_vertex_far_away_leaves_the_faces_as_they_are(tmp_path: Path) -> None:
    mesh = mesh_of(tmp_path, np.concatenate([CUBE, [[0, 1e17, 0]]]), FACES)
    np.testing.assert_array_equal(mesh.normals, mesh_of(tmp_path, CUBE, FACES).normals)
    assert summarize(mesh).degenerate_faces == 0


def test_inside_out_is_noted_and_cavities_are_not(tmp_path: Path) -> None:
    summary = summarize(mesh_of(tmp_path, CUBE, FACES[:, ::-1]))
    assert summary.inside_out == 1
    assert "1 closed pieces are wound inside out; they are painted and shown all the same" in summary.notes
    hollow = mesh_of(tmp_path, np.concatenate([CUBE, CUBE * 0.5 + 0.25]), np.concatenate([FACES, FACES[:, ::-1] + 8]))
    assert summarize(hollow).inside_out == 0
    opened = mesh_of(tmp_path, CUBE, FACES[1:, ::-1])
    assert summarize(opened).inside_out == 0


def test_duplicates_leftovers_and_crowded_edges(tmp_path: Path) -> None:
    """Vertices twice, a vertex without a face, a face twice, a fin on an edge, a triangle without area."""
    vertices = np.concatenate([CUBE, CUBE[:4], [[50.0, 50, 50], [-1, -1, 0.5]]])
    extra = [[8, 9, 11], FACES[2], [0, 1, 13], [0, 0, 1]]
    mesh = mesh_of(tmp_path, vertices, np.concatenate([FACES[1:], extra]))
    summary = summarize(mesh)
    assert (len(mesh.vertices), len(mesh.faces)) == (14, 15)
    np.testing.assert_array_equal(mesh.vertices, vertices)
    assert summary.extent == 2.0
    assert (summary.positions, summary.degenerate_faces) == (9, 1)
    assert summary.non_manifold_edges > 0
    assert np.isfinite(mesh.uvs).all()
    assert np.isfinite(mesh.tangents).all()


@pytest.mark.parametrize("scale", [1e31, 1e-40])
def test_sizes_that_formats_cannot_hold(tmp_path: Path, scale: float) -> None:
    with pytest.raises(MeshError, match="beyond what 3D formats can hold") as error:
        mesh_of(tmp_path, CUBE * scale, FACES)
    assert error.value.code == "mesh.size"


def test_a_heap_of_leaves_gets_a_cell_for_each_triangle(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    count = 4200
    leaves = rng.uniform(-1, 1, (count, 1, 3)) * 50 + rng.uniform(-1, 1, (count, 3, 3))
    mesh = mesh_of(tmp_path, leaves.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))
    assert "a cell for each of its 4200 triangles (4200 flat pieces)" in mesh.report.notes[-1]
    found = summarize(mesh).uv
    assert found.overlap == pytest.approx(1, abs=1e-3)
    assert found.coverage > 0.5
    assert found.zero_area_faces == 0
    assert mesh.uvs.min() > 0
    assert mesh.uvs.max() < 1


def test_faces_that_lie_on_one_another_share_their_texels(tmp_path: Path) -> None:
    """A cube whose sides are stored three times, once inside out and once from another corner on."""
    mesh = mesh_of(tmp_path, CUBE, np.concatenate([FACES, FACES[:, ::-1], np.roll(FACES, 1, axis=1)]))
    alone = mesh_of(tmp_path, CUBE, FACES)
    uv = mesh.corner_uvs.reshape(3, len(FACES), 3, 2)
    np.testing.assert_array_equal(uv[0], alone.corner_uvs)
    np.testing.assert_array_equal(uv[1], uv[0][:, ::-1])
    np.testing.assert_array_equal(uv[2], np.roll(uv[0], 1, axis=1))
