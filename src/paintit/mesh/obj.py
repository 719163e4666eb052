"""Wavefront OBJ, parsed strictly, with all that is needed to write the same file back."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from paintit.errors import MeshError
from paintit.mesh.mesh import Ints, Layer, Part
from paintit.mesh.obj_quick import read_quickly
from paintit.mesh.obj_statements import Statements, read_statements
from paintit.mesh.parsed import Parsed
from paintit.mesh.triangulate import triangulate


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


def read_obj(data: bytes) -> Parsed:
    """Parse an OBJ file.

    Raises:
        MeshError: not text, malformed statements, NaN, an index that is 0 or out of range.
    """
    if b"\x00" in data:
        raise MeshError("mesh.garbage", "the .obj file holds binary data", "export the mesh again as OBJ text")
    data = data.removeprefix(b"\xef\xbb\xbf").replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    lines = _logical_lines(text)
    found = read_quickly(data, lines) or read_statements(lines)
    uvs = np.stack(
        [found.vt[:, 0], 1.0 - found.vt[:, 1]], 1
    )  # OBJ counts v upward; this is the only place that flips it
    triangle_corner = triangulate(found.v[found.corners[:, 0]], found.starts)
    size = np.diff(found.starts)
    run = found.run_of_polygon[np.repeat(np.arange(len(size)), size - 2)]
    layers, layer_of_run = _layers(found.runs)
    parts = _parts(found.runs, run, layer_of_run)
    corner = found.corners[triangle_corner]
    given = np.full((len(corner), 3, 3), np.nan, np.float32)
    has_normal = corner[..., 2] >= 0
    if has_normal.any():
        # Larger ones would overflow float32; their direction is all that counts, and that of such numbers is noise.
        usable = np.abs(found.vn).max(1) < 1e30
        given[has_normal] = np.where(usable[:, None], found.vn, 0.0)[corner[..., 2][has_normal]]
    document = ObjDocument(
        tuple(lines),
        found.polygon_line,
        found.starts,
        found.corners[:, 0],
        found.corners[:, 1],
        found.corners[:, 2],
        triangle_corner,
        found.libraries,
    )
    return Parsed(
        found.v,
        corner[..., 0],
        uvs,
        corner[..., 1],
        given,
        layer_of_run[run],
        layers,
        parts,
        document=document,
        notes=_notes(size, found),
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


def _layers(runs: tuple[tuple[str, str | None], ...]) -> tuple[tuple[Layer, ...], Ints]:
    """Materials in the order of first use, and the layer of each run."""
    order: dict[str | None, int] = {}
    layer_of_run = np.array([order.setdefault(material, len(order)) for _, material in runs], np.int64)
    return tuple(Layer(name or "material") for name in order), layer_of_run


def _parts(runs: tuple[tuple[str, str | None], ...], run: Ints, layer_of_run: Ints) -> tuple[Part, ...]:
    cuts = np.concatenate([[0], np.flatnonzero(np.diff(run)) + 1, [len(run)]])
    return tuple(Part(runs[run[a]][0] or "mesh", (a, b), int(layer_of_run[run[a]])) for a, b in pairwise(cuts.tolist()))


def _notes(size: Ints, found: Statements) -> tuple[str, ...]:
    notes = []
    quads, larger = int((size == 4).sum()), int((size > 4).sum())
    if quads or larger:
        kinds = [f"{n} {word}" for n, word in ((quads, "quads"), (larger, "larger polygons")) if n]
        notes.append(f"triangulated {' and '.join(kinds)}")
    if found.small:
        line = found.small[0][0] + 1
        notes.append(f"left out {len(found.small)} faces with fewer than 3 corners (the first on line {line})")
    if found.other:
        words = ", ".join(f"'{w[:20]}'" for w in list(found.other)[:5])
        notes.append(f"ignored {sum(found.other.values())} unknown statements ({words})")
    if found.rational:
        notes.append("ignored the weights of rational vertices")
    return tuple(notes)
