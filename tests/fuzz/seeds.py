"""Small meshes for the fuzzer to start from: files made here with every feature of the readers, and real small ones."""

from __future__ import annotations

import struct
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from tests.mesh.glb_builder import QUAD, QUAD_INDICES, Builder, quad

ASSETS = Path(__file__).parents[2] / "assets" / "meshes"
LARGEST = 20_000
"""Bytes of a real file that is taken as it is; larger seeds slow the fuzzer down more than they teach it."""


def seeds(kind: str) -> Iterator[bytes]:
    """Files of format ``kind``; all of them can be read."""
    if kind in ("glb", "gltf"):
        yield from _documents(kind)
    else:
        yield from {"obj": _obj, "ply": _ply, "stl": _stl, "off": _off}[kind]()
    for path in sorted(ASSETS.rglob(f"*.{kind}")):
        if path.stat().st_size <= LARGEST:
            yield path.read_bytes()


def _documents(kind: str) -> Iterator[bytes]:
    for builder in (quad(), _strip(), _sparse(), _quantised(), _skinned(), _morphed(), _instanced(), _textured()):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"seed.{kind}"
            (builder.glb if kind == "glb" else builder.gltf)(path)
            yield path.read_bytes()


def _primitive(builder: Builder) -> dict[str, Any]:
    return builder.json["meshes"][0]["primitives"][0]


def _strip() -> Builder:
    b = quad(translation=[1, 2, 3], rotation=[0, 0.6, 0, 0.8], scale=[1, -1, 2])
    _primitive(b).update(mode=5, indices=b.accessor([0, 1, 3, 2], "B"))
    return b


def _sparse() -> Builder:
    b = quad(matrix=np.eye(4).reshape(-1).tolist())
    where, what = b.view(np.array([1, 3], "<u2").tobytes()), b.view(np.ones((2, 3), "<f4").tobytes())
    accessor = b.json["accessors"][_primitive(b)["attributes"]["POSITION"]]
    accessor["sparse"] = {
        "count": 2,
        "indices": {"bufferView": where, "componentType": 5123},
        "values": {"bufferView": what},
    }
    return b


def _quantised() -> Builder:
    b = quad()
    b.json["extensionsRequired"] = b.json["extensionsUsed"] = ["KHR_mesh_quantization"]
    attributes = _primitive(b)["attributes"]
    rows = np.concatenate([np.array(QUAD, np.int16), np.zeros((4, 1), np.int16)], 1)
    view = b.view(rows.astype("<i2").tobytes(), byteStride=8)
    b.json["accessors"].append({"bufferView": view, "componentType": 5122, "count": 4, "type": "VEC3"})
    attributes["POSITION"] = len(b.json["accessors"]) - 1
    attributes["TEXCOORD_0"] = b.accessor([[0, 65535], [65535, 65535], [65535, 0], [0, 0]], "H", normalized=True)
    del attributes["NORMAL"]
    return b


def _skinned() -> Builder:
    b = quad(skin=0)
    attributes = _primitive(b)["attributes"]
    attributes["JOINTS_0"] = b.accessor([[0, 1, 0, 0]] * 4, "B")
    attributes["WEIGHTS_0"] = b.accessor([[0.5, 0.5, 0, 0]] * 4)
    b.json["nodes"] += [{"name": "root", "children": [2]}, {"name": "head", "translation": [0, 1, 0]}]
    b.json["scenes"][0]["nodes"] += [1]
    inverse = b.accessor(np.tile(np.eye(4).reshape(-1), (2, 1)))
    b.json["skins"] = [{"joints": [1, 2], "inverseBindMatrices": inverse, "skeleton": 1}]
    times, turns = b.accessor([[0.0], [1.0]]), b.accessor([[0, 0, 0, 1], [0, 0.6, 0, 0.8]])
    sampler = {"input": times, "output": turns, "interpolation": "LINEAR"}
    channel = {"sampler": 0, "target": {"node": 2, "path": "rotation"}}
    b.json["animations"] = [{"channels": [channel], "samplers": [sampler]}]
    return b


def _morphed() -> Builder:
    b = quad(weights=[0.5])
    target = {"POSITION": b.accessor([[0, 0, 1]] * 4), "NORMAL": b.accessor([[0.1, 0, 0]] * 4)}
    _primitive(b)["targets"] = [target]
    b.json["meshes"][0]["weights"] = [0.25]
    return b


