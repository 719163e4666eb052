"""A second, small glTF reader for judging files: it shares no line with the package's own."""

from __future__ import annotations

import base64
import json
import struct
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
VECTORS = {"SCALAR": (1, 1), "VEC2": (1, 2), "VEC3": (1, 3), "VEC4": (1, 4)}
SHAPES = VECTORS | {"MAT2": (2, 2), "MAT3": (3, 3), "MAT4": (4, 4)}


class Gltf:
    """JSON and bytes of a .glb or .gltf file."""

    def __init__(self, path: Path) -> None:
        self.folder = path.parent
        data = path.read_bytes()
        self.chunk = b""
        if data[:4] == b"glTF":
            length, at = struct.unpack_from("<I", data, 8)[0], 12
            chunks: dict[bytes, bytes] = {}
            while at < length:
                size, kind = struct.unpack_from("<I4s", data, at)
                chunks[kind] = data[at + 8 : at + 8 + size]
                at += 8 + size
            self.chunk, data = chunks.get(b"BIN\0", b""), chunks[b"JSON"]
        self.json: dict[str, Any] = json.loads(data)
        self.buffers = [self._bytes(b) if "uri" in b else self.chunk for b in self.json.get("buffers", [])]

    def _bytes(self, holder: dict[str, Any]) -> bytes:
        uri: str = holder["uri"]
        if uri.startswith("data:"):
            return base64.b64decode(uri.partition(",")[2])
        return (self.folder / unquote(uri)).read_bytes()

    def view(self, index: int) -> bytes:
        view = self.json["bufferViews"][index]
        start = view.get("byteOffset", 0)
        return self.buffers[view["buffer"]][start : start + view["byteLength"]]

    def image(self, image: dict[str, Any]) -> bytes:
        return self.view(image["bufferView"]) if "bufferView" in image else self._bytes(image)

    def stored(self, accessor: dict[str, Any]) -> np.ndarray:
        """(count, components) in the stored type, sparse values in their places."""
        columns, rows = SHAPES[accessor["type"]]
        kind = np.dtype(COMPONENTS[accessor["componentType"]])
        values = np.zeros((accessor["count"], columns * rows), kind)
        if "bufferView" in accessor:
            values = self._table(accessor, accessor["count"], columns, rows, kind)
        if "sparse" in accessor:
            sparse = accessor["sparse"]
            where = np.dtype(COMPONENTS[sparse["indices"]["componentType"]])
            rows_at = self._table(sparse["indices"], sparse["count"], 1, 1, where)[:, 0]
            values[rows_at] = self._table(sparse["values"], sparse["count"], columns, rows, kind)
        return values

    def _table(self, holder: dict[str, Any], count: int, columns: int, rows: int, kind: np.dtype) -> np.ndarray:
        data = self.view(holder["bufferView"])
        column = rows * kind.itemsize if columns == 1 else -(-rows * kind.itemsize // 4) * 4
        stride = self.json["bufferViews"][holder["bufferView"]].get("byteStride", column * columns)
        offset = holder.get("byteOffset", 0)
        out = np.empty((count, columns, rows), kind)
        for c in range(columns):
            for r in range(rows):
                start = offset + c * column + r * kind.itemsize
                out[:, c, r] = np.ndarray((count,), kind, data, start, (stride,))
        return out.reshape(count, -1)

    def values(self, index: int) -> np.ndarray:
        """(count, components) float64; normalised integers as the fractions they stand for."""
        accessor = self.json["accessors"][index]
        values = self.stored(accessor).astype(np.float64)
        if accessor.get("normalized"):
            values = np.maximum(values / np.iinfo(COMPONENTS[accessor["componentType"]]).max, -1.0)
        return values

    def triangles(self, primitive: dict[str, Any]) -> np.ndarray:
        """(n, 3) vertices of a list, strip or fan; those that repeat a vertex are left out."""
        count = self.json["accessors"][primitive["attributes"]["POSITION"]]["count"]
        order = np.arange(count)
        if "indices" in primitive:
            order = self.stored(self.json["accessors"][primitive["indices"]])[:, 0].astype(np.int64)
        mode = primitive.get("mode", 4)
        if mode == 4:
            faces = order[: len(order) // 3 * 3].reshape(-1, 3)
        elif mode == 5:
            faces = np.array([order[[i, i + 1 + i % 2, i + 2 - i % 2]] for i in range(len(order) - 2)])
        else:
            faces = np.array([order[[i + 1, i + 2, 0]] for i in range(len(order) - 2)])
        repeated = (faces[:, 0] == faces[:, 1]) | (faces[:, 1] == faces[:, 2]) | (faces[:, 2] == faces[:, 0])
        return faces if mode == 4 else faces[~repeated]
