"""GLB and glTF files: the input document with new materials where there is one, else a new document."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from paintit.export.gltf_assembly import Assembly
from paintit.export.gltf_existing import repaint_document
from paintit.export.gltf_new import new_document
from paintit.export.gltf_source import document_of
from paintit.export.image import check_layers, encode_maps
from paintit.files import write_set
from paintit.mesh.mesh import Mesh
from paintit.texture.maps import TextureMaps


def assemble(mesh: Mesh, maps: TextureMaps, metadata: dict[str, Any]) -> Assembly:
    """The painted asset as a glTF document in memory.

    Raises:
        OutputError: the maps do not fit the mesh or hold values that are not finite.
    """
    check_layers(mesh, maps)
    encoded = encode_maps(maps)
    document = document_of(mesh)
    if document is None:
        return new_document(mesh, encoded, metadata)
    return repaint_document(document, mesh, encoded, metadata)


def write_gltf(path: Path, mesh: Mesh, maps: TextureMaps, metadata: dict[str, Any]) -> list[Path]:
    """Write ``path`` (.glb, or .gltf with ``STEM.bin`` and images beside it); equal input, equal bytes.

    ``metadata`` (JSON values: prompt, prior, version, seed, ...) is stored under ``asset.extras.paintit``.

    Returns:
        The paths written, ``path`` last.

    Raises:
        OutputError: the maps do not fit the mesh, or the file system refuses; nothing of this call is left then.
    """
    path, assembly = Path(path), assemble(mesh, maps, metadata)
    return write_set(path, path.stem, lambda stem: assembly.files(path, stem))
