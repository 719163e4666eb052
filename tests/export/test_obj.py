"""OBJ + MTL: the file's own lines where they can stay, else from the mesh; read back by trimesh."""

import numpy as np
import pytest
import trimesh
from PIL import Image
from tests.export.exporting import ASSETS, asset, known_maps

from paintit.export.image import encode_maps
from paintit.export.obj import write_obj
from paintit.mesh.read import read_mesh


@pytest.mark.parametrize("name", ["spot_quads.obj", "teapot/teapot.obj"])
def test_own_lines_stay(name: str, tmp_path) -> None:
    """v, vt, vn, f, o, g and usemtl lines are those of the input, in order."""
    mesh = asset(name)
    write_obj(tmp_path / "out.obj", mesh, known_maps(mesh, 8))
    kept = {"v", "vt", "vn", "f", "o", "g", "s"}

    def statements(text: str) -> list[str]:
        return [line.rstrip() for line in text.splitlines() if line.strip() and line.split()[0] in kept]

    assert statements((tmp_path / "out.obj").read_text()) == statements((ASSETS / name).read_text())
    again = read_mesh(tmp_path / "out.obj")
    assert np.array_equal(again.face_layer, mesh.face_layer)
    assert [layer.name for layer in again.layers] == [layer.name for layer in mesh.layers]
    assert (tmp_path / "out.obj").read_text().count("mtllib") == 1


def test_unwrapped_mesh_reads_back(tmp_path) -> None:
    mesh = asset("koala.ply")
    write_obj(tmp_path / "my koala.obj", mesh, known_maps(mesh, 8))
    again = read_mesh(tmp_path / "my koala.obj")
    np.testing.assert_array_equal(again.vertices, mesh.vertices)
    np.testing.assert_array_equal(again.faces, mesh.faces)
    np.testing.assert_allclose(again.corner_uvs, mesh.corner_uvs, atol=1e-12)
    np.testing.assert_allclose(again.normals, mesh.normals, atol=1e-5)


def test_trimesh_reads_it(tmp_path) -> None:
    mesh = asset("koala.ply")
    maps = known_maps(mesh, 8)
    paths = write_obj(tmp_path / "out.obj", mesh, maps)
    assert sorted(p.name for p in paths) == sorted(
        ["out.obj", "out.mtl", "out_base_color.png", "out_roughness.png", "out_metallic.png", "out_normal.png"]
    )
    loaded = trimesh.load(tmp_path / "out.obj", process=False, force="mesh")
    assert isinstance(loaded, trimesh.Trimesh)
    np.testing.assert_allclose(loaded.triangles, mesh.vertices[mesh.faces], atol=1e-9)
    uv = np.asarray(loaded.visual.uv)[loaded.faces]  # pyright: ignore[reportAttributeAccessIssue]
    np.testing.assert_allclose(uv[..., 1], 1 - mesh.corner_uvs[..., 1], atol=1e-9)
    image = np.asarray(loaded.visual.material.image)  # pyright: ignore[reportAttributeAccessIssue]
    (encoded,) = encode_maps(maps)
    assert np.array_equal(image[..., :3], encoded.base_color)
    assert np.array_equal(np.asarray(Image.open(tmp_path / "out_metallic.png")), encoded.metallic)


def test_material_library(tmp_path) -> None:
    mesh = asset("teapot/teapot.obj")
    write_obj(tmp_path / "out.obj", mesh, known_maps(mesh, 8))
    blocks = (tmp_path / "out.mtl").read_text().split("newmtl ")[1:]
    for block, layer in zip(blocks, mesh.layers, strict=True):
        lines = dict(line.split(" ", 1) for line in block.splitlines()[1:] if line)
        assert block.startswith(layer.name + "\n")
        assert (lines["Kd"], lines["Pr"], lines["Pm"]) == ("1 1 1", "1", "1")
        for key, kind in {
            "map_Kd": "base_color",
            "map_Pr": "roughness",
            "map_Pm": "metallic",
            "norm": "normal",
        }.items():
            assert lines[key] == f"out_{kind}_{layer.name}.png"
            assert (tmp_path / lines[key]).is_file()


def test_faces_before_any_material_get_one(tmp_path) -> None:
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\nusemtl b\nf 3/3 2/2 1/1\n"
    (tmp_path / "in.obj").write_text(text)
    mesh = read_mesh(tmp_path / "in.obj", "never")
    write_obj(tmp_path / "out.obj", mesh, known_maps(mesh, 8))
    again = read_mesh(tmp_path / "out.obj", "never")
    assert [layer.name for layer in again.layers] == ["material", "b"]
    assert again.face_layer.tolist() == [0, 1]
