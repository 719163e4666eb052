"""From face corners to vertices: which corners may share one, and the gather that carries every attribute along."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from paintit.mesh.weld import row_ids

Ints = NDArray[np.int64]


def group_rows(columns: list[NDArray[Any]]) -> tuple[Ints, Ints]:
    """Group equal rows, bit for bit (with -0 equal to 0), in order of first appearance.

    Args:
        columns: arrays (n, ...) that together make a row.

    Returns:
        first: (groups,) index of the first row of each group, ascending.
        group: (n,) group of each row.
    """
    group, count = row_ids(np.concatenate([_words(column) for column in columns], 1))
    first = np.zeros(count, np.int64)
    first[group[::-1]] = np.arange(len(group))[::-1]  # the last one written is the first of the group
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return first[order], rank[group]


def _words(column: NDArray[Any]) -> NDArray[np.int64]:
    """(n, k) int64 whose rows are equal exactly where the rows of ``column`` are."""
    flat = np.ascontiguousarray(column).reshape(len(column), -1)
    if flat.dtype.kind == "f":
        flat = flat + np.zeros((), flat.dtype)  # -0.0 + 0.0 is +0.0, so both zeros have one bit pattern
        bits = flat.view(np.int32 if flat.dtype.itemsize == 4 else np.int64)
        if flat.dtype.itemsize == 4 and bits.shape[1] % 2 == 0:
            return bits.view(np.int64)
        return bits.astype(np.int64)
    return flat.astype(np.int64)


@dataclass(frozen=True)
class Split:
    """Vertices made from corners.

    Attributes:
        corner: (v,) flat corner (3 * face + k) that each new vertex takes its values from.
        indices: (f, 3) new vertex of each corner.
    """

    corner: Ints
    indices: Ints


def split_corners(columns: list[NDArray[Any]]) -> Split:
    """Vertices unique by ``columns``, each (f, 3, ...) per corner; order of first appearance, so reproducible."""
    faces = len(columns[0])
    first, group = group_rows([c.reshape(faces * 3, *c.shape[2:]) for c in columns])
    return Split(first, group.reshape(faces, 3))


def agree(corner_vertex: Ints, values: NDArray[Any], vertices: int) -> NDArray[Any] | None:
    """Per-vertex form of per-corner ``values`` (f, 3, ...), zeros where unused; None where corners differ."""
    flat = values.reshape(-1, *values.shape[2:])
    out = np.zeros((vertices, *flat.shape[1:]), values.dtype)
    out[corner_vertex.reshape(-1)] = flat
    return out if np.array_equal(out[corner_vertex.reshape(-1)], flat) else None
