"""A painted thing by its path: a run folder, finished or not, or a GLB or glTF with materials."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from paintit import api
from paintit.config import LimitConfig
from paintit.errors import MeshError, RunError
from paintit.export.read_maps import read_maps, read_maps_folder
from paintit.mesh.mesh import Mesh
from paintit.run import record as records
from paintit.run.folder import RunFolder, find
from paintit.run.paint import prepare
from paintit.run.request import Request, settings_of
from paintit.texture.maps import TextureMaps


@dataclass(frozen=True)
class Asset:
    """A mesh with finished maps.

    Attributes:
        mesh, maps: the painted mesh.
        metadata: what goes into an exported file; empty where the file keeps its own.
        note: where the maps came from, in words.
    """

    mesh: Mesh
    maps: TextureMaps
    metadata: dict[str, Any] = field(default_factory=dict)
    note: str = ""


def load_asset(path: Path, limits: LimitConfig | None = None, pose: str = "rest") -> Asset:
    """The painted mesh at ``path``, in ``pose``, if it asks for no more than ``limits``.

    Raises:
        PaintitError: there is nothing painted there.
    """
    if path.is_dir():
        return _of_run(find(path), limits, pose)
    if path.suffix.lower() in (".glb", ".gltf"):
        mesh = api.load_mesh(path, pose=pose, limits=limits)
        return Asset(mesh, read_maps(mesh), note=f"the materials of {path.name}")
    api.load_mesh(path, limits=limits)  # for its own message, where it is no mesh at all
    try:
        folder = find(path)
    except RunError:
        raise MeshError(
            "maps.none", f"{path} has no materials that can be read", "name a .glb, a .gltf or a run folder"
        ) from None
    return _of_run(folder, limits, pose)


def _of_run(path: Path, limits: LimitConfig | None, pose: str) -> Asset:
    """A finished run is read from its asset and textures; another is continued from its checkpoint, in memory."""
    record = records.read(path / "run.json")
    folder = RunFolder(path, path / record.asset)
    if record.state == "finished" and folder.asset.exists():
        config = settings_of(path)
        mesh = api.load_mesh(
            folder.asset, materials=config.materials, exclude=config.exclude, pose=pose,
            limits=limits or config.limits,
        )  # fmt: skip
        painted = folder.asset.suffix.lower() in (".glb", ".gltf")
        maps = read_maps(mesh) if painted else read_maps_folder(folder.textures, mesh)
        return Asset(mesh, maps, {"prompt": record.prompt, "seed": record.seed}, f"the asset of {path}")
    request = Request(None, None, settings_of(path), resume=path)
    job = prepare(request)
    result = api.result_of(job.painter, job.prompt, (), 0.0, stopped=True).finished()
    return Asset(result.mesh, result.maps, result.metadata, f"the run {path}, {result.outcome}")
