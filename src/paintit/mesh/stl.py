"""STL, binary and text: triangles that share nothing."""

from __future__ import annotations

import re

import numpy as np

from paintit.errors import MeshError
from paintit.mesh.mesh import Floats
from paintit.mesh.parsed import Parsed

_HINT = "check that it is an STL file, or export it again"
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_NAME = re.compile(rb"^\s*(end)?solid\b.*$", re.MULTILINE | re.IGNORECASE)
_VERTEX = re.compile(rb"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)", re.IGNORECASE)
_LOOP = re.compile(rb"\bendloop\b", re.IGNORECASE)


def read_stl(data: bytes) -> Parsed:
    """Parse an STL file. Its normals are left aside: they are those of the triangles, where they are right.

    Raises:
        MeshError: another kind of file, cut off, malformed, or no faces.
    """
    text = data[:512].lstrip()[:5].lower() == b"solid" and b"\x00" not in data[:512]
    corners = _text(data) if text else _binary(data)
    if not len(corners):
        raise MeshError("mesh.empty", "the mesh has no faces (0 vertices, 0 faces)", "export the mesh with its faces")
    faces = np.arange(len(corners), dtype=np.int64).reshape(-1, 3)
    return Parsed.bare(corners, faces)


def _text(data: bytes) -> Floats:
    """(3 f, 3) corners."""
    body = _NAME.sub(b"", data)  # a solid may be called anything
    words = _VERTEX.findall(body)
    loops = len(_LOOP.findall(body))
    if len(words) != 3 * loops:
        raise MeshError(
            "mesh.bad_statement",
            f"the STL file has {len(words)} vertices in {loops} triangles that are complete",
            _HINT,
        )
    try:
        return np.array(words, object).reshape(-1, 3).astype(np.float64)
    except ValueError as error:
        raise MeshError("mesh.bad_statement", f"cannot read a vertex: {str(error)[:60]}", _HINT) from None


def _binary(data: bytes) -> Floats:
    """(3 f, 3) corners."""
    count = int.from_bytes(data[80:84], "little")
    end = 84 + _TRIANGLE.itemsize * count
    if len(data) < 84 or (count >= 1 << 26 and end > len(data)) or (count == 0 and len(data) > 84):
        raise MeshError("mesh.garbage", f"this is not an STL file (it begins with {data[:8]!r})", _HINT)
    if end > len(data):
        raise MeshError(
            "mesh.truncated",
            f"the STL file promises {count} triangles in {end} bytes but holds {len(data)} bytes",
            _HINT,
        )
    return np.frombuffer(data, _TRIANGLE, count, 84)["corners"].reshape(-1, 3).astype(np.float64)
