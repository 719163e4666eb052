"""Dropping what nothing refers to any more, so that painting a file again does not make it grow."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from paintit.export.gltf_assembly import Assembly

#: Extensions whose references to textures, images, accessors and buffer views the walks below know.
KNOWN = frozenset(
    {
        "KHR_animation_pointer",
        "KHR_lights_punctual",
        "KHR_materials_anisotropy",
        "KHR_materials_clearcoat",
        "KHR_materials_diffuse_transmission",
        "KHR_materials_dispersion",
        "KHR_materials_emissive_strength",
        "KHR_materials_ior",
        "KHR_materials_iridescence",
        "KHR_materials_pbrSpecularGlossiness",
        "KHR_materials_sheen",
        "KHR_materials_specular",
        "KHR_materials_transmission",
        "KHR_materials_unlit",
        "KHR_materials_variants",
        "KHR_materials_volume",
        "KHR_mesh_quantization",
        "KHR_texture_basisu",
        "KHR_texture_transform",
        "KHR_xmp_json_ld",
        "EXT_texture_webp",
        "EXT_mesh_gpu_instancing",
        "MSFT_texture_dds",
    }
)

Reference = tuple[Any, Any]
"""A container and the key or index in it under which another object's index stands."""


def walk(value: Any, key: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """(key it stands under, dict) of every dict in a JSON value, extras left out."""
    if isinstance(value, dict):
        yield key, value
        for name, child in value.items():
            if name != "extras":
                yield from walk(child, name)
    elif isinstance(value, list):
        for child in value:
            yield from walk(child, key)


def texture_infos(material: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Every texture info of a material, those of its extensions too."""
    for key, value in walk(material):
        if key.endswith("Texture") and "index" in value:
            yield value


def variant_mappings(primitive: dict[str, Any]) -> list[dict[str, Any]]:
    """The primitive's other materials (KHR_materials_variants)."""
    return primitive.get("extensions", {}).get("KHR_materials_variants", {}).get("mappings", [])


def _textures(json: dict[str, Any]) -> Iterator[Reference]:
    for material in json.get("materials", []):
        for info in texture_infos(material):
            yield info, "index"


def _images(json: dict[str, Any]) -> Iterator[Reference]:
    for _, value in walk(json.get("textures", [])):
        if "source" in value:
            yield value, "source"


def _samplers(json: dict[str, Any]) -> Iterator[Reference]:
    for texture in json.get("textures", []):
        if "sampler" in texture:
            yield texture, "sampler"


def _accessors(json: dict[str, Any]) -> Iterator[Reference]:
    for mesh in json.get("meshes", []):
        for primitive in mesh["primitives"]:
            for attributes in [primitive["attributes"], *primitive.get("targets", [])]:
                yield from ((attributes, name) for name in attributes)
            if "indices" in primitive:
                yield primitive, "indices"
    for skin in json.get("skins", []):
        if "inverseBindMatrices" in skin:
            yield skin, "inverseBindMatrices"
    for animation in json.get("animations", []):
        for sampler in animation["samplers"]:
            yield sampler, "input"
            yield sampler, "output"
    for node in json.get("nodes", []):
        instancing = node.get("extensions", {}).get("EXT_mesh_gpu_instancing", {}).get("attributes", {})
        yield from ((instancing, name) for name in instancing)


def _views(json: dict[str, Any]) -> Iterator[Reference]:
    for _, value in walk({key: json.get(key, []) for key in ("accessors", "images")}):
        if isinstance(value.get("bufferView"), int):
            yield value, "bufferView"


def _drop(
    json: dict[str, Any],
    source: dict[str, Any],
    key: str,
    references: Callable[[dict[str, Any]], Iterator[Reference]],
) -> dict[int, int]:
    """Remove items of ``json[key]`` that nothing refers to and renumber; old index -> new index of those kept.

    What nothing referred to in the ``source`` either is kept: it is not for us to tidy up.
    """
    idle = set(range(len(source.get(key, [])))) - {holder[name] for holder, name in references(source)}
    used = idle | {holder[name] for holder, name in references(json)}
    kept = [i for i in range(len(json.get(key, []))) if i in used]
    number = {old: new for new, old in enumerate(kept)}
    # A dict may be reached twice (an object shared in memory), so each reference is renumbered once.
    for holder, name in list({(id(h), n): (h, n) for h, n in references(json)}.values()):
        holder[name] = number[holder[name]]
    if kept:
        json[key] = [json[key][i] for i in kept]
    else:
        json.pop(key, None)
    return number


def prune(assembly: Assembly, source: dict[str, Any]) -> None:
    """Drop textures, images, samplers, accessors and buffer views that lost their last reference, in place.

    ``source`` is the JSON of the document that ``assembly`` began as; what was added stands behind what was there.

    A document with an extension that is not in :data:`KNOWN` is left whole: it may refer to anything.
    """
    json = assembly.json
    if not set(json.get("extensionsUsed", [])) <= KNOWN:
        return
    _drop(json, source, "textures", _textures)
    images = _drop(json, source, "images", _images)
    assembly.pngs = {images[old]: value for old, value in assembly.pngs.items()}
    _drop(json, source, "samplers", _samplers)
    _drop(json, source, "accessors", _accessors)
    views = _drop(json, source, "bufferViews", _views)
    assembly.views = [assembly.views[old] for old in sorted(views)]