def _instanced() -> Builder:
    b = quad()
    b.json["nodes"] += [{"mesh": 0, "scale": [-1, 1, 1]}, {"children": [0, 1], "name": "both"}]
    b.json["scenes"] = [{"nodes": [2]}, {"nodes": [0]}]
    primitive = _primitive(b)
    fan = {**primitive, "mode": 6, "indices": b.accessor([0, 1, 2, 3], "I")}
    lines = {"attributes": {"POSITION": primitive["attributes"]["POSITION"]}, "mode": 1}
    loose = {"attributes": {"POSITION": b.accessor(np.array(QUAD)[QUAD_INDICES])}}
    b.json["meshes"][0]["primitives"] += [fan, lines, loose]
    return b


def _textured() -> Builder:
    b = quad()
    attributes = _primitive(b)["attributes"]
    attributes["TEXCOORD_1"] = attributes["TEXCOORD_0"]
    transform = {"KHR_texture_transform": {"scale": [2, 2], "offset": [0.5, 0]}}
    texture = {"index": 0, "texCoord": 1, "extensions": transform}
    b.json["materials"] = [
        {"name": "red", "pbrMetallicRoughness": {"baseColorTexture": texture}, "emissiveFactor": [1, 0, 0]}
    ]
    b.json["textures"] = [{"source": 0, "sampler": 0}]
    b.json["samplers"] = [{"wrapS": 33071}]
    b.json["images"] = [{"bufferView": b.view(b"\x89PNG\r\n\x1a\n"), "mimeType": "image/png"}]
    _primitive(b)["material"] = 0
    return b


_V = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0.5\n"


def _obj() -> Iterator[bytes]:
    vt = "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
    yield (_V + vt + "f 1/1 2/2 3/3 4/4\n").encode()
    yield (_V + vt + "vn 0 0 1\no a\ng b c\nusemtl red\ns 1\nf 1/1/1 2/2/1 3/3/1\nf -4//-1 -2//-1 -1//-1\n").encode()
    yield (_V + "v 0.5 0.2 0\nv 2 2 2 0.5\nmtllib m.mtl\nf 1 5 2 3 4\nf 1 2 \\\n3\n# a comment\nl 1 2\n").encode()
    yield b"\xef\xbb\xbf\tv\t0 0 0\r\nv 1e3 -2.5E-3 +.5 1 0 0\r\nv 0 1 0\r\nvp 1 2\r\nf 1 2 3 # end\r\n"


def _ply() -> Iterator[bytes]:
    head = "ply\nformat {} 1.0\ncomment c\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n{}"
    head += "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
    plain, more = head.format("ascii", ""), "property float nx\nproperty float ny\nproperty float nz\n"
    yield (plain + "0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n3 0 2 3\n").encode()
    yield (plain + "0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n3 0 2 3\n").encode()
    uv = more + "property float s\nproperty float t\n"
    rows = "".join(f"{x} {y} {z} 0 0 1 {x} {y}\n" for x, y, z in QUAD)
    yield (head.format("ascii", uv) + rows + "3 0 1 2\n3 0 2 3\n").encode()
    faces = [struct.pack("<B3i", 3, *face) for face in ((0, 1, 2), (0, 2, 3))]
    body = np.array(QUAD, "<f4").tobytes() + b"".join(faces)
    yield head.format("binary_little_endian", "").encode() + body
    swapped = [struct.pack(">B3i", 3, *face) for face in ((0, 1, 2), (0, 2, 3))]
    yield head.format("binary_big_endian", "").encode() + np.array(QUAD, ">f4").tobytes() + b"".join(swapped)


def _stl() -> Iterator[bytes]:
    triangles = np.array(QUAD, np.float32)[np.array(QUAD_INDICES).reshape(-1, 3)]
    yield bytes(80) + struct.pack("<I", 2) + b"".join(struct.pack("<12fH", 0, 0, 1, *t.ravel(), 0) for t in triangles)
    lines = ["solid name"]
    for triangle in triangles.tolist():
        vertices = "".join(f"      vertex {x} {y} {z}\n" for x, y, z in triangle)
        lines.append(f"  facet normal 0 0 1\n    outer loop\n{vertices}    endloop\n  endfacet")
    yield "\n".join([*lines, "endsolid name\n"]).encode()


def _off() -> Iterator[bytes]:
    yield b"OFF\n4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n3 0 2 3\n"
    yield b"COFF 5 1 0 # all\n0 0 0 255 0 0\n1 0 0 0 0 0\n1 1 0 0 0 0\n0 1 0 0 0 0\n.5 .2 0\n5 0 4 1 2 3 0.5 1 1\n"
