"""PLY and STL, by trimesh, with the checks that it leaves out."""

from __future__ import annotations

import io
import logging
from typing import TYPE_CHECKING

import numpy as np

from paintit.errors import MeshError
from paintit.mesh.mesh import Layer, Part
from paintit.mesh.parsed import Parsed

if TYPE_CHECKING:
    import trimesh


def read_soup(data: bytes, kind: str) -> Parsed:
    """Parse a file of ``kind`` ``"ply"`` or ``"stl"``.

    Raises:
        MeshError: the bytes are not such a file, or it holds no faces, or an index is out of range.
    """
    import trimesh

    _sniff(data, kind)
    logger = logging.getLogger("trimesh")
    disabled, logger.disabled = logger.disabled, True  # it logs whole tracebacks of what we report in one line
    try:
        with np.errstate(all="ignore"):
            loaded = trimesh.load(io.BytesIO(data), file_type=kind, process=False)
    except Exception as error:  # a parser fed with foreign bytes may raise anything
        reason = (str(error) or type(error).__name__).splitlines()[0][:80].lower()
        raise MeshError("mesh.garbage", f"cannot read it as {kind.upper()} ({reason})", _hint(kind)) from None
    finally:
        logger.disabled = disabled
    if isinstance(loaded, trimesh.Scene):
        found = [g for g in loaded.geometry.values() if isinstance(g, trimesh.Trimesh)]
        loaded = trimesh.util.concatenate(found) if found else None
    if not isinstance(loaded, trimesh.Trimesh) or len(loaded.faces) == 0:
        count = len(getattr(loaded, "vertices", ()))
        raise MeshError(
            "mesh.empty",
            f"the mesh has no faces ({count} vertices, 0 faces)",
            "export the mesh with its faces; point clouds and curves cannot be painted",
        )
    return _parsed(loaded, kind)


def _parsed(loaded: trimesh.Trimesh, kind: str) -> Parsed:
    vertices = np.asarray(loaded.vertices, np.float64).copy()
    faces = np.asarray(loaded.faces, np.int64).copy()
    if faces.min() < 0 or faces.max() >= len(vertices):
        bad = faces.max() if faces.max() >= len(vertices) else faces.min()
        raise MeshError(
            "mesh.index", f"a face uses vertex {bad} of {len(vertices)}", "repair the file or export it again"
        )
    normals = np.full((len(faces), 3, 3), np.nan, np.float32)
    if kind == "ply" and "vertex_normals" in loaded._cache.cache:
        normals = np.asarray(loaded.vertex_normals, np.float32)[faces]
    uv = getattr(loaded.visual, "uv", None)
    if uv is not None and len(uv) == len(vertices):
        uvs = np.stack([uv[:, 0], 1.0 - uv[:, 1]], 1).astype(np.float64)  # PLY counts v upward, as OBJ
        face_uvs = faces.copy()
    else:
        uvs, face_uvs = np.zeros((0, 2)), np.full_like(faces, -1)
    return Parsed(
        vertices,
        faces,
        uvs,
        face_uvs,
        normals,
        np.zeros(len(faces), np.int64),
        (Layer("material"),),
        (Part("mesh", (0, len(faces)), 0),),
    )


_ARTICLE = {"ply": "a", "stl": "an"}


def _hint(kind: str) -> str:
    return f"check that it is {_ARTICLE[kind]} {kind.upper()} file, or export it again"


def _sniff(data: bytes, kind: str) -> None:
    """Refuse what trimesh would turn into an empty scene without a word."""
    head = data[:512].lstrip()
    if kind == "ply":
        good = head.startswith(b"ply")
    else:
        count = int.from_bytes(data[80:84], "little") if len(data) >= 84 else 0
        binary = len(data) >= 84 and len(data) >= 84 + 50 * count and (count > 0 or len(data) == 84)
        text = head.startswith(b"solid") and b"\x00" not in data[:512]
        if text and b"facet" not in data:
            raise MeshError(
                "mesh.empty", "the mesh has no faces (0 vertices, 0 faces)", "export the mesh with its faces"
            )
        good = text or binary
        if not good and count > 0 and head.startswith(b"solid") is False and 0 < count < 1 << 26 and len(data) > 84:
            raise MeshError(
                "mesh.truncated",
                f"the STL file promises {count} triangles in {84 + 50 * count} bytes but holds {len(data)} bytes",
                _hint(kind),
            )
    if not good:
        raise MeshError(
            "mesh.garbage",
            f"this is not {_ARTICLE[kind]} {kind.upper()} file (it begins with {data[:8]!r})",
            _hint(kind),
        )
