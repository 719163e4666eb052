"""Triangles of a glTF document in world space: node transforms, skins in rest pose, every material a layer."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from paintit.errors import MeshError
from paintit.mesh.gltf_deform import attribute, morphed, skinning, turned
from paintit.mesh.gltf_document import GltfDocument, gltf_error
from paintit.mesh.mesh import Floats, Ints, Layer, Part
from paintit.mesh.parsed import Parsed

_MAX_DEPTH = 512


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


def read_gltf(document: GltfDocument) -> Parsed:
    """All triangles of the default scene.

    Raises:
        MeshError: damage, NaN, an index out of range, a node cycle, or no triangle at all.
    """
    notes: list[str] = []
    world, scene = _scene(document, notes)
    pieces: list[_Piece] = []
    for node_index, mesh_index in _placements(document, scene, notes):
        mesh = document.item("meshes", mesh_index)
        for p, primitive in enumerate(mesh.get("primitives", [])):
            piece = _piece(document, world, node_index, (mesh_index, p), primitive, notes)
            if piece is not None:
                pieces.append(piece)
    if not pieces:
        raise MeshError(
            "mesh.empty",
            "the mesh has no faces (no triangles in the scene)",
            "export the mesh with its faces; point clouds and curves cannot be painted",
        )
    return _joined(document, pieces, notes)


def _joined(document: GltfDocument, pieces: list[_Piece], notes: list[str]) -> Parsed:
    used = sorted({p.material for p in pieces if p.material is not None})
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
        notes=tuple(dict.fromkeys(notes)),
    )


def _scene(document: GltfDocument, notes: list[str]) -> tuple[dict[int, Floats], list[int]]:
    """World matrix of every node, and the nodes of the default scene in order."""
    nodes = document.items("nodes")
    parent: dict[int, int] = {}
    for i, node in enumerate(nodes):
        for child in node.get("children", []):
            document.item("nodes", child)
            if child in parent or child == i:
                raise gltf_error("gltf_cycle", f"node {child} has two parents or is its own")
            parent[child] = i
    world: dict[int, Floats] = {}
    order: list[int] = []
    stack = [(i, np.eye(4), 0) for i in reversed(range(len(nodes))) if i not in parent]
    while stack:
        i, above, depth = stack.pop()
        if depth > _MAX_DEPTH:
            raise gltf_error("gltf_cycle", f"the nodes are nested deeper than {_MAX_DEPTH}")
        world[i] = above @ _local(nodes[i], i)
        order.append(i)
        stack += [(c, world[i], depth + 1) for c in reversed(nodes[i].get("children", []))]
    if len(world) < len(nodes):
        raise gltf_error("gltf_cycle", f"node {min(set(range(len(nodes))) - set(world))} is its own ancestor")
    scenes = document.items("scenes")
    if not scenes:
        return world, order
    scene = document.item("scenes", document.json.get("scene", 0))
    members: set[int] = set()
    todo = list(scene.get("nodes", []))
    for i in todo:
        document.item("nodes", i)
    while todo:
        i = todo.pop()
        members.add(i)
        todo += nodes[i].get("children", [])
    hidden = sum("mesh" in nodes[i] for i in order if i not in members)
    if hidden and any("mesh" in nodes[i] for i in members):
        notes.append(f"left out {hidden} mesh nodes that are not in the default scene")
    elif hidden:
        notes.append("the default scene shows no mesh; took all nodes")
        return world, order
    return world, [i for i in order if i in members]


def _local(node: dict[str, Any], index: int) -> Floats:
    """4 x 4 local transform of a node."""

    def numbers(key: str, size: int, default: list[float]) -> Floats:
        value = np.asarray(node.get(key, default), dtype=object)
        try:
            found = value.astype(np.float64)
        except (ValueError, TypeError):
            found = np.full(0, np.nan)
        if found.shape != (size,) or not np.isfinite(found).all():
            raise gltf_error("gltf_invalid", f"'{key}' of node {index} is not {size} numbers")
        return found

    if "matrix" in node:
        return numbers("matrix", 16, []).reshape(4, 4).T
    x, y, z, w = numbers("rotation", 4, [0, 0, 0, 1])
    length = x * x + y * y + z * z + w * w
    s = 2.0 / length if length > 0 else 0.0
    rotation = np.array(
        [
            [1 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)],
            [s * (x * y + z * w), 1 - s * (x * x + z * z), s * (y * z - x * w)],
            [s * (x * z - y * w), s * (y * z + x * w), 1 - s * (x * x + y * y)],
        ]
    )
    matrix = np.eye(4)
    matrix[:3, :3] = rotation * numbers("scale", 3, [1, 1, 1])
    matrix[:3, 3] = numbers("translation", 3, [0, 0, 0])
    return matrix


def _placements(document: GltfDocument, scene: list[int], notes: list[str]) -> Iterator[tuple[int | None, int]]:
    """(node, mesh) pairs that are shown."""
    nodes = document.items("nodes")
    if not any("mesh" in node for node in nodes):
        if document.items("meshes"):
            notes.append("no node shows a mesh; took all meshes where they stand")
        for mesh in range(len(document.items("meshes"))):
            yield None, mesh
        return
    for i in scene:
        if "mesh" in nodes[i]:
            if "EXT_mesh_gpu_instancing" in nodes[i].get("extensions", {}):
                notes.append(f"node {i} is instanced by EXT_mesh_gpu_instancing; read it once")
            yield i, nodes[i]["mesh"]


def _piece(
    document: GltfDocument,
    world: dict[int, Floats],
    node_index: int | None,
    where: tuple[int, int],
    primitive: dict[str, Any],
    notes: list[str],
) -> _Piece | None:
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
    _refuse_compressed(document, primitive, attributes["POSITION"], owner)
    positions = attribute(document, attributes, "POSITION", 3, None, owner).astype(np.float64)
    normals = attribute(document, attributes, "NORMAL", 3, len(positions), owner) if "NORMAL" in attributes else None
    material = primitive.get("material")
    uvs = _uvs(document, attributes, material, len(positions), owner, notes)
    node = document.item("nodes", node_index) if node_index is not None else {}
    weights = node.get("weights", document.item("meshes", where[0]).get("weights", []))
    positions, normals = morphed(document, primitive, weights, positions, normals, owner)
    if node_index is not None and "skin" in node and "JOINTS_0" in attributes:
        matrices = skinning(document, world, node["skin"], attributes, len(positions), owner)
    else:
        matrices = (world[node_index] if node_index is not None else np.eye(4))[None]
    faces = _faces(document, primitive, mode, len(positions), owner, notes)
    if not len(faces):
        return None
    positions = (
        np.einsum("nij,nj->ni", matrices[:, :3, :3], positions) + matrices[:, :3, 3]
        if len(matrices) > 1
        else (positions @ matrices[0, :3, :3].T + matrices[0, :3, 3])
    )
    if not np.isfinite(positions).all():
        raise gltf_error("nan", f"POSITION of {owner} is not finite once placed")
    if normals is not None:
        normals = turned(normals, matrices)
    if np.median(np.linalg.det(matrices[:: max(1, len(matrices) // 1000), :3, :3])) < 0:
        faces = faces[:, [0, 2, 1]]  # a mirrored node turns triangles inside out; glTF says to flip the winding back
    name = node.get("name") or document.item("meshes", where[0]).get("name") or "mesh"
    return _Piece(str(name), node_index, where, material, positions, normals, uvs, faces)


def _refuse_compressed(document: GltfDocument, primitive: dict[str, Any], position: int, owner: str) -> None:
    accessor = document.item("accessors", position)
    view = document.item("bufferViews", accessor["bufferView"]) if "bufferView" in accessor else {}
    for name, where in (("KHR_draco_mesh_compression", primitive), ("EXT_meshopt_compression", view)):
        if name in where.get("extensions", {}) and (where is view or "bufferView" not in accessor):
            raise gltf_error(
                "gltf_extension", f"{owner} is compressed with {name}", "export the mesh without compression"
            )
    if "bufferView" not in accessor and "sparse" not in accessor:
        raise gltf_error("gltf_invalid", f"POSITION of {owner} holds no data")


def _uvs(
    document: GltfDocument, attributes: dict[str, Any], material: Any, count: int, owner: str, notes: list[str]
) -> Floats | None:
    """The texture coordinates that the material's base colour reads."""
    texture: Any = {}
    if material is not None:
        found = document.item("materials", material)
        texture = found.get("pbrMetallicRoughness", {}).get("baseColorTexture", {})
    if texture.get("extensions", {}).get("KHR_texture_transform"):
        notes.append(f"{owner}: KHR_texture_transform of the old base colour is not applied")
    name = f"TEXCOORD_{texture.get('texCoord', 0)}"
    if name not in attributes and "TEXCOORD_0" in attributes:
        notes.append(f"{owner} has no {name}; took TEXCOORD_0")
        name = "TEXCOORD_0"
    if name not in attributes:
        return None
    return attribute(document, attributes, name, 2, count, owner).astype(np.float64)


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
