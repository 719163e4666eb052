"""The texture coordinates that a material's colour reads: which set, and through which KHR_texture_transform."""

from __future__ import annotations

from typing import Any

import numpy as np

from paintit.mesh.mesh import Floats

SPECULAR_GLOSSINESS = "KHR_materials_pbrSpecularGlossiness"
TRANSFORM = "KHR_texture_transform"
#: How far outside the unit square texture coordinates may lie and still count as inside.
_MARGIN = 1e-3


def color_info(material: dict[str, Any]) -> dict[str, Any] | None:
    """Texture info of the colour that the painting replaces, None where the material has no colour texture."""
    glossy = material.get("extensions", {}).get(SPECULAR_GLOSSINESS, {})
    return glossy.get("diffuseTexture") or material.get("pbrMetallicRoughness", {}).get("baseColorTexture")


def texcoord_of(info: dict[str, Any]) -> int:
    """UV set that a texture info reads."""
    transform = info.get("extensions", {}).get(TRANSFORM, {})
    return int(transform.get("texCoord", info.get("texCoord", 0)))


def transformed(info: dict[str, Any], uv: Floats) -> Floats:
    """UVs (..., 2) after the info's KHR_texture_transform: translation * rotation * scale, in its order."""
    transform = info.get("extensions", {}).get(TRANSFORM)
    if transform is None:
        return uv
    scale = np.array(transform.get("scale", (1.0, 1.0)))
    offset = np.array(transform.get("offset", (0.0, 0.0)))
    angle = float(transform.get("rotation", 0.0))
    rotation = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    return (uv * scale) @ rotation.T + offset


def paints_transformed(info: dict[str, Any], uv: Floats) -> bool:
    """Whether a material is painted in transformed UVs rather than in those that its vertices hold, (n, 2) ``uv``.

    It is where the transform is what brings them into the unit square, or spreads them in it, as in a file whose UVs
    are quantised. A transform that tiles a picture, or picks one out of an atlas, is left out: the material has the
    whole square for itself.
    """
    transform = info.get("extensions", {}).get(TRANSFORM)
    if transform is None or not len(uv) or not np.isfinite(uv).all():
        return False
    if not _inside(transformed(info, uv)):
        return False
    grows = abs(float(np.prod(transform.get("scale", (1.0, 1.0))))) > 1.0
    return grows or not _inside(uv)


def _inside(uv: Floats) -> bool:
    return bool(uv.min() >= -_MARGIN and uv.max() <= 1.0 + _MARGIN)
