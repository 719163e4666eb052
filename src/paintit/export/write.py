"""One door for every output: the extension says what is written."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

from paintit.errors import OutputError, UsageError
from paintit.export.gltf import write_gltf
from paintit.export.image import write_maps
from paintit.export.obj import write_obj
from paintit.export.siblings import check_siblings
from paintit.files import output_error, write_files
from paintit.mesh.mesh import Mesh
from paintit.texture.maps import TextureMaps

#: What each extension writes.
KINDS = {
    ".glb": "GLB, textures inside",
    ".gltf": "glTF, with .bin and PNG files beside it",
    ".obj": "OBJ, with MTL and PNG files beside it",
    ".png": "a preview of four views",
    ".webp": "a turntable",
    "": "a folder of PNG maps",
}


def kind_of(path: Path) -> str:
    """The key of :data:`KINDS` that ``path`` asks for; an existing folder, or no extension, asks for PNG maps.

    Raises:
        UsageError: ``"output.unknown_extension"``, naming those there are.
    """
    try:
        kind = "" if path.is_dir() else path.suffix.lower()
    except OSError as error:
        raise output_error(path, error) from error
    if kind not in KINDS:
        known = ", ".join(name for name in KINDS if name)
        raise UsageError(
            "output.unknown_extension",
            f"cannot write '{path.name}': the extension {kind} is not known",
            f"choose one of {known}, or a folder name for PNG maps",
        )
    return kind


def check_output(path: Path, overwrite: bool = False) -> None:
    """Raise what :func:`write` would raise about the path itself, before any work is done.

    Raises:
        UsageError: the extension is not known.
        OutputError: ``"output.exists"``.
    """
    path = Path(path)
    try:
        taken = any(path.glob("base_color*.png")) if kind_of(path) == "" else path.exists()
    except OSError as error:
        raise output_error(path, error) from error
    if taken and not overwrite:
        raise OutputError("output.exists", f"{path} already exists", "add --overwrite or choose another name with -o")


def write(path: Path, mesh: Mesh, maps: TextureMaps, metadata: dict[str, Any], overwrite: bool = False) -> list[Path]:
    """Write the painted mesh as what the extension of ``path`` says (see :data:`KINDS`).

    ``metadata`` holds JSON values and goes into GLB and glTF files.

    Returns:
        The paths written; the one that was asked for is last, except for a folder of maps.

    Raises:
        UsageError: the extension is not known.
        OutputError: the file, or one that is written beside it, exists and ``overwrite`` is False or it belongs to the
            mesh that was read; or the file system refuses. A file under its final name is always complete.
    """
    path = Path(path)
    check_output(path, overwrite)
    check_siblings(path, mesh, overwrite)
    kind = kind_of(path)
    if kind in (".glb", ".gltf"):
        return write_gltf(path, mesh, maps, metadata)
    if kind == ".obj":
        return write_obj(path, mesh, maps)
    if kind == "":
        return write_maps(path, mesh, maps)
    # The renderer is needed for pictures alone.
    from paintit.export.preview import preview, turntable, write_turntable

    if kind == ".png":
        out = io.BytesIO()
        preview(mesh, maps).save(out, format="PNG", compress_level=6)
        write_files({path: out.getvalue()})
    else:
        write_turntable(path, turntable(mesh, maps))
    return [path]
