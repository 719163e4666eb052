"""What a file reader hands to ``read.py``: the file's content, nothing computed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from paintit.mesh.mesh import Floats, Head, Ints, Layer, Part


@dataclass(frozen=True)
class Parsed:
    """Geometry as the file states it, triangulated, in world space.

    Attributes:
        vertices: (v, 3) float64.
        faces: (f, 3) int64.
        uvs: (t, 2) float64, origin top left.
        face_uvs: (f, 3) int64, -1 at corners without texture coordinates.
        normals: (f, 3, 3) float32, NaN at corners without a normal.
        smooth: whether missing normals are smoothed (below the crease angle) or flat, as glTF demands.
        face_layer: (f,) int64.
        layers, parts, document, corner_vertex: as in ``Mesh`` and ``Source``.
        notes: repairs and oddities.
        head: as in ``Mesh``.
    """

    vertices: Floats
    faces: Ints
    uvs: Floats
    face_uvs: Ints
    normals: NDArray[np.float32]
    face_layer: Ints
    layers: tuple[Layer, ...]
    parts: tuple[Part, ...]
    smooth: bool = True
    document: Any = None
    corner_vertex: Ints | None = None
    notes: tuple[str, ...] = ()
    head: Head | None = None

    @classmethod
    def bare(cls, vertices: Floats, faces: Ints, notes: tuple[str, ...] = ()) -> Parsed:
        """Triangles of a format that knows nothing else: one part, one material, no texture coordinates or normals."""
        return cls(
            vertices,
            faces,
            np.zeros((0, 2)),
            np.full_like(faces, -1),
            np.full((len(faces), 3, 3), np.nan, np.float32),
            np.zeros(len(faces), np.int64),
            (Layer("material"),),
            (Part("mesh", (0, len(faces)), 0),),
            notes=notes,
        )
