"""What is in a mesh, as plain numbers: the content of ``paintit inspect``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from paintit.mesh.mesh import Mesh
from paintit.mesh.normals import face_normals
from paintit.mesh.quality import UVQuality, check
from paintit.mesh.weld import components, row_ids


@dataclass(frozen=True)
class LayerSummary:
    """One material.

    Attributes:
        name: as in the file.
        faces: triangles that read it.
        uv_origin: ``"file"`` or ``"unwrapped"``.
    """

    name: str
    faces: int
    uv_origin: str


@dataclass(frozen=True)
class PartSummary:
    """One primitive of the file: its name, number of triangles and material."""

    name: str
    faces: int
    layer: str


@dataclass(frozen=True)
class MeshSummary:
    """Everything ``dataclasses.asdict`` turns into JSON.

    Attributes:
        path, format: of the source file; empty for a mesh made in memory.
        vertices: in the file's own count; ``positions`` counts distinct places.
        faces: triangles.
        degenerate_faces: triangles without area.
        layers, parts: materials and primitives.
        bounds: lowest and highest corner in the file's units.
        extent: longest edge of the bounding box.
        area: of the surface, in squared file units.
        watertight: every edge has exactly two faces, once vertices at one place are joined.
        boundary_edges: edges with one face.
        non_manifold_edges: edges with more than two faces.
        components: connected pieces.
        inside_out: closed pieces whose triangles are wound so that they face inward, but for cavities of other pieces.
        uv: the texture coordinates as they will be painted.
        uv_origin: ``"file"`` or ``"unwrapped"``.
        notes: what was found and repaired.
    """

    path: str
    format: str
    vertices: int
    positions: int
    faces: int
    degenerate_faces: int
    layers: tuple[LayerSummary, ...]
    parts: tuple[PartSummary, ...]
    bounds: tuple[tuple[float, float, float], tuple[float, float, float]]
    extent: float
    area: float
    watertight: bool
    boundary_edges: int
    non_manifold_edges: int
    components: int
    inside_out: int
    uv: UVQuality
    uv_origin: str
    notes: tuple[str, ...]


def summarize(mesh: Mesh, resolution: int = 512) -> MeshSummary:
    """Measure a mesh.

    Args:
        mesh: as ``read_mesh`` returns it.
        resolution: texels along each side at which texture coordinates are measured.
    """
    ids, _ = row_ids(mesh.vertices)
    welded = ids[mesh.faces]
    area = face_normals(mesh.vertices, mesh.faces)[1]
    boundary, crowded = _edge_counts(welded[(welded != np.roll(welded, 1, axis=1)).all(1)])
    used, compact = np.unique(welded, return_inverse=True)
    compact = compact.reshape(-1, 3)
    label, pieces = components(compact[:, [0, 1]].reshape(-1), compact[:, [1, 2]].reshape(-1), len(used))
    inside_out = _inside_out(mesh.vertices[mesh.faces], compact, label, pieces)
    (ax, ay, az), (bx, by, bz) = mesh.bounds.tolist()
    own = set(mesh.report.unwrapped_layers)
    counts = np.bincount(mesh.face_layer, minlength=len(mesh.layers)).tolist()
    return MeshSummary(
        path=str(mesh.source.path) if mesh.source else "",
        format=mesh.source.format if mesh.source else "",
        vertices=len(mesh.vertices),
        positions=len(used),
        faces=len(mesh.faces),
        degenerate_faces=int((area == 0).sum()),
        layers=tuple(
            LayerSummary(layer.name, counts[k], "unwrapped" if k in own else "file")
            for k, layer in enumerate(mesh.layers)
        ),
        parts=tuple(PartSummary(p.name, p.faces[1] - p.faces[0], mesh.layers[p.layer].name) for p in mesh.parts),
        bounds=((ax, ay, az), (bx, by, bz)),
        extent=mesh.extent,
        area=float(area.sum()),
        watertight=boundary == 0 and crowded == 0,
        boundary_edges=boundary,
        non_manifold_edges=crowded,
        components=pieces,
        inside_out=inside_out,
        uv=check(mesh, resolution),
        uv_origin=mesh.report.uv_origin,
        notes=mesh.report.notes
        + (
            (f"{inside_out} closed pieces are wound inside out; they are painted and shown all the same",)
            * bool(inside_out)
        ),
    )


def _edge_counts(welded: np.ndarray) -> tuple[int, int]:
    """Edges with one face, and edges with more than two."""
    edges = np.sort(np.concatenate([welded[:, [0, 1]], welded[:, [1, 2]], welded[:, [2, 0]]]), axis=1)
    _, count = np.unique(edges[:, 0] * (int(welded.max(initial=0)) + 1) + edges[:, 1], return_counts=True)
    return int((count == 1).sum()), int((count > 2).sum())


def _inside_out(corners: np.ndarray, welded: np.ndarray, label: np.ndarray, pieces: int) -> int:
    """Closed pieces of negative volume that do not lie within the bounding box of another piece, as inner walls do.

    Args:
        corners: (f, 3, 3) positions. welded: (f, 3) vertices in [0, len(label)). label: piece of each vertex.
    """
    piece = label[welded[:, 0]]
    edges = np.sort(welded[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    solid = edges[:, 0] != edges[:, 1]
    _, first, count = np.unique(edges[solid, 0] * len(label) + edges[solid, 1], return_index=True, return_counts=True)
    closed = np.ones(pieces, bool)
    closed[np.repeat(piece, 3)[solid][first[count != 2]]] = False
    low, high = np.full((pieces, 3), np.inf), np.full((pieces, 3), -np.inf)
    np.minimum.at(low, piece, corners.min(1))
    np.maximum.at(high, piece, corners.max(1))
    local = corners - ((low + high) / 2)[piece][:, None]
    volume = np.bincount(piece, np.linalg.det(local) / 6, pieces)
    wrong = np.flatnonzero(closed & (volume < -1e-6 * (high - low).max(1) ** 3))
    return sum(not ((low < low[k]) & (high > high[k])).all(1).any() for k in wrong)
