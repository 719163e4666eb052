"""Texture maps that are there already: a glTF document's own materials, or a folder of PNG maps."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from paintit.color import decode_srgb
from paintit.errors import MeshError
from paintit.export.gltf_source import (
    SPECULAR_GLOSSINESS,
    document_of,
    image_pixels,
    material_of,
    onto_layer,
    resized,
    texture_pixels,
)
from paintit.export.image import layer_suffixes
from paintit.mesh.gltf_document import GltfDocument
from paintit.mesh.mesh import Mesh
from paintit.texture.maps import TextureMaps

#: Size of maps that hold factors alone.
PLAIN_SIZE = 16
#: Largest size taken from a file unasked.
MAX_SIZE = 4096


def read_maps(mesh: Mesh, size: int | None = None) -> TextureMaps:
    """The PBR textures and factors of the glTF document that ``mesh`` was read from, one set per layer.

    Everything is brought to one square size and into the mesh's own UVs. Linear values; the normal map's scale is
    applied. Specular-glossiness materials become dielectrics of the diffuse colour.

    Args:
        size: texels along each side; None: the largest texture in use (16 where there is none).

    Raises:
        MeshError: ``"maps.none"``, the mesh did not come from glTF; ``"image.unreadable"``.
    """
    document = document_of(mesh)
    if document is None:
        raise MeshError(
            "maps.none",
            "only .glb and .gltf files carry PBR textures that can be read",
            "name a .glb, a .gltf, or the run folder",
        )
    layers = [_Slots(document, material_of(document, mesh, i)) for i in range(len(mesh.layers))]
    side = size or min(max((slot.side for slot in layers), default=0) or PLAIN_SIZE, MAX_SIZE)
    return _stack([slot.maps(mesh, i, side) for i, slot in enumerate(layers)])


def read_maps_folder(folder: Path, mesh: Mesh, size: int | None = None) -> TextureMaps:
    """The maps that :func:`paintit.export.image.write_maps` wrote into ``folder`` for this mesh.

    Raises:
        MeshError: ``"maps.missing"``, a file is not there; ``"image.unreadable"``.
    """
    folder = Path(folder)
    pixels: list[dict[str, NDArray[np.float32]]] = []
    for suffix in layer_suffixes(mesh):
        found: dict[str, NDArray[np.float32]] = {}
        for name in ("base_color", "orm", "normal"):
            path = folder / f"{name}{suffix}.png"
            try:
                found[name] = image_pixels(path.read_bytes())[..., :3]
            except OSError as error:
                raise MeshError(
                    "maps.missing",
                    f"cannot read {path}: {(error.strerror or str(error)).lower()}",
                    "name a run folder, or a folder of maps written for this mesh",
                ) from None
        pixels.append(found)
    side = size or max(max(image.shape[:2]) for found in pixels for image in found.values())
    square = (side, side)
    return _stack(
        [
            _decode(
                resized(found["base_color"], square), resized(found["orm"], square), resized(found["normal"], square)
            )
            for found in pixels
        ]
    )


def _decode(base_color: NDArray[np.float32], orm: NDArray[np.float32], normal: NDArray[np.float32]) -> TextureMaps:
    """Maps of one layer from stored images in [0, 1], each (h, w, 3)."""
    image = torch.from_numpy(np.ascontiguousarray(orm))
    tangent = torch.from_numpy(np.ascontiguousarray(normal)) * 2.0 - 1.0
    linear = decode_srgb(torch.from_numpy(np.ascontiguousarray(base_color)))
    return TextureMaps(linear, image[..., 1:2], image[..., 2:3], torch.nn.functional.normalize(tangent, dim=-1))


def _stack(layers: list[TextureMaps]) -> TextureMaps:
    return TextureMaps.unpacked(torch.stack([layer.packed() for layer in layers]))


#: What a missing texture stands for, as stored.
_NEUTRAL = {"base_color": (1.0, 1.0, 1.0), "orm": (1.0, 1.0, 1.0), "normal": (0.5, 0.5, 1.0)}


class _Slots:
    """What one material says of colour, roughness, metalness and normals: texture infos, their pixels, factors."""

    def __init__(self, document: GltfDocument, material: dict[str, Any]) -> None:
        self.document = document
        pbr = material.get("pbrMetallicRoughness", {})
        glossy = material.get("extensions", {}).get(SPECULAR_GLOSSINESS)
        if glossy is None:
            self.color = list(pbr.get("baseColorFactor", [1.0] * 4))[:3]
            self.roughness, self.metallic = pbr.get("roughnessFactor", 1.0), pbr.get("metallicFactor", 1.0)
            infos = {"base_color": pbr.get("baseColorTexture"), "orm": pbr.get("metallicRoughnessTexture")}
        else:
            self.color = list(glossy.get("diffuseFactor", [1.0] * 4))[:3]
            self.roughness, self.metallic = 1.0 - glossy.get("glossinessFactor", 1.0), 0.0
            infos = {"base_color": glossy.get("diffuseTexture")}
        infos["normal"] = material.get("normalTexture")
        self.images: dict[str, tuple[dict[str, Any], NDArray[np.float32]]] = {}
        for name, info in infos.items():
            pixels = texture_pixels(document, info) if info is not None else None
            if info is not None and pixels is not None:
                self.images[name] = (info, pixels[..., :3])
        self.side = max((max(pixels.shape[:2]) for _, pixels in self.images.values()), default=0)

    def maps(self, mesh: Mesh, layer: int, side: int) -> TextureMaps:
        """(side, side, .) maps of the layer."""

        def image(name: str) -> NDArray[np.float32]:
            if name not in self.images:
                return np.broadcast_to(np.array(_NEUTRAL[name], np.float32), (side, side, 3))
            info, pixels = self.images[name]
            return onto_layer(self.document, mesh, layer, info, pixels, (side, side))

        maps = _decode(image("base_color"), image("orm"), image("normal"))
        scale = self.images["normal"][0].get("scale", 1.0) if "normal" in self.images else 1.0
        tilted = maps.normal * torch.tensor([scale, scale, 1.0], dtype=torch.float32)
        return TextureMaps(
            maps.base_color * torch.tensor(self.color, dtype=torch.float32),
            maps.roughness * self.roughness,
            maps.metallic * self.metallic,
            torch.nn.functional.normalize(tilted, dim=-1),
        )
