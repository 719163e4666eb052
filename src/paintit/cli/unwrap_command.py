"""``paintit unwrap``: new texture coordinates, with their quality before and after."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from paintit.cli.console import Console, Result
from paintit.cli.parse import parse
from paintit.config import LimitConfig, PaintConfig
from paintit.errors import UsageError
from paintit.settings import validate

if TYPE_CHECKING:
    from paintit.mesh.mesh import Mesh
    from paintit.mesh.uv import UVQuality
    from paintit.texture.maps import TextureMaps

ABOUT = """Give a mesh new texture coordinates and report their quality, before and after.

Example:  paintit unwrap koala.ply -o koala.glb

Without -o only the report is made."""

#: Rows of the report: field of UVQuality, and how to print it.
_ROWS = {
    "islands": "{:d}",
    "overlap": "{:.3f}",
    "coverage": "{:.1%}",
    "zero_area_faces": "{:d}",
    "outside_unit": "{:.1%}",
    "mirrored_share": "{:.1%}",
    "texel_density": "{:.4g}",
    "density_spread": "{:.2f}",
}
#: What a row is called where the field's name would mislead.
_LABELS = {
    "overlap": "faces to a covered texel",
    "outside_unit": "corners outside [0, 1]",
    "mirrored_share": "mirrored area",
    "texel_density": "texels per unit at 512",
    "density_spread": "density, 95th / 5th %",
}


@dataclass(frozen=True)
class UnwrapArguments:
    """Arguments of ``paintit unwrap``."""

    mesh: Annotated[tyro.conf.Positional[str | None], tyro.conf.arg(metavar="MESH", help_behavior_hint="")] = None
    """OBJ, PLY, STL, OFF, GLB or glTF."""
    output: Annotated[str | None, tyro.conf.arg(aliases=["-o"], metavar="PATH", help_behavior_hint="")] = None
    """File (.glb, .gltf, .obj) with the new texture coordinates and grey maps."""
    overwrite: tyro.conf.FlagCreatePairsOff[bool] = False
    """Replace what is there."""
    limits: LimitConfig = field(default_factory=LimitConfig)
    """What the file may ask for."""


def main(arguments: Sequence[str], console: Console) -> Result:
    given = parse(UnwrapArguments, arguments, "paintit unwrap", ABOUT)
    validate(PaintConfig(limits=given.limits))
    if given.mesh is None:
        raise UsageError("usage.no_mesh", "no mesh is given", "write: paintit unwrap MESH -o OUT.glb")
    from paintit.mesh.read import read_as_it_is, read_mesh
    from paintit.mesh.uv import check

    target = Path(given.output) if given.output is not None else None
    if target is not None:
        _check_target(target, given.overwrite)
    before = check(read_as_it_is(Path(given.mesh), limits=given.limits))
    mesh = read_mesh(Path(given.mesh), unwrap="always", limits=given.limits)
    after = check(mesh)
    data: dict[str, Any] = {"before": quality(before), "after": quality(after), "notes": list(mesh.report.notes)}
    if target is None:
        return Result(comparison(before, after), data)
    from paintit.export.write import write

    write(target, mesh, _grey(mesh), {}, overwrite=given.overwrite)
    console.note(comparison(before, after))
    return Result(str(target), data | {"asset": str(target)})


def _check_target(target: Path, overwrite: bool) -> None:
    from paintit.export.write import check_output
    from paintit.run.folder import ASSETS, check_writable

    if target.suffix.lower() not in ASSETS:
        raise UsageError("output.format", f"cannot write a mesh as '{target.name}'",
                         f"end the name with {', '.join(ASSETS)}")  # fmt: skip
    check_output(target, overwrite)
    check_writable(target.parent)


def quality(measured: UVQuality) -> dict[str, Any]:
    """The report as plain data."""
    return {key: value for key, value in dataclasses.asdict(measured).items() if key != "layers"}


def comparison(before: UVQuality, after: UVQuality) -> str:
    """Before and after in two columns."""
    lines = [f"{'':<24}  {'before':>10}  {'after':>10}"]
    for name, form in _ROWS.items():
        old = form.format(getattr(before, name)) if before.has_uvs else "-"
        lines.append(
            f"{_LABELS.get(name, name.replace('_', ' ')):<24}  {old:>10}  {form.format(getattr(after, name)):>10}"
        )
    return "\n".join([*lines, f"before: {before.reason}", f"after: {after.reason}"])


def _grey(mesh: Mesh) -> TextureMaps:
    """Plain maps, one set per layer: the file carries coordinates, not colours."""
    import torch

    from paintit.texture.maps import TextureMaps

    def plain(*values: float) -> torch.Tensor:
        return torch.tensor(values).expand(len(mesh.layers), 16, 16, len(values)).contiguous()

    return TextureMaps(plain(0.5, 0.5, 0.5), plain(0.8), plain(0.0), plain(0.0, 0.0, 1.0))
