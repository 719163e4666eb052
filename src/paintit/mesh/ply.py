"""Stanford PLY, text and binary, with polygons of any size and texture coordinates at vertices or face corners."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from paintit.errors import MeshError
from paintit.mesh.mesh import Floats, Ints, Layer, Part
from paintit.mesh.parsed import Parsed
from paintit.mesh.triangulate import triangulate

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
_FORMATS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_UV_NAMES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("s0", "t0"), ("u0", "v0"))
_HINT = "check that it is a PLY file, or export it again"


@dataclass
class _Element:
    """One ``element`` of the header; a property is (name, type) or, for a list, (name, type, type of its length)."""

    name: str
    count: int
    properties: list[tuple[str, ...]] = field(default_factory=list)


@dataclass(frozen=True)
class _Columns:
    """An element's content: numbers (n,) by name, and lists by name as (n,) lengths with all values in one row."""

    numbers: dict[str, NDArray[Any]]
    lists: dict[str, tuple[Ints, NDArray[Any]]]


def read_ply(data: bytes) -> Parsed:
    """Parse a PLY file.

    Raises:
        MeshError: another kind of file, cut off, malformed, an index out of range, a vertex not finite, no faces.
    """
    elements, order, at = _header(data)
    found: dict[str, _Columns] = {}
    body = data[at:] if order else _words(data[at:])
    at = 0
    for element in elements:
        found[element.name], at = _read(element, body, order, at)
        if "vertex" in found and "face" in found:
            break
    vertex = found.get("vertex", _Columns({}, {}))
    missing = [name for name in "xyz" if name not in vertex.numbers]
    if missing:
        raise MeshError("mesh.garbage", f"the PLY file has no vertices with a number '{missing[0]}'", _HINT)
    vertices = np.stack([vertex.numbers[name] for name in "xyz"], 1).astype(np.float64)
    if not np.isfinite(vertices).all():
        bad = int(np.flatnonzero(~np.isfinite(vertices).all(1))[0])
        raise MeshError("mesh.nan", f"vertex {bad} is not finite: {vertices[bad].tolist()}", _HINT)
    return _parsed(vertices, vertex, found.get("face", _Columns({}, {})))


def _header(data: bytes) -> tuple[list[_Element], str, int]:
    """The elements, the byte order (empty: text), and where the body begins."""
    end = data.find(b"end_header")
    if data[:3] != b"ply" or data[3:4] not in (b"\n", b"\r"):
        raise MeshError("mesh.garbage", f"this is not a PLY file (it begins with {data[:8]!r})", _HINT)
    if end < 0:
        raise MeshError("mesh.truncated", "the header of the PLY file has no end", _HINT)
    order: str | None = None
    elements: list[_Element] = []
    for line in data[:end].decode("latin-1").splitlines()[1:]:
        match line.split():
            case [] | ["comment" | "obj_info", *_]:
                pass
            case ["format", name, _] if name in _FORMATS:
                order = _FORMATS[name]
            case ["element", name, count] if count.isascii() and count.isdigit() and len(count) < 16:
                elements.append(_Element(name, int(count)))
            case ["property", "list", size, kind, name] if elements and {size, kind} <= _TYPES.keys():
                elements[-1].properties.append((name, _TYPES[kind], _TYPES[size]))
            case ["property", kind, name] if elements and kind in _TYPES:
                elements[-1].properties.append((name, _TYPES[kind]))
            case _:
                raise MeshError("mesh.garbage", f"cannot read '{line[:60]}' in the header of the PLY file", _HINT)
    if order is None:
        raise MeshError("mesh.garbage", "the header of the PLY file does not state its format", _HINT)
    newline = data.find(b"\n", end)
    return elements, order, newline + 1 if newline >= 0 else len(data)


