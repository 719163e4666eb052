"""Files made to do harm: each is refused with one line, quickly, and before memory is taken for what it claims."""

from __future__ import annotations

import io
import json
import os
import resource
import struct
import time
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from tests.mesh.glb_builder import Builder, quad

from paintit.config import LimitConfig
from paintit.errors import MeshError
from paintit.export.gltf_source import image_pixels
from paintit.export.read_maps import read_maps
from paintit.mesh.gltf import read_gltf
from paintit.mesh.gltf_parse import read_document
from paintit.mesh.read import read_mesh

HUGE = 2**60


@pytest.fixture(autouse=True)
def quick_and_small() -> Iterator[None]:
    """No hostile file may take 5 seconds, or 400 MiB more than there was."""
    start, before = time.process_time(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    yield
    assert time.process_time() - start < 5
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 400 * 1024


def refused(path: Path, **arguments: Any) -> MeshError:
    with pytest.raises(MeshError) as error:
        read_mesh(path, **arguments)
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 400 + len(str(path))
    assert error.value.hint
    return error.value


def lying(change: str) -> Builder:
    """A square whose numbers promise what is not there."""
    b = quad()
    j = b.json
    attributes = j["meshes"][0]["primitives"][0]["attributes"]
    position = j["accessors"][attributes["POSITION"]]
    match change:
        case "count":
            position["count"] = HUGE
        case "stride":
            j["bufferViews"][0]["byteStride"] = HUGE
        case "stride 0":
            j["bufferViews"][0]["byteStride"] = 0
        case "accessor offset":
            position["byteOffset"] = HUGE
        case "view offset":
            j["bufferViews"][0]["byteOffset"] = HUGE
        case "view length":
            j["bufferViews"][0]["byteLength"] = HUGE
        case "negative offset":
            j["bufferViews"][0]["byteOffset"] = -16
        case "zeros":
            attributes["NORMAL"] = b.accessor([[0, 0, 1]] * 4)
            j["accessors"][attributes["NORMAL"]] |= {"count": 50_000_000}
            del j["accessors"][attributes["NORMAL"]]["bufferView"]
        case "sparse count":
            view = j["accessors"][attributes["POSITION"]]["bufferView"]
            position["sparse"] = {
                "count": HUGE,
                "indices": {"bufferView": view, "componentType": 5121},
                "values": {"bufferView": view},
            }
        case "sparse zeros":
            del position["bufferView"]
            position["count"] = 50_000_000
            position["sparse"] = {
                "count": 1,
                "indices": {"bufferView": 0, "componentType": 5121},
                "values": {"bufferView": 0},
            }
        case "more zeros than bytes":
            j["accessors"].append({"count": 10**9, "type": "MAT4", "componentType": 5126})
            attributes["NORMAL"] = len(j["accessors"]) - 1
    return b


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("count", f"triangles' worth of elements in accessor 0: {-(-HUGE // 3)}, more than the limit of 20000000"),
        ("stride", f"accessor 0 reaches byte {HUGE * 3 + 12} of a buffer view of 48"),
        ("stride 0", "accessor 0 reaches byte 12 of a buffer view of 48"),
        ("accessor offset", f"accessor 0 reaches byte {HUGE + 48} of a buffer view of 48"),
        ("view offset", f"buffer view 0 reaches byte {HUGE + 48} of a buffer of 140"),
        ("view length", f"buffer view 0 reaches byte {HUGE} of a buffer of 140"),
        ("negative offset", "'byteOffset' is -16, not a whole number"),
        ("zeros", "accessor 4 asks for 50000000 elements out of nothing"),
        ("sparse count", "accessor 0 has invalid sparse indices"),
        ("sparse zeros", "accessor 0 asks for 50000000 elements out of nothing"),
    ],
)
def test_lying_numbers(tmp_path: Path, change: str, message: str) -> None:
    path = lying(change).glb(tmp_path / "a.glb")
    assert refused(path).message == f"cannot read {path}: {message}"


