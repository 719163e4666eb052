"""The input glTF document with new materials: everything that painting does not touch stays as it was."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from paintit._version import __version__
from paintit.errors import OutputError
from paintit.export.gltf_assembly import SAMPLER, Assembly
from paintit.export.gltf_geometry import PaintedPrimitive, write_primitive
from paintit.export.gltf_new import add_textures
from paintit.export.gltf_prune import prune, texture_infos, variant_mappings
from paintit.export.gltf_source import (
    corner_vertices,
    file_of,
    layer_parts,
    layer_uv,
    material_of,
    onto_layer,
    primitive_of,
    texture_pixels,
)
from paintit.export.image import Bytes8, EncodedMaps, layer_suffixes
from paintit.mesh.gltf_document import GltfDocument
from paintit.mesh.gltf_texcoord import SPECULAR_GLOSSINESS, TRANSFORM, color_info, texcoord_of
from paintit.mesh.gltf_uri import resolve
from paintit.mesh.mesh import Mesh, Part

#: Extensions under which a viewer would show something else than the metallic-roughness textures.
OVERRIDING = (SPECULAR_GLOSSINESS, "KHR_materials_unlit")


def repaint_document(
    document: GltfDocument, mesh: Mesh, encoded: list[EncodedMaps], metadata: dict[str, Any]
) -> Assembly:
    """The document with the painted layers' materials and, where needed, vertices replaced.

    Kept as they are: nodes, skins, animations, morph targets, cameras, extras, occlusion and emissive textures, alpha
    mode, sidedness, other UV sets, a skinned mesh's bind-space positions, and all of the layers that are not painted.
    """
    views = [document.view(i) for i in range(len(document.items("bufferViews")))]
    assembly = Assembly(copy.deepcopy(document.json), views)
    if "EXT_meshopt_compression" in assembly.json.get("extensionsUsed", []):
        raise OutputError(
            "output.compressed",
            "the input document uses EXT_meshopt_compression",
            "export the input without compression, or write an .obj",
        )
    notes: list[str] = []
    painted = _painted(document, mesh, assembly)
    for layer, (suffix, images) in enumerate(zip(layer_suffixes(mesh), encoded, strict=True)):
        mine = [p for p in painted if p.part.layer == layer]
        if mine and mesh.layers[layer].painted:
            alpha = _alpha(document, mesh, layer, (images.base_color.shape[0], images.base_color.shape[1]))
            uv_set = _uv_set(document, mesh, layer, mine)
            uv_info = _uv_info(document, mesh, layer, uv_set)
            _write_material(assembly, mesh, layer, mine, suffix, images, alpha, uv_info, notes)
            for primitive in mine:
                write_primitive(assembly, document, mesh, primitive, uv_set)
    asset = assembly.json["asset"]
    record = dict(metadata)
    if "generator" in asset:
        record["source_generator"] = asset["generator"]
    if notes:
        record["notes"] = notes
    asset["generator"] = f"paintit {__version__}"
    asset["extras"] = (asset["extras"] if isinstance(asset.get("extras"), dict) else {}) | {"paintit": record}
    prune(assembly, document.json)
    _keep_images(assembly, document)
    return assembly


def _keep_images(assembly: Assembly, document: GltfDocument) -> None:
    """Read the images that stay and lie in files or data URIs: the output may stand elsewhere."""
    for index, image in enumerate(assembly.json.get("images", [])):
        if "uri" in image:
            data = resolve(image["uri"], document.base, f"image {index}", document.limits)
            assembly.kept[index] = (file_of(image["uri"]), data)


def _painted(document: GltfDocument, mesh: Mesh, assembly: Assembly) -> list[PaintedPrimitive]:
    """One entry per primitive to rewrite. Nodes that share a glTF mesh but have different UVs now get copies of it."""
    by_instance: dict[tuple[int, int | None], list[Part]] = {}
    for part in mesh.parts:
        if part.primitive is not None:
            by_instance.setdefault((part.primitive[0], part.node), []).append(part)
    out: list[PaintedPrimitive] = []
    variants: dict[int, list[tuple[list[Part], int]]] = {}
    for (source, node), parts in by_instance.items():
        known = variants.setdefault(source, [])
        target = next((index for other, index in known if _alike(mesh, parts, other)), None)
        if target is None:
            target = source
            if known:
                target = assembly.append("meshes", copy.deepcopy(document.json["meshes"][source]))
            known.append((parts, target))
            out += [
                PaintedPrimitive(part, target, assembly.json["meshes"][target]["primitives"][part.primitive[1]])
                for part in parts
                if part.primitive is not None
            ]
        if target != source and node is not None:
            assembly.json["nodes"][node]["mesh"] = target
    return out


def _alike(mesh: Mesh, parts: list[Part], others: list[Part]) -> bool:
    """Two instances of a glTF mesh have the same faces with the same UVs and layers, be one of them mirrored."""

    def same_faces(a: Part, b: Part) -> bool:
        pairs = (
            (corner_vertices(mesh, a), corner_vertices(mesh, b)),
            (mesh.corner_uvs[slice(*a.faces)], mesh.corner_uvs[slice(*b.faces)]),
        )
        return any(all(np.array_equal(x[:, order], y) for x, y in pairs) for order in ([0, 1, 2], [0, 2, 1]))

    key = lambda part: part.primitive or (0, 0)  # noqa: E731
    pairs = list(zip(sorted(parts, key=key), sorted(others, key=key), strict=False))
    return len(parts) == len(others) and all(
        a.primitive == b.primitive and a.layer == b.layer and same_faces(a, b) for a, b in pairs
    )


def _alpha(document: GltfDocument, mesh: Mesh, layer: int, size: tuple[int, int]) -> Bytes8 | None:
    """(h, w) original alpha in the mesh's UVs; None where the material is opaque or its texture has no transparency."""
    material = material_of(document, mesh, layer)
    info = color_info(material)
    if material.get("alphaMode", "OPAQUE") == "OPAQUE" or info is None:
        return None
    pixels = texture_pixels(document, info)
    if pixels is None or bool((pixels[..., 3] == 1.0).all()):
        return None
    alpha = onto_layer(document, mesh, layer, info, pixels[..., 3:], size)[..., 0]
    return np.floor(alpha.clip(0, 1) * 255.0 + 0.5).astype(np.uint8)


