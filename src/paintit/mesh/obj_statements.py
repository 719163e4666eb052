"""The statements of an OBJ file, line by line: the definition of what is accepted, and every message of refusal.

``obj_quick.py`` is its fast twin for files without oddities; both give the same ``Statements``.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from paintit.errors import MeshError
from paintit.mesh.mesh import Floats, Ints

IGNORED = frozenset(
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


_MOST = 1 << 48
"""No file has so many vertices; larger numbers would not fit an array."""


@dataclass(frozen=True)
class Statements:
    """What the file says about polygons.

    Attributes:
        v, vt, vn: (n, 3), (n, 2), (n, 3) float64, as written; v finite, missing numbers of a vt zero.
        corners: (c, 3) zero-based indices into v, vt, vn of each face corner, -1 where left out; all in range.
        starts: (p + 1,) where each polygon's corners begin.
        polygon_line: (p,) line of each polygon.
        run_of_polygon: (p,) index into ``runs``.
        runs: (object or group name, material) in the order of first use.
        libraries: file names of the ``mtllib`` statements.
        other: how often each unknown word begins a line.
        small: line and number of corners of each face with fewer than three, which is left out.
        rational: the first vertex has a weight other than 1.
    """

    v: Floats
    vt: Floats
    vn: Floats
    corners: Ints
    starts: Ints
    polygon_line: Ints
    run_of_polygon: Ints
    runs: tuple[tuple[str, str | None], ...]
    libraries: tuple[str, ...]
    other: dict[str, int]
    small: tuple[tuple[int, int], ...]
    rational: bool


@dataclass
class Names:
    """The object, group and material that hold at a line; fed with the lines that are neither vertices nor faces."""

    libraries: list[str] = field(default_factory=list)
    other: dict[str, int] = field(default_factory=dict)
    _object: str = ""
    _group: str = ""
    _material: str | None = None

    @property
    def run(self) -> tuple[str, str | None]:
        return self._object or self._group, self._material

    def read(self, word: str, line: str) -> None:
        """Take in a line that begins with ``word``."""
        if word == "o":
            self._object = line.strip()[1:].strip()
        elif word == "g":
            self._group = line.strip()[1:].strip()
            self._object = self._object if self._object and not self._group else self._group or self._object
        elif word == "usemtl":
            self._material = line.strip()[6:].strip() or None
        elif word == "mtllib":
            self.libraries.append(line.strip()[6:].strip())
        elif word not in IGNORED:
            self.other[word] = self.other.get(word, 0) + 1


@dataclass
class _Tables:
    """Raw statements, collected in one pass."""

    rows: dict[str, list[list[str]]] = field(default_factory=lambda: {"v": [], "vt": [], "vn": []})
    line_of: dict[str, list[int]] = field(default_factory=lambda: {"v": [], "vt": [], "vn": []})
    corners: list[tuple[int, int, int]] = field(default_factory=list)
    starts: list[int] = field(default_factory=lambda: [0])
    polygon_line: list[int] = field(default_factory=list)
    run_of_polygon: list[int] = field(default_factory=list)
    small: list[tuple[int, int]] = field(default_factory=list)


def _error(code: str, message: str, line: int) -> MeshError:
    return MeshError(f"mesh.{code}", f"{message} (line {line + 1})", "repair the file or export it again")


def read_statements(lines: list[str]) -> Statements:
    """Read logical lines.

    Raises:
        MeshError: no faces, malformed statements, a vertex that is not finite, an index that is 0 or out of range.
    """
    t, names = _Tables(), Names()
    run_index: dict[tuple[str, str | None], int] = {}
    for number, line in enumerate(lines):
        fields = line.split()
        if not fields or fields[0][0] == "#":
            continue
        word = fields[0]
        if word in t.rows:
            t.rows[word].append(fields)
            t.line_of[word].append(number)
        elif word in ("f", "fo"):
            if _face(t, fields, number):
                t.run_of_polygon.append(run_index.setdefault(names.run, len(run_index)))
                t.polygon_line.append(number)
        else:
            names.read(word, line)
    if not t.polygon_line and t.small:
        raise _error("face_too_small", f"a face has {t.small[0][1]} corners", t.small[0][0])
    if not t.polygon_line:
        raise _nothing(len(t.rows["v"]), names.other)
    corners = np.array(t.corners, np.int64).reshape(-1, 3)
    first = t.rows["v"][0] if t.rows["v"] else []
    return Statements(
        _numbers(t, corners, "v", 3),
        _numbers(t, corners, "vt", 2),
        _numbers(t, corners, "vn", 3),
        corners,
        np.array(t.starts, np.int64),
        np.array(t.polygon_line, np.int64),
        np.array(t.run_of_polygon, np.int64),
        tuple(run_index),
        tuple(names.libraries),
        names.other,
        tuple(t.small),
        len(first) == 5 and _is_weight(first[4]),
    )


def _is_weight(text: str) -> bool:
    try:
        return float(text) != 1.0
    except ValueError:
        return False


def _nothing(vertices: int, other: dict[str, int]) -> MeshError:
    if not vertices and other:
        return MeshError(
            "mesh.garbage",
            f"the .obj file holds no OBJ statements (it begins with {next(iter(other))[:20]!r})",
            "export the mesh again as OBJ text",
        )
    return MeshError(
        "mesh.empty",
        f"the mesh has no faces ({vertices} vertices, 0 faces)",
        "export the mesh with its faces; point clouds and curves cannot be painted",
    )


def _face(t: _Tables, fields: list[str], number: int) -> bool:
    """Take in a face; False where it has too few corners to be one, as exporters write for loose edges."""
    tokens = fields[1:]
    comment = next((i for i, token in enumerate(tokens) if token[0] == "#"), len(tokens))
    if comment < 3:
        t.small.append((number, comment))
        return False
    counts = tuple(len(rows) for rows in t.rows.values())
    for token in tokens[:comment]:
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
            if index == 0 or not 0 <= corner[k] < _MOST:
                raise _error("index", f"index {index} of the face corner '{token}' is out of range", number)
        t.corners.append((corner[0], corner[1], corner[2]))
    t.starts.append(len(t.corners))
    return True


def _numbers(t: _Tables, corners: Ints, word: str, width: int) -> Floats:
    """(n, width) the table of ``word``; also checks that every face corner points into it."""
    rows = t.rows[word]
    least = 1 if word == "vt" else width
    values = np.zeros((len(rows), width), np.float64)
    for i, row in enumerate(rows):
        try:
            found = [float(x) for x in row[1 : width + 1]]
        except ValueError:
            raise _error("bad_statement", f"cannot read '{' '.join(row)}'", t.line_of[word][i]) from None
        if len(found) < least:
            raise _error("bad_statement", f"'{' '.join(row)}' has too few numbers", t.line_of[word][i])
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
