"""Playing a glTF file: where every corner of every triangle is at a time, by the book and apart from the package."""

from __future__ import annotations

from typing import Any

import numpy as np
from tests.export.gltf_bytes import Gltf

Floats = np.ndarray


def times(gltf: Gltf, count: int = 5) -> Floats:
    """``count`` times from the first to the last key of all animations."""
    inputs = [gltf.values(s["input"]) for a in gltf.json.get("animations", []) for s in a["samplers"]]
    return np.linspace(min(i.min() for i in inputs), max(i.max() for i in inputs), count)


def corners_at(gltf: Gltf, animation: int, time: float) -> dict[tuple[int, int], Floats]:
    """(node, primitive) -> (n, 3, 3) world positions of the triangles' corners."""
    nodes = _animated(gltf, gltf.json["animations"][animation], time)
    world = _worlds(nodes)
    out: dict[tuple[int, int], Floats] = {}
    for i, node in enumerate(nodes):
        if "mesh" not in node:
            continue
        mesh = gltf.json["meshes"][node["mesh"]]
        weights = node.get("weights", mesh.get("weights", []))
        for k, primitive in enumerate(mesh["primitives"]):
            if primitive.get("mode", 4) < 4:
                continue
            points = gltf.values(primitive["attributes"]["POSITION"])
            for weight, target in zip(weights, primitive.get("targets", []), strict=False):
                points = points + weight * gltf.values(target["POSITION"])
            matrices = joint_matrices(gltf, node["skin"], world) if "skin" in node else None
            blended = _blend(gltf, primitive["attributes"], matrices, len(points)) if matrices is not None else world[i]
            placed = np.einsum("...ij,...j->...i", blended[..., :3, :3], points) + blended[..., :3, 3]
            out[i, k] = placed[gltf.triangles(primitive)]
    return out


def joint_matrices(gltf: Gltf, skin: int, world: Floats) -> Floats:
    """(joints, 4, 4) what the skin's joints do to a vertex in bind space."""
    found = gltf.json["skins"][skin]
    inverse = gltf.values(found["inverseBindMatrices"]).reshape(-1, 4, 4).transpose(0, 2, 1)
    return world[found["joints"]] @ inverse[: len(found["joints"])]


def matrices_at(gltf: Gltf, animation: int, time: float) -> list[Floats]:
    """Joint matrices of every skin."""
    world = _worlds(_animated(gltf, gltf.json["animations"][animation], time))
    return [joint_matrices(gltf, skin, world) for skin in range(len(gltf.json.get("skins", [])))]


def _blend(gltf: Gltf, attributes: dict[str, int], matrices: Floats, count: int) -> Floats:
    blended, k = np.zeros((count, 4, 4)), 0
    while f"JOINTS_{k}" in attributes:
        index = gltf.values(attributes[f"JOINTS_{k}"]).astype(int)
        blended += np.einsum("nc,ncij->nij", gltf.values(attributes[f"WEIGHTS_{k}"]), matrices[index])
        k += 1
    return blended


def _animated(gltf: Gltf, animation: dict[str, Any], time: float) -> list[dict[str, Any]]:
    nodes = [dict(node) for node in gltf.json["nodes"]]
    for channel in animation["channels"]:
        target, sampler = channel["target"], animation["samplers"][channel["sampler"]]
        keys = gltf.values(sampler["input"])[:, 0]
        values = gltf.values(sampler["output"])
        if target["path"] == "weights":
            values = values.reshape(len(keys) * (3 if sampler.get("interpolation") == "CUBICSPLINE" else 1), -1)
        kind = sampler.get("interpolation", "LINEAR")
        nodes[target["node"]][target["path"]] = _sample(keys, values, time, kind, target["path"] == "rotation")
    return nodes


def _sample(keys: Floats, values: Floats, time: float, kind: str, rotation: bool) -> Floats:
    i = int(np.clip(np.searchsorted(keys, time, side="right") - 1, 0, max(len(keys) - 2, 0)))
    span = keys[i + 1] - keys[i] if len(keys) > 1 else 1.0
    s = float(np.clip((time - keys[i]) / span, 0, 1))
    j = min(i + 1, len(keys) - 1)
    if kind == "STEP":
        return values[j if s >= 1 else i]
    if kind == "CUBICSPLINE":
        table = values.reshape(len(keys), 3, -1)
        p, m, q, n = table[i, 1], table[i, 2] * span, table[j, 1], table[j, 0] * span
        out = (2 * s**3 - 3 * s**2 + 1) * p + (s**3 - 2 * s**2 + s) * m
        out = out + (3 * s**2 - 2 * s**3) * q + (s**3 - s**2) * n
        return out / np.linalg.norm(out) if rotation else out
    a, b = values[i], values[j]
    if not rotation:
        return (1 - s) * a + s * b
    dot = float(a @ b)
    b, dot = (b, dot) if dot >= 0 else (-b, -dot)
    angle = np.arccos(min(dot, 1.0))
    if angle < 1e-6:
        return a
    return (np.sin((1 - s) * angle) * a + np.sin(s * angle) * b) / np.sin(angle)


def _worlds(nodes: list[dict[str, Any]]) -> Floats:
    """(nodes, 4, 4)."""
    world = np.stack([_local(node) for node in nodes])
    children = {child for node in nodes for child in node.get("children", [])}
    todo = [i for i in range(len(nodes)) if i not in children]
    while todo:
        i = todo.pop()
        for child in nodes[i].get("children", []):
            world[child] = world[i] @ world[child]
            todo.append(child)
    return world


def _local(node: dict[str, Any]) -> Floats:
    if "matrix" in node:
        return np.array(node["matrix"], float).reshape(4, 4).T
    x, y, z, w = node.get("rotation", (0, 0, 0, 1))
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    out = np.eye(4)
    out[:3, :3] = rotation * np.asarray(node.get("scale", (1, 1, 1)))
    out[:3, 3] = node.get("translation", (0, 0, 0))
    return out