@pytest.mark.parametrize("extension", ["EXT_meshopt_compression", "KHR_meshopt_compression"])
def test_the_empty_buffer_of_a_meshopt_file(tmp_path: Path, extension: str) -> None:
    """A fallback buffer states a size and holds nothing; the size may be anything."""
    b = quad()
    path = b.glb(tmp_path / "a.glb")
    data = path.read_bytes()
    b.json["buffers"] += [{"byteLength": HUGE, "extensions": {extension: {"fallback": True}}}]
    b.json["extensionsUsed"] = [extension]
    rewrite(path, data, b.json)
    assert refused(path).message == f"cannot read {path}: buffer 1 is compressed with {extension}"


def test_a_buffer_that_promises_more_than_its_file(tmp_path: Path) -> None:
    b = quad()
    path = b.glb(tmp_path / "a.glb")
    data = path.read_bytes()
    b.json["buffers"][0]["byteLength"] = HUGE
    rewrite(path, data, b.json)
    assert refused(path).message == f"cannot read {path}: buffer 0 holds 140 of its {HUGE} bytes"


def rewrite(path: Path, data: bytes, document: dict[str, Any]) -> None:
    """The GLB in ``data`` with another JSON chunk."""
    old = struct.unpack_from("<I", data, 12)[0]
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + old :]
    head = struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text) + len(rest), len(text), b"JSON")
    path.write_bytes(head + text + rest)


def text_file(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


@pytest.mark.parametrize("depth", [101, 900, 100_000])
def test_deep_json(tmp_path: Path, depth: int) -> None:
    nested = "[" * depth + "]" * depth
    path = text_file(tmp_path / "a.gltf", '{"asset": {"version": "2.0"}, "extras": ' + nested + "}")
    message = refused(path).message
    deep = f"cannot read {path}: the JSON of the file is nested deeper than 100"
    assert message == deep or message.startswith(f"cannot read {path}: the JSON of the file is broken (maximum rec")


def test_a_large_json_without_content(tmp_path: Path) -> None:
    path = text_file(tmp_path / "a.gltf", '{"asset": {"version": "2.0"}, "extras": [' + "{}," * 6_000_000 + "0]}")
    error = refused(path)
    assert error.code == "mesh.limit"
    assert error.hint == "if you trust it, add --limits.nodes 120000"


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        ("1e999", "the JSON of the file holds a number beyond all bounds"),
        ('"\\ud800"', "the JSON of the file holds broken text (?)"),
        ("1" * 5000, "the JSON of the file is broken (exceeds the limit (4300 digits)"),
    ],
)
def test_json_that_could_not_be_written_back(tmp_path: Path, value: str, reason: str) -> None:
    path = text_file(tmp_path / "a.gltf", '{"asset": {"version": "2.0", "extras": [' + value + "]}}")
    assert refused(path).message.startswith(f"cannot read {path}: {reason}")


def chain(count: int) -> Builder:
    b = quad()
    b.json["nodes"] = [{"mesh": 0}, *({"children": [i]} for i in range(count))]
    b.json["scenes"] = [{"nodes": [count]}]
    return b


def test_a_tall_tree_of_nodes(tmp_path: Path) -> None:
    assert len(read_mesh(chain(500).glb(tmp_path / "a.glb")).faces) == 2
    path = chain(90_000).glb(tmp_path / "b.glb")
    assert refused(path).message == f"cannot read {path}: the nodes are nested deeper than 512"


def test_too_many_nodes(tmp_path: Path) -> None:
    b = quad()
    b.json["nodes"] += [{}] * 100_000
    error = refused(b.glb(tmp_path / "a.glb"))
    assert (error.code, error.hint) == ("mesh.limit", "if you trust it, add --limits.nodes 100001")


