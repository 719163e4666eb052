"""Both sides of a UV seam brought to one value: the smallest smooth correction, fading into the islands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from scipy.sparse import csr_array, diags_array

from paintit.color import decode_srgb, encode_srgb
from paintit.mesh.mesh import Floats, Ints, Mesh
from paintit.mesh.normals import face_normals
from paintit.mesh.quality import islands
from paintit.mesh.seams import EdgePoints, SurfaceEdges, surface_edges
from paintit.mesh.uv import TexelMap, fill_gutters, nearest_covered, rasterize_uv

#: A correction that is the same all along a seam falls to 1/e at this distance from it, as a share of the mesh's
#: extent; one that changes along the seam fades sooner, within the length on which it changes.
REACH = 0.02
#: The correction is zero from this many times the reach on.
BAND = 3.0
#: How much disagreement at a point of a seam costs, against a correction that changes by as much between two texels.
PULL = 32.0
#: Points of a seam at which the sides are compared, for each texel of its length.
POINTS_PER_TEXEL = 2.0
#: The correction is solved until the residual is this share of the mismatch; a hundredth of it changes no figure.
TOLERANCE = 1e-3
_MAX_ITERATIONS = 2000
#: Maps of this size or less are solved without a coarser one.
_COARSEST = 128


def close_seams(
    mesh: Mesh, values: NDArray[np.float32], texels: TexelMap
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Packed maps whose two sides agree along every seam, as far as their texels can.

    Sought is the correction c of the texels near seams that minimises

        PULL * sum over points of seams (difference of the sides' bilinear lookups)^2
        + sum over neighbouring texels of an island (c_i - c_j)^2 + sum over texels (area_i / reach^2) c_i^2

    The second term keeps the painted gradients, so detail is moved but not blurred; the third lets the
    correction fade. Both are the same on the surface whatever the texel density (the Dirichlet energy is conformally
    invariant, areas are true areas), so the sides share the change fairly. Texels outside the islands that a lookup on
    the seam reads are unknowns like the rest. Base colour is corrected in sRGB-coded values, where equal steps look
    about equal. Normals are left alone here, see ``docs/design/seams.md``.

    Args:
        mesh: with texture coordinates.
        values: (layers, size, size, c) packed maps with filled gutters, see :class:`paintit.texture.maps.TextureMaps`.
        texels: which face each texel belongs to, at that size.

    Returns:
        The maps, and (layers, size, size) which texels now hold values of their own: the islands' and those beside
        seams. Gutters farther out are to be filled again. Deterministic, whatever the thread count.
    """
    edges = surface_edges(mesh, only_seams=True)
    if not len(edges):
        return values, texels.covered
    channels = values[..., :5].astype(np.float64)
    channels[..., :3] = _coded(channels[..., :3])
    correction, own = _correction(mesh, edges, channels, texels)
    corrected = np.clip(channels + correction, channels[own].min(0), channels[own].max(0))
    corrected[..., :3] = _linear(corrected[..., :3])
    changed = (correction != 0).any(-1)
    out = values.copy()
    out[changed, :5] = corrected[changed]
    return out, own


