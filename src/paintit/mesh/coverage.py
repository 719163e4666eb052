"""Which face each texel belongs to, and texels outside every face filled from the nearest one inside."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from paintit.mesh.mesh import Floats, Ints, Mesh, remembered

_CHUNK = 1 << 21
"""Texels handled at once; bounds the memory, not the result."""
_EDGE = 1e-9
"""A texel centre this close to an edge (in barycentric units) counts as inside for coverage, as outside for overlap."""


@dataclass(frozen=True)
class TexelMap:
    """The mesh seen from texture space. Texel (row, column) has its centre at uv (column + .5, row + .5) / size.

    Attributes:
        face: (layers, size, size) int32 face whose texture coordinates contain the centre, after repeat wrapping;
            the first such face of the file; -1 outside all.
        barycentric: (layers, size, size, 3) float32 of that centre in that face; zero outside.
        count: (layers, size, size) int32 number of faces that contain the centre.
    """

    face: NDArray[np.int32]
    barycentric: NDArray[np.float32]
    count: NDArray[np.int32]

    @property
    def covered(self) -> NDArray[np.bool_]:
        """(layers, size, size)."""
        return self.face >= 0


@dataclass(frozen=True)
class Fragments:
    """Texel centres inside faces, one entry for each (face, texel) pair.

    Attributes:
        face: (n,) index into the faces given.
        texel: (n,) row * size + column, wrapped.
        barycentric: (n, 3).
        inner: (n,) bool, False within rounding of an edge.
    """

    face: Ints
    texel: Ints
    barycentric: Floats
    inner: NDArray[np.bool_]


def fragments(corner_uvs: Floats, size: int) -> Iterator[Fragments]:
    """Scan-convert triangles in texture space, in chunks.

    Args:
        corner_uvs: (f, 3, 2) finite texture coordinates, any range; they repeat.
        size: texels along each side.
    """
    # Move every triangle to the first tile: large offsets would cost precision.
    corners = (corner_uvs - np.floor(corner_uvs.min(axis=1, keepdims=True))) * size if len(corner_uvs) else corner_uvs
    d1, d2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0]
    low, high = corners.min(1), corners.max(1)
    first = np.ceil(low[:, 1] - 0.5 - 1e-6).astype(np.int64)
    rows = np.floor(high[:, 1] - 0.5 + 1e-6).astype(np.int64) - first + 1
    rows = np.where(area != 0, np.maximum(rows, 0), 0)
    for faces in _batches(rows):
        face = np.repeat(faces, rows[faces])
        row = first[face] + _ramp(rows[faces])
        left, width = _spans(corners[face], row + 0.5)
        for spans in _batches(width):
            at = np.repeat(spans, width[spans])
            column = left[at] + _ramp(width[spans])
            f, y = face[at], row[at]
            p = np.stack([column + 0.5, y + 0.5], 1) - corners[f, 0]
            b = (p[:, 0] * d2[f, 1] - p[:, 1] * d2[f, 0]) / area[f]
            c = (d1[f, 0] * p[:, 1] - d1[f, 1] * p[:, 0]) / area[f]
            barycentric = np.stack([1.0 - b - c, b, c], 1)
            least = barycentric.min(1)
            inside = least >= -_EDGE
            yield Fragments(
                f[inside], ((y % size) * size + column % size)[inside], barycentric[inside], least[inside] > _EDGE
            )


def _spans(corners: Floats, y: Floats) -> tuple[Ints, Ints]:
    """First column and number of columns whose centres may lie in each triangle on the line ``y``."""
    low, high = np.full(len(y), np.inf), np.full(len(y), -np.inf)
    for k in range(3):
        a, b = corners[:, k], corners[:, (k + 1) % 3]
        rise = b[:, 1] - a[:, 1]
        with np.errstate(divide="ignore", invalid="ignore"):
            t = np.where(rise != 0, (y - a[:, 1]) / np.where(rise != 0, rise, 1.0), np.nan)
        hit = (t >= -1e-6) & (t <= 1 + 1e-6)
        x = a[:, 0] + t * (b[:, 0] - a[:, 0])
        low, high = np.where(hit, np.minimum(low, x), low), np.where(hit, np.maximum(high, x), high)
        level = (rise == 0) & (np.abs(y - a[:, 1]) <= 1e-6)
        low = np.where(level, np.minimum(low, np.minimum(a[:, 0], b[:, 0])), low)
        high = np.where(level, np.maximum(high, np.maximum(a[:, 0], b[:, 0])), high)
    low, high = np.where(low <= high, low, 1.0), np.where(low <= high, high, 0.0)
    left = np.ceil(low - 0.5 - 1e-5).astype(np.int64)
    return left, np.maximum(np.floor(high - 0.5 + 1e-5).astype(np.int64) - left + 1, 0)


def _batches(sizes: Ints) -> Iterator[Ints]:
    """Runs of items with a size above zero, each run about ``_CHUNK`` in total."""
    items = np.flatnonzero(sizes)
    total = np.cumsum(sizes[items])
    at = 0
    while at < len(items):
        done = total[at - 1] if at else 0
        end = max(int(np.searchsorted(total, done + _CHUNK, side="right")), at + 1)
        yield items[at:end]
        at = end


def _ramp(sizes: Ints) -> Ints:
    """0 .. size - 1 for each size, one after another."""
    total = np.cumsum(sizes)
    return np.arange(int(total[-1]) if len(total) else 0) - np.repeat(total - sizes, sizes)


@remembered
def rasterize_uv(mesh: Mesh, size: int) -> TexelMap:
    """Map every texel whose centre lies in a face's texture triangle to that face.

    Args:
        mesh: with texture coordinates on every face.
        size: texels along each side of each layer. Layers that are not painted own no texels.
    """
    shape = (len(mesh.layers), size, size)
    face = np.full(shape, -1, np.int32).reshape(len(mesh.layers), -1)
    barycentric = np.zeros((len(mesh.layers), size * size, 3), np.float32)
    count = np.zeros((len(mesh.layers), size * size), np.int32)
    uvs = mesh.corner_uvs
    for layer in (k for k, found in enumerate(mesh.layers) if found.painted):
        members = np.flatnonzero((mesh.face_layer == layer) & (mesh.face_uvs >= 0).all(1))
        for part in fragments(uvs[members], size):
            texel, first = np.unique(part.texel, return_index=True)  # fragments come in face order within a chunk
            new = face[layer, texel] < 0
            texel, first = texel[new], first[new]
            face[layer, texel] = members[part.face[first]]
            barycentric[layer, texel] = part.barycentric[first]
            count[layer] += np.bincount(part.texel[part.inner], minlength=size * size).astype(np.int32)
    count = np.maximum(count, face >= 0)
    return TexelMap(face.reshape(shape), barycentric.reshape(*shape, 3), count.reshape(shape))


def nearest_covered(covered: NDArray[np.bool_]) -> Ints:
    """For each texel the nearest covered one of its layer, itself where covered; textures repeat, so distance wraps.

    Args:
        covered: (layers, h, w).

    Returns:
        (layers, h, w) indices into the flattened (layers h w) texels; itself in a layer without any covered texel.
    """
    layers, h, w = covered.shape
    nearest = np.arange(covered.size).reshape(covered.shape)
    rows, columns = np.arange(-(h // 2), h + h // 2) % h, np.arange(-(w // 2), w + w // 2) % w
    for layer in range(layers):
        mask = covered[layer]
        if mask.all() or not mask.any():
            continue
        indices = np.asarray(
            distance_transform_edt(~mask[rows][:, columns], return_distances=False, return_indices=True)
        )
        y, x = (indices[k][h // 2 : h // 2 + h, w // 2 : w // 2 + w] for k in range(2))
        nearest[layer] = (layer * h + rows[y]) * w + columns[x]
    return nearest


def fill_gutters(image: NDArray[np.float32], covered: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Give every texel outside the coverage the value of the nearest covered one, see :func:`nearest_covered`.

    Args:
        image: (layers, h, w, c).
        covered: (layers, h, w).

    Returns:
        (layers, h, w, c); a layer without any covered texel comes back as it is.
    """
    return image.reshape(-1, image.shape[-1])[nearest_covered(covered)]
