"""Compressed geometry in a glTF document: Draco is decoded, meshopt is refused unless an uncompressed copy is there.

What comes out has plain accessors only, so that neither the reader nor an exporter needs to know of compression.
"""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from paintit.mesh.gltf_document import COMPONENTS, SHAPES, GltfDocument
from paintit.mesh.gltf_schema import gltf_error

DRACO = "KHR_draco_mesh_compression"
MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")
_WITHOUT = "export the mesh without compression"
#: Triangles that a byte of Draco data may stand for; a flat grid, the best case there is, comes to 7.
_FACES_PER_BYTE = 200


def refuse_unreadable(buffer: dict[str, Any], index: int, has_data: bool) -> None:
    """Refuse a buffer that only meshopt could fill: just its size is stored, whatever that is.

    Raises:
        MeshError: ``mesh.gltf_extension``.
    """
    for name in MESHOPT:
        if name in buffer.get("extensions", {}) and not has_data:
            raise gltf_error("gltf_extension", f"buffer {index} is compressed with {name}", _WITHOUT)


def decoded(document: GltfDocument) -> GltfDocument:
    """The document with plain accessors in the place of compressed ones, and without the names of the compressions.

    Raises:
        MeshError: geometry that cannot be decoded here, or is damaged.
    """
    used = {name for key in ("extensionsUsed", "extensionsRequired") for name in document.json.get(key, [])}
    primitives = [primitive for mesh in document.items("meshes") for primitive in mesh.get("primitives", [])]
    draco = any(_draco_of(primitive) is not None for primitive in primitives)
    if not draco and not used & {DRACO, *MESHOPT} and not _meshopt_owners(document.json):
        return document
    _refuse_empty_copies(document)
    work = _Decoder(document)
    for i, mesh in enumerate(document.items("meshes")):
        for p, primitive in enumerate(mesh.get("primitives", [])):
            if _draco_of(primitive) is not None:
                work.primitive(i, p)
    return work.result()


def _draco_of(primitive: dict[str, Any]) -> dict[str, Any] | None:
    return primitive.get("extensions", {}).get(DRACO)


def _meshopt_owners(json: dict[str, Any]) -> list[dict[str, Any]]:
    """Buffers and buffer views that a meshopt extension speaks of."""
    owners = [*json.get("buffers", []), *json.get("bufferViews", [])]
    return [owner for owner in owners if any(name in owner.get("extensions", {}) for name in MESHOPT)]


def _refuse_empty_copies(document: GltfDocument) -> None:
    """A meshopt view may have an uncompressed copy in its own buffer; one of nothing but zeros was never filled."""
    for index, view in enumerate(document.items("bufferViews")):
        for name in MESHOPT:
            if name in view.get("extensions", {}):
                data = document.buffers[view["buffer"]]
                if data.count(0) == len(data):
                    raise gltf_error("gltf_extension", f"buffer view {index} is compressed with {name}", _WITHOUT)


