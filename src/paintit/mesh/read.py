"""A file on disk to a ``Mesh``, with everything that was found and repaired on the way."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from paintit.config import LimitConfig
from paintit.errors import MeshError, UsageError
from paintit.mesh import quality
from paintit.mesh.choice import choose, with_some_uvs
from paintit.mesh.gltf import read_gltf
from paintit.mesh.gltf_parse import read_document
from paintit.mesh.limits import check_limit, mib
from paintit.mesh.mesh import Mesh, Report, Source
from paintit.mesh.normals import CREASE_DEGREES, face_normals, flat_normals, smooth_normals
from paintit.mesh.obj import read_obj
from paintit.mesh.off import read_off
from paintit.mesh.parsed import Parsed
from paintit.mesh.ply import read_ply
from paintit.mesh.pose import REST
from paintit.mesh.stl import read_stl
from paintit.mesh.tangents import mikktspace
from paintit.mesh.unwrap import unwrap as make_uvs

_FARTHEST = 1e30
"""Coordinates beyond this, and meshes smaller than its inverse, leave the range of float32 once they are squared."""
FORMATS = ("obj", "ply", "stl", "off", "glb", "gltf")
Unwrap = Literal["auto", "always", "never"]


def read_mesh(
    path: str | Path,
    unwrap: Unwrap = "auto",
    materials: Sequence[str] = (),
    exclude: Sequence[str] = (),
    *,
    pose: str = REST,
    limits: LimitConfig | None = None,
) -> Mesh:
    """Read a mesh and make it ready to paint.

    Args:
        path: an .obj, .ply, .stl, .off, .glb or .gltf file.
        unwrap: ``"auto"`` keeps the texture coordinates of each layer where they can be painted on and makes new ones
            where not; ``"always"`` makes new ones; ``"never"`` refuses a mesh that needs them.
        materials: names of the materials to paint; empty: all.
        exclude: names of materials not to paint. What is not painted is neither unwrapped nor judged.
        pose: ``"rest"`` or a moment of a glTF animation, ``"NAME@SECONDS"``.
        limits: what the file may ask for.

    Raises:
        MeshError: the file cannot be read or cannot be painted.
        UsageError: ``unwrap`` is none of the three; a material is not there, or none is left.
    """
    if unwrap not in ("auto", "always", "never"):
        raise UsageError("mesh.unwrap_mode", f"unwrap is '{unwrap}'", "choose auto, always or never")
    mesh = read_as_it_is(path, pose=pose, limits=limits)
    return made_paintable(replace(mesh, layers=choose(mesh.layers, materials, exclude)), path, unwrap)


def made_paintable(mesh: Mesh, path: str | Path, unwrap: Unwrap = "auto") -> Mesh:
    """What :func:`read_as_it_is` read from ``path``, with texture coordinates to paint on and tangents.

    Raises:
        MeshError: they cannot be made.
    """
    try:
        return _with_uvs(with_some_uvs(mesh), unwrap)
    except MeshError as error:
        raise MeshError(error.code, f"cannot read {path}: {error.message}", error.hint) from error


def read_as_it_is(path: str | Path, *, pose: str = REST, limits: LimitConfig | None = None) -> Mesh:
    """The mesh with the file's own texture coordinates, however bad, and without tangents: for reports.

    A corner without texture coordinates has ``face_uvs`` -1. Arguments as :func:`read_mesh`.

    Raises:
        MeshError: the file cannot be read or cannot be painted.
    """
    path, limits = Path(path), limits or LimitConfig()
    try:
        kind, data = _load(path, limits)
        parsed = _parse(path, kind, data, pose, limits)
        check_limit(limits, "faces", len(parsed.faces), "triangles")
        return _complete(parsed, path, kind, data)
    except MeshError as error:
        if error.code in _SAYS_PATH:
            raise
        raise MeshError(error.code, f"cannot read {path}: {error.message}", error.hint) from error


#: Errors whose message names the file already.
_SAYS_PATH = (
    "mesh.folder", "mesh.missing", "mesh.not_a_file", "mesh.extension", "mesh.unreadable", "mesh.empty_file",
)  # fmt: skip


def _load(path: Path, limits: LimitConfig) -> tuple[str, bytes]:
    kind = path.suffix.lower().lstrip(".")
    known = ", ".join(f".{f}" for f in FORMATS)
    if path.is_dir():
        raise MeshError("mesh.folder", f"{path} is a folder, not a mesh file", f"name a file inside it ({known})")
    if not path.exists():
        raise MeshError("mesh.missing", f"there is no file {path}", "check the path")
    if kind not in FORMATS:
        raise MeshError(
            "mesh.extension",
            f"{path} is not a mesh file that can be read ('.{kind}')" if kind else f"{path} has no extension",
            f"use one of {known}",
        )
    if not path.is_file():
        raise MeshError("mesh.not_a_file", f"{path} is a device or a pipe, not a file", "copy it into a file first")
    try:
        check_limit(limits, "file_mib", mib(path.stat().st_size), "MiB of the file")
        data = path.read_bytes()
    except OSError as error:
        raise MeshError(
            "mesh.unreadable", f"cannot read {path}: {(error.strerror or str(error)).lower()}", "check its permissions"
        ) from None
    if not data:
        raise MeshError("mesh.empty_file", f"{path} is empty (0 bytes)", "export or copy the mesh again")
    return kind, data


def _parse(path: Path, kind: str, data: bytes, pose: str, limits: LimitConfig) -> Parsed:
    if kind in ("glb", "gltf"):
        return read_gltf(read_document(path, data, limits), pose)
    if pose != REST:
        raise MeshError("mesh.pose", f"a .{kind} file has no animation to take a pose from", "leave --pose out")
    if kind == "obj":
        return read_obj(data)
    return {"ply": read_ply, "stl": read_stl, "off": read_off}[kind](data)


def _complete(parsed: Parsed, path: Path, kind: str, data: bytes) -> Mesh:
    """A ``Mesh`` with normals; tangents and missing texture coordinates still to come."""
    notes = list(parsed.notes)
    if not np.isfinite(parsed.vertices).all():
        bad = int(np.flatnonzero(~np.isfinite(parsed.vertices).all(1))[0])
        raise MeshError(
            "mesh.nan",
            f"vertex {bad} is not finite: {parsed.vertices[bad].tolist()}",
            "repair the file or export it again",
        )
    _check_size(parsed)
    area = face_normals(parsed.vertices, parsed.faces)[1]
    flat = int((area == 0).sum())
    if flat == len(area):
        raise MeshError(
            "mesh.degenerate",
            f"all {len(area)} faces are degenerate (zero area)",
            "repair the mesh: its triangles have no area",
        )
    if flat:
        notes.append(f"{flat} degenerate triangles (zero area) kept; they stay invisible")
    normals = _normals(parsed, notes)
    source = Source(path, kind, hashlib.sha256(data).hexdigest(), parsed.document, parsed.corner_vertex)
    tangents = np.zeros((len(parsed.faces), 3, 4), np.float32)
    return Mesh(
        parsed.vertices,
        parsed.faces,
        parsed.uvs,
        parsed.face_uvs,
        normals,
        tangents,
        parsed.face_layer,
        parsed.layers,
        parsed.parts,
        source,
        Report(tuple(notes)),
        parsed.head,
    )


def _check_size(parsed: Parsed) -> None:
    """Refuse what the formats that are written, which hold float32, could not hold."""
    farthest = float(np.abs(parsed.vertices).max())
    with np.errstate(over="ignore"):
        extent = float(np.ptp(parsed.vertices[parsed.faces.reshape(-1)], axis=0).max())
    if farthest > _FARTHEST or 0 < extent < 1 / _FARTHEST:
        raise MeshError(
            "mesh.size",
            f"the mesh is {extent:.3g} across and reaches out to {farthest:.3g}, beyond what 3D formats can hold",
            "scale it to a usual unit, such as metres",
        )


def _normals(parsed: Parsed, notes: list[str]) -> NDArray[np.float32]:
    """The file's normals, unit; computed where they are missing or bad."""
    given = parsed.normals.astype(np.float64)
    absent = np.isnan(given).all(-1)
    with np.errstate(invalid="ignore", over="ignore"):
        length = np.linalg.norm(given, axis=-1, keepdims=True)
        unit = given / np.where(length > 0, length, 1.0)
    bad = ~(np.isfinite(unit).all(-1) & (length[..., 0] > 1e-8))
    if bad.any():
        made = (smooth_normals if parsed.smooth else flat_normals)(parsed.vertices, parsed.faces)
        unit[bad] = (made * _sides(made, np.where(bad[..., None], 0.0, unit))[:, None, None])[bad]
        how = (
            f"smooth, with edges over {CREASE_DEGREES:.0f} degrees kept sharp"
            if parsed.smooth
            else "flat, as glTF asks"
        )
        if bad.all():
            notes.append(f"computed normals ({how})")
        else:
            broken = int((bad & ~absent).sum())
            notes.append(
                f"computed normals at {int(bad.sum())} corners where they were missing or bad ({broken} bad; {how})"
            )
    return unit.astype(np.float32)


