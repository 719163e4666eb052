"""Triangles of a glTF document in world space: node transforms, skins, morph targets, every material a layer."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from paintit.errors import MeshError
from paintit.mesh.gltf_deform import Skins, attribute, morphed, placed
from paintit.mesh.gltf_document import GltfDocument
from paintit.mesh.gltf_scene import Scene, read_scene
from paintit.mesh.gltf_schema import gltf_error, plain
from paintit.mesh.gltf_texcoord import TRANSFORM, color_info, paints_transformed, texcoord_of, transformed
from paintit.mesh.head import Joint, find_head, head_of
from paintit.mesh.limits import check_limit
from paintit.mesh.mesh import Floats, Ints, Layer, Part
from paintit.mesh.parsed import Parsed
from paintit.mesh.pose import REST, pose_changes

#: Notes that are worth reading; a broken file can give rise to thousands.
_MAX_NOTES = 40


@dataclass(frozen=True)
class _Piece:
    """One primitive as one node shows it."""

    name: str
    node: int | None
    primitive: tuple[int, int]
    material: int | None
    positions: Floats
    normals: NDArray[np.float32] | None
    uvs: Floats | None
    faces: Ints
    on_head: NDArray[np.bool_] | None


@dataclass(frozen=True)
class _Reading:
    """What every primitive is read with."""

    document: GltfDocument
    scene: Scene
    skins: Skins
    head: Joint | None
    notes: list[str]


def read_gltf(document: GltfDocument, pose: str = REST) -> Parsed:
    """All triangles of the default scene.

    Args:
        document: the file; it is not changed, whatever the pose.
        pose: ``"rest"``, or a moment of an animation: see :func:`paintit.mesh.pose.pose_changes`.

    Raises:
        MeshError: damage, NaN, an index out of range, a node cycle, no such pose, too much, or no triangle at all.
    """
    notes: list[str] = list(document.notes)
    scene = read_scene(document, pose_changes(document, pose, notes), notes)
    reading = _Reading(document, scene, Skins(document, scene.world), find_head(document), notes)
    pieces: list[_Piece] = []
    for node, mesh in scene.shown:
        for p, primitive in enumerate(document.item("meshes", mesh).get("primitives", [])):
            piece = _piece(reading, node, (mesh, p), primitive)
            if piece is not None:
                pieces.append(piece)
    if not pieces:
        raise MeshError(
            "mesh.empty",
            "the mesh has no faces (no triangles in the scene)",
            "export the mesh with its faces; point clouds and curves cannot be painted",
        )
    return _joined(document, _with_transforms(document, pieces, notes), reading.head, notes)


def _joined(document: GltfDocument, pieces: list[_Piece], head: Joint | None, notes: list[str]) -> Parsed:
    used = sorted({p.material for p in pieces if p.material is not None})
    check_limit(document.limits, "materials", len(used), "materials in use")
    layers = [Layer(str(document.item("materials", m).get("name") or "material"), m) for m in used]
    layer_of: dict[int | None, int] = {m: i for i, m in enumerate(used)}
    if any(p.material is None for p in pieces):
        layer_of[None] = len(layers)
        layers.append(Layer("material"))
    vertex_offset = face_offset = 0
    faces, face_uvs, uvs, normals, parts = [], [], [], [], []
    uv_offset = 0
    for piece in pieces:
        count = len(piece.faces)
        faces.append(piece.faces + vertex_offset)
        face_uvs.append(piece.faces + uv_offset if piece.uvs is not None else np.full_like(piece.faces, -1))
        if piece.uvs is not None:
            uvs.append(piece.uvs)
            uv_offset += len(piece.uvs)
        normals.append(
            piece.normals[piece.faces] if piece.normals is not None else np.full((count, 3, 3), np.nan, np.float32)
        )
        layer = layer_of[piece.material]
        parts.append(Part(piece.name, (face_offset, face_offset + count), layer, piece.node, piece.primitive))
        vertex_offset += len(piece.positions)
        face_offset += count
    return Parsed(
        np.concatenate([p.positions for p in pieces]),
        np.concatenate(faces),
        np.concatenate(uvs) if uvs else np.zeros((0, 2)),
        np.concatenate(face_uvs),
        np.concatenate(normals),
        np.repeat([p.layer for p in parts], [len(p.faces) for p in pieces]).astype(np.int64),
        tuple(layers),
        tuple(parts),
        smooth=False,
        document=document,
        corner_vertex=np.concatenate([p.faces for p in pieces]),
        notes=_few(notes),
        head=head_of(head, [(p.positions, p.faces, p.on_head) for p in pieces]),
    )


def _few(notes: list[str]) -> tuple[str, ...]:
    distinct = list(dict.fromkeys(notes))
    if len(distinct) > _MAX_NOTES:
        distinct[_MAX_NOTES:] = [f"and {len(distinct) - _MAX_NOTES} more such notes"]
    return tuple(distinct)


def _piece(
    reading: _Reading, node_index: int | None, where: tuple[int, int], primitive: dict[str, Any]
) -> _Piece | None:
    document, notes = reading.document, reading.notes
    owner = f"primitive {where[1]} of mesh {where[0]}"
    mode = primitive.get("mode", 4)
    if mode in (0, 1, 2, 3):
        notes.append(f"left out {owner}: points or lines")
        return None
    if mode not in (4, 5, 6):
        raise gltf_error("gltf_invalid", f"{owner} has mode {mode!r}")
    attributes = primitive.get("attributes")
    if not isinstance(attributes, dict) or "POSITION" not in attributes:
        raise gltf_error("gltf_invalid", f"{owner} has no POSITION")
    accessor = document.item("accessors", attributes["POSITION"])
    if "bufferView" not in accessor and "sparse" not in accessor:
        raise gltf_error("gltf_invalid", f"POSITION of {owner} holds no data")
    positions = attribute(document, attributes, "POSITION", 3, None, owner).astype(np.float64)
    count = len(positions)
    normals = attribute(document, attributes, "NORMAL", 3, count, owner) if "NORMAL" in attributes else None
    material = primitive.get("material")
    uvs = _uvs(document, attributes, material, count, owner, notes)
    mesh = document.item("meshes", where[0])
    node = reading.scene.nodes[node_index] if node_index is not None else {}
    weights = node.get("weights", mesh.get("weights", []))
    positions, normals = morphed(document, primitive, weights, positions, normals, owner)
    on_head = None
    if node_index is not None and "skin" in node and "JOINTS_0" in attributes:
        by = reading.skins.of(node["skin"], attributes, count, owner)
        on_head = by.share(reading.head.below) > 0.5 if reading.head is not None else None
    else:
        by = reading.scene.world[node_index] if node_index is not None else np.eye(4)
    faces = _faces(document, primitive, mode, count, owner, notes)
    if not len(faces):
        return None
    if "COLOR_0" in attributes:
        notes.append("vertex colours (COLOR_0) are kept: viewers multiply the painted base colour by them")
    with np.errstate(over="ignore", invalid="ignore"):
        positions, normals, inside_out = placed(positions, normals, by)
    if not np.isfinite(positions).all():
        raise gltf_error("nan", f"POSITION of {owner} is not finite once placed")
    if inside_out:
        faces = faces[:, [0, 2, 1]]  # a mirrored node turns triangles inside out; glTF says to flip the winding back
    name = plain(str(node.get("name") or mesh.get("name") or "mesh"))
    return _Piece(name, node_index, where, material, positions, normals, uvs, faces, on_head)


def _uvs(
    document: GltfDocument, attributes: dict[str, Any], material: Any, count: int, owner: str, notes: list[str]
) -> Floats | None:
    """The set of texture coordinates that the material's colour reads, as the vertices hold them."""
    info = color_info(document.item("materials", material)) if material is not None else None
    name = f"TEXCOORD_{texcoord_of(info or {})}"
    if name not in attributes and "TEXCOORD_0" in attributes:
        notes.append(f"{owner} has no {name}; took TEXCOORD_0")
        name = "TEXCOORD_0"
    if name not in attributes:
        return None
    return attribute(document, attributes, name, 2, count, owner).astype(np.float64)


