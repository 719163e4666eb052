"""Draco geometry is decoded into plain accessors; meshopt needs an uncompressed copy."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import DracoPy
import numpy as np
import pytest
from tests.export.exporting import known_maps
from tests.mesh.glb_builder import QUAD, QUAD_INDICES, QUAD_UV, Builder, quad

from paintit.errors import MeshError
from paintit.export.gltf import assemble
from paintit.mesh.gltf_document import GltfDocument
from paintit.mesh.gltf_parse import read_document
from paintit.mesh.mesh import Mesh
from paintit.mesh.read import read_mesh

DRACO = "KHR_draco_mesh_compression"
MESHOPT = "EXT_meshopt_compression"


def wave(n: int = 12) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions, texture coordinates and faces of a curved sheet."""
    u, v = (grid.ravel() for grid in np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n)))
    i = np.arange(n * n).reshape(n, n)
    faces = np.stack([i[:-1, :-1], i[:-1, 1:], i[1:, 1:], i[:-1, :-1], i[1:, 1:], i[1:, :-1]], -1).reshape(-1, 3)
    return np.stack([u, v, 0.1 * np.sin(6 * u)], 1), np.stack([u, 1 - v], 1), faces


def compressed(required: bool = True, **encoding: Any) -> Builder:
    """A skinned sheet in Draco: quantised positions, lossless texture coordinates, joints and weights."""
    points, uv, faces = wave()
    joints = np.zeros((len(points), 4), np.uint16)
    joints[:, 0] = points[:, 0] > 0.5
    data = DracoPy.encode(
        points, faces.astype(np.uint32), tex_coord=uv.copy(), quantization_bits=14,
        generic_attributes={0: joints, 1: np.tile(np.float32([1, 0, 0, 0]), (len(points), 1))}, **encoding,
    )  # fmt: skip
    found = DracoPy.decode(data)
    ids = {a["attribute_type"]: a["unique_id"] for a in found.attributes}
    b = Builder()

    def empty(kind: str, code: int, count: int = len(points), **extra: Any) -> int:
        b.json["accessors"].append({"componentType": code, "count": count, "type": kind, **extra})
        return len(b.json["accessors"]) - 1

    primitive = {
        "attributes": {
            "POSITION": empty("VEC3", 5126, min=[0, 0, -0.1], max=[1, 1, 0.1]),
            "TEXCOORD_0": empty("VEC2", 5126),
            "JOINTS_0": empty("VEC4", 5121),
            "WEIGHTS_0": empty("VEC4", 5126),
        },
        "indices": empty("SCALAR", 5123, faces.size),
        "extensions": {
            DRACO: {
                "bufferView": b.view(data),
                "attributes": {"POSITION": ids[0], "TEXCOORD_0": ids[3], "JOINTS_0": 0, "WEIGHTS_0": 1},
            }
        },
    }
    b.json["meshes"] = [{"primitives": [primitive]}]
    b.json["skins"] = [{"joints": [1, 2]}]
    b.json["nodes"] = [{"mesh": 0, "skin": 0}, {}, {}]
    b.json["extensionsUsed"] = [DRACO]
    if required:
        b.json["extensionsRequired"] = [DRACO]
    return b


def refused(path: Path) -> str:
    with pytest.raises(MeshError) as error:
        read_mesh(path)
    assert "\n" not in str(error.value)
    return error.value.message.removeprefix(f"cannot read {path}: ")


def document(mesh: Mesh) -> GltfDocument:
    assert mesh.source is not None
    return mesh.source.document


@pytest.mark.parametrize("encoding", [{"compression_level": 10}, {"preserve_order": True}], ids=["edges", "in order"])
def test_draco_is_decoded(tmp_path: Path, encoding: dict[str, Any]) -> None:
    mesh = read_mesh(compressed(**encoding).glb(tmp_path / "a.glb"))
    points, uv, faces = wave()
    assert len(mesh.faces) == len(faces)
    # Corners in an order of their own: every decoded one has its like in the sheet, position and texture alike.
    nearest = np.linalg.norm(mesh.vertices[:, None] - points, axis=-1).argmin(1)
    np.testing.assert_allclose(mesh.vertices, points[nearest], atol=1e-4)
    np.testing.assert_allclose(mesh.uvs, uv[nearest], atol=1e-6)
    key = lambda f: sorted(tuple(np.roll(t, -int(np.argmin(t)))) for t in f.tolist())  # noqa: E731
    assert key(nearest[mesh.faces]) == key(faces)
    assert mesh.report.notes[0] == f"decoded 1 primitives from {DRACO}"


def test_a_decoded_document_is_a_plain_one(tmp_path: Path) -> None:
    found = document(read_mesh(compressed().glb(tmp_path / "a.glb")))
    assert "extensionsUsed" not in found.json
    assert "extensionsRequired" not in found.json
    primitive = found.json["meshes"][0]["primitives"][0]
    assert "extensions" not in primitive
    joints = found.accessor(primitive["attributes"]["JOINTS_0"])
    assert (joints.dtype, sorted(set(joints[:, 0].tolist()))) == (np.uint8, [0, 1])
    position = found.json["accessors"][primitive["attributes"]["POSITION"]]
    values = found.accessor(primitive["attributes"]["POSITION"])
    assert (position["min"], position["max"]) == (values.min(0).tolist(), values.max(0).tolist())


