"""Texture maps that are there already: a glTF document's own materials, or a folder of PNG maps."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from paintit.color import decode_srgb
from paintit.errors import MeshError
from paintit.export.gltf_source import (
    document_of,
    image_pixels,
    material_of,
    onto_layer,
    resized,
    texture_pixels,
)
from paintit.export.image import layer_suffixes
from paintit.mesh.gltf_document import GltfDocument
from paintit.mesh.gltf_texcoord import SPECULAR_GLOSSINESS
from paintit.mesh.mesh import Mesh
from paintit.texture.fixed import grey, with_fixed
from paintit.texture.maps import TextureMaps

#: Size of maps that hold factors alone.
PLAIN_SIZE = 16
#: Largest size taken from a file unasked.
MAX_SIZE = 4096


def read_maps(mesh: Mesh, size: int | None = None, layers: Sequence[int] | None = None) -> TextureMaps:
    """The PBR textures and factors of the glTF document that ``mesh`` was read from, one set per layer.

    Everything is brought to one square size and into the mesh's own UVs. Linear values; the normal map's scale is
    applied. Specular-glossiness materials become dielectrics of the diffuse colour.

    Args:
        size: texels along each side; None: the largest texture in use (16 where there is none).
        layers: which layers; None: all.

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
    chosen = range(len(mesh.layers)) if layers is None else layers
    slots = {i: _Slots(document, material_of(document, mesh, i)) for i in chosen}
    side = size or min(max((slot.side for slot in slots.values()), default=0) or PLAIN_SIZE, MAX_SIZE)
    return _stack([slot.maps(mesh, i, side) for i, slot in slots.items()])


def unpainted_maps(mesh: Mesh, size: int) -> TextureMaps | None:
    """How the layers that are not painted look, in their order: a glTF file's own maps; None for other formats.

    Raises:
        MeshError: ``"image.unreadable"``.
    """
    kept = [i for i, layer in enumerate(mesh.layers) if not layer.painted]
    return read_maps(mesh, size, kept) if kept and document_of(mesh) is not None else None


def read_emission(mesh: Mesh, size: int) -> torch.Tensor | None:
    """(layers, size, size, 3) linear radiance that the document's materials emit by themselves; None where none does.

    Not among the maps, since it is never painted: the exporter keeps it as it is, and every viewer shows it.

    Raises:
        MeshError: ``"image.unreadable"``.
    """
    document = document_of(mesh)
    if document is None:
        return None
    layers = []
    for index in range(len(mesh.layers)):
        material = material_of(document, mesh, index)
        strength = (
            material.get("extensions", {}).get("KHR_materials_emissive_strength", {}).get("emissiveStrength", 1.0)
        )
        factor = strength * torch.tensor(material.get("emissiveFactor", [0.0] * 3), dtype=torch.float32)
        info = material.get("emissiveTexture")
        pixels = texture_pixels(document, info) if info is not None and factor.any() else None
        if info is None or pixels is None:
            layers.append(factor.expand(size, size, 3))
        else:
            stored = onto_layer(document, mesh, index, info, pixels[..., :3], (size, size))
            layers.append(decode_srgb(torch.from_numpy(np.ascontiguousarray(stored))) * factor)
    emission = torch.stack(layers)
    return emission if emission.any() else None


def read_occlusion(mesh: Mesh, size: int) -> torch.Tensor | None:
    """(layers, size, size, 1) in [0, 1]: the document's occlusion textures, at their strength; None where it has none.

    Like emission it is never painted: it says how much of its surroundings a point of the shape sees.

    Raises:
        MeshError: ``"image.unreadable"``.
    """
    document = document_of(mesh)
    if document is None:
        return None
    occlusion = torch.ones(len(mesh.layers), size, size, 1)
    for index in range(len(mesh.layers)):
        info = material_of(document, mesh, index).get("occlusionTexture")
        pixels = texture_pixels(document, info) if info is not None else None
        if info is not None and pixels is not None:
            stored = onto_layer(document, mesh, index, info, pixels[..., :1], (size, size))
            occlusion[index] = 1 + info.get("strength", 1.0) * (torch.from_numpy(np.ascontiguousarray(stored)) - 1)
    return None if bool((occlusion == 1).all()) else occlusion


def read_maps_folder(folder: Path, mesh: Mesh, size: int | None = None) -> TextureMaps:
    """The maps that :func:`paintit.export.image.write_maps` wrote into ``folder`` for this mesh.

    Layers that are not painted have no files there: they look as in :func:`unpainted_maps`, grey where that is None.

    Raises:
        MeshError: ``"maps.missing"``, a file is not there; ``"image.unreadable"``.
    """
    folder = Path(folder)
    pixels: list[dict[str, NDArray[np.float32]]] = []
    for suffix, layer in zip(layer_suffixes(mesh), mesh.layers, strict=True):
        if not layer.painted:
            continue
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
    painted = _stack(
        [
            _decode(
                resized(found["base_color"], square), resized(found["orm"], square), resized(found["normal"], square)
            )
            for found in pixels
        ]
    )
    mine = [layer.painted for layer in mesh.layers]
    return with_fixed(painted, unpainted_maps(mesh, side) or grey(mine.count(False), side), mine)


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