def _with_transforms(document: GltfDocument, pieces: list[_Piece], notes: list[str]) -> list[_Piece]:
    """The pieces with the texture transform of their material's colour applied where the material is painted in it."""
    by_material: dict[int, list[_Piece]] = {}
    for piece in pieces:
        if piece.material is not None and piece.uvs is not None:
            by_material.setdefault(piece.material, []).append(piece)
    applied: dict[int, dict[str, Any]] = {}
    for material, mine in by_material.items():
        info = color_info(document.item("materials", material))
        if info is None or TRANSFORM not in info.get("extensions", {}):
            continue
        name = plain(str(document.item("materials", material).get("name") or f"material {material}"))
        used = np.concatenate([p.uvs[np.unique(p.faces)] for p in mine if p.uvs is not None])
        if paints_transformed(info, used):
            applied[material] = info
            notes.append(f"'{name}' is painted through the {TRANSFORM} of its colour, which stays")
        else:
            notes.append(f"'{name}' is painted without the {TRANSFORM} of its old colour")
    return [
        replace(p, uvs=transformed(applied[p.material], p.uvs)) if p.material in applied and p.uvs is not None else p
        for p in pieces
    ]


def _faces(
    document: GltfDocument, primitive: dict[str, Any], mode: int, count: int, owner: str, notes: list[str]
) -> Ints:
    """(f, 3) triangles of a list, strip or fan."""
    if "indices" in primitive:
        values = document.accessor(primitive["indices"])
        if values.shape[1] != 1 or values.dtype.kind != "u":
            raise gltf_error("gltf_invalid", f"indices of {owner} are not whole numbers")
        order = values[:, 0].astype(np.int64)
        if order.max() >= count:
            raise gltf_error("index", f"{owner} uses vertex {order.max()} of {count}")
    else:
        order = np.arange(count, dtype=np.int64)
    if mode == 4:
        if len(order) % 3:
            notes.append(f"{owner} ends with {len(order) % 3} indices too many; left them out")
        return order[: len(order) // 3 * 3].reshape(-1, 3)
    i = np.arange(max(len(order) - 2, 0))
    if mode == 5:
        faces = order[np.stack([i, i + 1 + i % 2, i + 2 - i % 2], 1)]
    else:
        faces = order[np.stack([i + 1, i + 2, np.zeros_like(i)], 1)]
    # Strips join pieces by repeating vertices; those triangles were never meant to exist.
    real = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    return faces[real]