def test_painted_output_has_plain_accessors(tmp_path: Path) -> None:
    mesh = read_mesh(compressed().glb(tmp_path / "a.glb"))
    (tmp_path / "b.glb").write_bytes(assemble(mesh, known_maps(mesh), {}).glb())
    again = read_mesh(tmp_path / "b.glb")
    assert DRACO not in document(again).json.get("extensionsUsed", [])
    np.testing.assert_array_equal(again.vertices[again.faces], mesh.vertices[mesh.faces])
    np.testing.assert_array_equal(again.corner_uvs, mesh.corner_uvs)


def test_without_the_decoder_it_is_refused_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = compressed().glb(tmp_path / "a.glb")
    monkeypatch.setitem(sys.modules, "DracoPy", None)  # what Python does where a module is not installed
    with pytest.raises(MeshError) as error:
        read_mesh(path)
    assert error.value.code == "mesh.gltf_extension"
    assert f"primitive 0 of mesh 0 is compressed with {DRACO}, and DracoPy" in error.value.message
    assert error.value.hint == "pip install DracoPy, or export the mesh without compression"


def test_an_uncompressed_copy_is_taken(tmp_path: Path) -> None:
    b = quad()
    b.json["extensionsUsed"] = [DRACO]
    primitive = b.json["meshes"][0]["primitives"][0]
    primitive["extensions"] = {DRACO: {"bufferView": 0, "attributes": {"POSITION": 0}}}
    mesh = read_mesh(b.glb(tmp_path / "a.glb"))
    np.testing.assert_allclose(mesh.vertices, QUAD)
    assert mesh.report.notes == (f"took the uncompressed copy beside {DRACO} of 1 primitives",)
    assert "extensionsUsed" not in document(mesh).json


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("cut", "the Draco data of primitive 0 of mesh 0 is damaged"),
        ("not draco", "the Draco data of primitive 0 of mesh 0 is damaged"),
        ("more faces", "the Draco data of primitive 0 of mesh 0 promises 268435455 faces"),
        ("no such attribute", "the Draco data of primitive 0 of mesh 0 holds no TEXCOORD_0"),
        ("type", "POSITION of primitive 0 of mesh 0 is decoded to another type than it has in the file"),
        ("view", "bufferViews index -1 is out of range (there are 1)"),
    ],
)
def test_damaged_draco(tmp_path: Path, change: str, message: str) -> None:
    b = compressed()
    primitive = b.json["meshes"][0]["primitives"][0]
    draco = primitive["extensions"][DRACO]
    match change:
        case "cut":
            b.json["bufferViews"][0]["byteLength"] //= 2
        case "not draco":
            b.body = b"x" + b.body[1:]
        case "more faces":  # edgebreaker: the header's 12 bytes, then the numbers of vertices and of faces
            b.body = b.body[:12] + b"\x90\x01" + b"\xff\xff\xff\x7f" + b.body[18:]
        case "no such attribute":
            draco["attributes"]["TEXCOORD_0"] = 77
        case "type":
            b.json["accessors"][0]["type"] = "VEC4"
        case "view":
            del draco["bufferView"]
    assert refused(b.glb(tmp_path / "a.glb")).startswith(message)


def test_random_changes_of_draco_data_never_raise_anything_else(tmp_path: Path) -> None:
    b = compressed()
    whole, generator = b.body, np.random.default_rng(3)
    for _ in range(150):
        changed = bytearray(whole)
        for at in generator.integers(0, len(whole), 2):
            changed[at] = int(generator.integers(0, 256))
        b.body = bytes(changed)
        path = b.glb(tmp_path / "a.glb")
        try:
            read_document(path, path.read_bytes())
        except MeshError:
            continue


def with_meshopt_copy(filled: bool) -> Builder:
    """A square whose views say that meshopt holds them too; the copy is there, or zeros in its place."""
    b = quad()
    for view in b.json["bufferViews"]:
        view["extensions"] = {MESHOPT: {"buffer": 0, "byteLength": 1, "byteStride": 4, "count": 1, "mode": "TRIANGLES"}}
    b.json["extensionsUsed"] = [MESHOPT]
    b.body = b.body if filled else bytes(len(b.body))
    return b


def test_meshopt_with_a_filled_copy_is_read_and_forgotten(tmp_path: Path) -> None:
    mesh = read_mesh(with_meshopt_copy(True).glb(tmp_path / "a.glb"))
    np.testing.assert_allclose(mesh.vertices, QUAD)
    np.testing.assert_allclose(mesh.uvs, QUAD_UV)
    assert mesh.faces.ravel().tolist() == QUAD_INDICES
    assert mesh.report.notes == (f"took the uncompressed copy beside {MESHOPT}",)
    assert MESHOPT not in str(document(mesh).json)


def test_meshopt_with_a_copy_of_zeros_is_refused_by_name(tmp_path: Path) -> None:
    assert refused(with_meshopt_copy(False).glb(tmp_path / "a.glb")) == f"buffer view 0 is compressed with {MESHOPT}"
