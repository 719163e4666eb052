"""glTF features and damage, each in a file made here."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.mesh.glb_builder import QUAD, QUAD_INDICES, QUAD_UV, Builder, quad

from paintit.errors import MeshError
from paintit.mesh.gltf_document import GltfDocument
from paintit.mesh.gltf_parse import read_document
from paintit.mesh.read import read_mesh


def normal_of_faces(mesh: Any) -> np.ndarray:
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    return cross / np.linalg.norm(cross, axis=1, keepdims=True)


def test_quad(tmp_path: Path) -> None:
    mesh = read_mesh(quad(name="leaf").glb(tmp_path / "a.glb"))
    np.testing.assert_allclose(mesh.vertices, QUAD)
    np.testing.assert_allclose(mesh.uvs, QUAD_UV)
    assert mesh.faces.reshape(-1).tolist() == QUAD_INDICES
    assert (mesh.parts[0].name, mesh.parts[0].node, mesh.parts[0].primitive) == ("leaf", 0, (0, 0))
    np.testing.assert_allclose(mesh.tangents.reshape(-1, 4), [[1, 0, 0, 1]] * 6, atol=1e-6)
    assert mesh.report.uv_origin == "file"


def test_node_tree_and_matrix(tmp_path: Path) -> None:
    b = quad(translation=[0, 0, 1])
    half = 0.5**0.5
    b.json["nodes"] += [
        {"children": [0], "rotation": [0, half, 0, half], "scale": [2, 2, 2]},
        {"children": [1], "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 10, 0, 0, 1]},
    ]
    b.json["scenes"] = [{"nodes": [2]}]
    mesh = read_mesh(b.glb(tmp_path / "a.glb"))
    # z = 1 turned by 90 degrees about +Y is x = 1, doubled and moved: x = 12; x runs along -z.
    np.testing.assert_allclose(mesh.vertices, [[12, 0, 0], [12, 0, -2], [12, 2, -2], [12, 2, 0]], atol=1e-6)
    np.testing.assert_allclose(mesh.normals.reshape(-1, 3), [[1, 0, 0]] * 6, atol=1e-6)


def test_mirrored_node_keeps_faces_outward(tmp_path: Path) -> None:
    mesh = read_mesh(quad(scale=[-1, 1, 1]).glb(tmp_path / "a.glb"))
    np.testing.assert_allclose(normal_of_faces(mesh), [[0, 0, 1]] * 2)
    np.testing.assert_allclose(mesh.normals.reshape(-1, 3), [[0, 0, 1]] * 6)
    assert mesh.source is not None
    assert (mesh.source.corner_vertex == mesh.faces).all()
    assert (mesh.tangents[..., 3] == -1).all()


def test_materials_layers_and_texture_coordinate_set(tmp_path: Path) -> None:
    b = quad()
    first = b.json["meshes"][0]["primitives"][0]
    second_uv = b.accessor(np.array(QUAD_UV) / 2)
    b.json["textures"] = [{}]
    b.json["materials"] = [
        {"name": "unused"},
        {"name": "red", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "texCoord": 1}}},
    ]
    with_material = {**first, "material": 1, "attributes": {**first["attributes"], "TEXCOORD_1": second_uv}}
    b.json["meshes"][0]["primitives"] = [first, with_material]
    mesh = read_mesh(b.glb(tmp_path / "a.glb"))
    assert [(layer.name, layer.source_index) for layer in mesh.layers] == [("red", 1), ("material", None)]
    assert mesh.face_layer.tolist() == [1, 1, 0, 0]
    np.testing.assert_allclose(mesh.corner_uvs[2:], mesh.corner_uvs[:2] / 2)


@pytest.mark.parametrize(
    ("mode", "order", "expected"),
    [
        (5, [0, 1, 3, 2], [[0, 1, 3], [1, 2, 3]]),
        (6, [0, 1, 2, 3], [[1, 2, 0], [2, 3, 0]]),
        (5, [0, 1, 3, 2, 2, 0, 0, 1, 3, 2], [[0, 1, 3], [1, 2, 3], [0, 1, 3], [1, 2, 3]]),
    ],
    ids=["strip", "fan", "strip joined by repeats"],
)
def test_strips_and_fans(tmp_path: Path, mode: int, order: list[int], expected: list[list[int]]) -> None:
    b = quad()
    b.json["meshes"][0]["primitives"][0] |= {"mode": mode, "indices": b.accessor(order, "B")}
    mesh = read_mesh(b.glb(tmp_path / "a.glb"))
    rolled = {tuple(np.roll(f, -int(np.argmin(f)))) for f in mesh.faces.tolist()}
    assert rolled == {tuple(np.roll(f, -int(np.argmin(f)))) for f in expected}
    np.testing.assert_allclose(normal_of_faces(mesh), [[0, 0, 1]] * len(expected))


def test_without_indices_and_normals_it_is_flat(tmp_path: Path) -> None:
    b = Builder()
    fold = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 0], [0, 1, 0], [0, 0, 1]]
    uv = [[0, 0], [0.4, 0], [0, 0.4], [0.6, 0.6], [1, 0.6], [0.6, 1]]
    b.json["meshes"] = [{"primitives": [{"attributes": {"POSITION": b.accessor(fold), "TEXCOORD_0": b.accessor(uv)}}]}]
    mesh = read_mesh(b.gltf(tmp_path / "a.gltf"))  # no nodes either: the mesh is taken where it stands
    np.testing.assert_allclose(mesh.normals[:, 0], [[0, 0, 1], [1, 0, 0]])
    assert mesh.report.notes[0] == "no node shows a mesh; took all meshes where they stand"


def test_quantized_and_normalised_attributes(tmp_path: Path) -> None:
    b = quad(scale=[1 / 1000, 1 / 1000, 1 / 1000])
    b.json["extensionsRequired"] = ["KHR_mesh_quantization"]
    attributes = b.json["meshes"][0]["primitives"][0]["attributes"]
    padded = np.zeros((4, 4), np.int16)
    padded[:, :3] = np.array(QUAD) * 1000
    attributes["POSITION"] = b.accessor(np.zeros((4, 3)), "h")
    b.json["bufferViews"][-1] |= {"byteStride": 8}
    b.json["bufferViews"][-1] = {**b.json["bufferViews"][b.view(padded.tobytes())], "byteStride": 8}
    attributes["TEXCOORD_0"] = b.accessor(np.array(QUAD_UV) * 65535, "H", normalized=True)
    attributes["NORMAL"] = b.accessor([[0, 0, 127]] * 4, "b", normalized=True)
    b.json["accessors"][attributes["POSITION"]]["bufferView"] = len(b.json["bufferViews"]) - 3
    mesh = read_mesh(b.glb(tmp_path / "a.glb"))
    np.testing.assert_allclose(mesh.vertices, QUAD, atol=1e-12)
    np.testing.assert_allclose(mesh.uvs, QUAD_UV)


def test_sparse_accessor(tmp_path: Path) -> None:
    b = quad()
    attributes = b.json["meshes"][0]["primitives"][0]["attributes"]
    at = b.view(np.array([2], np.uint16).tobytes())
    value = b.view(np.array([[3, 3, 0]], np.float32).tobytes())
    b.json["accessors"][attributes["POSITION"]]["sparse"] = {
        "count": 1,
        "indices": {"bufferView": at, "componentType": 5123},
        "values": {"bufferView": value},
    }
    np.testing.assert_allclose(read_mesh(b.glb(tmp_path / "a.glb")).vertices[2], [3, 3, 0])
    b.json["accessors"][attributes["POSITION"]]["sparse"]["indices"]["componentType"] = 5121
    b.body = b.body.replace(np.array([[3, 3, 0]], np.float32).tobytes(), np.array([[4, 4, 0]], np.float32).tobytes())
    np.testing.assert_allclose(read_mesh(b.glb(tmp_path / "b.glb")).vertices[2], [4, 4, 0])


def test_skin_in_rest_pose(tmp_path: Path) -> None:
    b = quad(translation=[100, 0, 0], skin=0)  # a skinned mesh ignores its own node's transform
    attributes = b.json["meshes"][0]["primitives"][0]["attributes"]
    attributes["JOINTS_0"] = b.accessor([[0, 1, 0, 0]] * 4, "B")
    attributes["WEIGHTS_0"] = b.accessor([[1, 0, 0, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0.25, 0.25, 0, 0]])
    bind = np.tile(np.eye(4), (2, 1, 1))
    bind[:, 0, 3] = -1
    b.json["nodes"] += [{"translation": [1, 0, 0]}, {"translation": [1, 2, 0]}]
    b.json["scenes"] = [{"nodes": [0, 1, 2]}]
    matrices = b.accessor(bind.transpose(0, 2, 1).reshape(2, 16))
    b.json["skins"] = [{"joints": [1, 2], "inverseBindMatrices": matrices}]
    mesh = read_mesh(b.glb(tmp_path / "a.glb"))
    np.testing.assert_allclose(mesh.vertices, [[0, 0, 0], [1, 0, 0], [1, 3, 0], [0, 2, 0]])


def test_default_morph_weights(tmp_path: Path) -> None:
    b = quad()
    b.json["meshes"][0]["weights"] = [0.5]
    b.json["meshes"][0]["primitives"][0]["targets"] = [{"POSITION": b.accessor([[0, 0, 4]] * 4)}]
    np.testing.assert_allclose(read_mesh(b.glb(tmp_path / "a.glb")).vertices[:, 2], 2)


def test_nodes_outside_the_scene_are_left_out_and_said(tmp_path: Path) -> None:
    b = quad()
    b.json["nodes"].append({"mesh": 0, "translation": [5, 0, 0]})
    mesh = read_mesh(b.glb(tmp_path / "a.glb"))
    assert len(mesh.faces) == 2
    assert mesh.report.notes == ("left out 1 mesh nodes that are not in the default scene",)


def test_external_buffer_with_percent_encoded_name(tmp_path: Path) -> None:
    b = quad()
    (tmp_path / "mein büffer.bin").write_bytes(b.body)
    mesh = read_mesh(b.gltf(tmp_path / "a.gltf", "mein%20b%C3%BCffer.bin"))
    np.testing.assert_allclose(mesh.vertices, QUAD)


def test_image_bytes(tmp_path: Path) -> None:
    b = quad()
    (tmp_path / "wood.png").write_bytes(b"file")
    inline = "data:image/png;base64," + base64.b64encode(b"inline").decode()
    b.json["images"] = [{"bufferView": b.view(b"in the buffer")}, {"uri": "wood.png"}, {"uri": inline}]
    path = b.glb(tmp_path / "a.glb")
    document = read_document(path, path.read_bytes())
    assert [document.image(i) for i in range(3)] == [b"in the buffer", b"file", b"inline"]


def broken(change: str) -> Builder:
    """A square damaged in one way."""
    b = quad()
    j = b.json
    primitive = j["meshes"][0]["primitives"][0]
    position = j["accessors"][primitive["attributes"]["POSITION"]]
    match change:
        case "index":
            primitive["indices"] = b.accessor([0, 1, 4], "H")
        case "nan":
            primitive["attributes"]["POSITION"] = b.accessor([[0, 0, 0], [1, 0, 0], [1, float("nan"), 0], [0, 1, 0]])
        case "negative accessor":
            primitive["attributes"]["POSITION"] = -1
        case "vec2 position":
            primitive["attributes"]["POSITION"] = primitive["attributes"]["TEXCOORD_0"]
        case "count":
            primitive["attributes"]["NORMAL"] = b.accessor([[0, 0, 1]] * 3)
        case "accessor bounds":
            position["count"] = 5
        case "view bounds":
            j["bufferViews"][0]["byteLength"] = 10_000
        case "version":
            j["asset"]["version"] = "1.0"
        case "empty draco":
            primitive["extensions"] = {"KHR_draco_mesh_compression": {}}
            del position["bufferView"]
        case "meshopt":
            j["extensionsRequired"] = ["EXT_meshopt_compression"]
        case "own child":
            j["nodes"] += [{"children": [2]}, {"children": [1]}]
        case "two parents":
            j["nodes"] += [{"children": [0]}, {"children": [0]}]
        case "path escape":
            j["images"] = []
            return b
        case "float indices":
            primitive["indices"] = b.accessor([0, 1, 2])
        case "points":
            primitive["mode"] = 0
        case "no position":
            del primitive["attributes"]["POSITION"]
        case "bad rotation":
            j["nodes"][0]["rotation"] = [0, 0, 1]
    return b


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("index", "primitive 0 of mesh 0 uses vertex 4 of 4"),
        ("nan", "vertex 2 of primitive 0 of mesh 0 is not finite: [1.0, nan, 0.0]"),
        ("negative accessor", "accessors index -1 is out of range (there are 4)"),
        ("vec2 position", "POSITION of primitive 0 of mesh 0 has 2 components, not 3"),
        ("count", "NORMAL of primitive 0 of mesh 0 has 3 elements for 4 positions"),
        ("accessor bounds", "accessor 0 reaches byte 60 of a buffer view of 48"),
        ("view bounds", "buffer view 0 reaches byte 10000 of a buffer of 140"),
        ("version", "glTF version '1.0' is not supported"),
        ("empty draco", "KHR_draco_mesh_compression of primitive 0 of mesh 0 does not say which attributes it holds"),
        ("meshopt", "the file requires the extension EXT_meshopt_compression"),
        ("own child", "node 1 is its own ancestor"),
        ("two parents", "node 0 has two parents or is its own"),
        ("float indices", "indices of primitive 0 of mesh 0 are not whole numbers"),
        ("points", "the mesh has no faces (no triangles in the scene)"),
        ("no position", "primitive 0 of mesh 0 has no POSITION"),
        ("bad rotation", "'rotation' of node 0 is not 4 numbers"),
    ],
)
def test_damage(tmp_path: Path, change: str, message: str) -> None:
    path = broken(change).glb(tmp_path / "a.glb")
    with pytest.raises(MeshError) as error:
        read_mesh(path)
    assert error.value.message == f"cannot read {path}: {message}"
    assert error.value.hint


@pytest.mark.parametrize(
    ("uri", "message"),
    [
        ("../secret.bin", "buffer 0 lies outside the folder of the .gltf: '../secret.bin'"),
        ("%2e%2e/secret.bin", "buffer 0 lies outside the folder of the .gltf: '../secret.bin'"),
        ("/etc/hostname", "buffer 0 is not a relative file name: '/etc/hostname'"),
        ("http://example.com/a.bin", "buffer 0 is not a relative file name: 'http://example.com/a.bin'"),
        ("file:///etc/hostname", "buffer 0 is not a relative file name: 'file:///etc/hostname'"),
        ("gone.bin", "buffer 0 cannot be read: 'gone.bin' (no such file or directory)"),
        ("short.bin", "buffer 0 holds 3 of its 140 bytes"),
        (
            "data:application/octet-stream;base64,@@@",
            "buffer 0 has a broken data URI ('data:application/octet-stream;base64...)",
        ),
    ],
)
def test_buffer_uris(tmp_path: Path, uri: str, message: str) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    (tmp_path / "secret.bin").write_bytes(bytes(1000))
    (folder / "short.bin").write_bytes(b"abc")
    path = quad().gltf(folder / "a.gltf", uri)
    with pytest.raises(MeshError) as error:
        read_mesh(path)
    assert error.value.message == f"cannot read {path}: {message}"


def test_deep_nesting_is_refused_without_a_traceback(tmp_path: Path) -> None:
    b = quad()
    b.json["nodes"] = [{"children": [i + 1]} for i in range(3000)] + [{"mesh": 0}]
    with pytest.raises(MeshError, match="nested deeper than 512"):
        read_mesh(b.glb(tmp_path / "a.glb"))
    path = tmp_path / "b.gltf"
    path.write_text('{"asset":' + "[" * 100_000)
    with pytest.raises(MeshError, match="the JSON of the file is broken"):
        read_mesh(path)


def test_every_cut_of_a_glb_is_one_clear_error(tmp_path: Path) -> None:
    data = quad().glb(tmp_path / "whole.glb").read_bytes()
    path = tmp_path / "cut.glb"
    for length in range(1, len(data) - 1, 37):
        path.write_bytes(data[:length])
        with pytest.raises(MeshError):
            read_mesh(path)


def test_random_changes_never_raise_anything_else(tmp_path: Path) -> None:
    """Any single changed byte of the JSON gives a mesh or a MeshError, never another exception."""
    data = quad().glb(tmp_path / "whole.glb").read_bytes()
    generator = np.random.default_rng(0)
    end = 20 + int.from_bytes(data[12:16], "little")
    for _ in range(300):
        changed = bytearray(data)
        changed[int(generator.integers(0, end))] = int(generator.choice(list(b'0123456789-"[]{},:a')))
        path = tmp_path / "changed.glb"
        path.write_bytes(changed)
        try:
            read_mesh(path, unwrap="never")
        except MeshError:
            continue


@pytest.mark.parametrize(
    "change",
    [
        {"meshes": [{}]},
        {"meshes": 3},
        {"meshes": [{"primitives": 7}]},
        {"meshes": [{"primitives": [7]}]},
        {"nodes": [{"mesh": "0"}]},
        {"nodes": [{"mesh": 0, "children": 5}]},
        {"nodes": [{"mesh": 0, "children": ["x"]}]},
        {"nodes": [{"mesh": 0, "extensions": 3}]},
        {"scenes": [{"nodes": 3}]},
        {"scene": "main"},
        {"accessors": [{}] * 4},
        {"accessors": [{"count": 10**12, "type": "VEC3", "componentType": 5126}] * 4},
        {"extensionsRequired": 5},
        {"extensionsRequired": [5]},
        {"materials": 1},
        {"buffers": 1},
        {"buffers": [{"byteLength": 10, "extensions": 1}]},
    ],
    ids=lambda c: json.dumps(c)[:40],
)
def test_wrong_types_in_the_json_are_mesh_errors(tmp_path: Path, change: dict[str, Any]) -> None:
    b = quad()
    b.gltf(tmp_path / "a.gltf")
    (tmp_path / "a.gltf").write_text(json.dumps(b.json | change))
    with pytest.raises(MeshError):
        read_mesh(tmp_path / "a.gltf")


def test_document_is_kept(tmp_path: Path) -> None:
    b = quad()
    b.json["extras"] = {"kept": True}
    mesh = read_mesh(b.glb(tmp_path / "a.glb"))
    assert mesh.source is not None
    assert isinstance(mesh.source.document, GltfDocument)
    assert mesh.source.document.json["extras"] == {"kept": True}
    assert mesh.source.document.binary
