"""Equal rows share an identity: exact welding of positions, texture coordinates and normals."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from paintit.mesh.mesh import Ints


def row_ids(rows: NDArray[Any]) -> tuple[Ints, int]:
    """An identity for each row such that equal rows, and only those, share it.

    Exact: no tolerance, and -0.0 equals 0.0. Rows are sorted by a hash of their bits, which is several times quicker
    than sorting rows; the result is checked, and ranked column by column in the one case in 10^6 that two hashes meet.

    Args:
        rows: (n, k) numbers without NaN.

    Returns:
        (n,) int64 identities in [0, count), and count.
    """
    if not len(rows):
        return np.zeros(0, np.int64), 0
    hashed, shifted = np.zeros((2, len(rows)), np.uint64)
    for column in rows.T:
        number = np.array(column, np.float64 if column.dtype.kind == "f" else np.int64)
        number += 0  # -0.0 becomes 0.0
        hashed ^= number.view(np.uint64)
        hashed *= np.uint64(0x9E3779B97F4A7C15)
        hashed ^= np.right_shift(hashed, np.uint64(29), out=shifted)
    _, first, ids = np.unique(hashed, return_index=True, return_inverse=True)
    if np.array_equal(rows[first][ids], rows):
        return ids.astype(np.int64), len(first)
    ids = np.zeros(len(rows), np.int64)
    for column in rows.T:
        values, rank = np.unique(column + 0, return_inverse=True)
        _, ids = np.unique(ids * len(values) + rank, return_inverse=True)
    return ids.astype(np.int64), int(ids.max()) + 1


def components(a: Ints, b: Ints, count: int) -> tuple[Ints, int]:
    """Connected components of the graph on ``count`` nodes with the links ``a[i] - b[i]``.

    Returns:
        (count,) int64 component of each node, and the number of components.
    """
    graph = coo_array((np.ones(len(a), np.int8), (a, b)), shape=(count, count))
    found, label = connected_components(graph, directed=False)
    return label.astype(np.int64), int(found)


def edge_pairs(faces: Ints, both_ways: bool = False) -> Ints:
    """Pairs of half-edges on the same edge. Half-edge 3 f + k runs from corner k of face f to its next corner.

    Args:
        faces: (f, 3) vertex identities.
        both_ways: pair any two consecutive half-edges of an edge; otherwise only those that run in opposite directions
            (the k-th forward one with the k-th backward one, so a non-manifold edge still pairs).

    Returns:
        (p, 2) half-edges.
    """
    start = faces.reshape(-1)
    end = np.roll(faces, -1, axis=1).reshape(-1)
    key = np.minimum(start, end) * (int(faces.max()) + 1 if faces.size else 1) + np.maximum(start, end)
    half_edges = np.flatnonzero(start != end)
    if both_ways:
        order = half_edges[np.argsort(key[half_edges], kind="stable")]
        same = key[order[1:]] == key[order[:-1]]
        return np.stack([order[:-1][same], order[1:][same]], 1)
    forward, backward = half_edges[(start < end)[half_edges]], half_edges[(start > end)[half_edges]]
    forward, backward = (h[np.argsort(key[h], kind="stable")] for h in (forward, backward))
    # An edge's k-th half-edge in each direction gets the same (edge, k) tag; equal tags pair up.
    tags = [_occurrence(key[h]) for h in (forward, backward)]
    width = 1 + max(int(t.max(initial=0)) for t in tags)
    a, b = key[forward] * width + tags[0], key[backward] * width + tags[1]
    at = np.minimum(np.searchsorted(a, b), max(len(a) - 1, 0))
    found = a[at] == b if len(a) else np.zeros(len(b), bool)
    return np.stack([forward[at[found]], backward[found]], 1)


def _occurrence(ordered: Ints) -> Ints:
    """0, 1, 2, ... within each run of equal values of a sorted array."""
    index = np.arange(len(ordered))
    first = np.ones(len(ordered), bool)
    first[1:] = ordered[1:] != ordered[:-1]
    return index - np.maximum.accumulate(np.where(first, index, 0))
