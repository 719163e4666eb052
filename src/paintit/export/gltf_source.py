"""Reading the source glTF document: stored attributes, texture infos and their pixels, layer by layer."""

from __future__ import annotations

import posixpath
from dataclasses import dataclass, replace
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from paintit.config import LimitConfig
from paintit.errors import MeshError
from paintit.mesh.gltf_document import GltfDocument
from paintit.mesh.gltf_texcoord import texcoord_of, transformed
from paintit.mesh.limits import check_limit
from paintit.mesh.mesh import Mesh, Part
from paintit.picture import opened


def document_of(mesh: Mesh) -> GltfDocument | None:
    """The glTF document that the mesh was read from, or None where it came from another format."""
    source = mesh.source
    return source.document if source is not None and isinstance(source.document, GltfDocument) else None


_INTEGERS = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32}


def decoded(document: GltfDocument, accessor: int) -> NDArray[np.float64]:
    """Values of an accessor as float64, (count, components); normalised integers as the fractions they stand for."""
    return document.accessor(accessor).astype(np.float64)


def stored(document: GltfDocument, accessor: int) -> NDArray[Any]:
    """Values of an accessor in their own component type, (count, components); normalised integers as integers."""
    description = document.json["accessors"][accessor]
    values = document.accessor(accessor)
    kind = _INTEGERS.get(description["componentType"])
    if kind is None or not description.get("normalized"):
        return values
    return np.rint(values.astype(np.float64) * np.iinfo(kind).max).astype(kind)


