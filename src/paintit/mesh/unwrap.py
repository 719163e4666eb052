"""Texture coordinates made by us: each layer gets its own square."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from paintit.errors import MeshError
from paintit.mesh.coverage import fragments
from paintit.mesh.mesh import Floats, Ints, Mesh
from paintit.mesh.normals import face_normals
from paintit.mesh.quality import first_instances
from paintit.mesh.tangents import mikktspace
from paintit.mesh.weld import components, edge_pairs, row_ids

PAGE = 1024
"""Texels along each side of the page that charts are packed into."""
PADDING = 6
"""Texels between charts on that page: three at 512."""
MIN_PACKING = 0.40
"""Share of the square that a good unwrap covers; below it the other program is tried too."""
MAX_OVERLAP = 0.005
"""Share of covered texels that may belong to two faces."""
MAX_PIECES = 4000
"""Pieces without a sharp edge inside from which on charts would be smaller than the gaps between them."""
SHARP_DEGREES = 50.0
"""An edge that bends by more is taken to part two charts."""
LARGE = 200_000
"""Faces from which on charts are kept flatter, which takes half the time and a few more charts."""
_M_PERTURB, _ZEROS = -6, 0xFF
"""glibc's setting for what new memory is filled with (malloc.h), which is the complement of its value."""

Program = Callable[[NDArray[np.float32], Ints], Floats]
"""Points (v, 3) and faces (f, 3) -> texture coordinates (f, 3, 2) in the unit square."""


@dataclass(frozen=True)
class _Result:
    """corner_uvs (f, 3, 2) of the triangles given; coverage and overlap as measured."""

    corner_uvs: Floats
    coverage: float
    overlap: float
    by: str


def unwrap(mesh: Mesh, layers: tuple[int, ...] | None = None) -> Mesh:
    """The mesh with new texture coordinates and tangents.

    Positions, faces, normals, layers and parts stay. Parts that show the same glTF primitive share one unwrap.

    Args:
        mesh: with or without texture coordinates.
        layers: which layers to unwrap; None for all.

    Raises:
        MeshError: no unwrap without overlap could be made.
    """
    chosen = tuple(range(len(mesh.layers))) if layers is None else layers
    once = first_instances(mesh)
    corner_uvs = np.full((len(mesh.faces), 3, 2), np.nan)
    notes: list[str] = []
    for layer in chosen:
        members = np.flatnonzero((mesh.face_layer == layer) & once)
        result = _unwrap_faces(mesh.vertices, mesh.faces[members], mesh.layers[layer].name)
        corner_uvs[members] = result.corner_uvs
        notes.append(
            f"unwrapped '{mesh.layers[layer].name}' with {result.by}: {result.coverage:.0%} of the square covered"
        )
    _copy_to_instances(mesh, corner_uvs)
    redone = np.isin(mesh.face_layer, chosen)
    fresh = corner_uvs[redone].reshape(-1, 2)
    ids, count = row_ids(fresh)
    table = np.empty((count, 2))
    table[ids] = fresh
    face_uvs = mesh.face_uvs.copy()
    face_uvs[redone] = ids.reshape(-1, 3) + len(mesh.uvs)
    taken = np.zeros(len(mesh.uvs) + count, bool)
    taken[face_uvs] = True
    uvs = np.concatenate([mesh.uvs, table])[taken]
    face_uvs = (np.cumsum(taken) - 1)[face_uvs]
    report = replace(
        mesh.report,
        notes=mesh.report.notes + tuple(notes),
        uv_origin="unwrapped",
        unwrapped_layers=tuple(sorted({*mesh.report.unwrapped_layers, *chosen})),
    )
    tangents = mikktspace(mesh.vertices, mesh.faces, uvs, face_uvs, mesh.normals)
    return replace(mesh, uvs=uvs, face_uvs=face_uvs, tangents=tangents, report=report)


