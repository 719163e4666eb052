"""Wavefront OBJ, parsed strictly, with all that is needed to write the same file back."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from paintit.errors import MeshError
from paintit.mesh.mesh import Floats, Ints, Layer, Part
from paintit.mesh.parsed import Parsed
from paintit.mesh.triangulate import triangulate

_IGNORED = frozenset(
    (
        "s",
        "l",
        "p",
        "vp",
        "cstype",
        "deg",
        "curv",
        "curv2",
        "surf",
        "parm",
        "trim",
        "hole",
        "scrv",
        "sp",
        "end",
        "con",
        "mg",
        "bevel",
        "c_interp",
        "d_interp",
        "lod",
        "maplib",
        "usemap",
        "shadow_obj",
        "trace_obj",
    )
)
"""Statements of the format that say nothing about polygons."""


@dataclass(frozen=True)
class ObjDocument:
    """The parsed text. A polygon is one ``f`` statement; its corners are a run of the corner arrays.

    Attributes:
        lines: the file's lines without line ends; a continued statement stands on its first line, the rest is empty.
        polygon_line: (p,) index into ``lines`` of each ``f`` statement.
        polygon_start: (p + 1,) where each polygon's corners begin.
        corner_vertex, corner_uv, corner_normal: (c,) zero-based indices into the file's v, vt, vn; -1 where left out.
        triangle_corner: (f, 3) corner of the document that each corner of ``Mesh.faces`` came from.
        material_libraries: file names of the ``mtllib`` statements.
    """

    lines: tuple[str, ...]
    polygon_line: Ints
    polygon_start: Ints
    corner_vertex: Ints
    corner_uv: Ints
    corner_normal: Ints
    triangle_corner: Ints
    material_libraries: tuple[str, ...]


@dataclass
class _Tables:
    """Raw statements, collected in one pass."""

    v: list[list[str]] = field(default_factory=list)
    vt: list[list[str]] = field(default_factory=list)
    vn: list[list[str]] = field(default_factory=list)
    line_of: dict[str, list[int]] = field(default_factory=lambda: {"v": [], "vt": [], "vn": []})
    corners: list[tuple[int, int, int]] = field(default_factory=list)
    starts: list[int] = field(default_factory=lambda: [0])
    polygon_line: list[int] = field(default_factory=list)
    run_of_polygon: list[int] = field(default_factory=list)
    runs: list[tuple[str, str | None]] = field(default_factory=list)
    libraries: list[str] = field(default_factory=list)
    other: dict[str, int] = field(default_factory=dict)


def _error(code: str, message: str, line: int) -> MeshError:
    return MeshError(f"mesh.{code}", f"{message} (line {line + 1})", "repair the file or export it again")


def read_obj(data: bytes) -> Parsed:
    """Parse an OBJ file.

    Raises:
        MeshError: not text, malformed statements, NaN, an index that is 0 or out of range.
    """
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    if "\x00" in text:
        raise MeshError("mesh.garbage", "the .obj file holds binary data", "export the mesh again as OBJ text")
    lines = _logical_lines(text.replace("\r\n", "\n").replace("\r", "\n"))
    tables = _collect(lines)
    if not tables.polygon_line:
        _nothing(tables, lines)
    corners = np.array(tables.corners, np.int64).reshape(-1, 3)
    vertices = _numbers(tables, corners, "v", 3)
    uvs = _numbers(tables, corners, "vt", 2)
    uvs = np.stack([uvs[:, 0], 1.0 - uvs[:, 1]], 1)  # OBJ counts v upward; this is the only place that flips it
    normals = _numbers(tables, corners, "vn", 3)
    starts = np.array(tables.starts, np.int64)
    triangle_corner = triangulate(vertices[corners[:, 0]], starts)
    size = np.diff(starts)
    polygon = np.repeat(np.arange(len(size)), size - 2)
    run = np.array(tables.run_of_polygon, np.int64)[polygon]
    layers, layer_of_run = _layers(tables.runs)
    parts = _parts(tables.runs, run, layer_of_run)
    corner = corners[triangle_corner]
    given = np.full((len(corner), 3, 3), np.nan, np.float32)
    has_normal = corner[..., 2] >= 0
    given[has_normal] = np.nan_to_num(normals, nan=0.0, posinf=0.0, neginf=0.0)[corner[..., 2][has_normal]]
    document = ObjDocument(
        tuple(lines),
        np.array(tables.polygon_line, np.int64),
        starts,
        corners[:, 0],
        corners[:, 1],
        corners[:, 2],
        triangle_corner,
        tuple(tables.libraries),
    )
    return Parsed(
        vertices,
        corner[..., 0],
        uvs,
        corner[..., 1],
        given,
        layer_of_run[run],
        layers,
        parts,
        document=document,
        notes=_notes(size, tables),
    )


def _logical_lines(text: str) -> list[str]:
    """Lines with continuations joined into their first line, the rest left empty so that line numbers stay true."""
    lines = text.split("\n")
    if "\\\n" not in text:
        return lines
    for i in reversed(range(len(lines) - 1)):
        # A comment that ends with a backslash (a Windows path, say) must not swallow the next line.
        if lines[i].endswith("\\") and not lines[i].lstrip().startswith("#"):
            lines[i], lines[i + 1] = lines[i][:-1] + " " + lines[i + 1], ""
    return lines


def _nothing(tables: _Tables, lines: list[str]) -> None:
    if not tables.v and tables.other:
        sample = next(iter(tables.other))[:20]
        raise MeshError(
            "mesh.garbage",
            f"the .obj file holds no OBJ statements (it begins with {sample!r})",
            "export the mesh again as OBJ text",
        )
    raise MeshError(
        "mesh.empty",
        f"the mesh has no faces ({len(tables.v)} vertices, 0 faces)",
        "export the mesh with its faces; point clouds and curves cannot be painted",
    )


def _collect(lines: list[str]) -> _Tables:
    t = _Tables()
    name, material = "", None
    group = ""
    run_index: dict[tuple[str, str | None], int] = {}
    tables = {"v": t.v, "vt": t.vt, "vn": t.vn}
    for number, line in enumerate(lines):
        fields = line.split()
        if not fields or fields[0][0] == "#":
            continue
        word = fields[0]
        if word in tables:
            tables[word].append(fields)
            t.line_of[word].append(number)
        elif word in ("f", "fo"):
            _face(t, fields, number)
            t.run_of_polygon.append(run_index.setdefault((name or group, material), len(run_index)))
            t.polygon_line.append(number)
        elif word == "o":
            name = line.strip()[1:].strip()
        elif word == "g":
            group = line.strip()[1:].strip()
            name = name if name and not group else group or name
        elif word == "usemtl":
            material = line.strip()[6:].strip() or None
        elif word == "mtllib":
            t.libraries.append(line.strip()[6:].strip())
        elif word not in _IGNORED:
            t.other[word] = t.other.get(word, 0) + 1
    t.runs = list(run_index)
    return t


def _face(t: _Tables, fields: list[str], number: int) -> None:
    if len(fields) < 4:
        raise _error("face_too_small", f"a face has {len(fields) - 1} corners", number)
    counts = (len(t.v), len(t.vt), len(t.vn))
    for token in fields[1:]:
        if token[0] == "#":
            break
        indices = token.split("/")
        if len(indices) > 3 or not indices[0]:
            raise _error("bad_statement", f"cannot read the face corner '{token}'", number)
        corner = [-1, -1, -1]
        for k, text in enumerate(indices):
            if not text:
                continue
            try:
                index = int(text)
            except ValueError:
                raise _error("bad_statement", f"cannot read the face corner '{token}'", number) from None
            # Relative indices count back from the last one *so far*; absolute ones may point ahead.
            corner[k] = index - 1 if index > 0 else counts[k] + index
            if index == 0 or corner[k] < 0:
                raise _error("index", f"index {index} of the face corner '{token}' is out of range", number)
        t.corners.append((corner[0], corner[1], corner[2]))
    if len(t.corners) - t.starts[-1] < 3:
        raise _error("face_too_small", f"a face has {len(t.corners) - t.starts[-1]} corners", number)
    t.starts.append(len(t.corners))


def _numbers(t: _Tables, corners: Ints, word: str, width: int) -> Floats:
    """(n, width) the table of ``word``; also checks that every face corner points into it."""
    rows = {"v": t.v, "vt": t.vt, "vn": t.vn}[word]
    least = 1 if word == "vt" else width
    values = np.zeros((len(rows), width), np.float64)
    try:
        table = np.array([[float(x) for x in row[1 : width + 1]] for row in rows], np.float64)
        if rows and table.shape != values.shape:
            raise ValueError
        values = table.reshape(-1, width)
    except ValueError:
        for i, row in enumerate(rows):
            try:
                found = [float(x) for x in row[1 : width + 1]]
            except ValueError:
                raise _error("bad_statement", f"cannot read '{' '.join(row)}'", t.line_of[word][i]) from None
            if len(found) < least:
                raise _error("bad_statement", f"'{' '.join(row)}' has too few numbers", t.line_of[word][i]) from None
            values[i, : len(found)] = found
    if word == "v" and not np.isfinite(values).all():
        i = int(np.flatnonzero(~np.isfinite(values).all(1))[0])
        raise _error("nan", f"vertex {i + 1} is not finite: '{' '.join(rows[i])}'", t.line_of[word][i])
    used = corners[:, {"v": 0, "vt": 1, "vn": 2}[word]]
    if used.max() >= len(rows):
        corner = int((used >= len(rows)).argmax())
        line = t.polygon_line[int(np.searchsorted(t.starts, corner, side="right")) - 1]
        raise _error("index", f"a face uses {word} {used[corner] + 1} of {len(rows)}", line)
    return values


def _layers(runs: list[tuple[str, str | None]]) -> tuple[tuple[Layer, ...], Ints]:
    """Materials in the order of first use, and the layer of each run."""
    order: dict[str | None, int] = {}
    layer_of_run = np.array([order.setdefault(material, len(order)) for _, material in runs], np.int64)
    return tuple(Layer(name or "material") for name in order), layer_of_run


def _parts(runs: list[tuple[str, str | None]], run: Ints, layer_of_run: Ints) -> tuple[Part, ...]:
    cuts = np.concatenate([[0], np.flatnonzero(np.diff(run)) + 1, [len(run)]])
    return tuple(Part(runs[run[a]][0] or "mesh", (a, b), int(layer_of_run[run[a]])) for a, b in pairwise(cuts.tolist()))


def _notes(size: Ints, t: _Tables) -> tuple[str, ...]:
    notes = []
    quads, larger = int((size == 4).sum()), int((size > 4).sum())
    if quads or larger:
        kinds = [f"{n} {word}" for n, word in ((quads, "quads"), (larger, "larger polygons")) if n]
        notes.append(f"triangulated {' and '.join(kinds)}")
    if t.other:
        words = ", ".join(f"'{w[:20]}'" for w in list(t.other)[:5])
        notes.append(f"ignored {sum(t.other.values())} unknown statements ({words})")
    if t.v and any(len(row) == 5 and float(row[4]) != 1.0 for row in t.v[:1]):
        notes.append("ignored the weights of rational vertices")
    return tuple(notes)