def _sides(made: NDArray[np.float32], given: NDArray[np.float64]) -> NDArray[np.float64]:
    """(f,) -1 for faces that wind against the good normals the file has at their other corners, else 1.

    Faces without any, (f, 3, 3) zeros in ``given``, go with the majority of the rest.
    """
    toward = np.einsum("fkc,fkc->f", made.astype(np.float64), given)
    toward[toward == 0] = toward.sum()
    return np.where(toward < 0, -1.0, 1.0)


def _with_uvs(mesh: Mesh, unwrap: Unwrap) -> Mesh:
    painted = tuple(k for k, layer in enumerate(mesh.layers) if layer.painted)
    if unwrap == "always":
        return make_uvs(mesh, painted)
    found = quality.check(mesh)
    if unwrap == "never" and not found.paintable:
        raise MeshError(
            "mesh.uvs",
            f"its texture coordinates cannot be painted on: {found.reason}",
            "let new ones be made with --unwrap auto, or unwrap the mesh in a 3D program",
        )
    judged = dict(zip(painted, found.layers, strict=True))
    bad = tuple(k for k, q in judged.items() if not q.paintable)
    notes = [f"new texture coordinates for '{mesh.layers[k].name}': {judged[k].reason}" for k in bad]
    notes += [
        f"kept the texture coordinates of '{mesh.layers[k].name}': {q.reason}"
        for k, q in judged.items()
        if q.paintable and max(q.mirrored_overlap, q.distant_overlap) > 0.001
    ]
    # Those that are not finite are replaced now, or no corner uses them.
    uvs = np.nan_to_num(mesh.uvs, nan=0.0, posinf=0.0, neginf=0.0)
    mesh = replace(mesh, uvs=uvs, report=replace(mesh.report, notes=mesh.report.notes + tuple(notes)))
    if bad:
        return make_uvs(mesh, bad)
    return replace(mesh, tangents=mikktspace(mesh.vertices, mesh.faces, mesh.uvs, mesh.face_uvs, mesh.normals))
