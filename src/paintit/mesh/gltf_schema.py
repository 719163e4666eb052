"""The JSON types of the glTF members that are read here, so that nothing further in has to doubt them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from paintit.errors import MeshError

#: Nesting of the JSON; real documents stay below 20. What walks or copies it later may then recurse.
MAX_DEPTH = 100

KINDS: dict[str, dict[str, type]] = {
    "": {
        "scenes": list,
        "nodes": list,
        "meshes": list,
        "materials": list,
        "textures": list,
        "images": list,
        "samplers": list,
        "accessors": list,
        "bufferViews": list,
        "buffers": list,
        "skins": list,
        "animations": list,
        "cameras": list,
        "extensionsRequired": list,
        "extensionsUsed": list,
    },
    "scenes": {"nodes": list},
    "nodes": {"children": list, "weights": list},
    "meshes": {"primitives": list, "weights": list},
    "primitives": {"attributes": dict, "targets": list, "mode": int},
    "materials": {
        "pbrMetallicRoughness": dict,
        "normalTexture": dict,
        "occlusionTexture": dict,
        "emissiveTexture": dict,
        "alphaMode": str,
    },
    "pbrMetallicRoughness": {"baseColorTexture": dict, "metallicRoughnessTexture": dict},
    "baseColorTexture": {"texCoord": int},
    "metallicRoughnessTexture": {"texCoord": int},
    "normalTexture": {"texCoord": int},
    "occlusionTexture": {"texCoord": int},
    "emissiveTexture": {"texCoord": int},
    "textures": {},
    "images": {},
    "samplers": {},
    "accessors": {"sparse": dict, "type": str, "componentType": int},
    "sparse": {"indices": dict, "values": dict},
    "indices": {"componentType": int},
    "values": {},
    "skins": {"joints": list},
    "animations": {"channels": list, "samplers": list},
    "channels": {"target": dict},
    "target": {},
    "cameras": {},
    "bufferViews": {},
    "buffers": {},
    "targets": {},
}
"""JSON type of the members that are read here, by the name of their owner; every owner may also have ``extensions``."""

_NUMBERS: dict[str, dict[str, int]] = {
    "materials": {"emissiveFactor": 3},
    "pbrMetallicRoughness": {"baseColorFactor": 4, "metallicFactor": 0, "roughnessFactor": 0},
    "normalTexture": {"scale": 0},
    "KHR_texture_transform": {"offset": 2, "scale": 2, "rotation": 0},
    "KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": 4, "glossinessFactor": 0},
}
"""Members that are numbers: how many in a list, 0 for a bare one."""


def check_types(owner: Any, name: str) -> None:
    """Refuse a document whose members have another JSON type than the format says."""
    if not isinstance(owner, dict):
        raise gltf_error("gltf_invalid", f"an entry of '{name}' is not an object")
    for key, kind in {**KINDS[name], "extensions": dict}.items():
        if key not in owner:
            continue
        value: Any = owner[key]
        if not isinstance(value, kind) or isinstance(value, bool):
            raise gltf_error("gltf_invalid", f"'{key}' is {short(value)}, which is of the wrong type")
        if key == "extensions":
            if not all(isinstance(v, dict) for v in value.values()):
                raise gltf_error("gltf_invalid", "an entry of 'extensions' is not an object")
            for extension, content in value.items():
                _check_numbers(content, extension)
        if key == "weights" and not all(isinstance(w, int | float) for w in value):
            raise gltf_error("gltf_invalid", f"'weights' is {short(value)}, not numbers")
        if key in ("extensionsUsed", "extensionsRequired") and not all(isinstance(n, str) for n in value):
            raise gltf_error("gltf_invalid", f"'{key}' is {short(value)}, not names")
        # Indices of nodes, buffer views and accessors stand under the names of what they point to.
        if key in KINDS and not (key == "nodes" and name == "scenes"):
            for entry in value if kind is list else [value]:
                check_types(entry, key)
    _check_numbers(owner, name)


def _check_numbers(owner: dict[str, Any], name: str) -> None:
    for key, count in _NUMBERS.get(name, {}).items():
        value = owner.get(key, [0] * count if count else 0)
        numbers = value if isinstance(value, list) and count else [value]
        if len(numbers) != max(count, 1) or not all(type(n) in (int, float) for n in numbers):
            wanted = f"{count} numbers" if count else "a number"
            raise gltf_error("gltf_invalid", f"'{key}' of '{name}' is {short(value)}, not {wanted}")


def check_values(document: dict[str, Any]) -> None:
    """Refuse what could not be written back: nesting beyond ``MAX_DEPTH``, infinite numbers, broken text."""
    level: list[Any] = [document]
    for _ in range(MAX_DEPTH):
        inner: list[Any] = []
        for holder in level:
            if isinstance(holder, dict):
                _check_text(*holder)
                holder = holder.values()
            for value in holder:
                if isinstance(value, dict | list):
                    inner.append(value)
                elif isinstance(value, str):
                    _check_text(value)
                elif isinstance(value, float) and not math.isfinite(value):
                    raise gltf_error("gltf_invalid", "the JSON of the file holds a number beyond all bounds")
        if not inner:
            return
        level = inner
    raise gltf_error("gltf_invalid", f"the JSON of the file is nested deeper than {MAX_DEPTH}")


def _check_text(*texts: str) -> None:
    for text in texts:
        if not text.isascii() and any("\ud800" <= c <= "\udfff" for c in text):
            raise gltf_error("gltf_invalid", f"the JSON of the file holds broken text ({plain(text)})")


def check_references(document: dict[str, Any]) -> None:
    """Refuse an index that points to nothing, wherever the format has one.

    Raises:
        MeshError: ``mesh.gltf_index``, naming the array, the index and how many there are.
    """
    for kind, index in _references(document):
        entry_of(document, kind, index)
    for number, animation in enumerate(document.get("animations", [])):
        samplers = animation.get("samplers", [])
        for channel in animation.get("channels", []):
            if _outside(channel.get("sampler"), samplers):
                raise _no_such(f"animation {number} samplers", channel.get("sampler"), samplers)


def entry_of(document: dict[str, Any], kind: str, index: Any) -> dict[str, Any]:
    """Entry ``index`` of the top-level array ``kind``.

    Raises:
        MeshError: the index is not a whole number within the array.
    """
    found = document.get(kind, [])
    if _outside(index, found):
        raise _no_such(kind, index, found)
    return found[index]


def _outside(index: Any, array: list[Any]) -> bool:
    return isinstance(index, bool) or not isinstance(index, int) or not 0 <= index < len(array)


def _no_such(kind: str, index: Any, array: list[Any]) -> MeshError:
    return gltf_error("gltf_index", f"{kind} index {short(index)} is out of range (there are {len(array)})")


#: (array, member, array that the member points into) of every single index.
_SINGLE = (
    ("nodes", "mesh", "meshes"),
    ("nodes", "skin", "skins"),
    ("nodes", "camera", "cameras"),
    ("skins", "inverseBindMatrices", "accessors"),
    ("skins", "skeleton", "nodes"),
    ("accessors", "bufferView", "bufferViews"),
    ("bufferViews", "buffer", "buffers"),
    ("images", "bufferView", "bufferViews"),
    ("textures", "source", "images"),
    ("textures", "sampler", "samplers"),
)
#: The same of every list of indices.
_LISTS = (("scenes", "nodes", "nodes"), ("nodes", "children", "nodes"), ("skins", "joints", "nodes"))


def _references(document: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    """(array, index into it) of every index in the document but those between an animation's own parts."""
    if "scene" in document:
        yield "scenes", document["scene"]
    for owner, member, kind in _SINGLE:
        yield from ((kind, entry[member]) for entry in document.get(owner, []) if member in entry)
    for owner, member, kind in _LISTS:
        yield from ((kind, index) for entry in document.get(owner, []) for index in entry.get(member, []))
    for view in document.get("bufferViews", []):
        yield "buffers", view.get("buffer")
    for mesh in document.get("meshes", []):
        for primitive in mesh.get("primitives", []):
            for attributes in [primitive.get("attributes", {}), *primitive.get("targets", [])]:
                yield from (("accessors", index) for index in attributes.values())
            for member, kind in (("indices", "accessors"), ("material", "materials")):
                if member in primitive:
                    yield kind, primitive[member]
            variants = primitive.get("extensions", {}).get("KHR_materials_variants", {}).get("mappings", [])
            yield from (("materials", mapping.get("material")) for mapping in variants if isinstance(mapping, dict))
    for accessor in document.get("accessors", []):
        for part in ("indices", "values"):
            if "sparse" in accessor:
                yield "bufferViews", accessor["sparse"].get(part, {}).get("bufferView")
    for texture in document.get("textures", []):
        for extension in texture.get("extensions", {}).values():
            if "source" in extension:
                yield "images", extension["source"]
    for material in document.get("materials", []):
        yield from (("textures", info.get("index")) for info in _texture_infos(material))
    for animation in document.get("animations", []):
        for sampler in animation.get("samplers", []):
            yield "accessors", sampler.get("input")
            yield "accessors", sampler.get("output")
        for channel in animation.get("channels", []):
            if "node" in channel.get("target", {}):
                yield "nodes", channel["target"]["node"]


def _texture_infos(value: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Every texture info inside a material, those of its extensions too."""
    for key, child in value.items():
        if key == "extras" or not isinstance(child, dict):
            continue
        if key.endswith("Texture"):
            yield child
        else:
            yield from _texture_infos(child)


def short(value: Any) -> str:
    """``repr`` cut to 40 characters, for messages."""
    text = repr(value)
    return text if len(text) <= 40 else text[:37] + "..."


def plain(text: str) -> str:
    """Text from a file as one short line without control characters, for messages."""
    return "".join(c if c.isprintable() else "?" for c in text[:80])


def gltf_error(
    code: str, message: str, hint: str = "check the file with a glTF validator, or export it again"
) -> MeshError:
    """A ``MeshError`` with the hint that suits most damage to a glTF file."""
    return MeshError(f"mesh.{code}", message, hint)