def grid(n: int) -> Builder:
    """A square of 2 (n - 1)^2 triangles without texture coordinates."""
    b = Builder()
    points = np.stack([*np.meshgrid(np.arange(n), np.arange(n)), np.zeros((n, n))], -1).reshape(-1, 3)
    i = np.arange(n * n).reshape(n, n)
    faces = np.stack([i[:-1, :-1], i[:-1, 1:], i[1:, 1:], i[:-1, :-1], i[1:, 1:], i[1:, :-1]], -1)
    b.json["meshes"] = [
        {"primitives": [{"attributes": {"POSITION": b.accessor(points)}, "indices": b.accessor(faces.ravel(), "I")}]}
    ]
    return b


def test_a_mesh_that_is_shown_very_often(tmp_path: Path) -> None:
    b = grid(120)
    b.json["nodes"] = [{"mesh": 0}] * 90_000
    error = refused(b.glb(tmp_path / "a.glb"))
    faces = 2 * 119**2 * 90_000
    assert error.message.endswith(f"triangles shown: {faces}, more than the limit of 20000000")
    assert error.hint == f"if you trust it, add --limits.faces {faces}"


def test_vertices_without_triangles_count_too(tmp_path: Path) -> None:
    """One triangle on a hundred thousand vertices, shown very often."""
    b = grid(300)
    b.json["meshes"][0]["primitives"][0]["indices"] = b.accessor([0, 1, 2], "I")
    b.json["nodes"] = [{"mesh": 0}] * 90_000
    assert "triangles' worth of vertices, morphs and joints" in refused(b.glb(tmp_path / "a.glb")).message


@pytest.mark.parametrize("what", ["morphs", "joints"])
def test_one_accessor_used_very_often(tmp_path: Path, what: str) -> None:
    b = grid(300)
    primitive = b.json["meshes"][0]["primitives"][0]
    b.json["nodes"] = [{"mesh": 0, "skin": 0}]
    b.json["skins"] = [{"joints": [0]}]
    if what == "morphs":
        primitive["targets"] = [{"POSITION": 0}] * 200_000
        b.json["meshes"][0]["weights"] = [1] * 200_000
    else:
        primitive["attributes"] |= {f"JOINTS_{k}": 0 for k in range(100_000)}
    assert "triangles' worth of vertices, morphs and joints" in refused(b.glb(tmp_path / "a.glb")).message


def test_many_primitives_shown_very_often(tmp_path: Path) -> None:
    b = quad()
    b.json["meshes"][0]["primitives"] = [{"attributes": {}, "mode": 0}] * 90_000
    b.json["nodes"] = [{"mesh": 0}] * 90_000
    del b.json["scene"], b.json["scenes"]
    assert "primitives shown: 8100000000, more than the limit of 100000" in refused(b.glb(tmp_path / "a.glb")).message


def test_many_notes_become_few(tmp_path: Path) -> None:
    b = quad()
    points = {"attributes": {"POSITION": 0}, "mode": 0}
    b.json["meshes"][0]["primitives"] += [points] * 5000
    notes = read_mesh(b.glb(tmp_path / "a.glb")).report.notes
    assert len(notes) == 41
    assert notes[-1] == "and 4960 more such notes"


def test_a_skin_with_many_joints_on_many_primitives(tmp_path: Path) -> None:
    """Joint matrices are made once, not for every primitive."""
    b = quad()
    b.json["nodes"] = [{"mesh": 0, "skin": 0}, {}]
    b.json["skins"] = [{"joints": [1] * 20_000}]
    primitive = b.json["meshes"][0]["primitives"][0]
    primitive["attributes"]["JOINTS_0"] = b.accessor([[0, 0, 0, 0]] * 4, "B")
    primitive["attributes"]["WEIGHTS_0"] = b.accessor([[1, 0, 0, 0]] * 4)
    b.json["meshes"][0]["primitives"] = [primitive] * 200
    assert len(read_mesh(b.glb(tmp_path / "a.glb")).faces) == 400


def test_scene_that_names_one_node_very_often(tmp_path: Path) -> None:
    b = chain(500)
    b.json["scenes"] = [{"nodes": [500] * 100_000}]
    assert len(read_mesh(b.glb(tmp_path / "a.glb")).faces) == 2


