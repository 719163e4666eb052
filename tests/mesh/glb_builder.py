"""Small glTF files made in memory for the tests."""

from __future__ import annotations

import base64
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

CODES = {"b": 5120, "B": 5121, "h": 5122, "H": 5123, "I": 5125, "f": 5126}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


class Builder:
    """Collects accessors into one buffer and writes a .glb or a .gltf."""

    def __init__(self) -> None:
        self.body = b""
        self.json: dict[str, Any] = {"asset": {"version": "2.0"}, "bufferViews": [], "accessors": []}

    def view(self, data: bytes, **extra: Any) -> int:
        self.body += bytes(-len(self.body) % 4)
        self.json["bufferViews"].append({"buffer": 0, "byteOffset": len(self.body), "byteLength": len(data), **extra})
        self.body += data
        return len(self.json["bufferViews"]) - 1

    def accessor(self, values: Any, code: str = "f", **extra: Any) -> int:
        array = np.atleast_1d(np.asarray(values)).astype(np.dtype(code).newbyteorder("<"))
        array = array.reshape(len(array), -1)
        entry = {
            "bufferView": self.view(array.tobytes()),
            "componentType": CODES[code],
            "count": len(array),
            "type": TYPES[array.shape[1]],
        }
        self.json["accessors"].append({**entry, **extra})
        return len(self.json["accessors"]) - 1

    def glb(self, path: Path) -> Path:
        body = self.body + bytes(-len(self.body) % 4)
        self.json["buffers"] = [{"byteLength": len(self.body)}]
        text = json.dumps(self.json).encode()
        text += b" " * (-len(text) % 4)
        length = 12 + 8 + len(text) + 8 + len(body)
        path.write_bytes(
            struct.pack("<4sII", b"glTF", 2, length)
            + struct.pack("<I4s", len(text), b"JSON")
            + text
            + struct.pack("<I4s", len(body), b"BIN\x00")
            + body
        )
        return path

    def gltf(self, path: Path, uri: str | None = None) -> Path:
        """Text form; the buffer goes into a data URI, or into the file ``uri`` if the caller writes it."""
        uri = uri or "data:application/octet-stream;base64," + base64.b64encode(self.body).decode()
        self.json["buffers"] = [{"byteLength": len(self.body), "uri": uri}]
        path.write_text(json.dumps(self.json))
        return path


QUAD = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
QUAD_UV = [[0, 1], [1, 1], [1, 0], [0, 0]]
QUAD_INDICES = [0, 1, 2, 0, 2, 3]


def quad(**node: Any) -> Builder:
    """A unit square in the z = 0 plane that faces +Z, with texture coordinates and normals, shown by one node."""
    b = Builder()
    attributes = {
        "POSITION": b.accessor(QUAD),
        "TEXCOORD_0": b.accessor(QUAD_UV),
        "NORMAL": b.accessor([[0, 0, 1]] * 4),
    }
    b.json["meshes"] = [{"primitives": [{"attributes": attributes, "indices": b.accessor(QUAD_INDICES, "H")}]}]
    b.json["nodes"] = [{"mesh": 0, **node}]
    b.json["scenes"] = [{"nodes": [0]}]
    b.json["scene"] = 0
    return b