def _correction(
    mesh: Mesh, edges: SurfaceEdges, channels: Floats, texels: TexelMap
) -> tuple[Floats, NDArray[np.bool_]]:
    """What to add to (layers, size, size, c) channels, and which texels hold values of their own then.

    The solution at half the size is where the solver starts: it only has fine detail left to find.
    """
    size = channels.shape[1]
    differences = seam_differences(edges, mesh.face_layer[edges.faces[:, 0]], len(channels), size)
    touched = np.zeros(texels.face.shape, bool)
    touched.reshape(-1)[differences.indices] = True
    own = texels.covered | touched
    start = np.zeros_like(channels)
    if size % 2 == 0 and size > _COARSEST:
        halved = channels.reshape(len(channels), size // 2, 2, size // 2, 2, -1).mean((2, 4))
        coarse, known = _correction(mesh, edges, halved, rasterize_uv(mesh, size // 2))
        start = _doubled(fill_gutters(coarse.astype(np.float32), known))
    system = _system(mesh, texels, touched)
    reads = differences[:, system.texels]
    matrix = csr_array(PULL * (reads.T @ reads) + system.smooth)
    flat = (-1, channels.shape[-1])
    right = -PULL * (reads.T @ (reads @ channels.reshape(flat)[system.texels]))
    correction = np.zeros_like(channels)
    correction.reshape(flat)[system.texels] = conjugate_gradients(matrix, right, start.reshape(flat)[system.texels])
    return correction, own


def seam_differences(edges: SurfaceEdges, layer: Ints, layers: int, size: int) -> csr_array:
    """(m, layers size size) the matrix that takes texels to the differences of the two sides at points on the edges.

    Args:
        edges: n edges.
        layer: (n,) the layer of each.
        layers, size: of the maps.
    """
    span = np.linalg.norm(edges.uv[:, :, 1] - edges.uv[:, :, 0], axis=-1).max(1) * size
    points = EdgePoints.spread(np.ceil(POINTS_PER_TEXEL * span).astype(np.int64).clip(1))
    uv = points.along(edges.uv)
    index, weight = zip(*(taps(uv[:, side], size) for side in (0, 1)), strict=True)
    columns = np.concatenate(index, 1) + layer[points.edge, None] * size * size
    rows = np.repeat(np.arange(len(uv)), columns.shape[1])
    signed = np.concatenate([weight[0], -weight[1]], 1)
    matrix = csr_array((signed.reshape(-1), (rows, columns.reshape(-1))), shape=(len(uv), layers * size * size))
    matrix.eliminate_zeros()
    return matrix


def taps(uv: Floats, size: int) -> tuple[Ints, Floats]:
    """The four texels of a square repeating map that a bilinear lookup at ``uv`` (m, 2) reads, row * size + column,
    and their weights, each (m, 4)."""
    at = uv * size - 0.5
    first = np.floor(at).astype(np.int64)
    share = at - first
    x, y = ((first[:, None, k] + [0, 1]) % size for k in (0, 1))
    wx, wy = (np.stack([1 - share[:, k], share[:, k]], 1) for k in (0, 1))
    index = (y[:, :, None] * size + x[:, None, :]).reshape(-1, 4)
    return index, (wy[:, :, None] * wx[:, None, :]).reshape(-1, 4)


@dataclass(frozen=True)
class _System:
    """The unknowns and what holds them: ``texels`` (n,) flat indices, ``smooth`` (n, n) symmetric."""

    texels: Ints
    smooth: csr_array


def _system(mesh: Mesh, texels: TexelMap, touched: NDArray[np.bool_]) -> _System:
    """Texels within the band around ``touched`` ones, joined to their neighbours in the island and to zero."""
    covered, size = texels.covered, texels.face.shape[1]
    owner = texels.face.reshape(-1)[nearest_covered(covered)]  # of texels outside: the nearest island's
    island = np.where(covered | touched, islands(mesh)[owner], -1)
    area = _texel_areas(mesh, size)
    reach = REACH * mesh.extent
    near = touched.copy()
    for layer in np.flatnonzero(touched.any((1, 2))):
        side = np.sqrt(np.median(area[texels.face[layer][covered[layer]]])) if covered[layer].any() else reach
        distance = np.asarray(distance_transform_edt(~touched[layer]))
        near[layer] |= covered[layer] & (distance <= BAND * reach / max(side, 1e-300))
    unknown = np.flatnonzero(near)
    number = np.full(near.size, -1)
    number[unknown] = np.arange(len(unknown))
    number = number.reshape(near.shape)

    diagonal = area[owner.reshape(-1)[unknown]] / reach**2
    rows, columns = [], []
    for axis in (1, 2):
        for step in (-1, 1):
            same = (island == np.roll(island, step, axis)).reshape(-1)[unknown]
            other = np.roll(number, step, axis).reshape(-1)[unknown]
            diagonal += same
            joined = np.flatnonzero(same & (other >= 0))
            rows.append(joined)
            columns.append(other[joined])
    row, column = np.concatenate(rows), np.concatenate(columns)
    links = csr_array((np.full(len(row), -1.0), (row, column)), shape=(len(unknown), len(unknown)))
    return _System(unknown, csr_array(links + diags_array(diagonal)))


def _texel_areas(mesh: Mesh, size: int) -> Floats:
    """(f,) area on the surface of one texel of each face."""
    d1, d2 = (mesh.corner_uvs[:, k] - mesh.corner_uvs[:, 0] for k in (1, 2))
    flat = np.abs(d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0]) / 2
    return face_normals(mesh.vertices, mesh.faces)[1] / np.maximum(flat * size * size, 1e-30)


def conjugate_gradients(matrix: csr_array, right: Floats, start: Floats) -> Floats:
    """Solve matrix @ x = right (n, c) for all columns at once from ``start``, preconditioned by the diagonal.

    One pass over the matrix serves every column, and sums do not depend on the number of threads, neither of which
    holds for SciPy's solver.
    """
    inverse = 1.0 / matrix.diagonal()[:, None]
    x, residual = start.copy(), right - matrix @ start
    goal = TOLERANCE * np.sqrt(_dot(right, inverse * right))
    z = inverse * residual
    direction, energy = z.copy(), _dot(residual, z)
    for _ in range(_MAX_ITERATIONS):
        if (np.sqrt(energy) <= goal).all():
            break
        image = matrix @ direction
        step = energy / np.maximum(_dot(direction, image), 1e-300)
        x += step * direction
        residual -= step * image
        z = inverse * residual
        before, energy = energy, _dot(residual, z)
        direction = z + energy / np.maximum(before, 1e-300) * direction
    return x


def _dot(a: Floats, b: Floats) -> Floats:
    """(c,) products of the columns of (n, c); summed in one order on any number of threads, which BLAS is not."""
    return np.einsum("nc,nc->c", a, b)


def _doubled(maps: NDArray[np.float32]) -> Floats:
    """(n, s, s, c) at twice the size, bilinear."""
    channels_first = torch.from_numpy(maps).movedim(-1, 1)
    return F.interpolate(channels_first, scale_factor=2, mode="bilinear").movedim(1, -1).double().numpy()


def _coded(linear: Floats) -> Floats:
    return encode_srgb(torch.from_numpy(linear)).numpy()


def _linear(coded: Floats) -> Floats:
    return decode_srgb(torch.from_numpy(coded)).numpy()
