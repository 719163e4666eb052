"""A glTF 2.0 document, read strictly: the JSON as it stands and its buffers, so that all of it can be written back."""

from __future__ import annotations

import base64
import binascii
import json
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from paintit.mesh.gltf_schema import check_types, gltf_error, short

_COMPONENTS = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
_SHAPES = {
    "SCALAR": (1, 1),
    "VEC2": (1, 2),
    "VEC3": (1, 3),
    "VEC4": (1, 4),
    "MAT2": (2, 2),
    "MAT3": (3, 3),
    "MAT4": (4, 4),
}
"""Columns and rows of each accessor type; matrices are stored column by column."""
_MAX_ZEROS = 1 << 26
"""Elements that an accessor without data may have; a bound on what a tiny file can make us allocate."""
_KNOWN_REQUIRED = (
    "KHR_mesh_quantization",
    "KHR_materials_",
    "KHR_texture_",
    "KHR_lights_",
    "KHR_node_visibility",
    "KHR_animation_pointer",
    "KHR_xmp",
    "EXT_texture_",
    "EXT_lights_",
    "MSFT_lod",
    "MSFT_texture_dds",
)
"""Required extensions, or their beginnings, that do not change how geometry is stored."""


@dataclass(frozen=True)
class GltfDocument:
    """One parsed file. Nothing here is ever changed; an exporter copies ``json`` first.

    Attributes:
        json: the document.
        buffers: the resolved bytes of each entry of ``json["buffers"]``.
        base: folder that relative URIs start from.
        binary: read from a .glb.
    """

    json: dict[str, Any]
    buffers: tuple[bytes, ...]
    base: Path
    binary: bool

    def items(self, kind: str) -> list[dict[str, Any]]:
        """The top-level array called ``kind``, empty where the document has none."""
        found = self.json.get(kind, [])
        if not isinstance(found, list) or not all(isinstance(item, dict) for item in found):
            raise gltf_error("gltf_invalid", f"'{kind}' is not an array of objects")
        return found

    def item(self, kind: str, index: Any) -> dict[str, Any]:
        """Entry ``index`` of the top-level array ``kind``.

        Raises:
            MeshError: the index is not a whole number within the array.
        """
        found = self.items(kind)
        if isinstance(index, bool) or not isinstance(index, int) or not 0 <= index < len(found):
            raise gltf_error("gltf_index", f"{kind} index {index!r} is out of range (there are {len(found)})")
        return found[index]

    def view(self, index: int) -> bytes:
        """The bytes of a buffer view."""
        view = self.item("bufferViews", index)
        self.item("buffers", view.get("buffer"))
        data = self.buffers[view["buffer"]]
        offset, length = _whole(view, "byteOffset", 0), _whole(view, "byteLength", None)
        if offset + length > len(data):
            raise gltf_error(
                "gltf_bounds", f"buffer view {index} reaches byte {offset + length} of a buffer of {len(data)}"
            )
        return data[offset : offset + length]

    def accessor(self, index: int) -> NDArray[Any]:
        """Elements of an accessor, sparse values filled in, normalised integers turned into float32.

        Returns:
            (count, components) in the stored type, or float32 where the accessor is normalised.

        Raises:
            MeshError: any part of it lies outside its buffer, or its description is invalid.
        """
        accessor = self.item("accessors", index)
        count = _whole(accessor, "count", None)
        if count < 1:
            raise gltf_error("gltf_invalid", f"accessor {index} has no elements")
        shape = _SHAPES.get(accessor.get("type", ""))
        kind = _COMPONENTS.get(accessor.get("componentType", 0))
        if shape is None or kind is None:
            raise gltf_error(
                "gltf_invalid",
                f"accessor {index} has type {accessor.get('type')!r} "
                f"and component type {accessor.get('componentType')!r}",
            )
        if "bufferView" in accessor:
            values = self._elements(
                accessor["bufferView"], _whole(accessor, "byteOffset", 0), count, shape, kind, index
            )
        elif count > _MAX_ZEROS:
            raise gltf_error("gltf_invalid", f"accessor {index} asks for {count} elements out of nothing")
        else:
            values = np.zeros((count, shape[0] * shape[1]), kind)
        if isinstance(sparse := accessor.get("sparse"), dict):
            values = self._sparse(sparse, values, shape, kind, index)
        if accessor.get("normalized") and kind is not np.float32:
            limit = float(np.iinfo(kind).max)
            values = np.maximum(values.astype(np.float32) / np.float32(limit), np.float32(-1.0))
        return values

    def _elements(
        self, view_index: int, offset: int, count: int, shape: tuple[int, int], kind: type, index: int
    ) -> NDArray[Any]:
        data = self.view(view_index)
        columns, rows = shape
        size = np.dtype(kind).itemsize
        column = -(-rows * size // 4) * 4 if columns > 1 else rows * size  # matrix columns are padded to 4 bytes
        element = column * (columns - 1) + rows * size
        stride = _whole(self.item("bufferViews", view_index), "byteStride", column * columns)
        end = offset + stride * (count - 1) + element
        if end > len(data) or stride < element:
            raise gltf_error("gltf_bounds", f"accessor {index} reaches byte {end} of a buffer view of {len(data)}")
        array = np.ndarray(
            (count, columns, rows), np.dtype(kind).newbyteorder("<"), data, offset, (stride, column, size)
        )
        return array.reshape(count, columns * rows).astype(kind)

    def _sparse(
        self, sparse: dict[str, Any], values: NDArray[Any], shape: tuple[int, int], kind: type, index: int
    ) -> NDArray[Any]:
        where, what = sparse.get("indices", {}), sparse.get("values", {})
        index_kind = _COMPONENTS.get(where.get("componentType", 0))
        count = _whole(sparse, "count", None)
        if index_kind not in (np.uint8, np.uint16, np.uint32) or count < 1:
            raise gltf_error("gltf_invalid", f"accessor {index} has invalid sparse indices")
        at = self._elements(where.get("bufferView"), _whole(where, "byteOffset", 0), count, (1, 1), index_kind, index)[
            :, 0
        ]
        if at.max() >= len(values):
            raise gltf_error("gltf_index", f"accessor {index} has a sparse index {at.max()} of {len(values)}")
        values = values.copy()
        values[at] = self._elements(what.get("bufferView"), _whole(what, "byteOffset", 0), count, shape, kind, index)
        return values

    def image(self, index: int) -> bytes:
        """The encoded bytes (PNG, JPEG, ...) of an image."""
        image = self.item("images", index)
        if "bufferView" in image:
            return self.view(image["bufferView"])
        return resolve(image.get("uri"), self.base, f"image {index}")


def _whole(owner: dict[str, Any], key: str, default: int | None) -> int:
    value = owner.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise gltf_error("gltf_invalid", f"'{key}' is {short(value)}, not a whole number")
    return value


def resolve(uri: Any, base: Path, owner: str) -> bytes:
    """The bytes behind a URI: base64 ``data:`` or a percent-decoded file at or below ``base``.

    Raises:
        MeshError: another scheme, a path that leaves ``base``, or a file that cannot be read.
    """
    if not isinstance(uri, str) or not uri:
        raise gltf_error("gltf_invalid", f"{owner} has no data")
    if uri[:5].lower() == "data:":
        head, _, body = uri.partition(",")
        try:
            return (
                base64.b64decode(body, validate=True)
                if head.lower().endswith(";base64")
                else unquote(body).encode("latin-1")
            )
        except (binascii.Error, ValueError):
            raise gltf_error("gltf_uri", f"{owner} has a broken data URI ({short(uri)})") from None
    name = unquote(uri)
    if "://" in name or "\x00" in name:
        raise gltf_error("gltf_uri", f"{owner} is not a local file: {name[:80]!r}", "store the file beside the .gltf")
    path = (base / name).resolve()
    if not path.is_relative_to(base.resolve()):
        raise gltf_error(
            "gltf_uri", f"{owner} lies outside the folder of the .gltf: {name!r}", "store the file beside the .gltf"
        )
    try:
        return path.read_bytes()
    except OSError as error:
        raise gltf_error(
            "gltf_uri",
            f"{owner} cannot be read: {name!r} ({(error.strerror or 'error').lower()})",
            "copy the whole folder of the .gltf, not the .gltf alone",
        ) from None


def read_document(path: Path, data: bytes) -> GltfDocument:
    """Parse the bytes of a .glb or .gltf file (told apart by its first four bytes).

    Raises:
        MeshError: damage of any kind, a version other than 2, a required extension that stores geometry in another way.
    """
    binary = data[:4] == b"glTF"
    if path.suffix.lower() == ".glb" and not binary:
        raise gltf_error(
            "garbage",
            f"this is not a GLB file (it begins with {data[:8]!r})",
            "check that it is a GLB file, or export it again",
        )
    text, chunk = _chunks(data) if binary else (data, None)
    try:
        document = json.loads(text.decode("utf-8-sig"), parse_constant=_no_constant)
    except (ValueError, RecursionError) as error:
        if not binary and not text.lstrip()[:1] == b"{":
            raise gltf_error(
                "garbage",
                f"this is not a glTF file (it begins with {data[:8]!r})",
                "check that it is a glTF file, or export it again",
            ) from None
        raise gltf_error("gltf_invalid", f"the JSON of the file is broken ({str(error)[:60].lower()})") from None
    if not isinstance(document, dict) or not isinstance(document.get("asset"), dict):
        raise gltf_error("gltf_invalid", "the JSON of the file has no 'asset'")
    version = str(document["asset"].get("version", ""))
    if version.split(".")[0] != "2":
        raise gltf_error("gltf_version", f"glTF version {version!r} is not supported", "export the mesh as glTF 2.0")
    check_types(document, "")
    for name in document.get("extensionsRequired", []):
        if not isinstance(name, str) or not name.startswith(_KNOWN_REQUIRED):
            raise gltf_error(
                "gltf_extension",
                f"the file requires the extension {name}",
                "export the mesh without it (for compressed geometry: without compression)",
            )
    partial = GltfDocument(document, (), path.parent, binary)
    return GltfDocument(document, _buffers(partial, chunk), path.parent, binary)


def _no_constant(name: str) -> float:
    raise ValueError(f"{name} is not JSON")


def _chunks(data: bytes) -> tuple[bytes, bytes | None]:
    """JSON and BIN chunk of a GLB."""
    if len(data) < 20:
        raise gltf_error("truncated", f"the GLB file is cut off after {len(data)} bytes", "copy or download it again")
    _, version, length = struct.unpack_from("<4sII", data)
    if version != 2:
        raise gltf_error("gltf_version", f"GLB version {version} is not supported", "export the mesh as glTF 2.0")
    if length > len(data):
        raise gltf_error(
            "truncated", f"the GLB file is cut off: {len(data)} of {length} bytes", "copy or download it again"
        )
    chunks: list[tuple[bytes, bytes]] = []
    at = 12
    while at + 8 <= length:
        size, kind = struct.unpack_from("<I4s", data, at)
        if at + 8 + size > length:
            raise gltf_error("gltf_bounds", f"a chunk of the GLB file reaches byte {at + 8 + size} of {length}")
        chunks.append((kind, data[at + 8 : at + 8 + size]))
        at += 8 + size
    if not chunks or chunks[0][0] != b"JSON":
        raise gltf_error("gltf_invalid", "the GLB file does not begin with a JSON chunk")
    return chunks[0][1], next((body for kind, body in chunks[1:2] if kind == b"BIN\x00"), None)


def _buffers(document: GltfDocument, chunk: bytes | None) -> tuple[bytes, ...]:
    found: list[bytes] = []
    for i, buffer in enumerate(document.items("buffers")):
        length = _whole(buffer, "byteLength", None)
        if "uri" in buffer:
            data = resolve(buffer["uri"], document.base, f"buffer {i}")
        elif i == 0 and chunk is not None:
            data = chunk
        elif "EXT_meshopt_compression" in buffer.get("extensions", {}):
            data = bytes(length)  # the fallback buffer of an optional compression: only its size is stored
        else:
            raise gltf_error("gltf_invalid", f"buffer {i} has no data")
        if len(data) < length:
            raise gltf_error("gltf_bounds", f"buffer {i} holds {len(data)} of its {length} bytes")
        found.append(data[:length])
    return tuple(found)
