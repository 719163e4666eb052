"""KHR_texture_transform: which UVs are painted, what the painted file says, and that the old look is read rightly."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image
from tests.export.exporting import known_maps
from tests.mesh.glb_builder import QUAD_UV, Builder, quad

from paintit.color import decode_srgb
from paintit.export.gltf import assemble
from paintit.export.read_maps import read_maps
from paintit.mesh.gltf_texcoord import transformed
from paintit.mesh.mesh import Mesh
from paintit.mesh.read import read_mesh

TRANSFORM = "KHR_texture_transform"
QUANTISED = {"scale": [1 / 4095, 1 / 4095]}
ATLAS = {"offset": [0.5, 0.0], "scale": [0.5, 0.5]}
TILES = {"scale": [4, 4]}


def pictures() -> tuple[np.ndarray, bytes]:
    """Four coloured quarters, and their PNG."""
    pixels = np.zeros((16, 16, 3), np.uint8)
    pixels[:8, :8], pixels[:8, 8:], pixels[8:, :8], pixels[8:, 8:] = (
        (255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 0),
    )  # fmt: skip
    data = io.BytesIO()
    Image.fromarray(pixels).save(data, "PNG")
    return pixels, data.getvalue()


def textured(transform: dict[str, Any], scale: float = 1.0) -> Builder:
    """A square with a colour and an emission through ``transform``; its UVs are ``scale`` times the unit square."""
    b = quad()
    b.json["images"] = [{"bufferView": b.view(pictures()[1]), "mimeType": "image/png"}]
    b.json["textures"] = [{"source": 0}]
    info = {"index": 0, "extensions": {TRANSFORM: transform}}
    b.json["materials"] = [
        {"name": "skin", "pbrMetallicRoughness": {"baseColorTexture": info, "metallicFactor": 0},
         "emissiveTexture": info, "emissiveFactor": [1, 1, 1]}
    ]  # fmt: skip
    primitive = b.json["meshes"][0]["primitives"][0]
    primitive["material"] = 0
    primitive["attributes"]["TEXCOORD_0"] = b.accessor(np.array(QUAD_UV) * scale)
    b.json["extensionsUsed"] = [TRANSFORM]
    return b


def painted(mesh: Mesh, path: Path) -> tuple[dict[str, Any], Mesh]:
    """The painted file's material and the mesh in it."""
    path.write_bytes(assemble(mesh, known_maps(mesh), {}).glb())
    again = read_mesh(path)
    assert again.source is not None
    return again.source.document.json["materials"][0], again


def transform_of(info: dict[str, Any]) -> dict[str, Any] | None:
    return info.get("extensions", {}).get(TRANSFORM)


@pytest.mark.parametrize(
    ("transform", "scale", "kept"),
    [(QUANTISED, 4095, True), (ATLAS, 1, False), (TILES, 1, False), ({"scale": [16, 16]}, 1 / 16, True)],
    ids=["quantised", "part of an atlas", "tiles", "in a corner"],
)
def test_the_square_is_painted_whole(tmp_path: Path, transform: dict[str, Any], scale: float, kept: bool) -> None:
    """In every case the painted texture covers the square once, whatever the transform did to the old one."""
    mesh = read_mesh(textured(transform, scale).glb(tmp_path / "a.glb"))
    np.testing.assert_allclose(mesh.uvs, QUAD_UV, atol=1e-6)
    assert mesh.report.uv_origin == "file"
    how = (
        f"through the {TRANSFORM} of its colour, which stays" if kept else f"without the {TRANSFORM} of its old colour"
    )
    assert mesh.report.notes == (f"'skin' is painted {how}",)
    material, again = painted(mesh, tmp_path / "b.glb")
    pbr = material["pbrMetallicRoughness"]
    for info in (pbr["baseColorTexture"], pbr["metallicRoughnessTexture"], material["normalTexture"]):
        assert transform_of(info) == (transform if kept else None)
    assert transform_of(material["emissiveTexture"]) == transform  # what is not painted stays as it was
    np.testing.assert_allclose(again.corner_uvs, mesh.corner_uvs, atol=1e-6)
    maps, back = known_maps(mesh), read_maps(again)
    np.testing.assert_allclose(back.base_color, maps.base_color, atol=0.02)


def test_stored_coordinates_stay_byte_for_byte(tmp_path: Path) -> None:
    mesh = read_mesh(textured(QUANTISED, 4095).glb(tmp_path / "a.glb"))
    _, again = painted(mesh, tmp_path / "b.glb")
    assert mesh.source is not None
    assert again.source is not None
    for document in (mesh.source.document, again.source.document):
        attributes = document.json["meshes"][0]["primitives"][0]["attributes"]
        assert document.accessor(attributes["TEXCOORD_0"]).max() == 4095
        assert "TEXCOORD_1" not in attributes


@pytest.mark.parametrize(
    ("transform", "scale"),
    [(QUANTISED, 4095), (ATLAS, 1), ({"offset": [0.0, 1.0], "rotation": np.pi / 2}, 1)],
    ids=["quantised", "part of an atlas", "a quarter turn"],
)
def test_the_old_look_is_read_through_the_transform(tmp_path: Path, transform: dict[str, Any], scale: float) -> None:
    """At the middle of each quarter of the square: the colour that the transform leads to, worked out by hand."""
    mesh = read_mesh(textured(transform, scale).glb(tmp_path / "a.glb"))
    found = read_maps(mesh, 32).base_color[0].numpy()
    pixels = decode_srgb(torch.from_numpy(pictures()[0] / 255.0)).numpy()
    for u, v in [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)]:
        x, y = {
            "quantised": (u, v),
            "atlas": (0.5 + u / 2, v / 2),
            "turn": (v, 1 - u),  # counter-clockwise on the screen, where v points down
        }["quantised" if scale > 1 else "turn" if "rotation" in transform else "atlas"]
        np.testing.assert_allclose(found[int(v * 32), int(u * 32)], pixels[int(y * 16), int(x * 16)], atol=0.01)


def test_the_transform_may_name_another_set(tmp_path: Path) -> None:
    b = textured(ATLAS | {"texCoord": 1})
    primitive = b.json["meshes"][0]["primitives"][0]
    primitive["attributes"]["TEXCOORD_1"] = b.accessor(np.array(QUAD_UV)[:, ::-1])
    mesh = read_mesh(b.glb(tmp_path / "a.glb"))
    np.testing.assert_allclose(mesh.uvs, np.array(QUAD_UV)[:, ::-1])
    material, _ = painted(mesh, tmp_path / "b.glb")
    assert material["pbrMetallicRoughness"]["baseColorTexture"]["texCoord"] == 1


def test_order_of_scale_rotation_and_offset() -> None:
    info = {"extensions": {TRANSFORM: {"offset": [10, 20], "rotation": np.pi / 2, "scale": [2, 3]}}}
    np.testing.assert_allclose(transformed(info, np.array([[1.0, 1.0]])), [[10 + 3, 20 - 2]])
