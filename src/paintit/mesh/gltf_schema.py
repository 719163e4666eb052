"""The JSON types of the glTF members that are read here, so that nothing further in has to doubt them."""

from __future__ import annotations

from typing import Any

from paintit.errors import MeshError

KINDS: dict[str, dict[str, type]] = {
    "": {
        "scenes": list,
        "nodes": list,
        "meshes": list,
        "materials": list,
        "accessors": list,
        "bufferViews": list,
        "buffers": list,
        "images": list,
        "skins": list,
        "extensionsRequired": list,
    },
    "scenes": {"nodes": list},
    "nodes": {"children": list, "weights": list},
    "meshes": {"primitives": list, "weights": list},
    "primitives": {"attributes": dict, "targets": list, "mode": int},
    "materials": {"pbrMetallicRoughness": dict},
    "pbrMetallicRoughness": {"baseColorTexture": dict},
    "baseColorTexture": {},
    "accessors": {"sparse": dict, "type": str, "componentType": int},
    "sparse": {"indices": dict, "values": dict},
    "indices": {"componentType": int},
    "skins": {"joints": list},
    "bufferViews": {},
    "buffers": {},
    "images": {},
    "targets": {},
}
"""JSON type of the members that are read here, by the name of their owner; every owner may also have ``extensions``."""


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
        if key == "extensions" and not all(isinstance(v, dict) for v in value.values()):
            raise gltf_error("gltf_invalid", "an entry of 'extensions' is not an object")
        if key == "weights" and not all(isinstance(w, int | float) for w in value):
            raise gltf_error("gltf_invalid", f"'weights' is {short(value)}, not numbers")
        if key in KINDS and not (key == "nodes" and name == "scenes"):
            for entry in value if kind is list else [value]:
                check_types(entry, key)


def short(value: Any) -> str:
    """``repr`` cut to 40 characters, for messages."""
    text = repr(value)
    return text if len(text) <= 40 else text[:37] + "..."


def gltf_error(
    code: str, message: str, hint: str = "check the file with a glTF validator, or export it again"
) -> MeshError:
    """A ``MeshError`` with the hint that suits most damage to a glTF file."""
    return MeshError(f"mesh.{code}", message, hint)
