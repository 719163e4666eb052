"""A new glTF document from a mesh that came without one (OBJ, PLY, STL, OFF)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from paintit._version import __version__
from paintit.export.gltf_assembly import SAMPLER, Assembly
from paintit.export.image import EncodedMaps, layer_suffixes, png_bytes
from paintit.export.vertices import split_corners
from paintit.mesh.mesh import Mesh, Part
from paintit.texture.fixed import GREY

#: Beyond this many extents from the origin, float32 positions would lose more than about 1/10000 of the mesh's size.
FAR_ORIGIN = 1000.0


def add_textures(
    assembly: Assembly, suffix: str, encoded: EncodedMaps, sampler: int, alpha: Any = None
) -> dict[str, dict[str, int]]:
    """The three textures of a layer; ``alpha`` (h, w) uint8 becomes the fourth channel of the base colour.

    Returns:
        glTF texture infos under ``base_color``, ``orm``, ``normal``.
    """
    base = encoded.base_color if alpha is None else np.concatenate([encoded.base_color, alpha[..., None]], -1)
    images = {"base_color": base, "orm": encoded.orm, "normal": encoded.normal}
    return {
        name: {"index": assembly.add_texture(f"{name}{suffix}", png_bytes(pixels), sampler)}
        for name, pixels in images.items()
    }


def unit(vectors: NDArray[np.floating[Any]], fallback: tuple[float, float, float]) -> NDArray[np.float32]:
    """Rows normalised in float64; rows without a direction become ``fallback``."""
    wide = np.nan_to_num(np.asarray(vectors, np.float64), nan=0.0, posinf=0.0, neginf=0.0)
    length = np.linalg.norm(wide, axis=-1, keepdims=True)
    return np.where(length > 1e-12, wide / np.maximum(length, 1e-12), fallback).astype(np.float32)


def clean_tangents(tangents: NDArray[np.floating[Any]]) -> NDArray[np.float32]:
    """(..., 4) with xyz unit and w exactly +-1, as the validator demands."""
    sign = np.where(tangents[..., 3:] < 0, -1.0, 1.0).astype(np.float32)
    return np.concatenate([unit(tangents[..., :3], (1.0, 0.0, 0.0)), sign], -1)


def _objects(mesh: Mesh, fallback: str) -> list[tuple[str, NDArray[np.int64]]]:
    """(object name, its faces), in order of first appearance; faces outside every part come last."""
    parts = mesh.parts or (Part(fallback, (0, len(mesh.faces)), 0),)
    faces: dict[str, list[NDArray[np.int64]]] = {}
    loose = np.ones(len(mesh.faces), bool)
    for part in parts:
        faces.setdefault(part.name or fallback, []).append(np.arange(*part.faces, dtype=np.int64))
        loose[part.faces[0] : part.faces[1]] = False
    if loose.any():
        faces.setdefault(fallback, []).append(np.flatnonzero(loose).astype(np.int64))
    return [(name, np.concatenate(runs)) for name, runs in faces.items()]


def _origin(mesh: Mesh) -> NDArray[np.float64]:
    """Where the nodes stand: the file's origin, or the mesh's own centre where float32 would blur the vertices."""
    far = float(np.abs(mesh.bounds).max()) > FAR_ORIGIN * max(mesh.extent, 1e-300)
    return mesh.center if far else np.zeros(3)


def new_document(mesh: Mesh, encoded: list[EncodedMaps], metadata: dict[str, Any]) -> Assembly:
    """A node and mesh per object of the file, a primitive per material in it; float32 in the file's own coordinates."""
    stem = mesh.source.path.stem if mesh.source else "mesh"
    assembly = Assembly(
        {
            "asset": {"version": "2.0", "generator": f"paintit {__version__}", "extras": {"paintit": metadata}},
            "scene": 0,
            "scenes": [{"nodes": []}],
            "nodes": [],
            "meshes": [],
        }
    )
    sampler = assembly.append("samplers", dict(SAMPLER))
    for layer, suffix, images in zip(mesh.layers, layer_suffixes(mesh), encoded, strict=True):
        if not layer.painted:
            assembly.append("materials", {"name": layer.name, "pbrMetallicRoughness": _factors(), "doubleSided": True})
            continue
        textures = add_textures(assembly, suffix, images, sampler)
        assembly.append(
            "materials",
            {
                "name": layer.name,
                "pbrMetallicRoughness": {
                    "baseColorFactor": [1.0, 1.0, 1.0, 1.0],
                    "baseColorTexture": textures["base_color"],
                    "metallicFactor": 1.0,
                    "roughnessFactor": 1.0,
                    "metallicRoughnessTexture": textures["orm"],
                },
                "normalTexture": textures["normal"] | {"scale": 1.0},
                "doubleSided": True,  # such files say nothing of sides, and their faces may be turned away
            },
        )
    origin = _origin(mesh)
    for name, faces in _objects(mesh, stem):
        primitives = [
            _primitive(assembly, mesh, faces[mesh.face_layer[faces] == layer], layer, origin)
            for layer in np.unique(mesh.face_layer[faces])
        ]
        index = assembly.append("meshes", {"name": name, "primitives": primitives})
        node: dict[str, Any] = {"name": name, "mesh": index}
        if origin.any():
            node["translation"] = origin.tolist()
        assembly.json["scenes"][0]["nodes"].append(assembly.append("nodes", node))
    return assembly


def _factors() -> dict[str, Any]:
    """The grey that an unpainted layer of such a file is shown in while the others are painted."""
    red, green, blue, roughness, metallic, *_ = GREY
    return {"baseColorFactor": [red, green, blue, 1.0], "metallicFactor": metallic, "roughnessFactor": roughness}


def _primitive(
    assembly: Assembly, mesh: Mesh, faces: NDArray[np.int64], layer: int, origin: NDArray[np.float64]
) -> dict[str, Any]:
    position = (mesh.vertices[mesh.faces[faces]] - origin).astype(np.float32)
    uv = mesh.corner_uvs[faces].astype(np.float32)
    normal = unit(mesh.normals[faces], (0.0, 0.0, 1.0))
    tangent = clean_tangents(mesh.tangents[faces])
    # Viewers turn the normal of a triangle whose back they see, and tell its back by its winding: where a file's
    # winding contradicts its normals, the normals are believed.
    across = np.cross(position[:, 1] - position[:, 0], position[:, 2] - position[:, 0])
    turned = (across * normal.sum(1)).sum(-1) < 0
    for corners in (position, uv, normal, tangent):
        corners[turned] = corners[turned][:, ::-1]
    split = split_corners([position, uv, normal, tangent])
    pick = lambda values: values.reshape(-1, values.shape[-1])[split.corner]  # noqa: E731
    return {
        "attributes": {
            "POSITION": assembly.add_attribute(pick(position), bounds=True),
            "NORMAL": assembly.add_attribute(pick(normal)),
            "TANGENT": assembly.add_attribute(pick(tangent)),
            "TEXCOORD_0": assembly.add_attribute(pick(uv)),
        },
        "indices": assembly.add_indices(split.indices),
        "material": int(layer),
    }