def _kept_infos(material: dict[str, Any]) -> list[dict[str, Any]]:
    """Texture infos that stay in the material: all but those that the painting replaces."""
    rest = {k: v for k, v in material.items() if k not in ("pbrMetallicRoughness", "normalTexture")}
    rest["extensions"] = {k: v for k, v in material.get("extensions", {}).items() if k not in OVERRIDING}
    return list(texture_infos(rest))


def _uv_set(document: GltfDocument, mesh: Mesh, layer: int, painted: list[PaintedPrimitive]) -> tuple[int, bool]:
    """(UV set for the new textures, whether it must be written).

    The file's own set where the mesh is painted in it; else set 0, unless a texture that stays needs the old one: then
    the first set after those there are.
    """
    material = material_of(document, mesh, layer)
    info = color_info(material) or {}
    own = texcoord_of(info)
    present = [_uv_sets(primitive_of(document, part)) for part in layer_parts(mesh, layer)]
    if own < min(present) and any(layer_uv(document, mesh, layer, i).same for i in ({"texCoord": own}, info)):
        return own, False
    others = {m["material"] for p in painted for m in variant_mappings(p.json)} - {mesh.layers[layer].source_index}
    kept = [*_kept_infos(material), *(i for m in others for i in texture_infos(document.json["materials"][m]))]
    if not kept or max(present) == 0:
        return 0, True
    return max(_uv_sets(p.json) for p in painted), True


def _uv_info(document: GltfDocument, mesh: Mesh, layer: int, uv_set: tuple[int, bool]) -> dict[str, Any]:
    """Members that new texture infos share: the UV set, and the transform that the mesh is painted through, if any."""
    index, written = uv_set
    found = {"texCoord": index} if index else {}
    if written or layer_uv(document, mesh, layer, {"texCoord": index}).same:
        return found
    transform = (color_info(material_of(document, mesh, layer)) or {})["extensions"][TRANSFORM]
    return found | {"extensions": {TRANSFORM: {k: v for k, v in transform.items() if k != "texCoord"}}}