def _words(body: bytes) -> Floats:
    """All numbers of a text body."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            return np.fromstring(body, np.float64, sep=" ")
        except (DeprecationWarning, ValueError):
            raise MeshError("mesh.bad_statement", "the PLY file holds something else than numbers", _HINT) from None


def _read(element: _Element, body: bytes | Floats, order: str, at: int) -> tuple[_Columns, int]:
    """The element that begins at byte, or word, ``at`` of the body, and where the next one does."""
    lengths = [0] * sum(len(p) == 3 for p in element.properties)
    if element.count and lengths:
        lengths = _lengths(element, body, order, at)
    kinds, size = _row(element, order, lengths)
    room = len(body) - at
    if element.count * _row(element, order, [0] * len(lengths))[1] > room:
        raise _cut_off(element)
    if element.count * size <= room:
        rows = _rows(kinds, size, body, element.count, at)
        if all((rows[f"#{k}"] == length).all() for k, length in enumerate(lengths)):
            lists = {
                p[0]: (np.full(element.count, lengths[k]), rows[f"={k}"].reshape(-1))
                for k, p in enumerate(p for p in element.properties if len(p) == 3)
            }
            numbers = {p[0]: rows[p[0]] for p in element.properties if len(p) == 2}
            return _Columns(numbers, lists), at + element.count * size
    return _read_rows(element, body, order, at)


def _row(element: _Element, order: str, lengths: list[int]) -> tuple[list[tuple[str, str, int]], int]:
    """Name, type and number of the values of a row whose lists have these lengths, and its size in bytes or words."""
    kinds: list[tuple[str, str, int]] = []
    for p in element.properties:
        if len(p) == 2:
            kinds.append((p[0], order + p[1], 1))
        else:
            k = sum(name[0] == "#" for name, _, _ in kinds)
            kinds += [(f"#{k}", order + p[2], 1), (f"={k}", order + p[1], lengths[k])]
    return kinds, sum(n * (np.dtype(kind).itemsize if order else 1) for _, kind, n in kinds)


def _rows(
    kinds: list[tuple[str, str, int]], size: int, body: bytes | Floats, count: int, at: int
) -> dict[str, NDArray[Any]]:
    """Columns of ``count`` equal rows."""
    columns: dict[str, NDArray[Any]] = {}
    offset = 0
    if isinstance(body, bytes):
        table = np.frombuffer(body, np.uint8, count * size, at).reshape(count, size)
        for name, kind, n in kinds:
            end = offset + n * np.dtype(kind).itemsize
            values = np.ascontiguousarray(table[:, offset:end]).view(kind)
            columns[name], offset = values.reshape(count, n) if name[0] == "=" else values.reshape(-1), end
    else:
        words = body[at : at + count * size].reshape(count, size)
        for name, _, n in kinds:
            part = words[:, offset : offset + n]
            columns[name], offset = part if name[0] == "=" else part.reshape(-1), offset + n
    return columns


def _lengths(element: _Element, body: bytes | Floats, order: str, at: int) -> list[int]:
    """The lengths of the lists of the row at ``at``."""
    lengths: list[int] = []
    for p in element.properties:
        if len(p) == 2:
            at += np.dtype(p[1]).itemsize if order else 1
            continue
        at += np.dtype(p[2]).itemsize if order else 1
        if at > len(body):
            raise _cut_off(element)
        value = np.frombuffer(body, order + p[2], 1, at - np.dtype(p[2]).itemsize)[0] if order else body[at - 1]
        if not 0 <= value < len(body) + 1 or value != int(value):
            raise MeshError("mesh.bad_statement", f"a list of the PLY file has the length {value}", _HINT)
        lengths.append(int(value))
        at += lengths[-1] * (np.dtype(p[1]).itemsize if order else 1)
    return lengths


def _read_rows(element: _Element, body: bytes | Floats, order: str, at: int) -> tuple[_Columns, int]:
    """Row by row, where lists differ in length."""
    if not element.properties or not any(len(p) == 3 for p in element.properties):
        raise _cut_off(element)
    rows: list[dict[str, NDArray[Any]]] = []
    sizes: list[list[int]] = []
    for _ in range(element.count):
        lengths = _lengths(element, body, order, at)
        kinds, size = _row(element, order, lengths)
        if at + size > len(body):
            raise _cut_off(element)
        rows.append(_rows(kinds, size, body, 1, at))
        sizes.append(lengths)
        at += size
    each = np.array(sizes, np.int64)
    lists = {
        p[0]: (each[:, k], np.concatenate([row[f"={k}"][0] for row in rows]))
        for k, p in enumerate(p for p in element.properties if len(p) == 3)
    }
    numbers = {p[0]: np.concatenate([row[p[0]] for row in rows]) for p in element.properties if len(p) == 2}
    return _Columns(numbers, lists), at


def _cut_off(element: _Element) -> MeshError:
    return MeshError(
        "mesh.truncated",
        f"the PLY file is cut off: it does not hold the {element.count} rows of '{element.name}' that it promises",
        "copy or export it again",
    )


def _parsed(vertices: Floats, vertex: _Columns, face: _Columns) -> Parsed:
    size, corners = next(
        (face.lists[name] for name in ("vertex_indices", "vertex_index") if name in face.lists),
        (np.zeros(0, np.int64), np.zeros(0, np.int64)),
    )
    whole = size >= 3
    notes = [f"left out {int((~whole).sum())} faces with fewer than 3 corners"] if (~whole).any() else []
    keep = np.repeat(whole, size)
    if not whole.any():
        raise MeshError(
            "mesh.empty",
            f"the mesh has no faces ({len(vertices)} vertices, 0 faces)",
            "export the mesh with its faces; point clouds and curves cannot be painted",
        )
    out = ~((corners >= 0) & (corners < len(vertices)))
    if out.any():
        raise MeshError(
            "mesh.index",
            f"a face uses vertex {corners[out][0]:.0f} of {len(vertices)}",
            "repair the file or export it again",
        )
    corner = corners[keep].astype(np.int64)
    start = np.concatenate([[0], np.cumsum(size[whole])])
    triangles = triangulate(vertices[corner], start)
    faces = corner[triangles]
    if (size > 3).any():
        notes.append(f"triangulated {int((size > 3).sum())} polygons")
    uvs, corner_uv = _uvs(vertex, face, size, keep, corner)
    normals = np.full((len(faces), 3, 3), np.nan, np.float32)
    if all(name in vertex.numbers for name in ("nx", "ny", "nz")):
        given = np.stack([vertex.numbers[name] for name in ("nx", "ny", "nz")], 1).astype(np.float64)
        normals = np.where(np.abs(given) < 1e30, given, 0.0).astype(np.float32)[faces]
    return Parsed(
        vertices,
        faces,
        np.stack([uvs[:, 0], 1.0 - uvs[:, 1]], 1),  # PLY counts v upward, as OBJ
        corner_uv[triangles],
        normals,
        np.zeros(len(faces), np.int64),
        (Layer("material"),),
        (Part("mesh", (0, len(faces)), 0),),
        notes=tuple(notes),
    )


def _uvs(vertex: _Columns, face: _Columns, size: Ints, keep: NDArray[np.bool_], corner: Ints) -> tuple[Floats, Ints]:
    """Texture coordinates (t, 2) and the one of each kept corner, -1 where there are none."""
    length, values = face.lists.get("texcoord", (size, np.zeros(0)))
    if len(values) and (length == 2 * size).all():
        return values.reshape(-1, 2).astype(np.float64), np.flatnonzero(keep)
    for u, v in _UV_NAMES:
        if u in vertex.numbers and v in vertex.numbers:
            return np.stack([vertex.numbers[u], vertex.numbers[v]], 1).astype(np.float64), corner
    return np.zeros((0, 2)), np.full(len(corner), -1)
