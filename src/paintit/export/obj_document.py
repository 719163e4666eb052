"""The lines of an OBJ file with new texture coordinates where it was unwrapped; all else as it came."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from paintit.export.vertices import group_rows
from paintit.mesh.mesh import Mesh
from paintit.mesh.obj import ObjDocument

Ints = NDArray[np.int64]


def rewritten_lines(document: ObjDocument, mesh: Mesh, names: list[str], library: str) -> list[str]:
    """The file's own lines with another ``mtllib`` and, for unwrapped layers, other texture coordinates.

    Vertices, normals, groups, objects, smoothing groups, comments and polygons stay in their order and words. New
    ``vt`` lines stand before the first face. A polygon whose triangles have several texture coordinates at one corner
    (a seam runs through it) is written as its triangles.

    Args:
        document: of the OBJ that ``mesh`` was read from.
        names: material name of each layer.
        library: file name of the new material library.
    """
    faces = _unwrapped_faces(document, mesh)
    first_face = int(document.polygon_line[0])
    out = [f"mtllib {library}"]
    named = False
    for number, line in enumerate(document.lines):
        word = line.split(maxsplit=1)[0] if line.strip() else ""
        if word == "mtllib" or (word == "vt" and faces.replaces_all):
            continue
        if number == first_face:
            out += faces.table
            if not named and mesh.layers[int(mesh.face_layer[0])].painted:
                out.append(f"usemtl {names[int(mesh.face_layer[0])]}")
        if word == "usemtl":
            named = True
            line = line if len(line.split()) > 1 else "usemtl material"
        out += faces.lines.get(number, [line])
    return out


class _Faces:
    """What changes in the text of an unwrapped OBJ.

    Attributes:
        table: new ``vt`` lines.
        lines: number of an ``f`` line -> what stands there now.
        replaces_all: no face needs an old ``vt`` line any more.
    """

    def __init__(self) -> None:
        self.table: list[str] = []
        self.lines: dict[int, list[str]] = {}
        self.replaces_all = False


def _unwrapped_faces(document: ObjDocument, mesh: Mesh) -> _Faces:
    faces = _Faces()
    if not mesh.report.unwrapped_layers:
        return faces
    size = np.diff(document.polygon_start)
    polygon = np.repeat(np.arange(len(size)), size - 2)
    redone = np.isin(mesh.face_layer, mesh.report.unwrapped_layers)
    changed = np.zeros(len(size), bool)
    changed[polygon[redone]] = True
    corner_changed = np.repeat(changed, size)
    fresh = mesh.corner_uvs[redone].reshape(-1, 2)
    used, index = group_rows([fresh])
    faces.table = [f"vt {number(u)} {number(1.0 - v)}" for u, v in fresh[used].tolist()]
    faces.replaces_all = bool((document.corner_uv[~corner_changed] < 0).all())
    first_face = int(document.polygon_line[0])
    # Old lines before the new ones keep their numbers, old lines behind them move up.
    before = sum(line.split()[:1] == ["vt"] for line in document.lines[:first_face])
    before = 0 if faces.replaces_all else before
    triangle_vt = np.zeros(mesh.faces.shape, np.int64)
    triangle_vt[redone] = index.reshape(-1, 3) + before + 1
    corner_vt = np.where(document.corner_uv < before, document.corner_uv + 1, document.corner_uv + 1 + len(used))
    corner_vt[document.corner_uv < 0] = 0
    corner_vt[document.triangle_corner[redone]] = triangle_vt[redone]
    whole = np.ones(len(size), bool)
    whole[polygon[(corner_vt[document.triangle_corner] != triangle_vt).any(1) & redone]] = False
    first_triangle = np.concatenate([[0], np.cumsum(size - 2)])
    for p in range(len(size)):
        start, end = document.polygon_start[p : p + 2].tolist()
        line = document.lines[int(document.polygon_line[p])]
        if whole[p]:
            if changed[p] or not faces.replaces_all:
                faces.lines[int(document.polygon_line[p])] = [_with_vt(line, corner_vt[start:end].tolist())]
            continue
        words = _corner_words(line)
        triangles = range(int(first_triangle[p]), int(first_triangle[p + 1]))
        faces.lines[int(document.polygon_line[p])] = [
            _with_vt(
                "f " + " ".join(words[c - start] for c in document.triangle_corner[t].tolist()), triangle_vt[t].tolist()
            )
            for t in triangles
        ]
    return faces


def _corner_words(line: str) -> list[str]:
    return line.partition("#")[0].split()[1:]


def _with_vt(line: str, vts: list[int]) -> str:
    """A face statement with the texture coordinates ``vts`` (0: none), its blanks and comment as they were."""
    statement, mark, comment = line.partition("#")
    left = iter(vts)

    def corner(found: re.Match[str]) -> str:
        vertex, _, rest = found[0].partition("/")
        vt, normal = next(left), rest.partition("/")[2]
        return vertex + (f"/{vt or ''}/{normal}" if normal else f"/{vt}" if vt else "")

    head = re.match(r"\s*\S+", statement)
    at = head.end() if head else 0
    return statement[:at] + re.sub(r"\S+", corner, statement[at:]) + mark + comment


def number(value: float) -> str:
    """Shortest text that reads back as the same number."""
    return repr(float(value)).removesuffix(".0")