def _copy_to_instances(mesh: Mesh, corner_uvs: Floats) -> None:
    """Fill the faces of repeated primitives from their first showing, corner by corner of the source primitive."""
    first: dict[tuple[int, int], tuple[int, int]] = {}
    order = mesh.source.corner_vertex if mesh.source is not None else None
    for part in mesh.parts:
        if part.primitive is None:
            continue
        a, b = first.setdefault(part.primitive, part.faces)
        start, end = part.faces
        if (a, b) == (start, end):
            continue
        values = corner_uvs[a:b]
        if order is not None and (order[a:b] != order[start:end]).any():
            values = values[:, [0, 2, 1]]  # one of the two nodes is mirrored, so its winding was flipped
        corner_uvs[start:end] = values


def _unwrap_faces(vertices: Floats, faces: Ints, name: str) -> _Result:
    """Texture coordinates of one layer's faces."""
    ids, count = row_ids(vertices[faces].reshape(-1, 3))
    welded = ids.reshape(-1, 3)
    points = np.empty((count, 3))
    points[ids] = vertices[faces].reshape(-1, 3)
    points -= (points.min(0) + points.max(0)) / 2
    points /= max(float(np.abs(points).max()), 1e-300)
    points = points.astype(np.float32)
    good = np.flatnonzero(face_normals(points.astype(np.float64), welded)[1] > 1e-14)
    if not len(good):
        raise MeshError(
            "mesh.degenerate",
            f"all {len(faces)} faces of '{name}' are degenerate (zero area)",
            "repair the mesh: its triangles have no area",
        )
    single, twin = _without_twins(welded[good])
    tried: list[_Result] = []
    reasons: list[str] = []
    for by, program in _programs(points, single):
        try:
            uv = program(points, single)
        except (KeyboardInterrupt, SystemExit):
            raise
        except BaseException as error:  # compiled code: a panic in Rust is no Exception; the other one may still do
            reasons.append(f"{by}: {str(error)[:60]}")
            continue
        if uv.shape != (len(single), 3, 2) or not np.isfinite(uv).all() or uv.min() < -1e-6 or uv.max() > 1 + 1e-6:
            reasons.append(f"{by}: invalid result")
            continue
        coverage, overlap = _measure(uv)
        tried.append(_Result(uv, coverage, overlap, by))
        if coverage >= MIN_PACKING and overlap <= MAX_OVERLAP:
            break
    if not tried:
        raise MeshError(
            "mesh.unwrap",
            f"'{name}' cannot be unwrapped ({'; '.join(reasons)})",
            "unwrap the mesh in a 3D program and pass it with its texture coordinates",
        )
    best = min(
        tried,
        key=lambda r: (r.overlap > MAX_OVERLAP, round(r.overlap, 3) if r.overlap > MAX_OVERLAP else 0, -r.coverage),
    )
    corner_uvs = np.empty((len(faces), 3, 2))
    same_vertex = (welded[good][:, :, None] == single[twin][:, None, :]).argmax(2)
    uv = np.take_along_axis(best.corner_uvs[twin], same_vertex[..., None], 1)
    corner_uvs[good] = np.clip(uv * (1.0, -1.0) + (0.0, 1.0), 0.0, 1.0)  # all programs count v upward
    _fill_degenerate(corner_uvs, welded, good)
    return replace(best, corner_uvs=corner_uvs)


