"""Where a file's winding contradicts its normals, the exported triangles turn toward the normals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from tests.export.exporting import known_maps, load

from paintit.export.gltf import write_gltf
from paintit.mesh.read import read_mesh

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvn 0 0 -1\n"


def test_front_is_where_the_normals_point(tmp_path: Path) -> None:
    (tmp_path / "in.obj").write_text(SQUARE + "f 1/1/1 2/2/1 3/3/1\nf 1/1/1 4/4/1 3/3/1\n")
    mesh = read_mesh(tmp_path / "in.obj")
    write_gltf(tmp_path / "out.glb", mesh, known_maps(mesh), {})
    document = load(tmp_path / "out.glb")
    primitive = document.json["meshes"][0]["primitives"][0]
    read = {name: document.accessor(index) for name, index in primitive["attributes"].items()}
    faces = document.accessor(primitive["indices"]).reshape(-1, 3)
    a, b, c = (read["POSITION"][faces[:, k]] for k in range(3))
    np.testing.assert_allclose(np.cross(b - a, c - a), [[0, 0, -1]] * 2)
    np.testing.assert_allclose(read["NORMAL"], [[0, 0, -1]] * len(read["NORMAL"]))
    # Each vertex keeps its own texture coordinates.
    np.testing.assert_allclose(read["TEXCOORD_0"], read["POSITION"][:, :2] * (1, -1) + (0, 1))
