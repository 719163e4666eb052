"""MikkTSpace tangents (Mikkelsen, "Simulation of wrinkled surfaces revisited", 2008), vectorised.

The published algorithm walks triangle by triangle; the groups it finds are connected components of corners, so they are
found here with a graph instead. Corners with equal position, normal and texture coordinates are one vertex; two
triangles that share an edge between such vertices, and whose texture is not mirrored with respect to each other, share
the tangent at both ends of the edge. A tangent is the mean of the triangles' directions of increasing u, each projected
onto the normal's plane and weighted by the corner's angle there.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from paintit.mesh.mesh import Floats, Ints
from paintit.mesh.weld import components, edge_pairs, row_ids


def mikktspace(
    vertices: Floats, faces: Ints, uvs: Floats, face_uvs: Ints, normals: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Tangents of every face corner.

    Args:
        vertices: (v, 3).
        faces: (f, 3).
        uvs: (t, 2), origin top left.
        face_uvs: (f, 3).
        normals: (f, 3, 3) unit corner normals.

    Returns:
        (f, 3, 4) float32: unit tangent perpendicular to the corner's normal and w = +-1, where
        w * cross(normal, tangent) points to the top of the image (the glTF convention). Where the texture gives no
        direction, any perpendicular.
    """
    position_id, _ = row_ids(vertices)
    uv_id, _ = row_ids(uvs)
    corner_position = position_id[faces]
    same = np.concatenate([corner_position[..., None], uv_id[face_uvs][..., None], normals], 2)
    vertex = row_ids(same.reshape(-1, 5))[0].reshape(-1, 3)
    degenerate = (corner_position == np.roll(corner_position, 1, axis=1)).any(1)

    direction, mirrored, undirected = _triangle_directions(vertices[faces], uvs[face_uvs])
    pairs = edge_pairs(vertex)
    pairs = pairs[~degenerate[pairs // 3].any(1)]
    mirrored = _adopt_orientation(mirrored, undirected & ~degenerate, pairs // 3)
    pairs = pairs[mirrored[pairs[:, 0] // 3] == mirrored[pairs[:, 1] // 3]]
    start, end = pairs, pairs // 3 * 3 + (pairs + 1) % 3
    group, count = components(
        np.concatenate([start[:, 0], end[:, 0]]), np.concatenate([end[:, 1], start[:, 1]]), vertex.size
    )
    summed = _group_sums(vertices[faces], normals.astype(np.float64), direction, degenerate | undirected, group, count)
    tangent = summed[group]
    sign = np.where(np.repeat(mirrored, 3), -1.0, 1.0)
    tangent, sign = _fill(tangent, sign, vertex.reshape(-1), np.repeat(degenerate, 3), normals.reshape(-1, 3))
    return np.concatenate([tangent, sign[:, None]], 1).astype(np.float32).reshape(-1, 3, 4)


def _triangle_directions(corners: Floats, uv: Floats) -> tuple[Floats, NDArray[np.bool_], NDArray[np.bool_]]:
    """Per triangle: direction of increasing u (f, 3), whether its texture is mirrored, whether it has no uv area."""
    d1, d2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    t1, t2 = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    t1, t2 = t1 * (1.0, -1.0), t2 * (1.0, -1.0)  # v upward, as MikkTSpace's signs suppose
    area = t1[:, 0] * t2[:, 1] - t1[:, 1] * t2[:, 0]
    undirected = np.abs(area) <= np.finfo(np.float32).tiny
    u = t2[:, 1:] * d1 - t1[:, 1:] * d2
    return _unit(u * np.where(area < 0, -1.0, 1.0)[:, None]), area <= 0, undirected


def _adopt_orientation(mirrored: NDArray[np.bool_], free: NDArray[np.bool_], face_pairs: Ints) -> NDArray[np.bool_]:
    """Triangles without uv area join whichever neighbour reaches them first, so they do not cut a group in two."""
    mirrored, free = mirrored.copy(), free.copy()
    touching = face_pairs[free[face_pairs].any(1)]
    while len(touching):
        a, b = touching.T
        give = np.concatenate([np.stack([a, b], 1)[~free[a] & free[b]], np.stack([b, a], 1)[free[a] & ~free[b]]])
        if not len(give):
            break
        give = give[np.lexsort((give[:, 0], give[:, 1]))]
        first = np.ones(len(give), bool)
        first[1:] = give[1:, 1] != give[:-1, 1]
        giver, taker = give[first].T
        mirrored[taker], free[taker] = mirrored[giver], False
        touching = touching[free[touching].any(1)]
    return mirrored


def _group_sums(
    corners: Floats, normals: Floats, direction: Floats, left_out: NDArray[np.bool_], group: Ints, count: int
) -> Floats:
    """(count, 3) unit mean tangent of each group, zero where nothing contributes."""
    summed = np.zeros((count, 3))
    for k in range(3):
        n = normals[:, k]

        def flat(v: Floats, n: Floats = n) -> Floats:
            return _unit(v - n * (n * v).sum(1, keepdims=True))

        to_previous = flat(corners[:, k - 1] - corners[:, k])
        to_next = flat(corners[:, (k + 1) % 3] - corners[:, k])
        angle = np.arccos(np.clip((to_previous * to_next).sum(1), -1.0, 1.0))
        weighted = flat(direction) * np.where(left_out, 0.0, angle)[:, None]
        for axis in range(3):
            summed[:, axis] += np.bincount(group[k::3], weighted[:, axis], count)
    return _unit(summed)


def _fill(
    tangent: Floats, sign: Floats, vertex: Ints, degenerate: NDArray[np.bool_], normals: NDArray[np.float32]
) -> tuple[Floats, Floats]:
    """Corners without a tangent borrow one from a corner of the same vertex; failing that, any perpendicular."""
    missing = ~tangent.any(1) | degenerate
    donors = np.flatnonzero(~missing)
    if missing.any() and len(donors):
        donor_of = np.full(int(vertex.max()) + 1, -1, np.int64)
        donor_of[vertex[donors[::-1]]] = donors[::-1]  # the first one wins
        takers = np.flatnonzero(missing & (donor_of[vertex] >= 0))
        tangent, sign = tangent.copy(), sign.copy()
        tangent[takers], sign[takers] = tangent[donor_of[vertex[takers]]], sign[donor_of[vertex[takers]]]
        missing[takers] = False
    if missing.any():
        n = normals[missing].astype(np.float64)
        axis = np.eye(3)[np.abs(n).argmin(1)]
        tangent = tangent.copy()
        tangent[missing] = _unit(axis - n * (n * axis).sum(1, keepdims=True))
        sign = np.where(missing, 1.0, sign)
    return tangent, sign


def _unit(rows: Floats) -> Floats:
    length = np.sqrt((rows * rows).sum(-1, keepdims=True))
    good = length > np.finfo(np.float32).tiny
    return np.where(good, rows / np.where(good, length, 1.0), 0.0)