def _without_twins(faces: Ints) -> tuple[Ints, Ints]:
    """Each triangle once (k, 3), and (f,) which of these each of ``faces`` lies on, in either winding.

    Leaves and cloths are often stored twice, back to back. They are one place and share their texels; to an unwrapper
    three faces at an edge are no surface, and it would cut each triangle out by itself.
    """
    ids, _ = row_ids(np.sort(faces, axis=1))
    _, first, twin = np.unique(ids, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return faces[first[order]], rank[twin.reshape(-1)]


def _programs(points: NDArray[np.float32], faces: Ints) -> list[tuple[str, Program]]:
    """What to try, in order: a tree of thousands of leaves has no charts worth looking for."""
    pairs = edge_pairs(faces) // 3
    normals = face_normals(points.astype(np.float64), faces)[0]
    flat = (normals[pairs[:, 0]] * normals[pairs[:, 1]]).sum(1) > np.cos(np.radians(SHARP_DEGREES))
    pieces = components(pairs[flat, 0], pairs[flat, 1], len(faces))[1]
    if pieces > MAX_PIECES:
        return [(f"a cell for each of its {len(faces)} triangles ({pieces} flat pieces)", _cells)]
    return [("uvunwrap", _uvunwrap), ("xatlas", _xatlas)]


def _cells(points: NDArray[np.float32], faces: Ints) -> Floats:
    """(f, 3, 2) two triangles in each cell of a square grid, whatever their shape and size, a gap around each."""
    side = int(np.ceil(np.sqrt(len(faces) / 2)))
    index = np.arange(len(faces))
    row, column = np.divmod(index // 2, side)
    lower = np.array([[0.05, 0.05], [0.80, 0.05], [0.05, 0.80]])
    shape = np.where((index % 2 == 0)[:, None, None], lower, 1.0 - lower)
    return (np.stack([column, row], -1)[:, None] + shape) / side


def _fill_degenerate(corner_uvs: Floats, welded: Ints, good: Ints) -> None:
    """Degenerate faces become a point of the texture, at one of their own vertices where an ordinary face uses it."""
    bad = np.setdiff1d(np.arange(len(welded)), good)
    if not len(bad):
        return
    at = np.full((int(welded.max()) + 1, 2), np.nan)
    at[welded[good].reshape(-1)] = corner_uvs[good].reshape(-1, 2)
    choices = at[welded[bad]]
    known = np.isfinite(choices[..., 0])
    point = choices[np.arange(len(bad)), known.argmax(1)]
    point[~known.any(1)] = corner_uvs[good[0], 0]
    corner_uvs[bad] = point[:, None]


def _measure(uv: Floats, resolution: int = 512) -> tuple[float, float]:
    """Share of the square that is covered, and share of that which two faces cover."""
    count = np.zeros(resolution * resolution, np.int64)
    touched = np.zeros(resolution * resolution, bool)
    for part in fragments(uv, resolution):
        count += np.bincount(part.texel[part.inner], minlength=len(count))
        touched[part.texel] = True
    covered = max(int(touched.sum()), 1)
    return covered / len(count), float((count > 1).sum() / covered)


def _uvunwrap(points: NDArray[np.float32], faces: Ints) -> Floats:
    import uvunwrap

    used, compact = np.unique(faces, return_inverse=True)
    mesh = uvunwrap.Mesh(
        np.ascontiguousarray(points[used]), np.ascontiguousarray(compact.reshape(-1, 3).astype(np.uint32))
    )
    angle = SHARP_DEGREES if len(faces) > LARGE else 70.0
    with _zeroed_memory():
        atlas = uvunwrap.generate([mesh], page_size=PAGE, padding=PADDING, max_chart_angle=angle)
    if atlas.page_count != 1:
        raise ValueError(f"{atlas.page_count} pages")
    return np.asarray(atlas.meshes[0].corner_uvs, np.float64).reshape(-1, 3, 2)


@contextmanager
def _zeroed_memory() -> Iterator[None]:
    """New memory holds zeros, where the C library is glibc.

    ``uvunwrap`` 0.3.0 reads memory that it has not written when it orders the unknowns of some charts, and panics or
    not by what was there before: the same mesh would be unwrapped by one program today, by the other tomorrow.
    """
    fill = getattr(ctypes.CDLL(None), "mallopt", None) if sys.platform == "linux" else None
    if fill is not None:
        fill(_M_PERTURB, _ZEROS)
    try:
        yield
    finally:
        if fill is not None:
            fill(_M_PERTURB, 0)


def _xatlas(points: NDArray[np.float32], faces: Ints) -> Floats:
    import xatlas

    used, compact = np.unique(faces, return_inverse=True)
    atlas = xatlas.Atlas()
    atlas.add_mesh(np.ascontiguousarray(points[used]), np.ascontiguousarray(compact.reshape(-1, 3).astype(np.uint32)))
    pack = xatlas.PackOptions()
    pack.resolution, pack.padding, pack.bilinear = PAGE, PADDING, True
    atlas.generate(pack_options=pack)
    if atlas.atlas_count != 1:
        raise ValueError(f"{atlas.atlas_count} pages")
    _, indices, uvs = atlas[0]
    scale = max(atlas.width, atlas.height)  # keep the page square: rectangular pages would stretch the texels
    return uvs[indices].astype(np.float64) * (atlas.width / scale, atlas.height / scale)
