"""OBJ + MTL: the file's own lines where they can stay, else from the mesh; read back by trimesh."""

import dataclasses
import re

import numpy as np
import pytest
import trimesh
from PIL import Image
from tests.export.exporting import ASSETS, asset, known_maps

from paintit.export.image import encode_maps
from paintit.export.mtl import image_name
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


PATCH = """# a patch with everything
mtllib old.mtl
o patch
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 2 0 0.5
v 2 1 0.5
vn 0 0 1
vt 9 9
vt 0.1 0.1
vt 0.4 0.1
vt 0.4 0.4
vt 0.1 0.4
s 1
g left wall
usemtl a
f 1//1 2//1  3//1 4//1   # four corners
g right
s off
usemtl b
f -5/-4/1 -2/-3/1 -1/-2/1 -4/-1/1
vt 0.5 0.5
vt 0.9 0.5
vt 0.9 0.9
l 1 2
f 3/8 2/6 5/7
"""


def bare(text: str) -> list[str]:
    """The lines without texture coordinates, in tables or faces, and without the library."""
    lines = [line for line in text.splitlines() if line.split()[:1] not in (["vt"], ["mtllib"])]
    return [re.sub(r"(-?\d+)/(-?\d*)(?=/| |$)", r"\1/", line) if line.startswith("f") else line for line in lines]


def test_an_unwrap_changes_nothing_but_texture_coordinates(tmp_path) -> None:
    """One material has none and is unwrapped, the other keeps its own, named by numbers that count from both ends."""
    (tmp_path / "in.obj").write_text(PATCH)
    mesh = read_mesh(tmp_path / "in.obj")
    assert mesh.report.unwrapped_layers == (0,)
    write_obj(tmp_path / "out.obj", mesh, known_maps(mesh, 8))
    text = (tmp_path / "out.obj").read_text()
    want = [re.sub(r"^f (\S+)//1 (\S+)//1  (\S+)//1 (\S+)//1", r"f \1//1 \2//1  \3//1 \4//1", x) for x in bare(PATCH)]
    assert bare(text) == want
    again = read_mesh(tmp_path / "out.obj", "never")
    np.testing.assert_array_equal(again.faces, mesh.faces)
    np.testing.assert_allclose(again.corner_uvs, mesh.corner_uvs, atol=1e-12)
    assert [part.name for part in again.parts] == [part.name for part in mesh.parts]


def test_a_whole_unwrap_replaces_the_table(tmp_path) -> None:
    (tmp_path / "in.obj").write_text(PATCH)
    mesh = read_mesh(tmp_path / "in.obj", "always")
    write_obj(tmp_path / "out.obj", mesh, known_maps(mesh, 8))
    text = (tmp_path / "out.obj").read_text()
    assert "vt 9 9" not in text
    assert [line for line in text.splitlines() if line[:2] in ("g ", "s ", "l ", "o ", "# ", "us")] == [
        line for line in PATCH.splitlines() if line[:2] in ("g ", "s ", "l ", "o ", "# ", "us")
    ]
    np.testing.assert_allclose(read_mesh(tmp_path / "out.obj", "never").corner_uvs, mesh.corner_uvs, atol=1e-12)


def test_a_polygon_under_a_seam_becomes_its_triangles(tmp_path) -> None:
    (tmp_path / "in.obj").write_text(PATCH)
    mesh = read_mesh(tmp_path / "in.obj", "always")
    apart = mesh.corner_uvs.copy()
    apart[1] = apart[1] * 0.01 + 0.001
    mesh = dataclasses.replace(mesh, uvs=apart.reshape(-1, 2), face_uvs=np.arange(mesh.faces.size).reshape(-1, 3))
    write_obj(tmp_path / "out.obj", mesh, known_maps(mesh, 8))
    faces = [line.split() for line in (tmp_path / "out.obj").read_text().splitlines() if line.startswith("f ")]
    assert [len(words) - 1 for words in faces] == [3, 3, 4, 3]
    again = read_mesh(tmp_path / "out.obj", "never")
    np.testing.assert_allclose(again.corner_uvs, mesh.corner_uvs, atol=1e-12)
    np.testing.assert_array_equal(again.faces, mesh.faces)


@pytest.mark.parametrize("name", ["spot_quads.obj", "human.obj"])
def test_real_files_keep_their_polygons_when_unwrapped(name: str, tmp_path) -> None:
    mesh = asset(name, "always")
    write_obj(tmp_path / "out.obj", mesh, known_maps(mesh, 8))
    before, after = ((folder / name).read_text() for folder, name in ((ASSETS, name), (tmp_path, "out.obj")))
    kept = ("v ", "vn ", "g ", "o ", "s ", "#")
    pick = lambda text: [line.rstrip() for line in text.splitlines() if line.startswith(kept)]  # noqa: E731
    assert pick(after) == pick(before)
    again = read_mesh(tmp_path / "out.obj", "never")
    np.testing.assert_allclose(again.corner_uvs, mesh.corner_uvs, atol=1e-12)
    np.testing.assert_array_equal(again.faces, mesh.faces)


@pytest.mark.parametrize(
    ("line", "name"),
    [
        ("map_Kd wood.png", "wood.png"),
        ("  MAP_Kd  -s 1 2 3 -mm 0 1 -clamp on a b.png ", "a b.png"),
        ("bump -bm 0.5 -o 1 2 tiles.png", "tiles.png"),
        ("refl -type sphere sky.png", "sky.png"),
        ("Kd 1 1 1", ""),
        ("map_Kd", ""),
        ("map_Kd -s 1 1 1", ""),
    ],
)
def test_names_of_images_in_a_library(line: str, name: str) -> None:
    assert image_name(line) == name