def _uv_sets(primitive: dict[str, Any]) -> int:
    return sum(name.startswith("TEXCOORD_") for name in primitive["attributes"])


def _write_material(
    assembly: Assembly,
    mesh: Mesh,
    layer: int,
    painted: list[PaintedPrimitive],
    suffix: str,
    images: EncodedMaps,
    alpha: NDArray[np.uint8] | None,
    uv_info: dict[str, Any],
    notes: list[str],
) -> None:
    """Put the layer's textures into its material; a material that others use too is copied first."""
    json = assembly.json
    index = mesh.layers[layer].source_index
    mine = {id(p.json) for p in painted}
    strangers = [p for m in json["meshes"] for p in m["primitives"] if id(p) not in mine]
    shared = any(index in (p.get("material"), *(m["material"] for m in variant_mappings(p))) for p in strangers)
    if index is None:
        index = assembly.append("materials", {"name": mesh.layers[layer].name})
    elif shared:
        index = assembly.append("materials", copy.deepcopy(json["materials"][index]))
    for primitive in painted:
        primitive.json["material"] = index
        for mapping in variant_mappings(primitive.json):
            if mapping["material"] == mesh.layers[layer].source_index:
                mapping["material"] = index
        if primitive.json.get("extensions", {}).pop("KHR_draco_mesh_compression", None) is not None:
            notes.append("removed KHR_draco_mesh_compression: it holds the old vertices")
    material = json["materials"][index]
    old = material.get("pbrMetallicRoughness", {})
    extensions = material.get("extensions", {})
    opacity = old.get("baseColorFactor", [1.0] * 4)[3]
    opacity = extensions.get(SPECULAR_GLOSSINESS, {}).get("diffuseFactor", [1.0, 1.0, 1.0, opacity])[3]
    for name in OVERRIDING:
        if extensions.pop(name, None) is not None:
            notes.append(f"removed {name} from material '{mesh.layers[layer].name}': it would hide the textures")
    if not extensions:
        material.pop("extensions", None)
    sampler = next((i for i, s in enumerate(json.get("samplers", [])) if s == SAMPLER), None)
    if sampler is None:
        sampler = assembly.append("samplers", dict(SAMPLER))
    textures = add_textures(assembly, suffix, images, sampler, alpha)
    textures = {name: info | copy.deepcopy(uv_info) for name, info in textures.items()}
    kept = {k: v for k, v in old.items() if k in ("extras", "extensions")}
    material["pbrMetallicRoughness"] = kept | {
        "baseColorFactor": [1.0, 1.0, 1.0, opacity],
        "baseColorTexture": textures["base_color"],
        "metallicFactor": 1.0,
        "roughnessFactor": 1.0,
        "metallicRoughnessTexture": textures["orm"],
    }
    material["normalTexture"] = textures["normal"] | {"scale": 1.0}
    _forget_unused_extensions(json)


def _forget_unused_extensions(json: dict[str, Any]) -> None:
    """Take extensions that were removed off the lists once nothing uses them."""
    users = {name for key in ("materials", "meshes") for name in _extension_names(json.get(key, []))}
    ours = (*OVERRIDING, "KHR_texture_transform", "KHR_draco_mesh_compression")
    for key in ("extensionsUsed", "extensionsRequired"):
        if key in json:
            json[key] = [n for n in json[key] if n in users or n not in ours]
            if not json[key]:
                del json[key]


def _extension_names(value: Any) -> set[str]:
    if isinstance(value, dict):
        own = set(value.get("extensions", {})) if isinstance(value.get("extensions"), dict) else set()
        return own.union(*(_extension_names(v) for k, v in value.items() if k != "extras"))
    if isinstance(value, list):
        return set().union(*(_extension_names(v) for v in value))
    return set()