def test_materials_in_use(tmp_path: Path) -> None:
    b = quad()
    primitive = b.json["meshes"][0]["primitives"][0]
    b.json["materials"] = [{}] * 1001
    b.json["meshes"][0]["primitives"] = [primitive | {"material": i} for i in range(1001)]
    assert "materials in use: 1001, more than the limit of 1000" in refused(b.glb(tmp_path / "a.glb")).message


URIS = {
    "http://example.com/a.bin": "is not a relative file name: 'http://example.com/a.bin'",
    "file:///etc/hostname": "is not a relative file name: 'file:///etc/hostname'",
    "javascript:alert(1)": "is not a relative file name: 'javascript:alert(1)'",
    "/etc/hostname": "is not a relative file name: '/etc/hostname'",
    "%2Fetc%2Fhostname": "is not a relative file name: '/etc/hostname'",
    "//server/share/a.bin": "is not a relative file name: '//server/share/a.bin'",
    "\\\\server\\share\\a.bin": "is not a relative file name: '\\\\server\\share\\a.bin'",
    "%5C%5Cserver%5Ca.bin": "is not a relative file name: '\\\\server\\a.bin'",
    "C:\\a.bin": "is not a relative file name: 'C:\\a.bin'",
    "C:a.bin": "is not a relative file name: 'C:a.bin'",
    "c%3A/a.bin": "is not a relative file name: 'c:/a.bin'",
    "../secret.bin": "lies outside the folder of the .gltf: '../secret.bin'",
    "%2e%2e/secret.bin": "lies outside the folder of the .gltf: '../secret.bin'",
    "%2e%2e%2fsecret.bin": "lies outside the folder of the .gltf: '../secret.bin'",
    "..%5Csecret.bin": "lies outside the folder of the .gltf: '..\\secret.bin'",
    "sub/../../secret.bin": "lies outside the folder of the .gltf: 'sub/../../secret.bin'",
    "link.bin": "lies outside the folder of the .gltf: 'link.bin'",
    "away/secret.bin": "lies outside the folder of the .gltf: 'away/secret.bin'",
    "loop.bin": "is not a file name: 'loop.bin'",
    "a%00.bin": "is not a relative file name: 'a?.bin'",
    "line%0Abreak": "cannot be read: 'line?break' (no such file or directory)",
    "pipe.bin": "is not a file: 'pipe.bin'",
    "sub": "is not a file: 'sub'",
    "x" * 5000: f"is not a file name: '{'x' * 80}'",
}


@pytest.mark.parametrize(("uri", "reason"), URIS.items(), ids=lambda text: text[:30])
def test_uris(tmp_path: Path, uri: str, reason: str) -> None:
    folder = tmp_path / "folder"
    (folder / "sub").mkdir(parents=True)
    (tmp_path / "secret.bin").write_bytes(bytes(1000))
    (folder / "link.bin").symlink_to(tmp_path / "secret.bin")
    (folder / "away").symlink_to(tmp_path)
    (folder / "loop.bin").symlink_to(folder / "loop.bin")
    os.mkfifo(folder / "pipe.bin")
    path = quad().gltf(folder / "a.gltf", uri)
    found = refused(path).message
    if len(uri) > 1000:
        assert found.startswith(f"cannot read {path}: buffer 0 ")
        return
    assert found == f"cannot read {path}: buffer 0 {reason}"
    if reason.startswith(("is not a relative", "lies outside")):  # of an image, before anything is painted
        b = quad()
        b.json["images"] = [{"uri": uri}]
        path = b.glb(folder / "a.glb")
        assert refused(path).message == f"cannot read {path}: image 0 {reason}"


def test_windows_separators_inside_the_folder(tmp_path: Path) -> None:
    b = quad()
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "a b.bin").write_bytes(b.body)
    assert len(read_mesh(b.gltf(tmp_path / "a.gltf", "data%5Ca%20b.bin")).faces) == 2
    assert len(read_mesh(b.gltf(tmp_path / "b.gltf", ".\\data\\a b.bin")).faces) == 2