class _Decoder:
    """Collects decoded attributes into one more buffer of a copied document."""

    def __init__(self, document: GltfDocument) -> None:
        self.document = document
        self.json = copy.deepcopy(document.json)
        self.body = bytearray()
        self.counts = {"decoded": 0, "kept": 0}

    def primitive(self, mesh: int, index: int) -> None:
        """Put the attributes and indices of one Draco primitive into the document as plain accessors."""
        owner = f"primitive {index} of mesh {mesh}"
        primitive = self.json["meshes"][mesh]["primitives"][index]
        draco = primitive["extensions"].pop(DRACO)
        if not primitive["extensions"]:
            del primitive["extensions"]
        attributes, ids = primitive.get("attributes", {}), draco.get("attributes")
        if not isinstance(ids, dict) or not ids or not set(ids) <= set(attributes):
            raise gltf_error("gltf_invalid", f"{DRACO} of {owner} does not say which attributes it holds")
        accessors = [attributes[name] for name in ids] + [primitive[k] for k in ("indices",) if k in primitive]
        if all("bufferView" in self.json["accessors"][a] for a in accessors):
            self.counts["kept"] += 1  # an uncompressed copy for readers without Draco is in the file
            return
        faces, values = self._decode(self.document.view(draco.get("bufferView", -1)), primitive, ids, owner)
        for name, rows in values.items():
            attributes[name] = self._attribute(attributes[name], rows, f"{name} of {owner}")
        primitive["indices"] = self._indices(faces, len(next(iter(values.values()))))
        primitive.pop("mode", None)  # a strip was decoded into plain triangles, the default
        self.counts["decoded"] += 1

    def _decode(
        self, data: bytes, primitive: dict[str, Any], ids: dict[str, Any], owner: str
    ) -> tuple[NDArray[Any], dict[str, NDArray[Any]]]:
        """(f, 3) faces and the (n, k) values of each attribute."""
        try:
            import DracoPy
        except ImportError:
            raise gltf_error(
                "gltf_extension",
                f"{owner} is compressed with {DRACO}, and DracoPy, which decodes it, is not installed",
                "pip install DracoPy, or export the mesh without compression",
            ) from None
        promised = self.document.count(primitive["attributes"][next(iter(ids))])
        corners = self.document.count(primitive["indices"]) if "indices" in primitive else promised
        header = _header(data, owner)
        if (
            header.faces > max(corners, 3)
            or header.points > 3 * header.faces
            or (header.faces > _FACES_PER_BYTE * len(data))
        ):
            raise gltf_error("gltf_bounds", f"the Draco data of {owner} promises {header.faces} faces")
        try:
            found: Any = DracoPy.decode(data)
            tables = {name: found.get_attribute_by_unique_id(id_) for name, id_ in ids.items()}
            faces = np.asarray(found.faces).astype(np.int64).reshape(-1, 3)
        except (DracoPy.FileTypeException, ValueError, TypeError, AttributeError, RuntimeError) as error:
            reason = " ".join(str(error).split())[:80].lower()
            raise gltf_error("gltf_invalid", f"the Draco data of {owner} is damaged ({reason})") from None
        missing = next((name for name, table in tables.items() if not table), None)
        if missing is not None or not len(faces):
            raise gltf_error("gltf_invalid", f"the Draco data of {owner} holds no {missing or 'faces'}")
        return faces, {name: np.asarray(table["data"]) for name, table in tables.items()}

    def _attribute(self, accessor: int, rows: NDArray[Any], owner: str) -> int:
        """A new accessor with ``rows`` in the component type that the old one promises."""
        old = self.json["accessors"][accessor]
        kind = COMPONENTS.get(old.get("componentType", 0))
        columns, height = SHAPES.get(old.get("type", ""), (0, 0))
        if kind is None or rows.shape != (len(rows), columns * height):
            raise gltf_error("gltf_invalid", f"{owner} is decoded to another type than it has in the file")
        table = rows.astype(kind)
        width = table.shape[1] * table.itemsize
        padded = np.zeros((len(table), -(-width // 4) * 4), np.uint8)
        padded[:, :width] = np.ascontiguousarray(table).view(np.uint8).reshape(len(table), width)
        new = {k: v for k, v in old.items() if k not in ("byteOffset", "sparse")} | {"count": len(table)}
        if "min" in old or "max" in old:  # quantisation moved them a little
            new |= {"min": table.min(0).tolist(), "max": table.max(0).tolist()}
        return self._append(new, padded.tobytes(), {"byteStride": padded.shape[1], "target": 34962})

    def _indices(self, faces: NDArray[np.int64], vertices: int) -> int:
        code, kind = (5123, np.uint16) if vertices < 65_535 else (5125, np.uint32)
        accessor = {"componentType": code, "count": faces.size, "type": "SCALAR"}
        return self._append(accessor, faces.astype(kind).tobytes(), {"target": 34963})

    def _append(self, accessor: dict[str, Any], data: bytes, view: dict[str, Any]) -> int:
        buffer = len(self.document.buffers)
        views, accessors = self.json.setdefault("bufferViews", []), self.json["accessors"]
        views.append({"buffer": buffer, "byteOffset": len(self.body), "byteLength": len(data), **view})
        self.body += data + bytes(-len(data) % 4)
        accessors.append(accessor | {"bufferView": len(views) - 1})
        return len(accessors) - 1

    def result(self) -> GltfDocument:
        json, buffers = self.json, self.document.buffers
        notes = []
        if self.counts["decoded"]:
            notes.append(f"decoded {self.counts['decoded']} primitives from {DRACO}")
        if self.counts["kept"]:
            notes.append(f"took the uncompressed copy beside {DRACO} of {self.counts['kept']} primitives")
        owners = _meshopt_owners(json)
        for owner in owners:
            owner["extensions"] = {k: v for k, v in owner["extensions"].items() if k not in MESHOPT}
            if not owner["extensions"]:
                del owner["extensions"]
        if owners:
            notes.append(f"took the uncompressed copy beside {MESHOPT[0]}")
        for key in ("extensionsUsed", "extensionsRequired"):
            json[key] = [name for name in json.get(key, []) if name not in (DRACO, *MESHOPT)]
            if not json[key]:
                del json[key]
        if self.body:
            json["buffers"].append({"byteLength": len(self.body)})
            buffers = (*buffers, bytes(self.body))
        return replace(self.document, json=json, buffers=buffers, notes=(*self.document.notes, *notes))


class _Header(NamedTuple):
    faces: int
    points: int


def _header(data: bytes, owner: str) -> _Header:
    """What Draco data says it holds, before anything is allocated for it (Draco bitstream 2.2, sections 3 and 4)."""
    damaged = gltf_error("gltf_invalid", f"the Draco data of {owner} is damaged")
    if len(data) < 14 or data[:7] != b"DRACO\x02\x02" or data[7] != 1 or data[8] > 1:
        raise damaged
    if int.from_bytes(data[9:11], "little") & 0x8000:
        raise gltf_error("gltf_extension", f"the Draco data of {owner} holds metadata, which is not read", _WITHOUT)
    edgebreaker = data[8] == 1
    numbers, at = [], 12 if edgebreaker else 11
    for _ in range(2):
        value = shift = 0
        while True:
            if at >= len(data) or shift > 28:
                raise damaged
            value |= (data[at] & 0x7F) << shift
            at, shift = at + 1, shift + 7
            if data[at - 1] < 0x80:
                break
        numbers.append(value)
    return _Header(*reversed(numbers)) if edgebreaker else _Header(*numbers)
