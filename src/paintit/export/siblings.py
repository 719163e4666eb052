"""The files that are written beside an asset, and those of the user that they must not replace."""

from __future__ import annotations

from pathlib import Path

from paintit.errors import OutputError
from paintit.export.gltf_source import document_of, file_of
from paintit.export.image import layer_suffixes, safe_name
from paintit.export.mtl import libraries
from paintit.files import output_error
from paintit.mesh.mesh import Mesh
from paintit.mesh.obj import ObjDocument


def check_siblings(path: Path, mesh: Mesh, overwrite: bool = False) -> None:
    """Refuse to write ``path`` where a file beside it would be lost.

    Raises:
        OutputError: ``"output.exists"``, there is a file of that name and ``overwrite`` is False;
            ``"output.is_input"``, the file is the mesh that was read or belongs to it.
    """
    try:
        inputs = [file for file in input_files(mesh) if file.exists()]
        for file in (path, *made_beside(path, mesh)):
            if not file.exists():
                continue
            if any(file.samefile(own) for own in inputs):
                raise OutputError(
                    "output.is_input", f"{file} belongs to the mesh itself", "choose another name with -o"
                )
            if file != path and not overwrite:
                raise OutputError("output.exists", f"{file} already exists",
                                  "add --overwrite or choose another name with -o")  # fmt: skip
        for file, source in copied_beside(path, mesh).items():
            if file.exists() and not overwrite and not same_content(file, source):
                raise OutputError("output.exists", f"{file} already exists and is another file than {source}",
                                  "choose another folder with -o, or add --overwrite")  # fmt: skip
    except OSError as error:
        raise output_error(path, error) from error


def made_beside(path: Path, mesh: Mesh) -> list[Path]:
    """What is made for ``path`` (.obj, .gltf, a folder of maps) besides itself."""
    kind = "" if path.is_dir() else path.suffix.lower()
    suffixes = [s for s, layer in zip(layer_suffixes(mesh), mesh.layers, strict=True) if layer.painted]
    if kind == "":
        return [path / f"{key}{suffix}.png" for suffix in suffixes for key in ("base_color", "orm", "normal")]
    if kind == ".gltf":
        images = [f"{path.stem}_{key}{suffix}.png" for suffix in suffixes for key in ("base_color", "orm", "normal")]
        return [path.with_suffix(".bin"), *(path.with_name(name) for name in images)]
    if kind != ".obj":
        return []
    if not _is_obj(mesh):
        suffixes = layer_suffixes(mesh)
    stem = safe_name(path.stem, "mesh")
    keys = ("base_color", "roughness", "metallic", "normal")
    names = [f"{stem}.mtl", *(f"{stem}_{key}{suffix}.png" for suffix in suffixes for key in keys)]
    return [path.with_name(name) for name in names]


def copied_beside(path: Path, mesh: Mesh) -> dict[Path, Path]:
    """Where images that the file's own materials name come to lie -> where they are."""
    kind, document = path.suffix.lower(), document_of(mesh)
    if kind == ".gltf" and document is not None:
        names = [name for image in document.items("images") if (name := file_of(image.get("uri")))]
        return {path.parent / name: document.base / name for name in names}
    if kind == ".obj" and _is_obj(mesh):
        kept = [layer.name for layer in mesh.layers if not layer.painted]
        return {path.parent / name: file for name, file in libraries(mesh).images(kept).items()}
    return {}


def input_files(mesh: Mesh) -> list[Path]:
    """The file that ``mesh`` was read from and those that it names."""
    if mesh.source is None:
        return []
    document, own = document_of(mesh), libraries(mesh)
    files = [mesh.source.path, *own.files, *own.images(list(own.blocks)).values()]
    if document is not None:
        items = [*document.items("buffers"), *document.items("images")]
        files += [document.base / name for item in items if (name := file_of(item.get("uri")))]
    return files


def same_content(file: Path, other: Path) -> bool:
    """Both exist and hold the same bytes."""
    return file.is_file() and other.is_file() and (file.samefile(other) or file.read_bytes() == other.read_bytes())


def _is_obj(mesh: Mesh) -> bool:
    return mesh.source is not None and isinstance(mesh.source.document, ObjDocument)
