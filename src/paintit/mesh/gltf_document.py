"""A glTF 2.0 document, read strictly: the JSON as it stands and its buffers, so that all of it can be written back."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from paintit.config import LimitConfig
from paintit.mesh.gltf_schema import entry_of, gltf_error, short
from paintit.mesh.gltf_uri import resolve
from paintit.mesh.limits import check_limit

COMPONENTS = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
"""numpy type of each component type."""
SHAPES = {
    "SCALAR": (1, 1),
    "VEC2": (1, 2),
    "VEC3": (1, 3),
    "VEC4": (1, 4),
    "MAT2": (2, 2),
    "MAT3": (3, 3),
    "MAT4": (4, 4),
}
"""Columns and rows of each accessor type; matrices are stored column by column."""


@dataclass(frozen=True)
class GltfDocument:
    """One parsed file. Nothing here is ever changed; an exporter copies ``json`` first.

    Attributes:
        json: the document. Compressed geometry that could be decoded stands here as plain accessors.
        buffers: the resolved bytes of each entry of ``json["buffers"]``.
        base: folder that relative URIs start from.
        binary: read from a .glb.
        limits: what the file may ask for.
        notes: what was decoded on the way.
    """

    json: dict[str, Any]
    buffers: tuple[bytes, ...]
    base: Path
    binary: bool
    limits: LimitConfig = field(default_factory=LimitConfig)
    notes: tuple[str, ...] = ()

    def items(self, kind: str) -> list[dict[str, Any]]:
        """The top-level array called ``kind``, empty where the document has none."""
        return self.json.get(kind, [])

    def item(self, kind: str, index: Any) -> dict[str, Any]:
        """Entry ``index`` of the top-level array ``kind``.

        Raises:
            MeshError: the index is not a whole number within the array.
        """
        return entry_of(self.json, kind, index)

    def view(self, index: int) -> bytes:
        """The bytes of a buffer view."""
        view = self.item("bufferViews", index)
        self.item("buffers", view.get("buffer"))
        data = self.buffers[view["buffer"]]
        offset, length = whole(view, "byteOffset", 0), whole(view, "byteLength", None)
        if offset + length > len(data):
            raise gltf_error(
                "gltf_bounds", f"buffer view {index} reaches byte {offset + length} of a buffer of {len(data)}"
            )
        return data[offset : offset + length]

    def count(self, index: int) -> int:
        """Elements that an accessor says it has.

        Raises:
            MeshError: none, or more than the corners of as many triangles as the limit allows.
        """
        count = whole(self.item("accessors", index), "count", None)
        if count < 1:
            raise gltf_error("gltf_invalid", f"accessor {index} has no elements")
        check_limit(self.limits, "faces", -(-count // 3), f"triangles' worth of elements in accessor {index}")
        return count

    def accessor(self, index: int) -> NDArray[Any]:
        """Elements of an accessor, sparse values filled in, normalised integers turned into float32.

        Returns:
            (count, components) in the stored type, or float32 where the accessor is normalised.

        Raises:
            MeshError: any part of it lies outside its buffer, or its description is invalid.
        """
        accessor = self.item("accessors", index)
        count = self.count(index)
        shape = SHAPES.get(accessor.get("type", ""))
        kind = COMPONENTS.get(accessor.get("componentType", 0))
        if shape is None or kind is None:
            raise gltf_error(
                "gltf_invalid",
                f"accessor {index} has type {short(accessor.get('type'))} "
                f"and component type {short(accessor.get('componentType'))}",
            )
        if "bufferView" in accessor:
            values = self._elements(accessor["bufferView"], whole(accessor, "byteOffset", 0), count, shape, kind, index)
        elif count > max(65_536, sum(map(len, self.buffers))):
            # Sparse values change vertices that some other accessor holds, so there is at least a byte for each.
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
        stride = whole(self.item("bufferViews", view_index), "byteStride", column * columns)
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
        index_kind = COMPONENTS.get(where.get("componentType", 0))
        count = whole(sparse, "count", None)
        if index_kind not in (np.uint8, np.uint16, np.uint32) or not 1 <= count <= len(values):
            raise gltf_error("gltf_invalid", f"accessor {index} has invalid sparse indices")
        at = self._elements(where.get("bufferView"), whole(where, "byteOffset", 0), count, (1, 1), index_kind, index)[
            :, 0
        ]
        if at.max() >= len(values):
            raise gltf_error("gltf_index", f"accessor {index} has a sparse index {at.max()} of {len(values)}")
        values = values.copy()
        values[at] = self._elements(what.get("bufferView"), whole(what, "byteOffset", 0), count, shape, kind, index)
        return values

    def image(self, index: int) -> bytes:
        """The encoded bytes (PNG, JPEG, ...) of an image."""
        image = self.item("images", index)
        if "bufferView" in image:
            return self.view(image["bufferView"])
        return resolve(image.get("uri"), self.base, f"image {index}", self.limits)


def whole(owner: dict[str, Any], key: str, default: int | None) -> int:
    """The member ``key`` of ``owner``, a whole number of 0 or more; ``default`` None: it must be there."""
    value = owner.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise gltf_error("gltf_invalid", f"'{key}' is {short(value)}, not a whole number")
    return value
