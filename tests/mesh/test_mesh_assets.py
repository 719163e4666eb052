"""Every mesh in assets/meshes, held to the table in ASSETS.md."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from paintit.mesh.inspect import MeshSummary, summarize
from paintit.mesh.mesh import Mesh
from paintit.mesh.read import read_mesh

# path: distinct positions, triangles, layers, decision, bounds, boundary edges
TABLE = {
    "spot/spot.obj": (2930, 5856, 1, "file", (-0.47, -0.74, -0.67, 0.47, 0.95, 1.05), 0),
    "spot_quads.obj": (188, 372, 1, "file", (-0.59, -0.76, -0.70, 0.59, 0.98, 1.08), 0),
    "bob/bob.obj": (5344, 10688, 1, "file", (-0.91, -0.51, -0.73, 0.94, 0.46, 0.73), 0),
    "human.obj": (10475, 20908, 1, "file", (-0.82, 0.00, -0.15, 0.82, 1.72, 0.14), 32),
    "koala.ply": (3560, 7116, 1, "unwrapped", (-1.88, -1.38, -4.23, 1.88, 3.96, 4.98), 0),
    "wingnut.stl": (3047, 6090, 1, "unwrapped", (-1.51, -1.00, -3.61, 1.51, 3.27, 3.59), 0),
    "chair/chair.obj": (4802, 9584, 2, "unwrapped", (-25.9, 354.3, -26.7, 25.4, 434.2, 26.4), 0),
    "chicken/chicken.obj": (1433, 2724, 3, "file", (-12.1, -0.05, -16.8, 12.1, 45.5, 16.0), 114),
    "teapot/teapot.obj": (15728, 31456, 2, "file", (-9.6, 0.0, -7.5, 12.0, 21.3, 7.2), 0),
    "fox.glb": (290, 576, 1, "file", (-12.6, -0.1, -88.1, 12.6, 78.9, 66.6), 0),
    "rigged_figure.glb": (130, 256, 1, "unwrapped", (-0.59, 0.00, -0.13, 0.59, 1.45, 0.20), 0),
    "flight_helmet.glb": (47561, 94722, 6, "file", (-0.20, 0.00, -0.17, 0.16, 0.72, 0.20), 296),
    "avocado.glb": (363, 682, 1, "file", (-0.021, 0.000, -0.014, 0.021, 0.063, 0.014), 38),
    "water_bottle.glb": (2385, 4510, 1, "file", (-0.054, -0.130, -0.054, 0.054, 0.130, 0.054), 264),
}


@pytest.fixture(scope="module")
def read(assets: Path) -> dict[str, tuple[Mesh, MeshSummary]]:
    meshes = {name: read_mesh(assets / "meshes" / name) for name in TABLE}
    return {name: (mesh, summarize(mesh, 256)) for name, mesh in meshes.items()}


@pytest.mark.parametrize("name", TABLE)
def test_counts_and_decision(read: dict[str, tuple[Mesh, MeshSummary]], name: str) -> None:
    summary = read[name][1]
    positions, faces, layers, decision, bounds, boundary = TABLE[name]
    assert (summary.positions, summary.faces, len(summary.layers)) == (positions, faces, layers)
    assert summary.uv_origin == decision
    assert summary.boundary_edges == boundary
    assert summary.watertight == (boundary == 0)
    # ASSETS.md prints two or three digits; one unit of the last digit, as it truncates.
    digit = 0.1 if max(map(abs, bounds)) > 3 * 4 else 0.001 if max(map(abs, bounds)) < 0.2 else 0.01
    np.testing.assert_allclose(np.array(summary.bounds).reshape(-1), bounds, atol=digit)


@pytest.mark.parametrize("name", [n for n in TABLE if n != "rigged_figure.glb" and n != "fox.glb"])
def test_bounds_agree_with_another_reader(read: dict[str, tuple[Mesh, MeshSummary]], assets: Path, name: str) -> None:
    trimesh = pytest.importorskip("trimesh")
    expected = trimesh.load_scene(assets / "meshes" / name, process=False).bounds
    extent = float((expected[1] - expected[0]).max())
    np.testing.assert_allclose(read[name][0].bounds, expected, atol=1e-6 * extent)


@pytest.mark.parametrize("name", TABLE)
def test_invariants(read: dict[str, tuple[Mesh, MeshSummary]], name: str) -> None:
    mesh, summary = read[name]
    assert (mesh.face_uvs >= 0).all()
    assert np.isfinite(mesh.uvs).all()
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=-1), 1, atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(mesh.tangents[..., :3], axis=-1), 1, atol=1e-5)
    assert np.abs((mesh.normals * mesh.tangents[..., :3]).sum(-1)).max() < 1e-4
    assert set(np.unique(mesh.tangents[..., 3])) <= {-1.0, 1.0}
    assert [p.faces[0] for p in mesh.parts] == [0, *[p.faces[1] for p in mesh.parts[:-1]]]
    assert mesh.parts[-1].faces[1] == len(mesh.faces)
    for part in mesh.parts:
        assert (mesh.face_layer[slice(*part.faces)] == part.layer).all()
    assert summary.uv.paintable
    json.dumps(asdict(summary))


def test_tangents_agree_with_those_in_the_file(read: dict[str, tuple[Mesh, MeshSummary]]) -> None:
    """flight_helmet.glb brings its own TANGENT: another program's MikkTSpace, which also fixes the sign of w."""
    mesh, _ = read["flight_helmet.glb"]
    assert mesh.source is not None
    assert mesh.source.corner_vertex is not None
    document = mesh.source.document
    direction, sign = [], []
    for part in mesh.parts:
        assert part.primitive is not None
        primitive = document.json["meshes"][part.primitive[0]]["primitives"][part.primitive[1]]
        tangent = document.accessor(primitive["attributes"]["TANGENT"])[mesh.source.corner_vertex[slice(*part.faces)]]
        ours = mesh.tangents[slice(*part.faces)]
        direction.append((ours[..., :3] * tangent[..., :3]).sum(-1) > np.cos(np.radians(5)))
        sign.append(ours[..., 3] == tangent[..., 3])
    assert np.concatenate(sign).mean() > 0.999
    assert np.concatenate(direction).mean() > 0.95  # the file stores one tangent per vertex; ours are per corner


def test_skinned_rest_pose_ignores_the_node_transform(read: dict[str, tuple[Mesh, MeshSummary]]) -> None:
    low, high = read["rigged_figure.glb"][0].bounds
    assert high[1] - low[1] > 1.4  # stands along +Y although the node turns Z-up data
    assert abs(low[1]) < 0.01


def test_textures_of_the_fox_are_all_mirrored(read: dict[str, tuple[Mesh, MeshSummary]]) -> None:
    assert read["fox.glb"][1].uv.mirrored_share == pytest.approx(1.0)
    assert (read["fox.glb"][0].tangents[..., 3] == -1).all()
    assert read["koala.ply"][1].uv.mirrored_share == 0.0  # our own unwrap never mirrors


def test_units_and_origin_are_kept(read: dict[str, tuple[Mesh, MeshSummary]]) -> None:
    assert read["chair/chair.obj"][0].bounds[0, 1] > 354
