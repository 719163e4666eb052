"""Edges of the surface that two faces of one layer share: in how far they are one in the texture too."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from paintit.mesh.mesh import Floats, Ints, Mesh, remembered
from paintit.mesh.weld import edge_pairs, row_ids

SAME_UV = 1e-6
"""Texture coordinates nearer than this are one: a thousandth of a texel of a 1024 map."""
_FLAT = 1e-12
"""A face whose UV area is below this has no inside in the texture."""


@dataclass(frozen=True)
class SurfaceEdges:
    """n edges, each between two faces, side 0 and side 1; its ends 0 and 1 are the same points on both sides.

    Attributes:
        faces: (n, 2) the face on each side.
        corners: (n, 2, 2) which corner of its face (0, 1, 2) each side has at each end.
        points: (n, 2, 3) the ends, in the file's units.
        length: (n,) distance of the ends.
        uv: (n, 2, 2, 2) texture coordinates of each side at each end.
        inward: (n, 2, 2) for each side, the UV step of one unit of length on the surface, at right angles to the edge,
            into the face.
    """

    faces: Ints
    corners: Ints
    points: Floats
    length: Floats
    uv: Floats
    inward: Floats

    def __len__(self) -> int:
        return len(self.faces)

    def __getitem__(self, index: NDArray[np.bool_] | Ints) -> SurfaceEdges:
        return SurfaceEdges(
            self.faces[index], self.corners[index], self.points[index], self.length[index], self.uv[index],
            self.inward[index],
        )  # fmt: skip

    @property
    def seam(self) -> NDArray[np.bool_]:
        """(n,) whether the sides meet the edge at different texture coordinates.

        Sides that differ by whole textures read the same texels, since textures repeat: that is no seam.
        """
        return _apart(self.uv)

    @property
    def interior(self) -> NDArray[np.bool_]:
        """(n,) whether the texture simply goes on across the edge.

        False on seams, and where a mirrored half is folded onto the other in the texture: both sides show the same
        texels there, which says nothing about the picture.
        """
        along = self.uv[:, :, 1] - self.uv[:, :, 0]
        side = np.sign(along[..., 0] * self.inward[..., 1] - along[..., 1] * self.inward[..., 0])
        return ~self.seam & (side[:, 0] != side[:, 1])


def _apart(uv: Floats) -> NDArray[np.bool_]:
    """(n,) whether two sides, ``uv`` (n, 2, 2, 2), have different texture coordinates; False where one has none."""
    apart = uv[:, 0] - uv[:, 1]
    apart -= np.round(apart[:, :1])
    return (np.abs(apart) > SAME_UV).any((1, 2))


def surface_edges(mesh: Mesh, only_seams: bool = False) -> SurfaceEdges:
    """Every edge, or every seam, that two faces of one painted layer share, vertices at one place being one.

    Left out are edges between layers (borders of materials, not seams), those without length, and those of faces
    without area or without finite texture coordinates. More than two faces on an edge pair up two by two. The order is
    that of the file.
    """
    corner_uvs = np.where((mesh.face_uvs >= 0)[..., None], mesh.corner_uvs, np.nan)
    faces, corners = _shared_edges(mesh)
    uv = corner_uvs[faces[..., None], corners]
    if only_seams:
        kept = _apart(uv)
        faces, corners, uv = faces[kept], corners[kept], uv[kept]
    points = mesh.vertices[mesh.faces[faces[:, :1], corners[:, 0]]]
    third = 3 - corners.sum(-1)
    apex, apex_uv = mesh.vertices[mesh.faces[faces, third]], corner_uvs[faces, third]

    edge = points[:, 1] - points[:, 0]
    length = np.linalg.norm(edge, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        direction = edge / length[:, None]
        across = apex - points[:, :1]
        along = (across * direction[:, None]).sum(-1)
        height = np.linalg.norm(across - along[..., None] * direction[:, None], axis=-1)
        step = (uv[:, :, 1] - uv[:, :, 0]) / length[:, None, None]
        inward = (apex_uv - uv[:, :, 0] - along[..., None] * step) / height[..., None]
        area = np.abs(step[..., 0] * inward[..., 1] - step[..., 1] * inward[..., 0]) * length[:, None] * height
    layer = mesh.face_layer[faces]
    painted = np.array([found.painted for found in mesh.layers])[layer[:, 0]]
    usable = painted & (layer[:, 0] == layer[:, 1]) & (area > _FLAT).all(1) & np.isfinite(inward).all((1, 2))
    return SurfaceEdges(faces, corners, points, length, uv, inward)[usable]


@remembered
def _shared_edges(mesh: Mesh) -> tuple[Ints, Ints]:
    """``faces`` and ``corners`` of every edge that two faces share, see :class:`SurfaceEdges`."""
    welded = row_ids(mesh.vertices)[0][mesh.faces]
    pairs = _pairs(welded)
    pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
    faces, start = pairs // 3, pairs % 3
    corners = np.stack([start, (start + 1) % 3], -1)
    # Side 1 usually runs the other way: its ends are put in the order of side 0.
    first = welded.reshape(-1)[pairs]
    turned = first[:, 0] != first[:, 1]
    corners[turned, 1] = corners[turned, 1, ::-1]
    return faces, corners


def _pairs(welded: Ints) -> Ints:
    """(p, 2) half-edges that lie on one another: those that run in opposite directions, then what is left over, where
    a neighbour is wound the wrong way round."""
    proper, either = edge_pairs(welded), edge_pairs(welded, both_ways=True)
    free = np.ones(welded.size, bool)
    free[proper.reshape(-1)] = False
    return np.sort(np.concatenate([proper, either[free[either].all(1)]]), axis=1)


@dataclass(frozen=True)
class EdgePoints:
    """Points spread evenly along edges.

    Attributes:
        edge: (m,) the edge of each.
        share: (m,) how far along it: 0 at end 0, 1 at end 1.
    """

    edge: Ints
    share: Floats

    @classmethod
    def spread(cls, counts: Ints) -> EdgePoints:
        """``counts`` (n,) points on each edge, each in the middle of its piece."""
        edge = np.repeat(np.arange(len(counts)), counts)
        index = np.arange(len(edge)) - np.repeat(np.cumsum(counts) - counts, counts)
        return cls(edge, (index + 0.5) / counts[edge])

    def along(self, ends: Floats) -> Floats:
        """Values (n, ..., 2, c) at both ends of each edge -> (m, ..., c) at the points."""
        share = self.share.reshape(-1, *[1] * (ends.ndim - 2))
        first, last = ends[self.edge, ..., 0, :], ends[self.edge, ..., 1, :]
        return first + share * (last - first)
