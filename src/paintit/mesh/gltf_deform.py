"""Vertex attributes of a glTF primitive, and what moves them: morph targets, skins, node transforms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from paintit.mesh.gltf_document import GltfDocument
from paintit.mesh.gltf_schema import gltf_error
from paintit.mesh.mesh import Floats

#: Vertices that are moved at once: a blended matrix is 128 bytes for each.
_BLOCK = 1 << 16


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
    weights: Sequence[float],
    positions: Floats,
    normals: NDArray[Any] | None,
    owner: str,
) -> tuple[Floats, NDArray[Any] | None]:
    """Positions and normals with the morph targets at ``weights``."""
    for target, weight in zip(primitive.get("targets", []), weights, strict=False):
        if weight and "POSITION" in target:
            positions = positions + weight * attribute(document, target, "POSITION", 3, len(positions), owner)
        if weight and "NORMAL" in target and normals is not None:
            normals = normals + np.float32(weight) * attribute(document, target, "NORMAL", 3, len(positions), owner)
    return positions, normals


@dataclass(frozen=True)
class Skin:
    """Joint weights of a primitive's vertices.

    Attributes:
        matrices: (j, 4, 4) world matrix times inverse bind matrix of each joint.
        sets: (n, 4) joint and weight of each vertex, one pair for each JOINTS and WEIGHTS set.
        joints: node of each joint.
    """

    matrices: Floats
    sets: tuple[tuple[NDArray[np.int64], NDArray[Any]], ...]
    joints: tuple[int, ...]

    def blended(self, part: slice) -> Floats:
        """(n, 4, 4) matrices of the vertices in ``part``."""
        blended: Any = 0.0
        total: Any = 0.0
        for index, weight in self.sets:
            for c in range(4):
                blended = blended + weight[part, c, None, None] * self.matrices[index[part, c]]
                total = total + weight[part, c]
        return blended / np.where(total > 0, total, 1.0)[:, None, None]

    def share(self, nodes: frozenset[int]) -> Floats:
        """(n,) share of each vertex's weight that the joints among ``nodes`` have."""
        mine = np.array([joint in nodes for joint in self.joints])
        held = sum((weight * mine[index]).sum(1) for index, weight in self.sets)
        total = sum(weight.sum(1) for _, weight in self.sets)
        return np.asarray(held / np.where(np.asarray(total) > 0, total, 1.0), np.float64)


@dataclass(frozen=True)
class Skins:
    """The skins of a document in one pose; joint matrices are made once for each."""

    document: GltfDocument
    world: dict[int, Floats]
    _matrices: dict[int, Floats] = field(default_factory=dict)

    def of(self, skin: int, attributes: dict[str, Any], count: int, owner: str) -> Skin:
        """The skin numbered ``skin`` on a primitive with ``count`` vertices.

        Raises:
            MeshError: it has no joints, too few matrices, or a vertex names a joint that it has not.
        """
        if skin not in self._matrices:
            self._matrices[skin] = self._joint_matrices(skin)
        joints = self.document.item("skins", skin)["joints"]
        sets = []
        while f"JOINTS_{(k := len(sets))}" in attributes:
            index = attribute(self.document, attributes, f"JOINTS_{k}", 4, count, owner).astype(np.int64)
            if index.min() < 0 or index.max() >= len(joints):
                raise gltf_error("index", f"{owner} uses joint {index.max()} of {len(joints)}")
            weight = np.zeros((count, 4), np.float32)
            if f"WEIGHTS_{k}" in attributes:
                weight = attribute(self.document, attributes, f"WEIGHTS_{k}", 4, count, owner)
            sets.append((index, weight))
        return Skin(self._matrices[skin], tuple(sets), tuple(joints))

    def _joint_matrices(self, index: int) -> Floats:
        skin = self.document.item("skins", index)
        joints = skin.get("joints", [])
        if not joints:
            raise gltf_error("gltf_invalid", f"skin {index} has no joints")
        inverse = np.tile(np.eye(4), (len(joints), 1, 1))
        if "inverseBindMatrices" in skin:
            flat = self.document.accessor(skin["inverseBindMatrices"]).astype(np.float64)
            if flat.shape[1] != 16 or len(flat) < len(joints):
                raise gltf_error(
                    "gltf_invalid", f"skin {index} has {len(flat)} inverse bind matrices for {len(joints)} joints"
                )
            inverse = flat[: len(joints)].reshape(-1, 4, 4).transpose(0, 2, 1)
        return np.stack([self.world[joint] for joint in joints]) @ inverse


def placed(
    positions: Floats, normals: NDArray[Any] | None, by: Floats | Skin
) -> tuple[Floats, NDArray[np.float32] | None, bool]:
    """Positions (n, 3) and normals in world space, and whether that turns most triangles inside out.

    Args:
        positions, normals: in the primitive's own space.
        by: the (4, 4) matrix of its node, or its skin; a skinned node's own transform has no say.
    """
    if not isinstance(by, Skin):
        moved = positions @ by[:3, :3].T + by[:3, 3]
        return moved, turned(normals, by[None]) if normals is not None else None, bool(np.linalg.det(by[:3, :3]) < 0)
    moved = np.empty_like(positions)
    facing = np.empty(positions.shape, np.float32) if normals is not None else None
    signs = []
    for start in range(0, len(positions), _BLOCK):
        part = slice(start, start + _BLOCK)
        matrices = by.blended(part)
        moved[part] = np.einsum("nij,nj->ni", matrices[:, :3, :3], positions[part]) + matrices[:, :3, 3]
        if facing is not None and normals is not None:
            facing[part] = turned(normals[part], matrices)
        signs.append(np.sign(np.linalg.det(matrices[::64, :3, :3])))
    return moved, facing, bool(np.median(np.concatenate(signs)) < 0)


def turned(normals: NDArray[Any], matrices: Floats) -> NDArray[np.float32]:
    """Normals by the inverse transpose; zero where that gives no direction."""
    linear = matrices[:, :3, :3]
    a, b, c = linear[..., 0], linear[..., 1], linear[..., 2]
    # The cofactor matrix is det times the inverse transpose and exists for singular matrices too.
    cofactor = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], -1)
    sign = np.where(np.linalg.det(linear) < 0, -1.0, 1.0)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        result = (
            np.einsum("nij,nj->ni", np.broadcast_to(cofactor, (len(normals), 3, 3)), normals.astype(np.float64))
            * sign[:, None]
        )
        length = np.linalg.norm(result, axis=1, keepdims=True)
        return np.nan_to_num(result / length, nan=0.0, posinf=0.0, neginf=0.0).astype(np.float32)
