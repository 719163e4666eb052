"""A study from what methods made: one folder per method, of pictures, painted assets or runs named alike."""

from __future__ import annotations

import dataclasses
import io
import os
import re
import tempfile
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

from paintit.errors import OutputError, RunError, StudyError
from paintit.export.preview import RADIUS, pictures, sheet
from paintit.export.read_maps import read_emission, read_occlusion
from paintit.files import make_folder, output_error
from paintit.render.camera import fitted, orbit
from paintit.render.geometry import Geometry
from paintit.run.asset import Asset, load_asset
from paintit.run.folder import find
from paintit.run.record import Record
from paintit.run.record import read as read_record
from paintit.study.questions import Question, Study, write_study
from paintit.texture.fixed import grey

PICTURES = (".png", ".jpg", ".jpeg", ".webp")
ASSETS = (".glb", ".gltf")


@dataclass(frozen=True)
class Look:
    """How assets are rendered: the same for every method, with the renderer and light of ``paintit render``.

    The camera looks at the middle of the box from 3.25 times half its longest edge; how wide, its silhouette says.

    Attributes:
        size: pixels along each side of a view.
        views: side by side, evenly all round from ``azimuth`` on.
        azimuth, elevation: degrees; 0 looks at the front.
        light: ``default``, an .hdr or an .exr file.
    """

    size: int = 768
    views: int = 1
    azimuth: float = 35.0
    elevation: float = 15.0
    light: str = "default"


@dataclass(frozen=True)
class Created:
    """The study, and names of meshes that were left out: not every method has them, or there are enough."""

    study: Study
    lacking: tuple[str, ...]
    spare: tuple[str, ...]


def create(
    folder: Path,
    methods: Mapping[str, Path],
    *,
    title: str = "How realistic is it?",
    seed: int = 0,
    count: int = 10,
    untextured: Path | None = None,
    prompts: Mapping[str, str] | None = None,
    look: Look = Look(),
    on_picture: Callable[[str], None] | None = None,
) -> Created:
    """Build a study folder: whole or not at all.

    Args:
        methods: method -> folder.
        count: meshes at most, in order of name (supp. A.4: ten).
        untextured: folder of pictures of the bare meshes; without it they are rendered from the first method's asset.
        prompts: mesh -> prompt, where the runs do not tell or there are none.
        on_picture: called with the name of each picture before it is made.

    Raises:
        StudyError: a folder holds nothing, the methods have no mesh in common, they were given different prompts.
        OutputError: ``folder`` is there already, or cannot be written.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise OutputError("output.exists", f"{folder} exists already", "choose another name, or remove it")
    if len(methods) < 2:
        raise StudyError(
            "study.methods", f"{len(methods)} methods are given", "name at least 2: METHOD=FOLDER METHOD=FOLDER"
        )  # fmt: skip
    entries = {method: _entries(path) for method, path in methods.items()}
    names = sorted(set.union(*map(set, entries.values())), key=_natural)
    common = [name for name in names if all(name in found for found in entries.values())]
    if not common:
        examples = "; ".join(f"{method}: {', '.join(list(found)[:3])}" for method, found in entries.items())
        raise StudyError("study.nothing_common", f"no mesh is in all {len(methods)} folders ({examples})",
                         "name the files alike in all folders")  # fmt: skip
    chosen = common[:count]
    ours = {name: {method: found[name] for method, found in entries.items()} for name in chosen}
    records = {name: _records(ours[name]) for name in chosen}
    told = {name: (prompts or {}).get(name) or _prompt(name, records[name]) for name in chosen}
    bare = _entries(untextured) if untextured else {}
    make_folder(folder.parent)
    with tempfile.TemporaryDirectory(prefix=f".{folder.name}.", dir=folder.parent) as place:
        work = Path(place) / folder.name
        questions = []
        for name in chosen:
            turned = dataclasses.replace(look, azimuth=look.azimuth + _front(records[name]))
            questions.append(_question(work, name, told[name], ours[name], bare.get(name), turned, on_picture))
        study = Study(title, seed, tuple(methods), tuple(questions))
        write_study(work, study)
        try:
            os.replace(work, folder)
        except OSError as error:
            raise output_error(folder, error) from error
    return Created(study, tuple(n for n in names if n not in common), tuple(common[count:]))


def read_prompts(path: Path) -> dict[str, str]:
    """Mesh -> prompt, from a TOML table.

    Raises:
        StudyError: it cannot be read, or a prompt is no text.
    """
    try:
        table = tomllib.loads(path.read_text("utf-8"))
    except (OSError, ValueError) as error:
        raise StudyError("study.prompts", f"cannot read {path}: {error}", 'write lines of mesh = "prompt"') from None
    if wrong := next((name for name, prompt in table.items() if not isinstance(prompt, str)), None):
        raise StudyError("study.prompts", f"{wrong} in {path} is {table[wrong]!r}", 'write lines of mesh = "prompt"')
    return table


def _entries(folder: Path) -> dict[str, Path]:
    """Name of a mesh -> its run, asset or picture in ``folder``; an asset is preferred to a picture of it."""
    if not folder.is_dir():
        raise StudyError("study.folder", f"there is no folder {folder}", "check the path")
    found: dict[str, tuple[int, Path]] = {}
    for path in sorted(folder.iterdir()):
        kind = path.suffix.lower()
        rank = 0 if kind in ASSETS else 1 if (path / "run.json").is_file() else 2 if kind in PICTURES else None
        if rank is not None and not path.name.startswith("."):
            name = path.name.removesuffix(".paintit") if rank == 1 else path.stem
            found[name] = min(found.get(name, (rank, path)), (rank, path))
    if not found:
        known = ", ".join((*PICTURES, *ASSETS))
        raise StudyError("study.empty", f"{folder} holds no picture, asset or run", f"put {known} or run folders there")
    return {name: path for name, (_, path) in sorted(found.items(), key=lambda item: _natural(item[0]))}


def _records(found: Mapping[str, Path]) -> dict[str, Record]:
    """Method -> the record of the run behind its asset, where there is one."""
    records: dict[str, Record] = {}
    for method, path in found.items():
        try:
            records[method] = read_record(find(path) / "run.json")
        except RunError:
            continue
    return records


def _prompt(name: str, records: Mapping[str, Record]) -> str:
    told = {method: record.prompt for method, record in records.items()}
    if len(set(told.values())) > 1:
        text = "; ".join(f"{method}: '{prompt}'" for method, prompt in told.items())
        raise StudyError(
            "study.prompts", f"'{name}' was painted from different prompts ({text})",
            "compare what was made from one prompt, or give it with --prompts",
        )  # fmt: skip
    return next(iter(told.values()), "")


def _front(records: Mapping[str, Record]) -> float:
    """Azimuth of the mesh's front in degrees, as its runs were told (``views.front``)."""
    return next((float(record.config.get("views", {}).get("front", 0.0)) for record in records.values()), 0.0)


