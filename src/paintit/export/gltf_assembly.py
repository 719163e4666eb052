"""A glTF document under construction, and its two shapes on disk: one .glb, or .gltf with .bin and PNG files."""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from paintit.errors import OutputError

ARRAY_BUFFER = 34962
ELEMENT_ARRAY_BUFFER = 34963
COMPONENT_TYPES = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
ELEMENT_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}

#: glTF sampler: trilinear, repeat.
SAMPLER = {"magFilter": 9729, "minFilter": 9987, "wrapS": 10497, "wrapT": 10497}

_MAGIC = (
    (b"\x89PNG", "image/png"),
    (b"\xff\xd8\xff", "image/jpeg"),
    (b"RIFF", "image/webp"),
    (b"\xabKTX", "image/ktx2"),
)


@dataclass
class Assembly:
    """JSON, the bytes of each of its buffer views, and images that still need a place.

    Attributes:
        json: the document; ``buffers`` and each view's ``buffer`` and ``byteOffset`` are filled in when it is packed.
        views: bytes of ``json["bufferViews"][i]``.
        pngs: image index -> (file name, PNG bytes) of the images added here.
        kept: image index -> (file beside the source document, "" for a data URI; bytes) of images that stay.
    """

    json: dict[str, Any]
    views: list[bytes] = field(default_factory=list)
    pngs: dict[int, tuple[str, bytes]] = field(default_factory=dict)
    kept: dict[int, tuple[str, bytes]] = field(default_factory=dict)

    def append(self, key: str, value: dict[str, Any]) -> int:
        """Append to the top-level array ``key``; its index."""
        items = self.json.setdefault(key, [])
        items.append(value)
        return len(items) - 1

    def add_view(self, data: bytes, target: int | None = None, stride: int | None = None) -> int:
        view: dict[str, Any] = {"buffer": 0, "byteLength": len(data)}
        if stride is not None:
            view["byteStride"] = stride
        if target is not None:
            view["target"] = target
        self.views.append(data)
        return self.append("bufferViews", view)

    def add_attribute(self, values: NDArray[Any], *, normalized: bool = False, bounds: bool = False) -> int:
        """Accessor over a new vertex buffer view holding (n,) or (n, k) ``values`` in their own component type."""
        table = values.reshape(len(values), -1)
        item = table.dtype.itemsize
        width = table.shape[1] * item
        stride = -(-width // 4) * 4  # vertex attributes start at multiples of four bytes
        padded = np.zeros((len(table), stride), np.uint8)
        padded[:, :width] = np.ascontiguousarray(table).view(np.uint8).reshape(len(table), width)
        view = self.add_view(padded.tobytes(), ARRAY_BUFFER, stride if stride != width else None)
        return self._add_accessor(view, table, normalized, bounds)

    def add_indices(self, indices: NDArray[np.int64]) -> int:
        """Accessor of triangle indices (f, 3); 16 bits where they suffice (65535 is glTF's restart value)."""
        small = int(indices.max(initial=0)) < 65535
        values = indices.reshape(-1, 1).astype(np.uint16 if small else np.uint32)
        return self._add_accessor(self.add_view(values.tobytes(), ELEMENT_ARRAY_BUFFER), values, False, False)

    def _add_accessor(self, view: int, table: NDArray[Any], normalized: bool, bounds: bool) -> int:
        accessor: dict[str, Any] = {
            "bufferView": view,
            "componentType": COMPONENT_TYPES[table.dtype.str[1:]],
            "count": len(table),
            "type": ELEMENT_TYPES[table.shape[1]],
        }
        if normalized:
            accessor["normalized"] = True
        if bounds:
            accessor["min"] = table.min(0).tolist()
            accessor["max"] = table.max(0).tolist()
        return self.append("accessors", accessor)

    def add_texture(self, name: str, png: bytes, sampler: int) -> int:
        """Texture over a new PNG image; ``name`` is also its file name (without suffix) in a .gltf."""
        image = self.append("images", {"name": name})
        self.pngs[image] = (f"{name}.png", png)
        return self.append("textures", {"name": name, "sampler": sampler, "source": image})

    def glb(self) -> bytes:
        """One binary file, images inside."""
        for image, (_, png) in self.pngs.items():
            self.json["images"][image] |= {"mimeType": "image/png", "bufferView": self.add_view(png)}
        for image, (_, data) in self.kept.items():
            described = self.json["images"][image]
            del described["uri"]
            kind = next((k for magic, k in _MAGIC if data.startswith(magic)), described.get("mimeType", "image/png"))
            described |= {"mimeType": kind, "bufferView": self.add_view(data)}
        self.pngs, self.kept = {}, {}
        binary = self._place_views()
        text = _pad(self._text().encode(), b" ")
        chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
        if binary:
            body = _pad(binary, b"\0")
            chunks += struct.pack("<II", len(body), 0x004E4942) + body
        if len(chunks) + 12 >= 2**32:
            raise OutputError("output.too_large", "a .glb file cannot hold more than 4 GiB", "write a .gltf instead")
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks

    def files(self, path: Path, stem: str) -> dict[Path, bytes]:
        """Everything that makes ``path``: itself for .glb; .bin, images and, last, the JSON for .gltf.

        Names of files beside it begin with ``stem``; only images of the source that stay in files keep their own, and
        where the same file lies there already it is left out.
        """
        if path.suffix.lower() == ".glb":
            return {path: self.glb()}
        out: dict[Path, bytes] = {}
        for image, (name, png) in self.pngs.items():
            file_name = f"{stem}_{name}"
            self.json["images"][image]["uri"] = quote(file_name)
            out[path.with_name(file_name)] = png
        for name, data in self.kept.values():
            target = path.parent / name
            if name and not (target.is_file() and target.read_bytes() == data):
                out[target] = data
        binary = self._place_views()
        if binary:
            out[path.with_name(f"{stem}.bin")] = binary
            self.json["buffers"][0]["uri"] = quote(f"{stem}.bin")
        out[path] = (self._text(indent=2) + "\n").encode()
        return out

    def _text(self, indent: int | None = None) -> str:
        separators = (",", ":") if indent is None else None
        return json.dumps(self.json, ensure_ascii=False, allow_nan=False, indent=indent, separators=separators)

    def _place_views(self) -> bytes:
        """All views behind one another in buffer 0, each at a multiple of four bytes."""
        parts: list[bytes] = []
        offset = 0
        for view, data in zip(self.json.get("bufferViews", []), self.views, strict=True):
            view["buffer"] = 0
            view["byteOffset"] = offset
            view["byteLength"] = len(data)
            parts.append(_pad(data, b"\0"))
            offset += len(parts[-1])
        extra = {k: v for k, v in (self.json.get("buffers") or [{}])[0].items() if k in ("name", "extras")}
        if parts:
            self.json["buffers"] = [extra | {"byteLength": offset}]
        else:
            self.json.pop("buffers", None)
        return b"".join(parts)


def _pad(data: bytes, filler: bytes) -> bytes:
    return data + filler * (-len(data) % 4)