def test_a_pipe_or_a_device_as_the_mesh(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.glb")
    assert refused(tmp_path / "a.glb").code == "mesh.not_a_file"
    (tmp_path / "b.obj").symlink_to("/dev/zero")
    assert refused(tmp_path / "b.obj").code == "mesh.not_a_file"


@pytest.mark.parametrize("name", ["a.obj", "a.ply", "a.stl", "a.off", "a.glb", "a.gltf"])
def test_large_files_are_refused_unread(tmp_path: Path, name: str) -> None:
    """The file is 3 GiB of nothing: it is a hole on the disk."""
    with open(tmp_path / name, "wb") as file:
        file.truncate(3 * 2**30)
    error = refused(tmp_path / name)
    assert error.message == f"cannot read {tmp_path / name}: MiB of the file: 3072, more than the limit of 2048"
    assert error.hint == "if you trust it, add --limits.file-mib 3072"


def test_large_buffers_are_refused_unread(tmp_path: Path) -> None:
    with open(tmp_path / "a.bin", "wb") as file:
        file.truncate(3 * 2**30)
    assert "MiB of buffer 0: 3072" in refused(quad().gltf(tmp_path / "a.gltf", "a.bin")).message


def test_one_buffer_named_very_often(tmp_path: Path) -> None:
    (tmp_path / "a.bin").write_bytes(bytes(2**20))
    b = quad()
    path = b.gltf(tmp_path / "a.gltf", "a.bin")
    b.json["buffers"] *= 1000
    path.write_text(json.dumps(b.json))
    error = refused(path, limits=LimitConfig(file_mib=20))
    assert "MiB of the file and its buffers: 21" in error.message


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 3 2\n"),
        ("a.off", "OFF\n3 2 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n3 0 2 1\n"),
    ],
)
def test_the_limit_of_faces_holds_for_every_format(tmp_path: Path, name: str, text: str) -> None:
    path = text_file(tmp_path / name, text)
    assert len(read_mesh(path, limits=LimitConfig(faces=2)).faces) == 2
    assert refused(path, limits=LimitConfig(faces=1)).hint == "if you trust it, add --limits.faces 2"


def png_header(width: int, height: int, grey: bool = False) -> bytes:
    """A PNG of ten kilobytes that promises ``width`` x ``height`` pixels, in colour unless ``grey``."""

    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    head = struct.pack(">IIBBBBB", width, height, 8, 0 if grey else 2, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(bytes(10**7))) + chunk(b"IEND", b"")
    )


