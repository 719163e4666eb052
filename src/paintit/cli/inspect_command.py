"""``paintit inspect``: a mesh file, a painted asset, or a run."""

from __future__ import annotations

import dataclasses
import shlex
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from paintit.cli.console import Console, Result, size_text, table
from paintit.cli.parse import parse
from paintit.config import LimitConfig, PaintConfig
from paintit.errors import UsageError
from paintit.settings import validate

if TYPE_CHECKING:
    from paintit.mesh.inspect import MeshSummary
    from paintit.mesh.mesh import Mesh
    from paintit.mesh.quality import UVQuality
    from paintit.run.record import Record

ABOUT = """Say what is in a mesh, a painted asset or a run, and what is wrong with it.

Examples:  paintit inspect chair.obj
           paintit inspect chair.glb --json
           paintit inspect outputs/chair/2026-11-22T14-30-12"""


@dataclass(frozen=True)
class InspectArguments:
    """Arguments of ``paintit inspect``."""

    path: Annotated[tyro.conf.Positional[str | None], tyro.conf.arg(metavar="PATH", help_behavior_hint="")] = None
    """Mesh file, painted asset or run folder."""
    limits: LimitConfig = field(default_factory=LimitConfig)
    """What the file may ask for."""


def main(arguments: Sequence[str], console: Console) -> Result:
    given = parse(InspectArguments, arguments, "paintit inspect", ABOUT)
    validate(PaintConfig(limits=given.limits))
    if given.path is None:
        raise UsageError("usage.no_path", "no file is given", "write: paintit inspect PATH")
    path = Path(given.path)
    return _run(path) if path.is_dir() else _mesh(path, given.limits)


def _run(path: Path) -> Result:
    from paintit.run.folder import find
    from paintit.run.record import read

    folder = find(path)
    record = read(folder / "run.json")
    return Result(table(_record_rows(record)), {"kind": "run", "run": dataclasses.asdict(record)})


def _record_rows(record: Record) -> list[tuple[str, str]]:
    asset = record.input
    return [
        ("outcome", record.outcome),
        ("prompt", record.prompt),
        ("sent to the prior", "\n".join(repr(text) for text in record.prompts)),
        ("mesh", f"{asset.get('name')}, {asset.get('faces')} faces, sha256 {str(asset.get('sha256'))[:12]}"),
        ("asset", record.asset),
        (
            "prior",
            " ".join(str(record.prior.get(key, ""))[:n] for key, n in (("id", 80), ("revision", 12), ("licence", 80))),
        ),
        ("seed", str(record.seed)),
        ("device", f"{record.device} ({record.device_reason})"),
        ("time", f"{record.seconds:.1f} s, started {record.started}"),
        ("peak memory", size_text(record.peak_memory)),
        ("versions", ", ".join(f"{name} {number}" for name, number in record.versions.items())),
        ("command", shlex.join(record.command)),
        ("seams", seam_text(record.seam)),
        ("notes", "\n".join(record.notes) or "none"),
    ]


def _mesh(path: Path, limits: LimitConfig) -> Result:
    from paintit.mesh.gltf_document import GltfDocument
    from paintit.mesh.inspect import summarize
    from paintit.mesh.read import made_paintable, read_as_it_is
    from paintit.mesh.uv import check

    as_it_is = read_as_it_is(path, limits=limits)
    mesh = made_paintable(as_it_is, path)
    summary = summarize(mesh)
    own = summary.uv if summary.uv_origin == "file" else check(as_it_is)
    data: dict[str, Any] = {"kind": "mesh", "mesh": dataclasses.asdict(summary)}
    data["mesh"]["path"] = str(path)
    data["uv_in_file"] = dataclasses.asdict(own)
    rows = _mesh_rows(summary, own)
    document = mesh.source.document if mesh.source is not None else None
    if isinstance(document, GltfDocument):
        data["materials"] = materials(document.json)
        lines = [f"{m['name']}: {', '.join(m['textures']) or 'no textures'}" for m in data["materials"]]
        rows.append(("materials", "\n".join(lines) or "none"))
        data["seam"] = _seam(mesh, data["materials"])
        rows.append(("seams", seam_text(data["seam"])))
        if metadata := document.json.get("asset", {}).get("extras"):
            data["metadata"] = metadata
            rows.append(("metadata", _metadata_text(metadata)))
    return Result(table(rows), data)


