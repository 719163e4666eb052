"""``paintit export``: a run or an asset in another format."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from paintit.cli.console import Console, Result
from paintit.cli.parse import parse
from paintit.config import LimitConfig, PaintConfig
from paintit.errors import UsageError
from paintit.settings import validate

ABOUT = """Write a run or a painted asset as GLB, glTF, OBJ, a folder of PNG maps, a picture or a turntable.

The extension of -o says which.

Examples:  paintit export chair.glb -o chair.obj
           paintit export outputs/chair/2026-11-22T14-30-12 -o maps/

A run that was stopped is exported as far as it went."""


@dataclass(frozen=True)
class ExportArguments:
    """Arguments of ``paintit export``."""

    path: Annotated[tyro.conf.Positional[str | None], tyro.conf.arg(metavar="PATH", help_behavior_hint="")] = None
    """Run folder, or painted GLB or glTF."""
    output: Annotated[str | None, tyro.conf.arg(aliases=["-o"], metavar="PATH", help_behavior_hint="")] = None
    """Asset (.glb, .gltf, .obj), folder of PNG maps, picture of four views (.png) or turntable (.webp)."""
    overwrite: tyro.conf.FlagCreatePairsOff[bool] = False
    """Replace what is there."""
    limits: LimitConfig = field(default_factory=LimitConfig)
    """What the file may ask for."""


def main(arguments: Sequence[str], console: Console) -> Result:
    given = parse(ExportArguments, arguments, "paintit export", ABOUT)
    validate(PaintConfig(limits=given.limits))
    if given.path is None:
        raise UsageError("usage.no_path", "no run or asset is given", "write: paintit export PATH -o chair.glb")
    if given.output is None:
        raise UsageError("usage.no_output", "no output is given", "add -o chair.glb, or another name")
    from paintit.export.write import check_output, write
    from paintit.run.asset import load_asset
    from paintit.run.folder import check_writable

    target = Path(given.output)
    check_output(target, given.overwrite)
    check_writable(target.parent)
    asset = load_asset(Path(given.path), given.limits)
    console.note(f"exporting {asset.note}")
    files = write(target, asset.mesh, asset.maps, asset.metadata, given.overwrite)
    return Result(str(target), {"asset": str(target), "files": [str(path) for path in files]})
