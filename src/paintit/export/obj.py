"""OBJ with an MTL in the PBR keys that Blender and others read, and PNG maps beside it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from paintit._version import __version__
from paintit.export.image import (
    EncodedMaps,
    check_layers,
    encode_maps,
    layer_suffixes,
    png_bytes,
    safe_name,
    unique_names,
)
from paintit.export.mtl import libraries
from paintit.export.obj_document import number, rewritten_lines
from paintit.export.siblings import same_content
from paintit.export.vertices import group_rows
from paintit.files import write_set
from paintit.mesh.mesh import Mesh, Part
from paintit.mesh.obj import ObjDocument
from paintit.texture.maps import TextureMaps


def write_obj(path: Path, mesh: Mesh, maps: TextureMaps) -> list[Path]:
    """Write ``path`` (.obj), ``STEM.mtl`` and the PNG maps ``STEM_base_color.png`` etc. beside it.

    An OBJ is written line by line as it came (:func:`rewritten_lines`), with another material library: materials that
    are not painted keep their words in it, and the images these name are copied. Anything else is written from the
    mesh, vertices in the mesh's order.

    Returns:
        The paths written, ``path`` last.

    Raises:
        OutputError: the maps do not fit the mesh, or the file system refuses; nothing of this call is left then.
    """
    path = Path(path)
    check_layers(mesh, maps)
    images = [_images(encoded) for encoded in encode_maps(maps)]
    return write_set(path, safe_name(path.stem, "mesh"), lambda stem: _files(path, stem, mesh, images))


def _files(path: Path, stem: str, mesh: Mesh, images: list[dict[str, bytes]]) -> dict[Path, bytes]:
    """What makes ``path``, itself last: PNG maps of each layer, ``STEM.mtl``, images of materials that stay."""
    document = mesh.source.document if mesh.source is not None else None
    own = libraries(mesh)
    files: dict[Path, bytes] = {}
    library = [f"# paintit {__version__}"]
    names = material_names(mesh)
    kept: list[str] = []
    for layer, name, suffix, maps in zip(mesh.layers, names, layer_suffixes(mesh), images, strict=True):
        if isinstance(document, ObjDocument) and not layer.painted:
            library += ["", *own.blocks.get(name, ())]
            kept.append(name)
            continue
        library += ["", *_material(name, {key: f"{stem}_{key}{suffix}.png" for key in maps})]
        for key, data in maps.items():
            files[path.with_name(f"{stem}_{key}{suffix}.png")] = data
    for name, image in own.images(kept).items():
        if not same_content(path.parent / name, image):
            files[path.parent / name] = image.read_bytes()
    files[path.with_name(f"{stem}.mtl")] = ("\n".join(library) + "\n").encode()
    if isinstance(document, ObjDocument):
        lines = rewritten_lines(document, mesh, names, f"{stem}.mtl")
    else:
        lines = _from_mesh(mesh, names, f"{stem}.mtl")
    files[path] = ("\n".join(lines).rstrip("\n") + "\n").encode()
    return files


def material_names(mesh: Mesh) -> list[str]:
    """Material name of each layer: an OBJ's own names as they are, others made safe and distinct."""
    if mesh.source is not None and mesh.source.format == "obj":
        return [layer.name for layer in mesh.layers]
    return unique_names(layer.name for layer in mesh.layers)


def _images(encoded: EncodedMaps) -> dict[str, bytes]:
    return {
        "base_color": png_bytes(encoded.base_color),
        "roughness": png_bytes(encoded.roughness),
        "metallic": png_bytes(encoded.metallic),
        "normal": png_bytes(encoded.normal),
    }


def _material(name: str, files: dict[str, str]) -> list[str]:
    """The PBR extension of MTL. Blender takes the normal map from ``map_Bump`` only, others from ``norm``."""
    return [
        f"newmtl {name}",
        "Kd 1 1 1",
        "Ks 0.5 0.5 0.5",
        "Pr 1",
        "Pm 1",
        "illum 2",
        f"map_Kd {files['base_color']}",
        f"map_Pr {files['roughness']}",
        f"map_Pm {files['metallic']}",
        f"norm {files['normal']}",
        f"map_Bump {files['normal']}",
    ]


def _from_mesh(mesh: Mesh, names: list[str], library: str) -> list[str]:
    """All triangles, v as in the mesh, v axis of the texture turned upward again, normals shared where equal."""
    first, group = group_rows([mesh.normals.reshape(-1, 3)])
    normals = mesh.normals.reshape(-1, 3)[first]
    out = [f"# paintit {__version__}", f"mtllib {library}"]
    out += [f"v {number(x)} {number(y)} {number(z)}" for x, y, z in mesh.vertices.tolist()]
    out += [f"vt {number(u)} {number(1.0 - v)}" for u, v in mesh.uvs.tolist()]
    out += [f"vn {x:.6g} {y:.6g} {z:.6g}" for x, y, z in normals.tolist()]
    corner = np.stack([mesh.faces, mesh.face_uvs, group.reshape(-1, 3)], -1) + 1
    name, layer = None, -1
    for part in mesh.parts or (Part("mesh", (0, len(mesh.faces)), 0),):
        if part.name != name:
            name = part.name
            out.append(f"o {' '.join(name.split()) or 'mesh'}")
        for face in range(*part.faces):
            if mesh.face_layer[face] != layer:
                layer = int(mesh.face_layer[face])
                out.append(f"usemtl {names[layer]}")
            (a, b, c), (d, e, f), (g, h, i) = corner[face].tolist()
            out.append(f"f {a}/{b}/{c} {d}/{e}/{f} {g}/{h}/{i}")
    return out
