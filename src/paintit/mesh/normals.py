"""Shading normals for files that bring none, or bad ones."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from paintit.mesh.mesh import Floats, Ints
from paintit.mesh.weld import components, edge_pairs, row_ids

CREASE_DEGREES = 50.0
"""Edges that bend more than this stay sharp: hard-surface parts keep their edges, organic scans look smooth."""


def face_normals(vertices: Floats, faces: Ints) -> tuple[Floats, Floats]:
    """(f, 3) unit normals, zero for degenerate triangles, and (f,) areas in squared file units."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    length = np.linalg.norm(cross, axis=1)
    # Rounding of the coordinates alone makes a cross product of this size; below it the direction is noise.
    farthest = max(
        float(np.abs(corner).max(initial=0.0)) for corner in (a, b, c)
    )  # vertices without a face do not count
    scale = farthest * np.maximum(np.linalg.norm(b - a, axis=1), np.linalg.norm(c - a, axis=1))
    good = length > 8 * np.finfo(np.float64).eps * scale
    return np.where(good[:, None], cross / np.where(good, length, 1.0)[:, None], 0.0), np.where(good, length / 2, 0.0)


def corner_angles(vertices: Floats, faces: Ints) -> Floats:
    """(f, 3) interior angle at each corner in radians."""
    corners = vertices[faces]
    out = np.roll(corners, -1, axis=1) - corners
    back = np.roll(corners, 1, axis=1) - corners
    return np.arctan2(np.linalg.norm(np.cross(out, back), axis=-1), (out * back).sum(-1))


def flat_normals(vertices: Floats, faces: Ints) -> NDArray[np.float32]:
    """(f, 3, 3) the face's own normal at each corner; +Y on degenerate triangles."""
    normal, area = face_normals(vertices, faces)
    normal[area == 0] = (0.0, 1.0, 0.0)
    return np.repeat(normal[:, None], 3, axis=1).astype(np.float32)


def smooth_normals(vertices: Floats, faces: Ints, crease_degrees: float = CREASE_DEGREES) -> NDArray[np.float32]:
    """(f, 3, 3) corner normals, averaged with angle weights over the faces around a vertex.

    Faces are averaged when one reaches the other around the vertex over edges that bend less than ``crease_degrees``.
    Vertices at the same place count as one, so a triangle soup comes out smooth too.
    """
    ids, vertex_count = row_ids(vertices)
    welded = ids[faces]
    normal, area = face_normals(vertices, faces)
    pairs = edge_pairs(welded)
    face = pairs // 3
    gentle = (normal[face[:, 0]] * normal[face[:, 1]]).sum(1) > np.cos(np.radians(crease_degrees))
    start, end = pairs[gentle], (pairs // 3 * 3 + (pairs + 1) % 3)[gentle]
    # The half-edges run in opposite directions: one's start corner sits where the other's end corner sits.
    group, count = components(
        np.concatenate([start[:, 0], end[:, 0]]), np.concatenate([end[:, 1], start[:, 1]]), 3 * len(faces)
    )
    weight = np.where(area[:, None] > 0, corner_angles(vertices, faces), 0.0)
    weighted = (normal[:, None] * weight[..., None]).reshape(-1, 3)
    summed = _unit(np.stack([np.bincount(group, weighted[:, k], count) for k in range(3)], 1))[group]
    around = _unit(np.stack([np.bincount(welded.reshape(-1), weighted[:, k], vertex_count) for k in range(3)], 1))
    missing = ~summed.any(1)
    summed[missing] = around[welded.reshape(-1)][missing]
    summed[~summed.any(1)] = (0.0, 1.0, 0.0)
    return summed.reshape(-1, 3, 3).astype(np.float32)


def _unit(rows: NDArray[Any]) -> Floats:
    length = np.linalg.norm(rows, axis=-1, keepdims=True)
    return np.where(length > 1e-12, rows / np.where(length > 1e-12, length, 1.0), 0.0)
