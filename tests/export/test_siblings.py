"""Files beside the asset: what comes, what stays, and that the user's own are never lost."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from tests.export.exporting import asset, known_maps
from tests.export.models import MODELS, png
from tests.export.roundtrip import differences

from paintit.cli.main import main
from paintit.errors import OutputError
from paintit.export.siblings import check_siblings, copied_beside, made_beside
from paintit.export.write import write
from paintit.mesh.read import read_mesh


def refused(path: Path, mesh, overwrite: bool) -> str:
    """The code of the refusal; nothing in the folder has changed."""
    before = {p: p.read_bytes() for p in path.parent.rglob("*") if p.is_file()}
    with pytest.raises(OutputError) as caught:
        write(path, mesh, known_maps(mesh, 8), {}, overwrite)
    assert {p: p.read_bytes() for p in path.parent.rglob("*") if p.is_file()} == before
    assert "\n" not in str(caught.value)
    return caught.value.code


@pytest.mark.parametrize("neighbour", ["x.mtl", "x_base_color.png"])
def test_an_obj_replaces_no_neighbour_unasked(neighbour: str, tmp_path: Path) -> None:
    mesh = asset("spot_quads.obj")
    (tmp_path / neighbour).write_text("precious")
    assert refused(tmp_path / "x.obj", mesh, overwrite=False) == "output.exists"
    write(tmp_path / "x.obj", mesh, known_maps(mesh, 8), {}, overwrite=True)
    assert (tmp_path / "x.mtl").read_text().startswith("# paintit")


@pytest.mark.parametrize("neighbour", ["x.bin", "x_orm.png"])
def test_nor_does_a_gltf(neighbour: str, tmp_path: Path) -> None:
    mesh = asset("spot_quads.obj")
    (tmp_path / neighbour).write_text("precious")
    assert refused(tmp_path / "x.gltf", mesh, overwrite=False) == "output.exists"
    write(tmp_path / "x.gltf", mesh, known_maps(mesh, 8), {}, overwrite=True)


def test_the_input_and_what_it_names_are_never_replaced(tmp_path: Path) -> None:
    """Not even when told to overwrite: the painted file would be all that is left of them."""
    path = MODELS["separate_files"](tmp_path)
    document = json.loads(path.read_text())
    document["images"][1]["uri"] = "new_base_color.png"
    (tmp_path / "new_base_color.png").write_bytes(png(3))
    path.write_text(json.dumps(document))
    mesh = read_mesh(path)
    assert refused(tmp_path / "new.gltf", mesh, overwrite=True) == "output.is_input"
    assert refused(path, mesh, overwrite=True) == "output.is_input"
    assert refused(tmp_path / "ge ometrie é.gltf", mesh, overwrite=True) == "output.is_input"
    write(tmp_path / "other.gltf", mesh, known_maps(mesh, 8), {})
    obj = tmp_path / "spot.obj"
    obj.write_text("mtllib s.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n")
    (tmp_path / "s.mtl").write_text("newmtl m\nmap_Kd t_normal.png\n")
    (tmp_path / "t_normal.png").write_bytes(png(4))
    triangle = read_mesh(obj)
    assert refused(tmp_path / "s.obj", triangle, overwrite=True) == "output.is_input"
    assert refused(tmp_path / "t.obj", triangle, overwrite=True) == "output.is_input"


@pytest.mark.parametrize("how", ["itself", "symlink", "hard link", "another way"])
@pytest.mark.parametrize("kind", [".obj", ".gltf"])
def test_the_input_is_known_by_any_name(how: str, kind: str, tmp_path: Path, capsys) -> None:
    """By all commands that write a mesh, though told to overwrite."""
    source = tmp_path / f"mesh{kind}"
    write(source, asset("spot_quads.obj"), known_maps(asset("spot_quads.obj"), 8), {})
    target = tmp_path / f"other{kind}"
    if how == "itself":
        target = source
    elif how == "symlink":
        target.symlink_to(source)
    elif how == "hard link":
        target.hardlink_to(source)
    else:
        (tmp_path / "way").symlink_to(tmp_path)
        target = tmp_path / "way" / source.name
    before = {path: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()}
    commands = [["paint", source, "red plastic", "-o", target], ["unwrap", source, "-o", target]]
    if kind == ".gltf":
        commands.append(["export", source, "-o", target])
    for command in commands:
        assert main(["--quiet", *map(str, command), "--overwrite"]) == 1
        line = capsys.readouterr().err
        assert line.count("\n") == 1
        assert "mesh itself; choose another name with -o" in line
    assert {path: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()} == before


def test_maps_do_not_replace_the_textures_they_were_read_from(tmp_path: Path) -> None:
    path = MODELS["separate_files"](tmp_path)
    document = json.loads(path.read_text())
    document["images"][1]["uri"] = "base_color.png"
    (tmp_path / "base_color.png").write_bytes(png(3))
    path.write_text(json.dumps(document))
    assert refused(tmp_path, read_mesh(path), overwrite=True) == "output.is_input"


def test_images_that_stay_keep_their_names(tmp_path: Path) -> None:
    """In another folder they are copied under their own names; in the same one they are left where they lie."""
    source = MODELS["separate_files"](tmp_path)
    mesh = read_mesh(source)
    out = tmp_path / "far" / "away" / "out.gltf"
    paths = write(out, mesh, known_maps(mesh, 8), {})
    uris = [image.get("uri") for image in json.loads(out.read_text())["images"]]
    assert uris[:3] == ["écorce.png", "100%25%20sure.png", "sub/inner.png"]
    assert (out.parent / "100% sure.png").read_bytes() == (tmp_path / "100% sure.png").read_bytes()
    assert out.parent / "sub" / "inner.png" in paths
    assert not (out.parent / "Holz dunkel.png").exists()
    assert differences(source, out) == []
    beside = write(tmp_path / "out.gltf", mesh, known_maps(mesh, 8), {})
    assert len(beside) == 5
    assert differences(source, tmp_path / "out.gltf") == []
    (out.parent / "écorce.png").write_bytes(b"another tree")
    assert refused(out.parent / "again.gltf", mesh, overwrite=False) == "output.exists"


@pytest.mark.parametrize("name", ["separate_files", "data_uris", "two_uv_sets"])
def test_gltf_becomes_glb_and_back(name: str, tmp_path: Path) -> None:
    source = MODELS[name](tmp_path)
    mesh = read_mesh(source)
    write(tmp_path / "a.glb", mesh, known_maps(mesh, 8), {})
    assert differences(source, tmp_path / "a.glb") == []
    again = read_mesh(tmp_path / "a.glb")
    write(tmp_path / "b" / "b.gltf", again, known_maps(again, 8), {})
    assert differences(source, tmp_path / "b" / "b.gltf") == []


@pytest.mark.parametrize("name", ["a.glb", "b.gltf", "ü c.gltf", "d.obj"])
def test_the_names_told_beforehand_are_those_that_are_written(name: str, tmp_path: Path) -> None:
    for k, mesh in enumerate(
        (asset("spot_quads.obj"), asset("teapot/teapot.obj"), read_mesh(MODELS["two_uv_sets"](tmp_path)))
    ):
        path = tmp_path / str(k) / name
        check_siblings(path, mesh)
        told = {path, *made_beside(path, mesh), *copied_beside(path, mesh)}
        assert set(write(path, mesh, known_maps(mesh, 8), {})) == told
