"""Polygons to triangles: quads over the better diagonal, larger polygons by ear clipping."""

from __future__ import annotations

import math

import numpy as np

from paintit.errors import MeshError
from paintit.mesh.mesh import Floats, Ints

_MOST_WORK = 4e8
"""Sum of the squared numbers of corners of all polygons above four: at most a minute or so."""
_FEW = 48
"""Corners from which on arrays are quicker than a loop."""
_LOOKS = 8
"""How often a polygon without an ear is looked at anew."""


def triangulate(points: Floats, start: Ints) -> Ints:
    """Triangles of polygons that are given as runs of corners.

    Args:
        points: (c, 3) position of each polygon corner, polygon after polygon.
        start: (p + 1,) where each polygon begins; at least three corners each.

    Returns:
        (f, 3) corner indices, f = sum(corners - 2), in polygon order, winding kept. Polygons too large for their
        areas to be numbers are cut anyhow: a mesh of that size is refused later.

    Raises:
        MeshError: the polygons have so many corners that cutting them would take minutes.
    """
    size = np.diff(start)
    if (size[size > 4].astype(np.float64) ** 2).sum() > _MOST_WORK:
        raise MeshError(
            "mesh.polygon",
            f"its polygons have too many corners to be cut into triangles (the largest {int(size.max())})",
            "triangulate the mesh in a 3D program",
        )
    with np.errstate(over="ignore", invalid="ignore"):
        return _triangulate(points, start)


def _triangulate(points: Floats, start: Ints) -> Ints:
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
    return np.array(_ears(flat), np.int64)


def _ears(flat: Floats) -> list[tuple[int, int, int]]:
    """The n - 2 ears of a polygon (n, 2) that runs counterclockwise, those with the shortest diagonals first.

    Only corners that bend inward can keep a corner from being an ear, and a cut changes nothing but its two neighbours
    (Eberly, Triangulation by Ear Clipping), so what is known of the rest is kept. Where corners coincide that may fail:
    a polygon with no ear left is looked at anew, a few times; what then remains crosses itself or is flat, and any cut
    will do.
    """
    xy = [(float(x), float(y)) for x, y in flat]

    def cross(i: int, j: int, k: int) -> float:
        (ax, ay), (bx, by), (cx, cy) = xy[i], xy[j], xy[k]
        return (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)

    def bends_inward(at: int) -> bool:
        return cross(ring[at - 1], ring[at], ring[(at + 1) % len(ring)]) <= 0

    def blocked(i: int, j: int, k: int) -> bool:
        if len(inward) > _FEW:
            return _any_inside(flat, [i, j, k], inward)
        return any(
            min(cross(i, j, m), cross(j, k, m), cross(k, i, m)) >= 0
            for m in inward
            if xy[m] not in (xy[i], xy[j], xy[k])
        )

    def diagonal(at: int) -> float:
        """Squared length of the cut; infinite where there is no ear."""
        i, j, k = ring[at - 1], ring[at], ring[(at + 1) % len(ring)]
        squared = (xy[i][0] - xy[k][0]) ** 2 + (xy[i][1] - xy[k][1]) ** 2
        return math.inf if bends_inward(at) or blocked(i, j, k) or not squared < math.inf else squared

    ring = list(range(len(xy)))
    inward = [at for at in ring if bends_inward(at)]
    length = [diagonal(at) for at in ring]
    looks = 0
    out: list[tuple[int, int, int]] = []
    while len(ring) > 3:
        shortest = min(length)
        if shortest == math.inf and looks < _LOOKS:
            looks += 1
            inward = [ring[at] for at in range(len(ring)) if bends_inward(at)]
            length = [diagonal(at) for at in range(len(ring))]
            shortest = min(length)
        at = next(at for at, found in enumerate(length) if found <= shortest * (1 + 1e-9))
        out.append((ring[at - 1], ring[at], ring[(at + 1) % len(ring)]))
        if ring[at] in inward:
            inward.remove(ring[at])
        del ring[at], length[at]
        for neighbour in (at - 1, at % len(ring)):
            if ring[neighbour] in inward and not bends_inward(neighbour):
                inward.remove(ring[neighbour])
        for neighbour in (at - 1, at % len(ring)):
            length[neighbour] = diagonal(neighbour)
    return [*out, (ring[0], ring[1], ring[2])]


def _any_inside(flat: Floats, triangle: list[int], others: list[int]) -> bool:
    """Whether any of the corners ``others`` lies in or on a triangle without coinciding with one of its corners."""
    p, (a, b, c) = flat[others], flat[triangle]
    sides = [(t[0] - s[0]) * (p[:, 1] - s[1]) - (t[1] - s[1]) * (p[:, 0] - s[0]) for s, t in ((a, b), (b, c), (c, a))]
    inside = np.minimum(np.minimum(sides[0], sides[1]), sides[2]) >= 0
    return bool((inside & (p[:, None] != flat[triangle]).any(2).all(1)).any())
