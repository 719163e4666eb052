"""Material libraries of an OBJ file: the blocks of materials that are not painted, and the images they name."""

from __future__ import annotations

import posixpath
from dataclasses import dataclass
from pathlib import Path

from paintit.mesh.mesh import Mesh
from paintit.mesh.obj import ObjDocument

#: Arguments of each option that may stand before the file name of a map; those with a range take numbers only.
_OPTIONS = {"-mm": 2, "-o": 3, "-s": 3, "-t": 3}
_VARIABLE = ("-o", "-s", "-t")
_MAPS = ("map_", "bump", "disp", "decal", "refl", "norm")


@dataclass(frozen=True)
class Libraries:
    """What the ``mtllib`` files of an OBJ say.

    Attributes:
        files: the libraries that were found.
        blocks: material name -> its lines from ``newmtl`` on; the first definition counts.
        folder: where relative image names begin.
    """

    files: tuple[Path, ...]
    blocks: dict[str, tuple[str, ...]]
    folder: Path

    def images(self, names: list[str]) -> dict[str, Path]:
        """Image name as it lies below the OBJ's folder -> the file, for those of the materials ``names`` that exist.

        Names that lead out of the folder are left out: nothing is copied from elsewhere.
        """
        found: dict[str, Path] = {}
        for line in (line for name in names for line in self.blocks.get(name, ())):
            name = posixpath.normpath(image_name(line).replace("\\", "/"))
            inside = name != "." and not name.startswith(("/", "..")) and ":" not in name
            path = self.folder / name
            if inside and path.is_file() and path.resolve().is_relative_to(self.folder.resolve()):
                found[name] = path
        return found


def libraries(mesh: Mesh) -> Libraries:
    """The material libraries of the OBJ file that ``mesh`` was read from; empty for other formats."""
    source = mesh.source
    if source is None or not isinstance(source.document, ObjDocument):
        return Libraries((), {}, Path())
    folder = source.path.parent
    files: list[Path] = []
    blocks: dict[str, tuple[str, ...]] = {}
    for statement in source.document.material_libraries:
        # A name may hold blanks, and one statement may name several files.
        for name in [statement] if (folder / statement).is_file() else statement.split():
            path = folder / name
            if path.is_file() and path.resolve().is_relative_to(folder.resolve()):
                files.append(path)
                for material, lines in _blocks(path.read_bytes()).items():
                    blocks.setdefault(material, lines)
    return Libraries(tuple(files), blocks, folder)


def _blocks(data: bytes) -> dict[str, tuple[str, ...]]:
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    found: dict[str, list[str]] = {}
    lines: list[str] = []
    for line in text.splitlines():
        if line.split()[:1] == ["newmtl"]:
            lines = found.setdefault(line.strip()[6:].strip(), [])
        lines.append(line)
    return {name: tuple(lines) for name, lines in found.items()}


def image_name(line: str) -> str:
    """The file name in a map statement of an MTL file, options left out; "" where the line is none."""
    words = line.split()
    if not words or not words[0].lower().startswith(_MAPS):
        return ""
    at = 1
    while at < len(words) and words[at].startswith("-"):
        option = words[at].lower()
        at += 1
        for _ in range(_OPTIONS.get(option, 1)):
            if at >= len(words) or (option in _VARIABLE and not _is_number(words[at])):
                break
            at += 1
    return line.split(maxsplit=at)[at].strip() if at < len(words) else ""


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
