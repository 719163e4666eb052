"""Vertex attributes of a glTF primitive, and what moves them: morph targets, skins, node transforms."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from paintit.mesh.gltf_document import GltfDocument, gltf_error
from paintit.mesh.mesh import Floats


def attribute(
    document: GltfDocument, attributes: dict[str, Any], name: str, width: int, count: int | None, owner: str
) -> NDArray[Any]:
    values = document.accessor(attributes[name])
    if values.shape[1] != width:
        raise gltf_error("gltf_invalid", f"{name} of {owner} has {values.shape[1]} components, not {width}")
    if count is not None and len(values) != count:
        raise gltf_error("gltf_invalid", f"{name} of {owner} has {len(values)} elements for {count} positions")
    if name == "POSITION" and not np.isfinite(values).all():
        row = int(np.flatnonzero(~np.isfinite(values).all(1))[0])
        raise gltf_error("nan", f"vertex {row} of {owner} is not finite: {values[row].tolist()}")
    return values


def morphed(
    document: GltfDocument,
    primitive: dict[str, Any],
    weights: Any,
    positions: Floats,
    normals: NDArray[Any] | None,
    owner: str,
) -> tuple[Floats, NDArray[Any] | None]:
    """Default morph weights applied."""
    for target, weight in zip(primitive.get("targets", []), weights or [], strict=False):
        if weight and "POSITION" in target:
            positions = positions + weight * attribute(document, target, "POSITION", 3, len(positions), owner)
        if weight and "NORMAL" in target and normals is not None:
            normals = normals + np.float32(weight) * attribute(document, target, "NORMAL", 3, len(positions), owner)
    return positions, normals


def skinning(
    document: GltfDocument,
    world: dict[int, Floats],
    skin_index: int,
    attributes: dict[str, Any],
    count: int,
    owner: str,
) -> Floats:
    """(n, 4, 4) joint matrices blended at each vertex, joints at rest. The node's own transform has no say."""
    skin = document.item("skins", skin_index)
    joints = skin.get("joints", [])
    for joint in joints:
        document.item("nodes", joint)
    if not joints:
        raise gltf_error("gltf_invalid", f"skin {skin_index} has no joints")
    inverse = np.tile(np.eye(4), (len(joints), 1, 1))
    if "inverseBindMatrices" in skin:
        flat = document.accessor(skin["inverseBindMatrices"]).astype(np.float64)
        if flat.shape[1] != 16 or len(flat) < len(joints):
            raise gltf_error(
                "gltf_invalid", f"skin {skin_index} has {len(flat)} inverse bind matrices for {len(joints)} joints"
            )
        inverse = flat[: len(joints)].reshape(-1, 4, 4).transpose(0, 2, 1)
    matrices = np.stack([world[j] for j in joints]) @ inverse
    blended, total, k = np.zeros((count, 4, 4)), np.zeros(count), 0
    while f"JOINTS_{k}" in attributes:
        index = attribute(document, attributes, f"JOINTS_{k}", 4, count, owner).astype(np.int64)
        weight = (
            attribute(document, attributes, f"WEIGHTS_{k}", 4, count, owner)
            if f"WEIGHTS_{k}" in attributes
            else np.zeros((count, 4))
        )
        if index.max() >= len(joints):
            raise gltf_error("index", f"{owner} uses joint {index.max()} of {len(joints)}")
        for c in range(4):
            blended += weight[:, c, None, None] * matrices[index[:, c]]
            total += weight[:, c]
        k += 1
    total = np.where(total > 0, total, 1.0)
    return blended / total[:, None, None]


def turned(normals: NDArray[Any], matrices: Floats) -> NDArray[np.float32]:
    """Normals by the inverse transpose; zero where that gives no direction."""
    linear = matrices[:, :3, :3]
    a, b, c = linear[..., 0], linear[..., 1], linear[..., 2]
    # The cofactor matrix is det times the inverse transpose and exists for singular matrices too.
    cofactor = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], -1)
    sign = np.where(np.linalg.det(linear) < 0, -1.0, 1.0)
    result = (
        np.einsum("nij,nj->ni", np.broadcast_to(cofactor, (len(normals), 3, 3)), normals.astype(np.float64))
        * sign[:, None]
    )
    length = np.linalg.norm(result, axis=1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.nan_to_num(result / length, nan=0.0, posinf=0.0, neginf=0.0).astype(np.float32)