def _mesh_rows(summary: MeshSummary, own: UVQuality) -> list[tuple[str, str]]:
    low, high = summary.bounds
    rows = [
        ("file", f"{summary.path} ({summary.format})"),
        ("faces", f"{summary.faces}, {summary.degenerate_faces} degenerate"),
        ("vertices", f"{summary.vertices}, {summary.positions} distinct positions"),
        ("pieces", f"{summary.components}, {'watertight' if summary.watertight else 'not watertight'} "
                   f"({summary.boundary_edges} boundary edges, {summary.non_manifold_edges} non-manifold)"),
        ("bounds", f"{_point(low)} to {_point(high)}, longest edge {summary.extent:.6g}"),
        ("layers", "\n".join(f"{layer.name}: {layer.faces} faces" for layer in summary.layers)),
        ("UVs in the file", own.reason if own.has_uvs else "none"),
    ]  # fmt: skip
    if own.has_uvs:
        rows.append(("", _uv_line(own)))
    if summary.uv_origin != "file":
        rows.append(("UVs made by unwrapping", _uv_line(summary.uv)))
    return [*rows, ("notes", "\n".join(summary.notes) or "none")]


def _uv_line(uv: UVQuality) -> str:
    shared = "no overlap" if uv.overlap < 1.0005 else f"{uv.overlap:.3f} faces to a covered texel (overlap)"
    return (
        f"{uv.islands} islands on {uv.coverage:.1%} of the square, {shared}\n"
        f"{uv.outside_unit:.1%} of corners outside [0, 1], {uv.mirrored_share:.1%} of the area mirrored\n"
        f"{uv.texel_density:.4g} texels per unit of length at {uv.resolution} x {uv.resolution}"
    )


def _seam(mesh: Mesh, described: list[dict[str, Any]]) -> dict[str, Any] | None:
    """The seam figure of the file's own base colours; None without such textures, or without UVs they fit on."""
    if mesh.report.uv_origin != "file" or not any("baseColorTexture" in m["textures"] for m in described):
        return None
    from paintit.export.read_maps import read_maps
    from paintit.export.seams import seam_figure

    figure = seam_figure(mesh, read_maps(mesh))
    return dataclasses.asdict(figure) if figure else None


def seam_text(seam: dict[str, Any] | None) -> str:
    """A ``paintit.export.seams.SeamFigure`` as a dict, in words."""
    if seam is None:
        return "not measured: no texture, no seam, or no other edge to compare with"
    return (
        f"{seam['ratio']:.2f} times the difference across other edges "
        f"({seam['seams']:.2f} against {seam['interior']:.2f} in CIELAB), {seam['edges']} edges\n"
        f"worst {seam['worst']:.2f} at {_point(seam['worst_at'])}"
    )


def _metadata_text(metadata: Any) -> str:
    """The document's extras; what paintit wrote as one line for each entry."""
    ours = metadata.get("paintit") if isinstance(metadata, dict) else None
    if not isinstance(ours, dict) or len(metadata) > 1:
        return str(metadata)
    return "\n".join(f"{key.replace('_', ' ')}: {value}" for key, value in ours.items())


def _point(values: tuple[float, float, float]) -> str:
    return "(" + ", ".join(f"{value:.6g}" for value in values) + ")"


def materials(document: dict[str, Any]) -> list[dict[str, Any]]:
    """Name, factors and textures of each material of a glTF document's JSON."""
    found = []
    for index, material in enumerate(document.get("materials", [])):
        pbr = material.get("pbrMetallicRoughness", {})
        slots = {**pbr, **{key: value for key, value in material.items() if key.endswith("Texture")}}
        found.append(
            {
                "name": material.get("name", f"material {index}"),
                "textures": [key for key in slots if key.endswith("Texture")],
                "factors": {key: value for key, value in pbr.items() if key.endswith("Factor")},
            }
        )
    return found