def textured(image: dict[str, Any] | bytes, **info: Any) -> Builder:
    b = quad()
    b.json["images"] = [{"bufferView": b.view(image)} if isinstance(image, bytes) else image]
    b.json["textures"] = [{"source": 0}]
    b.json["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, **info}}, "alphaMode": "BLEND"}]
    b.json["meshes"][0]["primitives"][0]["material"] = 0
    return b


def test_image_bomb(tmp_path: Path) -> None:
    mesh = read_mesh(textured(png_header(60_000, 60_000)).glb(tmp_path / "a.glb"))
    with pytest.raises(MeshError) as error:
        read_maps(mesh)
    assert error.value.message == "megapixels of an image of 60000 x 60000: 3600, more than the limit of 135"
    assert error.value.hint == "if you trust it, add --limits.image-megapixels 3600"


def test_the_limit_of_pixels_can_be_raised_and_lowered() -> None:
    data = io.BytesIO()
    Image.new("RGB", (1200, 1000)).save(data, "PNG")
    assert image_pixels(data.getvalue()).shape == (1000, 1200, 4)
    with pytest.raises(MeshError, match="megapixels of an image of 1200 x 1000: 2, more than the limit of 1"):
        image_pixels(data.getvalue(), LimitConfig(image_megapixels=1))
    with pytest.raises(MeshError, match="a texture cannot be read"):  # past the limit, and then found to be cut off
        image_pixels(png_header(14_000, 10_000, grey=True)[:2000], LimitConfig(image_megapixels=200))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"textures": []}, "textures index 0 is out of range (there are 0)"),
        ({"textures": [{"source": 9}]}, "images index 9 is out of range (there are 1)"),
        ({"textures": [{"sampler": 0}]}, "samplers index 0 is out of range (there are 0)"),
        ({"textures": [{"extensions": {"EXT_texture_webp": {"source": -1}}}]}, "images index -1 is out of range"),
        ({"images": [{"bufferView": 77}]}, "bufferViews index 77 is out of range (there are 5)"),
        ({"materials": [{"normalTexture": {}}]}, "textures index None is out of range (there are 1)"),
        ({"materials": [{"extensions": {"KHR_materials_sheen": {"sheenColorTexture": {"index": 3}}}}]}, "textures ind"),
        ({"materials": []}, "materials index 0 is out of range (there are 0)"),
        ({"materials": [{"pbrMetallicRoughness": {"baseColorFactor": [1, 1]}}]}, "'baseColorFactor' of 'pbrMetallicRo"),
        ({"animations": [{"channels": [{"sampler": 0, "target": {}}], "samplers": []}]}, "animation 0 samplers index"),
        ({"animations": [{"samplers": [{"input": 0, "output": 99}]}]}, "accessors index 99 is out of range"),
        ({"animations": [{"channels": [{"target": {"node": 5}}]}]}, "nodes index 5 is out of range"),
        ({"skins": [{"joints": [8]}]}, "nodes index 8 is out of range"),
        ({"nodes": [{"mesh": 0, "skin": 0}]}, "skins index 0 is out of range"),
        ({"nodes": [{"mesh": 0, "camera": True}]}, "cameras index True is out of range"),
        ({"scenes": [{"nodes": [2**70]}]}, "nodes index 1180591620717411303424 is out of range"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_references_into_nowhere(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    b = textured(b"not read here")
    path = b.glb(tmp_path / "a.glb")
    data = path.read_bytes()
    rewrite(path, data, b.json | change)
    assert message in refused(path).message


def test_broken_base64_and_a_large_data_uri(tmp_path: Path) -> None:
    path = quad().gltf(tmp_path / "a.gltf", "data:application/octet-stream;base64," + "A" * 40_000_001)
    assert refused(path).message == (
        f"cannot read {path}: buffer 0 has a broken data URI ('data:application/octet-stream;base64...)"
    )


def test_names_with_control_characters_stay_on_one_line(tmp_path: Path) -> None:
    b = quad(name="a\nb\x1b[2J")
    b.json["extensionsRequired"] = ["EVIL\nname\x1b[2J"]
    path = b.glb(tmp_path / "a.glb")
    assert refused(path).message == f"cannot read {path}: the file requires the extension EVIL?name?[2J"
    del b.json["extensionsRequired"]
    assert read_mesh(b.glb(tmp_path / "a.glb")).parts[0].name == "a?b?[2J"


def test_random_changes_of_the_bytes_never_raise_anything_else(tmp_path: Path) -> None:
    """Any few changed bytes of a skinned file give a mesh or a MeshError, never another exception."""
    b = textured(b"")
    primitive = b.json["meshes"][0]["primitives"][0]
    primitive["attributes"]["JOINTS_0"] = b.accessor([[0, 0, 0, 0]] * 4, "B")
    primitive["attributes"]["WEIGHTS_0"] = b.accessor([[1, 0, 0, 0]] * 4)
    b.json["nodes"] = [{"mesh": 0, "skin": 0}, {"name": "Head"}]
    b.json["skins"] = [{"joints": [1], "inverseBindMatrices": b.accessor([np.eye(4).ravel()])}]
    data = b.glb(tmp_path / "whole.glb").read_bytes()
    generator = np.random.default_rng(1)
    for _ in range(150):
        changed = bytearray(data)
        for at in generator.integers(0, len(data), 3):
            changed[at] = int(generator.choice(list(b'0123456789-"[]{},:a\x00\xff')))
        try:
            read_gltf(read_document(tmp_path / "changed.glb", bytes(changed)))
        except MeshError:
            continue
