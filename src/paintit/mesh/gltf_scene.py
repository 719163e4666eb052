"""The node tree of a glTF document: world transforms, what the default scene shows, and how much that is."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from paintit.mesh.gltf_document import GltfDocument
from paintit.mesh.gltf_schema import gltf_error
from paintit.mesh.limits import check_limit
from paintit.mesh.mesh import Floats

_MAX_DEPTH = 512
#: Numbers that may be gathered for each triangle that the limit allows: corners times attributes, morphs and joints.
_WORK_PER_FACE = 48


@dataclass(frozen=True)
class Scene:
    """Where everything stands.

    Attributes:
        nodes: the document's nodes in the chosen pose.
        world: (4, 4) world matrix of each node.
        shown: (node, mesh) pairs to draw, in the order of the tree; node None: the mesh stands where it is.
    """

    nodes: tuple[dict[str, Any], ...]
    world: dict[int, Floats]
    shown: tuple[tuple[int | None, int], ...]


def read_scene(document: GltfDocument, changes: dict[int, dict[str, Any]], notes: list[str]) -> Scene:
    """The default scene.

    Args:
        document: the file.
        changes: members that a pose gives to nodes, by node.
        notes: oddities are added to it.

    Raises:
        MeshError: a cycle, a node with two parents, a tree too deep, a broken transform, or more than the limits allow.
    """
    nodes = tuple(node | changes.get(i, {}) for i, node in enumerate(document.items("nodes")))
    above = _parents(nodes)
    shown = tuple(_placements(document, nodes, _in_scene(document, nodes, list(above), notes), notes))
    _check_size(document, nodes, shown)
    world: dict[int, Floats] = {}
    for i, parent in above.items():
        local = local_matrix(nodes[i], i)
        world[i] = local if parent is None else world[parent] @ local
    return Scene(nodes, world, shown)


def _parents(nodes: tuple[dict[str, Any], ...]) -> dict[int, int | None]:
    """Parent of every node, parents first, in the order of the tree."""
    parent: dict[int, int] = {}
    for i, node in enumerate(nodes):
        for child in node.get("children", []):
            if child in parent or child == i:
                raise gltf_error("gltf_cycle", f"node {child} has two parents or is its own")
            parent[child] = i
    found: dict[int, int | None] = {}
    stack = [(i, 0) for i in reversed(range(len(nodes))) if i not in parent]
    while stack:
        i, depth = stack.pop()
        if depth > _MAX_DEPTH:
            raise gltf_error("gltf_cycle", f"the nodes are nested deeper than {_MAX_DEPTH}")
        found[i] = parent.get(i)
        stack += [(child, depth + 1) for child in reversed(nodes[i].get("children", []))]
    if len(found) < len(nodes):
        raise gltf_error("gltf_cycle", f"node {min(set(range(len(nodes))) - set(found))} is its own ancestor")
    return found


def _in_scene(
    document: GltfDocument, nodes: tuple[dict[str, Any], ...], order: list[int], notes: list[str]
) -> list[int]:
    """The nodes of the default scene, in ``order``."""
    if not document.items("scenes"):
        return order
    scene = document.item("scenes", document.json.get("scene", 0))
    members: set[int] = set()
    todo = list(scene.get("nodes", []))
    while todo:
        i = todo.pop()
        if i not in members:
            members.add(i)
            todo += nodes[i].get("children", [])
    hidden = sum("mesh" in nodes[i] for i in order if i not in members)
    if hidden and any("mesh" in nodes[i] for i in members):
        notes.append(f"left out {hidden} mesh nodes that are not in the default scene")
    elif hidden:
        notes.append("the default scene shows no mesh; took all nodes")
        return order
    return [i for i in order if i in members]


def local_matrix(node: dict[str, Any], index: int) -> Floats:
    """(4, 4) local transform of a node.

    Raises:
        MeshError: its members are not as many finite numbers as they should be.
    """

    def numbers(key: str, size: int, default: list[float]) -> Floats:
        value = np.asarray(node.get(key, default), dtype=object)
        try:
            found = value.astype(np.float64)
        except (ValueError, TypeError, OverflowError):
            found = np.full(0, np.nan)
        if found.shape != (size,) or not np.isfinite(found).all():
            raise gltf_error("gltf_invalid", f"'{key}' of node {index} is not {size} numbers")
        return found

    if "matrix" in node:
        return numbers("matrix", 16, []).reshape(4, 4).T
    x, y, z, w = numbers("rotation", 4, [0, 0, 0, 1]).tolist()
    length = x * x + y * y + z * z + w * w
    if not math.isfinite(length):
        raise gltf_error("gltf_invalid", f"'rotation' of node {index} is not a unit quaternion")
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


def _placements(
    document: GltfDocument, nodes: tuple[dict[str, Any], ...], scene: list[int], notes: list[str]
) -> list[tuple[int | None, int]]:
    """(node, mesh) pairs that are shown."""
    if not any("mesh" in node for node in nodes):
        if document.items("meshes"):
            notes.append("no node shows a mesh; took all meshes where they stand")
        return [(None, mesh) for mesh in range(len(document.items("meshes")))]
    shown: list[tuple[int | None, int]] = []
    for i in scene:
        if "mesh" in nodes[i]:
            if "EXT_mesh_gpu_instancing" in nodes[i].get("extensions", {}):
                notes.append(f"node {i} is instanced by EXT_mesh_gpu_instancing; read it once")
            shown.append((i, nodes[i]["mesh"]))
    return shown


def _check_size(
    document: GltfDocument, nodes: tuple[dict[str, Any], ...], shown: tuple[tuple[int | None, int], ...]
) -> None:
    """Refuse more than the limits before any array is made: a few bytes can show a large mesh a million times."""
    known: dict[tuple[int, int], tuple[int, int, int]] = {}
    primitives = faces = work = 0
    for node, index in shown:
        mesh = document.item("meshes", index)
        weights = (nodes[node] if node is not None else {}).get("weights", mesh.get("weights", []))
        key = (index, sum(map(bool, weights)))
        if key not in known:
            known[key] = _size(document, mesh, key[1])
        primitives += known[key][0]
        faces += known[key][1]
        work += known[key][2]
    check_limit(document.limits, "nodes", primitives, "primitives shown")
    check_limit(document.limits, "faces", faces, "triangles shown")
    check_limit(document.limits, "faces", -(-work // _WORK_PER_FACE), "triangles' worth of vertices, morphs and joints")


def _size(document: GltfDocument, mesh: dict[str, Any], active: int) -> tuple[int, int, int]:
    """Primitives, triangles, and values that have to be gathered for them, by what the accessors say.

    ``active`` morph targets have a weight.
    """
    faces = work = 0
    primitives = mesh.get("primitives", [])
    for primitive in primitives:
        attributes = primitive.get("attributes", {})
        if "POSITION" not in attributes:
            continue
        vertices = document.count(attributes["POSITION"])
        corners = document.count(primitive["indices"]) if "indices" in primitive else vertices
        faces += corners // 3 if primitive.get("mode", 4) == 4 else corners
        joints = sum(name.startswith("JOINTS_") for name in attributes)
        work += vertices * (1 + min(active, len(primitive.get("targets", []))) + 4 * joints) + corners
    return len(primitives), faces, work
