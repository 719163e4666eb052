"""The mesh as the painter sees it. Plain numpy, frozen; files and repairs live in ``read.py`` and ``uv.py``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, wraps
from pathlib import Path
from typing import Any, Concatenate, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
P = ParamSpec("P")
R = TypeVar("R")


@dataclass(frozen=True)
class Layer:
    """One texture set (glTF: material). A face reads the layer that ``Mesh.face_layer`` names."""

    name: str
    """Material name in the file; ``"material"`` where the file has none."""
    source_index: int | None = None
    """Index of the material in the source document, or None where it had none."""
    painted: bool = True
    """False: the layer keeps its own look; it is shown and hides what is behind it, and nothing else."""


@dataclass(frozen=True)
class Part:
    """A contiguous run of faces from one primitive of the source file (one OBJ object, one glTF primitive)."""

    name: str
    faces: tuple[int, int]
    """Half-open range into ``Mesh.faces``."""
    layer: int
    node: int | None = None
    """glTF node that instances the primitive."""
    primitive: tuple[int, int] | None = None
    """glTF (mesh, primitive) indices."""


@dataclass(frozen=True)
class Source:
    """Where the mesh came from, kept so that the same document can be written back."""

    path: Path
    format: str
    """``"obj"``, ``"ply"``, ``"stl"``, ``"off"``, ``"glb"`` or ``"gltf"``."""
    sha256: str
    document: Any = None
    """glTF: a ``paintit.mesh.gltf_document.GltfDocument``. OBJ: the parsed text. None for the rest."""
    corner_vertex: Ints | None = None
    """(f, 3) vertex index of each face corner *within its primitive* in the source document (glTF), after
    triangulation; lets an exporter carry every other attribute through an unwrap."""


@dataclass(frozen=True)
class Head:
    """Where a rigged body has its head, in the file's units and the pose that was read."""

    joint: str
    """Name of the joint it was found by."""
    center: tuple[float, float, float]
    radius: float
    """Half of the longest edge of the box around it."""


@dataclass(frozen=True)
class Report:
    """What was found and what was repaired while reading; shown by ``paintit inspect``."""

    notes: tuple[str, ...] = ()
    """Plain sentences such as ``"triangulated 160 quads"``; repairs and oddities alike, never silent."""
    uv_origin: str = "file"
    """``"file"`` (kept) or ``"unwrapped"`` (made by us for at least one layer)."""
    unwrapped_layers: tuple[int, ...] = ()
    """Layers whose texture coordinates were made by us."""


@dataclass(frozen=True)
class Mesh:
    """Triangles with texture coordinates, in the file's own units and place (float64: an origin far away is harmless).

    Attributes:
        vertices: (v, 3) float64 positions in world space (glTF node transforms and rest pose applied), +Y up.
        faces: (f, 3) int64 into ``vertices``.
        uvs: (t, 2) float64, origin TOP LEFT, v downward (glTF). May be outside [0, 1] where the file repeats.
        face_uvs: (f, 3) int64 into ``uvs``.
        normals: (f, 3, 3) float32 unit shading normal of each corner.
        tangents: (f, 3, 4) float32 MikkTSpace tangent of each corner, xyz unit, w = +-1;
            bitangent = w * cross(normal, tangent) (glTF).
        face_layer: (f,) int64 into ``layers``.
        layers, parts, source, report: see their classes.
        head: of a mesh with a skin, where a joint says that there is one.
    """

    vertices: Floats
    faces: Ints
    uvs: Floats
    face_uvs: Ints
    normals: NDArray[np.float32]
    tangents: NDArray[np.float32]
    face_layer: Ints
    layers: tuple[Layer, ...] = (Layer("material"),)
    parts: tuple[Part, ...] = ()
    source: Source | None = None
    report: Report = field(default_factory=Report)
    head: Head | None = None

    @cached_property
    def bounds(self) -> Floats:
        """(2, 3) lowest and highest corner over the vertices that faces use."""
        used = self.vertices[np.unique(self.faces)]
        return np.stack([used.min(0), used.max(0)])

    @property
    def center(self) -> Floats:
        """(3,) middle of the bounding box."""
        return self.bounds.mean(0)

    @property
    def extent(self) -> float:
        """Longest edge of the bounding box, in the file's units. The camera is normalised by it, the mesh never is."""
        low, high = self.bounds
        return float((high - low).max())

    @cached_property
    def corner_uvs(self) -> Floats:
        """(f, 3, 2) texture coordinates of each corner."""
        return self.uvs[self.face_uvs]

    @cached_property
    def _measured(self) -> dict[Any, Any]:
        return {}


def remembered(measure: Callable[Concatenate[Mesh, P], R]) -> Callable[Concatenate[Mesh, P], R]:
    """Keep what ``measure`` finds on the mesh itself, which never changes: several steps of an export ask the same.

    The results are shared, so nobody may write into them. Arguments must be hashable.
    """

    @wraps(measure)
    def once(mesh: Mesh, *args: P.args, **kwargs: P.kwargs) -> R:
        key = (measure, args, tuple(kwargs.items()))
        if key not in mesh._measured:
            mesh._measured[key] = measure(mesh, *args, **kwargs)
        return mesh._measured[key]

    return once