def source_triangles(document: GltfDocument, primitive: dict[str, Any]) -> NDArray[np.int64]:
    """(n, 3) vertices of the primitive's triangles in the winding of the file, lists, strips and fans alike."""
    if "indices" in primitive:
        order = document.accessor(primitive["indices"])[:, 0].astype(np.int64)
    else:
        order = np.arange(document.json["accessors"][primitive["attributes"]["POSITION"]]["count"], dtype=np.int64)
    mode = primitive.get("mode", 4)
    if mode == 4:
        return order[: len(order) // 3 * 3].reshape(-1, 3)
    i = np.arange(max(len(order) - 2, 0))
    if mode == 5:
        return order[np.stack([i, i + 1 + i % 2, i + 2 - i % 2], 1)]
    return order[np.stack([i + 1, i + 2, np.zeros_like(i)], 1)]


def primitive_of(document: GltfDocument, part: Part) -> dict[str, Any]:
    """JSON of the primitive that a part came from."""
    if part.primitive is None:
        raise MeshError("mesh.no_primitive", f"part '{part.name}' names no glTF primitive", "read the file again")
    mesh, primitive = part.primitive
    return document.json["meshes"][mesh]["primitives"][primitive]


def corner_vertices(mesh: Mesh, part: Part) -> NDArray[np.int64]:
    """(n, 3) vertex of the source primitive at each corner of the part's faces."""
    if mesh.source is None or mesh.source.corner_vertex is None:
        raise MeshError("mesh.no_primitive", "the mesh does not know its source vertices", "read the file again")
    return mesh.source.corner_vertex[part.faces[0] : part.faces[1]]


def material_of(document: GltfDocument, mesh: Mesh, layer: int) -> dict[str, Any]:
    """JSON of a layer's material; ``{}`` (glTF's default material) where the file has none."""
    index = mesh.layers[layer].source_index
    return {} if index is None else document.json["materials"][index]


def texture_pixels(document: GltfDocument, info: dict[str, Any]) -> NDArray[np.float32] | None:
    """(h, w, 4) in [0, 1] as stored (no colour decoding); None where the texture has no image that can be read."""
    texture = document.json["textures"][info["index"]]
    sources = [texture.get("source"), texture.get("extensions", {}).get("EXT_texture_webp", {}).get("source")]
    source = next((s for s in sources if s is not None), None)
    if source is None:
        return None
    return image_pixels(document.image(source), document.limits)


def image_pixels(data: bytes, limits: LimitConfig | None = None) -> NDArray[np.float32]:
    """Any PNG, JPEG or WebP as (h, w, 4) float32 in [0, 1]; grey is repeated, missing alpha is 1.

    Raises:
        MeshError: ``"image.unreadable"``; ``"mesh.limit"``, its header promises more pixels than ``limits`` allow.
    """
    try:
        image = opened(data)
        check_limit(limits or LimitConfig(), "image_megapixels", -(-image.width * image.height // 10**6),
                    f"megapixels of an image of {image.width} x {image.height}")  # fmt: skip
        image.load()
    except (OSError, SyntaxError, ValueError) as error:
        raise MeshError("image.unreadable", f"a texture cannot be read: {error}", "save it again as PNG") from None
    if image.mode.startswith("I"):  # 16-bit grey
        grey = (np.asarray(image, np.float32) / 65535.0).clip(0, 1)
        return np.stack([grey, grey, grey, np.ones_like(grey)], -1)
    return np.asarray(image.convert("RGBA"), np.float32) / 255.0


def file_of(uri: Any) -> str:
    """The file that a URI of a glTF document names, below its folder, with ``/``; "" where it names none.

    ``data:`` URIs name none, nor do paths that begin above the folder.
    """
    if not isinstance(uri, str) or uri[:5].lower() == "data:":
        return ""
    name = posixpath.normpath(unquote(uri))
    return "" if name.startswith(("/", "..")) else name


def layer_parts(mesh: Mesh, layer: int) -> list[Part]:
    return [part for part in mesh.parts if part.layer == layer]


@dataclass(frozen=True)
class LayerUv:
    """UVs at which one texture of the source document shows on a layer.

    Attributes:
        faces: (n,) faces of the layer.
        uv: (n, 3, 2) UV of their corners in the texture of the file.
        same: the mesh is painted in just these UVs.
    """

    faces: NDArray[np.int64]
    uv: NDArray[np.float64]
    same: bool


def layer_uv(document: GltfDocument, mesh: Mesh, layer: int, info: dict[str, Any]) -> LayerUv:
    """Where ``info``'s texture lies on ``layer``; corners without that UV set read (0, 0)."""
    faces, uvs = [np.zeros(0, np.int64)], [np.zeros((0, 3, 2))]
    for part in layer_parts(mesh, layer):
        accessor = primitive_of(document, part)["attributes"].get(f"TEXCOORD_{texcoord_of(info)}")
        corner = corner_vertices(mesh, part)
        uv = np.zeros((*corner.shape, 2)) if accessor is None else decoded(document, accessor)[corner]
        faces.append(np.arange(*part.faces, dtype=np.int64))
        uvs.append(transformed(info, uv))
    face, uv = np.concatenate(faces), np.concatenate(uvs)
    return LayerUv(face, uv, bool(np.allclose(uv, mesh.corner_uvs[face], atol=1e-6, rtol=0.0)))


def bilinear(pixels: NDArray[np.float32], uv: NDArray[np.float64]) -> NDArray[np.float32]:
    """Bilinear lookup with repeat: ``pixels`` (h, w, c), ``uv`` (n, 2) -> (n, c)."""
    height, width = pixels.shape[:2]
    x = uv[:, 0] * width - 0.5
    y = uv[:, 1] * height - 0.5
    x0, y0 = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    fx, fy = (x - x0)[:, None].astype(np.float32), (y - y0)[:, None].astype(np.float32)
    at = lambda i, j: pixels[(y0 + j) % height, (x0 + i) % width]  # noqa: E731
    top = at(0, 0) * (1 - fx) + at(1, 0) * fx
    return top * (1 - fy) + (at(0, 1) * (1 - fx) + at(1, 1) * fx) * fy


def resized(pixels: NDArray[np.float32], size: tuple[int, int]) -> NDArray[np.float32]:
    """(h, w, c) -> (\\*size, c): area mean when smaller, bilinear when larger."""
    if pixels.shape[:2] == size:
        return pixels
    height, width = size
    channels = [
        np.asarray(
            Image.fromarray(np.ascontiguousarray(pixels[..., c])).resize(
                (width, height),
                Image.Resampling.BOX
                if height * width < pixels.shape[0] * pixels.shape[1]
                else Image.Resampling.BILINEAR,
            )
        )
        for c in range(pixels.shape[2])
    ]
    return np.stack(channels, -1).astype(np.float32)


def onto_layer(
    document: GltfDocument,
    mesh: Mesh,
    layer: int,
    info: dict[str, Any],
    pixels: NDArray[np.float32],
    size: tuple[int, int],
) -> NDArray[np.float32]:
    """A source texture in the mesh's own UVs, (\\*size, c): resized where the UVs are the file's, else resampled."""
    where = layer_uv(document, mesh, layer, info)
    if where.same:
        return resized(pixels, size)
    from paintit.mesh.uv import fill_gutters, rasterize_uv

    side = max(size)
    alone = tuple(replace(found, painted=i == layer) for i, found in enumerate(mesh.layers))
    texels = rasterize_uv(replace(mesh, layers=alone), side)
    face, weight = texels.face[layer], texels.barycentric[layer]
    by_face = np.zeros((len(mesh.faces), 3, 2))
    by_face[where.faces] = where.uv
    covered = face >= 0
    uv = np.einsum("nk,nkc->nc", weight[covered].astype(np.float64), by_face[face[covered]])
    out = np.zeros((side, side, pixels.shape[2]), np.float32)
    out[covered] = bilinear(pixels, uv)
    return resized(fill_gutters(out[None], covered[None])[0], size)
