"""Polygons to triangles: quads over the better diagonal, larger polygons by ear clipping."""

from __future__ import annotations

import numpy as np

from paintit.mesh.mesh import Floats, Ints


def triangulate(points: Floats, start: Ints) -> Ints:
    """Triangles of polygons that are given as runs of corners.

    Args:
        points: (c, 3) position of each polygon corner, polygon after polygon.
        start: (p + 1,) where each polygon begins; at least three corners each.

    Returns:
        (f, 3) corner indices, f = sum(corners - 2), in polygon order, winding kept.
    """
    size = np.diff(start)
    first = np.concatenate([[0], np.cumsum(size - 2)])
    triangles = np.empty((int(first[-1]), 3), np.int64)
    threes = np.flatnonzero(size == 3)
    triangles[first[threes]] = start[threes, None] + np.arange(3)
    fours = np.flatnonzero(size == 4)
    if len(fours):
        corners = start[fours, None] + np.arange(4)
        split = np.where(
            _use_second_diagonal(points[corners])[:, None, None],
            np.array([[0, 1, 3], [1, 2, 3]]),
            np.array([[0, 1, 2], [0, 2, 3]]),
        )
        triangles[first[fours, None] + np.arange(2)] = start[fours, None, None] + split
    for p in np.flatnonzero(size > 4):
        triangles[first[p] : first[p + 1]] = start[p] + _clip_ears(points[start[p] : start[p + 1]])
    return triangles


def _use_second_diagonal(quads: Floats) -> np.ndarray:
    """(q,) bool: diagonal 1-3 instead of 0-2. The one inside a concave quad; otherwise the shorter, ties to 0-2."""
    a, b, c, d = (quads[:, k] for k in range(4))
    normal = np.cross(c - a, d - b)

    def side(p: Floats, q: Floats, r: Floats) -> Floats:
        return (np.cross(q - p, r - p) * normal).sum(-1)

    fits_02 = np.minimum(side(a, b, c), side(a, c, d))
    fits_13 = np.minimum(side(a, b, d), side(b, c, d))
    shorter_13 = ((d - b) ** 2).sum(-1) < ((c - a) ** 2).sum(-1) * (1 - 1e-9)
    return np.where((fits_02 > 0) & (fits_13 > 0), shorter_13, (fits_13 > 0) & (fits_02 <= 0))


def _clip_ears(points: Floats) -> Ints:
    """(n - 2, 3) triangles of one polygon, concave or not, by ear clipping in its best-fitting plane."""
    n = len(points)
    # In the polygon's own scale, so that squares neither overflow nor vanish.
    points = points - points[0]
    points = points / max(float(np.abs(points).max()), 1e-300)
    rolled = np.roll(points, -1, axis=0)
    normal = np.cross(points, rolled).sum(0)  # Newell: twice the vector area
    length = float(np.linalg.norm(normal))
    if length == 0:
        return np.stack([np.zeros(n - 2, np.int64), np.arange(1, n - 1), np.arange(2, n)], 1)
    axis = int(np.abs(normal).argmax())
    keep = [(1, 2), (2, 0), (0, 1)][axis]
    flat = points[:, keep] * (1.0 if normal[axis] > 0 else np.array([-1.0, 1.0]))
    xy = [(float(x), float(y)) for x, y in flat]

    def cross(i: int, j: int, k: int) -> float:
        (ax, ay), (bx, by), (cx, cy) = xy[i], xy[j], xy[k]
        return (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)

    ring = list(range(n))
    out: list[tuple[int, int, int]] = []
    while len(ring) > 3:
        best, best_length = -1, np.inf
        for at in range(len(ring)):
            i, j, k = ring[at - 1], ring[at], ring[(at + 1) % len(ring)]
            if cross(i, j, k) <= 0:
                continue
            if any(
                min(cross(i, j, m), cross(j, k, m), cross(k, i, m)) >= 0
                for m in ring
                if m not in (i, j, k) and xy[m] not in (xy[i], xy[j], xy[k])
            ):
                continue
            diagonal = (xy[i][0] - xy[k][0]) ** 2 + (xy[i][1] - xy[k][1]) ** 2
            if diagonal < best_length * (1 - 1e-9):
                best, best_length = at, diagonal
        at = best if best >= 0 else 0  # no ear left: crossing or flat remainder, any cut will do
        out.append((ring[at - 1], ring[at], ring[(at + 1) % len(ring)]))
        del ring[at]
    return np.array([*out, (ring[0], ring[1], ring[2])], np.int64)
