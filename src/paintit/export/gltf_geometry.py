"""New vertex attributes of one primitive: TANGENT always, UVs and normals where needed, vertices split to fit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from paintit.export.gltf_assembly import Assembly
from paintit.export.gltf_new import clean_tangents, unit
from paintit.export.gltf_source import corner_vertices, decoded, primitive_of, source_triangles, stored
from paintit.export.vertices import agree, split_corners
from paintit.mesh.gltf_document import GltfDocument
from paintit.mesh.mesh import Mesh, Part
from paintit.mesh.tangents import mikktspace


@dataclass(frozen=True)
class PaintedPrimitive:
    """A primitive to rewrite.

    Attributes:
        part: the faces of the mesh that came from it.
        mesh: index of the glTF mesh it stands in, which may be a copy.
        json: its JSON in the document under construction, changed in place.
    """

    part: Part
    mesh: int
    json: dict[str, Any]


def write_primitive(
    assembly: Assembly, document: GltfDocument, mesh: Mesh, primitive: PaintedPrimitive, uv_set: tuple[int, bool]
) -> None:
    """Give the primitive its tangents and, if ``uv_set[1]``, the mesh's UVs as set ``uv_set[0]``.

    Tangents are made in the primitive's own space (bind space where it is skinned) from its own positions and normals,
    since that is where a viewer reads them; node transforms and skins then act on them as on the normals.
    """
    attributes = primitive.json["attributes"]
    corner = corner_vertices(mesh, primitive.part)
    uv = mesh.corner_uvs[slice(*primitive.part.faces)]
    if _turned_over(corner, source_triangles(document, primitive_of(document, primitive.part))):
        # Under a mirroring node the mesh holds the winding that is seen; the file's own space has the other one.
        corner, uv = corner[:, [0, 2, 1]], uv[:, [0, 2, 1]]
    vertices = decoded(document, attributes["POSITION"])
    position = vertices[corner]
    if "NORMAL" in attributes:
        normal = unit(decoded(document, attributes["NORMAL"])[corner], (0.0, 0.0, 1.0))
    else:  # glTF 2.0, 3.7.2.1: without normals, flat ones
        flat = np.cross(position[:, 1] - position[:, 0], position[:, 2] - position[:, 0])
        normal = np.repeat(unit(flat, (0.0, 0.0, 1.0))[:, None], 3, 1)
    new: dict[str, NDArray[Any]] = {
        "TANGENT": clean_tangents(
            mikktspace(vertices, corner, uv.reshape(-1, 2), np.arange(corner.size).reshape(-1, 3), normal)
        )
    }
    if "NORMAL" not in attributes:
        new["NORMAL"] = normal
    if uv_set[1]:
        sets = sum(name.startswith("TEXCOORD_") for name in attributes)
        for index in {*range(sets, uv_set[0]), uv_set[0]}:  # sets must be numbered without a gap
            new[f"TEXCOORD_{index}"] = uv.astype(np.float32)
    _write(assembly, document, primitive.json, corner, new)


def _turned_over(corner: NDArray[np.int64], triangles: NDArray[np.int64]) -> bool:
    """Whether ``corner`` (n, 3) winds against the file's ``triangles`` (m, 3)."""
    if np.array_equal(corner, triangles):
        return False

    def cycles(faces: NDArray[np.int64]) -> NDArray[np.void]:
        start = faces.argmin(1)
        turned = np.take_along_axis(faces, (start[:, None] + np.arange(3)) % 3, 1)
        return np.ascontiguousarray(turned).view([("", np.int64)] * 3)[:, 0]

    return not bool(np.isin(cycles(corner), cycles(triangles)).all())


def _write(
    assembly: Assembly,
    document: GltfDocument,
    primitive: dict[str, Any],
    corner: NDArray[np.int64],
    new: dict[str, NDArray[Any]],
) -> None:
    """Attach per-corner attributes: on the vertices as they are where their corners agree, else on split vertices."""
    attributes = primitive["attributes"]
    count = int(document.json["accessors"][attributes["POSITION"]]["count"])
    whole = {name: agree(corner, values, count) for name, values in new.items()}
    if all(values is not None for values in whole.values()):
        unused = np.ones(count, bool)
        unused[corner] = False
        for name, values in whole.items():
            assert values is not None
            if name in _IDLE:
                values[unused] = _IDLE[name]
            attributes[name] = assembly.add_attribute(values)
        return
    split = split_corners([corner, *(new[name] for name in sorted(new))])
    vertex = corner.reshape(-1)[split.corner]
    gathered: dict[int, int] = {}
    for holder in [attributes, *primitive.get("targets", [])]:
        for name, accessor in holder.items():
            if holder is attributes and name in new:
                continue
            if accessor not in gathered:
                gathered[accessor] = _gather(assembly, document, accessor, vertex)
            holder[name] = gathered[accessor]
    for name, values in new.items():
        attributes[name] = assembly.add_attribute(values.reshape(-1, values.shape[-1])[split.corner])
    primitive["indices"] = assembly.add_indices(split.indices)
    primitive.pop("mode", None)  # strips and fans became plain triangles, the default


#: What vertices without a face hold, so that every stored vector is a unit vector.
_IDLE = {"TANGENT": (1.0, 0.0, 0.0, 1.0), "NORMAL": (0.0, 0.0, 1.0)}


def _gather(assembly: Assembly, document: GltfDocument, accessor: int, vertex: NDArray[np.int64]) -> int:
    """A new accessor with the stored values of the old one at ``vertex``, same component type and name."""
    old = document.json["accessors"][accessor]
    new = assembly.add_attribute(
        stored(document, accessor)[vertex], normalized=bool(old.get("normalized")), bounds="min" in old or "max" in old
    )
    for key in ("name", "extras"):
        if key in old:
            assembly.json["accessors"][new][key] = old[key]
    return new
