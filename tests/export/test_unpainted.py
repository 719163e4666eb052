"""Materials that are not chosen: shown while painting, and back in the file as they were."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import torch
from tests.export.exporting import errors_of, known_maps, load, validator_report
from tests.export.models import MODELS
from tests.export.roundtrip import differences

from paintit.config import OptimConfig, TextureConfig, ViewConfig, preset
from paintit.errors import MeshError, UsageError
from paintit.export.finish import finish
from paintit.export.image import write_maps
from paintit.export.read_maps import read_maps, read_maps_folder, unpainted_maps
from paintit.export.write import write
from paintit.guidance.exact import ExactPrior
from paintit.mesh.read import read_mesh
from paintit.paint.painter import Painter
from paintit.texture.fixed import GREY, grey, with_fixed

TINY = dataclasses.replace(
    preset("pocket"),
    texture=TextureConfig(size=32, widths=(4, 4), skip_widths=(2, 2), input_channels=2),
    views=ViewConfig(size=24, count=2),
    optim=OptimConfig(steps=2),
    device="cpu",
)
TWO = """mtllib in.mtl
o table
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 0 0 1
v 1 0 1
v 1 1 1
v 0 1 1
vt 0 0
vt 1 0
vt 1 1
vt 0 1
usemtl wood
f 1/1 2/2 3/3 4/4
# the glass has no texture coordinates
usemtl Glass Pane
f 5 6 7 8
"""
LIBRARY = """# by hand
newmtl wood
Kd 0.5 0.25 0
map_Kd old wood.png
newmtl Glass Pane
Kd 0.1 0.2 0.3
d 0.4
map_Kd -s 2 2 1 -clamp on images/glass tint.png
map_d ../outside.png
"""


@pytest.fixture
def table(tmp_path: Path) -> Path:
    folder = tmp_path / "in"
    (folder / "images").mkdir(parents=True)
    (folder / "in.obj").write_text(TWO)
    (folder / "in.mtl").write_text(LIBRARY)
    (folder / "images" / "glass tint.png").write_bytes(b"tint")
    (folder / "old wood.png").write_bytes(b"wood")
    (tmp_path / "outside.png").write_bytes(b"secret")
    return folder / "in.obj"


@pytest.mark.parametrize(
    ("materials", "exclude", "painted"),
    [
        ((), (), [True] * 5),
        (("leaf", "CAR"), (), [True, False, False, True, False]),
        ((), ("sign", "Glass"), [True, False, True, True, False]),
        (("leaf", "car"), ("car",), [True, False, False, False, False]),
    ],
)
def test_choosing(materials: tuple[str, ...], exclude: tuple[str, ...], painted: list[bool], tmp_path: Path) -> None:
    mesh = read_mesh(MODELS["material_settings"](tmp_path), "auto", materials, exclude)
    assert [layer.painted for layer in mesh.layers] == painted


def test_mistakes_are_one_line(table: Path) -> None:
    with pytest.raises(UsageError) as caught:
        read_mesh(table, materials=["wodo"])
    assert str(caught.value) == "there is no material 'wodo'; the mesh has: wood, Glass Pane"
    with pytest.raises(UsageError) as caught:
        read_mesh(table, exclude=["wood", "glass pane"])
    assert caught.value.code == "materials.none_left"
    assert "\n" not in str(caught.value)


def test_a_name_that_differs_in_case_from_two_is_unknown(table: Path) -> None:
    table.write_text(TWO + "usemtl WOOD\nf 1/1 2/2 3/3\n")
    assert [layer.painted for layer in read_mesh(table, materials=["WOOD"]).layers] == [False, False, True]
    with pytest.raises(UsageError, match="no material 'Wood'"):
        read_mesh(table, materials=["Wood"])


def test_they_are_neither_judged_nor_unwrapped(table: Path) -> None:
    with pytest.raises(MeshError, match="no texture coordinates"):
        read_mesh(table, "never")
    mesh = read_mesh(table, "never", exclude=["glass pane"])
    assert mesh.report.uv_origin == "file"
    assert (mesh.corner_uvs[mesh.face_layer == 1] == 0.5).all()
    always = read_mesh(table, "always", materials=["wood"])
    assert always.report.unwrapped_layers == (0,)
    assert (always.corner_uvs[always.face_layer == 1] == 0.5).all()


def test_they_are_shown_but_have_no_field(tmp_path: Path) -> None:
    """The fixed layer's maps are the file's own at every step; the field has one layer; support counts the rest."""
    path = MODELS["names_and_scenes"](tmp_path)
    full = read_mesh(MODELS["material_settings"](tmp_path), materials=["leaf", "car"])
    fixed = unpainted_maps(full, 32)
    assert fixed is not None
    assert fixed.layers == 3
    painter = Painter(full, "red plastic", TINY, ExactPrior(), fixed=fixed)
    list(painter)
    maps = painter.maps()
    assert maps.layers == 5
    assert painter.field().layers == 2
    own = read_maps(full, 32)
    for layer in (1, 2, 4):
        assert torch.equal(maps.packed()[layer], own.packed()[layer])
    for layer in (0, 3):
        assert not torch.equal(maps.packed()[layer], own.packed()[layer])
    finished = finish(full, maps, painter.support)
    for layer in (1, 2, 4):
        assert torch.equal(finished.packed()[layer], own.packed()[layer])
    assert unpainted_maps(read_mesh(path), 32) is None


def test_another_format_shows_them_grey(table: Path) -> None:
    mesh = read_mesh(table, materials=["wood"])
    assert unpainted_maps(mesh, 32) is None
    painter = Painter(mesh, "red plastic", TINY, ExactPrior())
    assert torch.equal(painter.maps().packed()[1], torch.tensor(GREY).expand(32, 32, 8))
    next(iter(painter))


def test_fixed_maps_must_fit() -> None:
    with pytest.raises(ValueError, match="fixed layers"):
        with_fixed(grey(1, 8), grey(1, 8), [True, False, False])
    with pytest.raises(ValueError, match="fixed ones"):
        with_fixed(grey(1, 8), grey(1, 4), [True, False])


@pytest.mark.parametrize("extension", [".glb", ".gltf"])
@pytest.mark.parametrize("unwrap", ["auto", "always"])
def test_gltf_keeps_them(unwrap: str, extension: str, tmp_path: Path) -> None:
    source = MODELS["material_settings"](tmp_path)
    mesh = read_mesh(source, unwrap, exclude=["sign", "lamp", "car"])  # pyright: ignore[reportArgumentType]
    out = tmp_path / "out" / f"out{extension}"
    write(out, mesh, known_maps(mesh, 8), {})
    assert differences(source, out, ["leaf", "glass"]) == []
    # The checker knows no painted one among them, so these would be differences.
    assert differences(source, out, ["glass"]) != []
    after = load(out)
    assert after.json["materials"][4] == load(source).json["materials"][4]
    assert "TANGENT" not in after.json["meshes"][4]["primitives"][0]["attributes"]
    assert "TANGENT" in after.json["meshes"][0]["primitives"][0]["attributes"]


@pytest.mark.judge
def test_a_new_gltf_has_factors_for_them(table: Path) -> None:
    mesh = read_mesh(table, materials=["wood"])
    out = table.parent / "out.glb"
    write(out, mesh, known_maps(mesh, 8), {})
    _, glass = load(out).json["materials"]
    assert glass["pbrMetallicRoughness"] == {
        "baseColorFactor": [0.5, 0.5, 0.5, 1.0],
        "metallicFactor": 0.0,
        "roughnessFactor": 0.8,
    }
    assert len(load(out).json["images"]) == 3
    assert errors_of(out) == []
    assert validator_report(out)["info"]["materialCount"] == 2


@pytest.mark.parametrize("unwrap", ["auto", "always"])
def test_obj_keeps_their_words_and_images(unwrap: str, table: Path, tmp_path: Path) -> None:
    mesh = read_mesh(table, unwrap, materials=["wood"])  # pyright: ignore[reportArgumentType]
    out = tmp_path / "out" / "new.obj"
    write(out, mesh, known_maps(mesh, 8), {})
    library = (out.parent / "new.mtl").read_text()
    assert library.endswith(LIBRARY[LIBRARY.index("newmtl Glass") :])
    assert "0.5 0.25 0" not in library
    assert (out.parent / "images" / "glass tint.png").read_bytes() == b"tint"
    names = {str(p.relative_to(out.parent)) for p in out.parent.rglob("*") if p.is_file()}
    pngs = {f"new_{key}_wood.png" for key in ("base_color", "roughness", "metallic", "normal")}
    assert names == {"new.obj", "new.mtl", "images/glass tint.png", *pngs}
    text = out.read_text()
    assert "# the glass has no texture coordinates\nusemtl Glass Pane\nf 5 6 7 8\n" in text
    again = read_mesh(out, "never", materials=["wood"])
    np.testing.assert_allclose(again.corner_uvs[:2], mesh.corner_uvs[:2], atol=1e-12)


def test_map_folders_hold_the_painted_alone(table: Path, tmp_path: Path) -> None:
    mesh = read_mesh(table, materials=["wood"])
    paths = write_maps(tmp_path / "maps", mesh, known_maps(mesh, 8))
    assert sorted(p.name for p in paths) == ["base_color_wood.png", "normal_wood.png", "orm_wood.png"]
    maps = read_maps_folder(tmp_path / "maps", mesh)
    np.testing.assert_allclose(maps.base_color[0], known_maps(mesh, 8).base_color[0], atol=1e-6)
    assert torch.equal(maps.packed()[1], torch.tensor(GREY).expand(8, 8, 8))
