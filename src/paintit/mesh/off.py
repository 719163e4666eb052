"""Geomview OFF in its text form."""

from __future__ import annotations

import re

import numpy as np

from paintit.errors import MeshError
from paintit.mesh.mesh import Floats, Ints
from paintit.mesh.parsed import Parsed
from paintit.mesh.triangulate import triangulate

_HEADER = re.compile(r"(ST)?(C)?(N)?OFF\b(?!\s*BINARY)", re.IGNORECASE)
_HINT = "check that it is a text OFF file, or export it again"


def read_off(data: bytes) -> Parsed:
    """Parse an OFF file; colours, normals and texture coordinates of its variants are left aside.

    Raises:
        MeshError: another kind of file, cut off, malformed, an index out of range, no faces.
    """
    text = data.decode("latin-1")
    lines = [line for line in (raw.split("#", 1)[0].strip() for raw in text.splitlines()) if line]
    header = _HEADER.match(lines[0]) if lines else None
    if header is None or "\x00" in text:
        raise MeshError("mesh.garbage", f"this is not an OFF file (it begins with {data[:8]!r})", _HINT)
    lines[0] = lines[0][header.end() :].strip()
    lines = lines if lines[0] else lines[1:]
    try:
        vertex_count, face_count = (int(x) for x in lines[0].split()[:2])
    except (ValueError, IndexError):
        raise MeshError(
            "mesh.garbage", "the OFF file does not state how many vertices and faces it has", _HINT
        ) from None
    if vertex_count < 0 or face_count <= 0:
        raise MeshError(
            "mesh.empty",
            f"the mesh has no faces ({max(vertex_count, 0)} vertices, 0 faces)",
            "export the mesh with its faces; point clouds and curves cannot be painted",
        )
    rows = [line.split() for line in lines[1 : 1 + vertex_count + face_count]]
    if len(rows) < vertex_count + face_count:
        raise MeshError(
            "mesh.truncated",
            f"the OFF file promises {vertex_count} vertices and {face_count} faces but has {len(rows)} lines of them",
            _HINT,
        )
    vertices = _vertices(rows[:vertex_count])
    corners, start = _polygons(rows[vertex_count:], vertex_count)
    faces = corners[triangulate(vertices[corners], start)]
    larger = int((np.diff(start) > 3).sum())
    return Parsed.bare(vertices, faces, (f"triangulated {larger} polygons",) if larger else ())


def _vertices(rows: list[list[str]]) -> Floats:
    vertices = np.empty((len(rows), 3))
    for i, row in enumerate(rows):
        try:
            vertices[i] = [float(x) for x in row[:3]]
        except ValueError:
            raise MeshError("mesh.bad_statement", f"cannot read vertex {i}: '{' '.join(row)[:60]}'", _HINT) from None
    if not np.isfinite(vertices).all():
        i = int(np.flatnonzero(~np.isfinite(vertices).all(1))[0])
        raise MeshError("mesh.nan", f"vertex {i} is not finite: {vertices[i].tolist()}", _HINT)
    return vertices


def _polygons(rows: list[list[str]], vertex_count: int) -> tuple[Ints, Ints]:
    """Corners of all polygons one after another, and where each begins."""
    corners: list[int] = []
    start = [0]
    for i, row in enumerate(rows):
        try:
            size = int(row[0])
            found = [int(x) for x in row[1 : 1 + size]]
        except ValueError:
            size, found = 0, []
        if size < 3 or len(found) < size:
            raise MeshError("mesh.bad_statement", f"cannot read face {i}: '{' '.join(row)[:60]}'", _HINT)
        for index in found:
            if not 0 <= index < vertex_count:
                raise MeshError("mesh.index", f"a face uses vertex {index} of {vertex_count}", _HINT)
        corners += found
        start.append(len(corners))
    return np.array(corners, np.int64), np.array(start, np.int64)
