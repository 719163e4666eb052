"""What was asked for, and the checks that a paint and its dry run begin with."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from paintit import api
from paintit.config import PaintConfig, ViewConfig
from paintit.errors import UsageError
from paintit.export.siblings import check_siblings
from paintit.mesh.mesh import Mesh
from paintit.run.folder import RunFolder, check_free, check_writable, resolve
from paintit.settings import load_toml, validate


@dataclass(frozen=True)
class Request:
    """What was asked for. ``mesh`` and ``prompt`` may be left out where ``resume`` names a run."""

    mesh: Path | None
    prompt: str | None
    config: PaintConfig
    output: str | None = None
    resume: Path | None = None
    overwrite: bool = False
    snapshot_every: int = 0
    preview: bool = True
    turntable: bool = False
    allow_download: bool = False
    command: tuple[str, ...] = ()


@dataclass(frozen=True)
class Checked:
    """What a request for a new run comes to."""

    folder: RunFolder
    mesh: Mesh
    prompt: str


def check(request: Request) -> Checked:
    """Check a request for a new run, cheap mistakes first: settings, prompt, output, mesh. Writes nothing.

    Raises:
        PaintitError: whatever is wrong with one of them.
    """
    validate(request.config)
    prompt = api.check_prompt(request.prompt)
    if request.mesh is None:
        raise UsageError("usage.no_mesh", "no mesh is given", 'write: paintit paint MESH "PROMPT"')
    folder = resolve(request.output, request.mesh)
    check_free(folder, request.mesh, request.overwrite)
    check_writable(folder.asset.parent)
    check_writable(folder.folder)
    mesh = load(request.mesh, request.config)
    check_siblings(folder.asset, mesh, request.overwrite)
    return Checked(folder, mesh, prompt)


def load(path: Path, config: PaintConfig) -> Mesh:
    """The mesh as the settings want it unwrapped, posed and chosen from.

    Raises:
        PaintitError: it cannot be read, or a material is not there.
    """
    return api.load_mesh(path, config.unwrap, config.materials, config.exclude, pose=config.pose, limits=config.limits)


def settings_of(run: Path) -> PaintConfig:
    """The settings that the run in the folder ``run`` was painted with.

    A setting that is younger than the run has the value of what was done before there was the setting, and not that of
    the preset today.

    Raises:
        UsageError: they cannot be read.
    """
    return load_toml(run / "config.toml", PaintConfig(views=ViewConfig(auto_focus=False)))