def _question(
    work: Path,
    name: str,
    prompt: str,
    entries: Mapping[str, Path],
    bare: Path | None,
    look: Look,
    on_picture: Callable[[str], None] | None,
) -> Question:
    """Write the pictures of one mesh into ``work/<name>/``. All its assets are seen by the first one's cameras."""
    folder = make_folder(work / name)
    written: dict[str, Path] = {}
    stage: _Stage | None = None
    for number, (method, path) in enumerate(entries.items(), 1):
        if on_picture:
            on_picture(f"{name}, {method}")
        if _is_picture(path):
            image = _read(path)
        else:
            asset = load_asset(path)
            stage = stage or _Stage(asset, look)
            image = stage.render(asset)
        written[method] = folder / f"{number}-{re.sub(r'[^A-Za-z0-9_-]+', '-', method)}.png"
        written[method].write_bytes(_png(image))
    untextured = _read(bare) if bare else stage.untextured() if stage else None
    if untextured is None:
        return Question(name, prompt, written)
    (folder / "untextured.png").write_bytes(_png(untextured))
    return Question(name, prompt, written, folder / "untextured.png")


class _Stage:
    """Camera and light for all assets of one question, fitted to the first."""

    def __init__(self, asset: Asset, look: Look) -> None:
        self._asset, self._look = asset, look
        around = orbit(look.views, look.elevation, RADIUS, 0.0, look.azimuth)
        self._cameras = fitted(around, Geometry.from_mesh(asset.mesh).corners)

    def render(self, asset: Asset) -> Image.Image:
        mesh, side = asset.mesh, asset.maps.size[0]
        images = pictures(
            mesh, asset.maps, self._cameras, self._look.light, self._look.size,
            emission=read_emission(mesh, side), occlusion=read_occlusion(mesh, side),
        )  # fmt: skip
        return sheet(images, len(images))

    def untextured(self) -> Image.Image:
        maps = grey(self._asset.maps.layers, 8)
        images = pictures(self._asset.mesh, maps, self._cameras, self._look.light, self._look.size)
        return sheet(images, len(images))


def _is_picture(path: Path) -> bool:
    return path.suffix.lower() in PICTURES


def _read(path: Path) -> Image.Image:
    try:
        with Image.open(path) as image:
            image.load()
            return image.copy()
    except Exception as error:  # Pillow's decoders raise nearly anything on damaged files
        raise StudyError("study.picture", f"cannot read the picture {path}: {error}", "export it again") from None


def _png(image: Image.Image) -> bytes:
    out = io.BytesIO()
    image.save(out, "PNG")
    return out.getvalue()


def _natural(name: str) -> list[tuple[int, str]]:
    """``mesh2`` before ``mesh10``."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", name)]
