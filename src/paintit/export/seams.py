"""The ``seam`` figure: how much more the base colour differs across UV seams than across other edges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from paintit.color import lab
from paintit.export.gltf_source import bilinear
from paintit.mesh.mesh import Floats, Ints, Mesh
from paintit.mesh.quality import islands
from paintit.mesh.seams import EdgePoints, SurfaceEdges, surface_edges
from paintit.mesh.uv import rasterize_uv
from paintit.texture.maps import TextureMaps

#: How far inside each face the sides are read, in texels of the coarser side: together they are as far apart as two
#: neighbouring texels.
DISTANCE = 0.5
#: Interior edges that each seam edge is held against.
PARTNERS = 4
#: Edges whose lengths differ by less than this share are equally long.
EQUAL_LENGTH = 0.1
#: Half of one 8-bit step of grey, in CIELAB units: smaller differences cannot be told from the file's rounding.
FLOOR = 0.2
#: Most points on one edge.
_MAX_POINTS = 64
_GOLDEN = (5**0.5 - 1) / 2


@dataclass(frozen=True)
class SeamFigure:
    """How visible UV seams are in the base colour. Differences are distances in CIELAB (CIE 1976; about 2.3 can just
    be seen).

    Attributes:
        ratio: ``seams`` over ``interior``, both raised to at least :data:`FLOOR`: 1 where a seam shows no more than
            any other edge.
        seams: mean difference across all seam edges.
        interior: mean difference across equally long interior edges, the two points equally far apart.
        edges: number of seam edges.
        worst: mean difference across the worst of them.
        worst_at: (x, y, z) its middle, in the file's units.
    """

    ratio: float
    seams: float
    interior: float
    edges: int
    worst: float
    worst_at: tuple[float, float, float]


def seam_figure(mesh: Mesh, maps: TextureMaps, distance: float = DISTANCE) -> SeamFigure | None:
    """The figure of finished maps (gutters filled), or None where there is no seam or no other edge to compare with.

    Deterministic. ``docs/design/seams.md`` says why it is measured so.
    """
    edges = surface_edges(mesh)
    seams, interior = edges[edges.seam], edges[edges.interior]
    partners = _partners(mesh, seams, interior)
    seams = seams[partners[:, 0] >= 0]
    partners = partners[partners[:, 0] >= 0]
    if not len(seams):
        return None
    reader = _Reader(mesh, maps)
    away = distance * reader.texel(seams).max(1)
    counts = np.ceil(seams.length / (away / distance)).clip(1, _MAX_POINTS).astype(np.int64)
    across = reader.differences(seams, away, counts)
    along = [reader.differences(interior[partners[:, k]], away, counts) for k in range(PARTNERS)]
    weight = seams.length * np.isfinite(across)
    weights = np.concatenate([seams.length * np.isfinite(each) for each in along])
    if not weight.any() or not weights.any():
        return None
    seam_mean = float((weight * np.nan_to_num(across)).sum() / weight.sum())
    interior_mean = float((weights * np.nan_to_num(np.concatenate(along))).sum() / weights.sum())
    worst = int(np.nan_to_num(across).argmax())
    x, y, z = seams.points[worst].mean(0).tolist()
    return SeamFigure(
        max(seam_mean, FLOOR) / max(interior_mean, FLOOR), seam_mean, interior_mean, len(seams),
        float(across[worst]), (x, y, z),
    )  # fmt: skip


def _partners(mesh: Mesh, seams: SurfaceEdges, interior: SurfaceEdges) -> Ints:
    """(n, PARTNERS) interior edges of the same layer about as long as each seam edge; -1 where the layer has none.

    Drawn evenly from all that are equally long, or from the nearest few in length where fewer are.
    """
    found = np.full((len(seams), PARTNERS), -1)
    layer, layer_inside = (mesh.face_layer[edges.faces[:, 0]] for edges in (seams, interior))
    for k in np.unique(layer):
        mine, theirs = np.flatnonzero(layer == k), np.flatnonzero(layer_inside == k)
        if not len(theirs):
            continue
        theirs = theirs[np.argsort(interior.length[theirs], kind="stable")]
        lengths, wanted = interior.length[theirs], seams.length[mine]
        low = np.searchsorted(lengths, wanted * (1 - EQUAL_LENGTH))
        high = np.searchsorted(lengths, wanted * (1 + EQUAL_LENGTH))
        few = high - low < PARTNERS
        low[few] = (np.searchsorted(lengths, wanted[few]) - PARTNERS // 2).clip(0, max(len(lengths) - PARTNERS, 0))
        high[few] = np.minimum(low[few] + PARTNERS, len(lengths))
        turn = np.arange(found[mine].size).reshape(len(mine), PARTNERS) * _GOLDEN % 1
        found[mine] = theirs[low[:, None] + (turn * (high - low)[:, None]).astype(np.int64)]
    return found


class _Reader:
    """Base colours beside edges, as a viewer's bilinear lookup shows them."""

    def __init__(self, mesh: Mesh, maps: TextureMaps) -> None:
        self._mesh, self._size = mesh, maps.size[0]
        self._colors = maps.base_color.detach().cpu().to(torch.float32).numpy()
        self._island = islands(mesh)
        self._face = rasterize_uv(mesh, self._size).face

    def texel(self, edges: SurfaceEdges) -> Floats:
        """(n, 2) what one texel of each side measures on the surface, at right angles to the edge."""
        return 1.0 / (np.linalg.norm(edges.inward, axis=-1) * self._size)

    def differences(self, edges: SurfaceEdges, away: Floats, counts: Ints) -> Floats:
        """(n,) mean difference of the sides at ``counts`` (n,) points ``away`` (n,) from each edge; NaN without any.

        A point that is no longer over its own side's island does not count.
        """
        points = EdgePoints.spread(counts)
        inside = points.along(edges.uv) + (away[:, None, None] * edges.inward)[points.edge]
        layer = self._mesh.face_layer[edges.faces[points.edge, 0]]
        usable, sides = np.ones(len(layer), bool), []
        for side in (0, 1):
            column, row = (np.floor(inside[:, side] * self._size).astype(np.int64) % self._size).T
            face = self._face[layer, row, column]
            usable &= (face >= 0) & (self._island[face] == self._island[edges.faces[points.edge, side]])
            sides.append(self._lab(layer, inside[:, side]))
        difference = np.linalg.norm(sides[0] - sides[1], axis=-1)
        total = np.bincount(points.edge[usable], difference[usable], len(edges))
        number = np.bincount(points.edge[usable], minlength=len(edges))
        return np.where(number > 0, total / np.maximum(number, 1), np.nan)

    def _lab(self, layer: Ints, uv: Floats) -> NDArray[np.float32]:
        """(m, 3) CIELAB at (m, 2)."""
        color = np.zeros((len(uv), 3), np.float32)
        for k in np.unique(layer):
            color[layer == k] = bilinear(self._colors[k], uv[layer == k])
        return lab(torch.from_numpy(color)).numpy()
