"""``paintit render``: pictures of a painted asset."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from paintit.cli.console import Console, Result
from paintit.cli.parse import check_range, parse
from paintit.errors import UsageError

if TYPE_CHECKING:
    from PIL.Image import Image

    from paintit.run.asset import Asset

ABOUT = """Make a picture or a turntable of a painted asset, with the renderer that painted it.

Examples:  paintit render chair.glb -o chair.png --views 4
           paintit render chair.glb -o chair.webp"""


@dataclass(frozen=True)
class RenderArguments:
    """Arguments of ``paintit render``."""

    path: Annotated[tyro.conf.Positional[str | None], tyro.conf.arg(metavar="PATH", help_behavior_hint="")] = None
    """Run folder, or painted GLB or glTF."""
    output: Annotated[str | None, tyro.conf.arg(aliases=["-o"], metavar="PATH", help_behavior_hint="")] = None
    """Picture (.png) or turntable (.webp); by default the asset's name with .png, here."""
    views: int = 1
    """Views side by side, evenly all round; for a turntable, frames (36 unless more than 1 is said)."""
    size: int = 512
    """Pixels along each side of a view."""
    azimuth: float = 35.0
    """Degrees of the first view; 0 looks at the front, 90 at the +X side."""
    elevation: float = 15.0
    """Degrees; positive looks from above."""
    light: str = "default"
    """The light in the package, or an .hdr or .exr file."""
    rotation: float = 0.0
    """Degrees by which the light is turned about the vertical axis."""
    overwrite: tyro.conf.FlagCreatePairsOff[bool] = False
    """Replace what is there."""


def main(arguments: Sequence[str], console: Console) -> Result:
    given = parse(RenderArguments, arguments, "paintit render", ABOUT)
    if given.path is None:
        raise UsageError("usage.no_path", "no run or asset is given", "write: paintit render PATH -o picture.png")
    check_range("--views", given.views, 1, 360)
    check_range("--size", given.size, 8, 8192)
    check_range("--elevation", given.elevation, -89.9, 89.9)
    check_range("--azimuth", given.azimuth, -720, 720)
    check_range("--rotation", given.rotation, -720, 720)
    target = Path(given.output or f"{Path(given.path).resolve().stem or 'render'}.png")
    if target.suffix.lower() not in (".png", ".webp"):
        raise UsageError("output.format", f"cannot write a picture as '{target.name}'", "end it with .png or .webp")
    from paintit.export.preview import sheet, write_turntable
    from paintit.export.write import check_output
    from paintit.files import atomic
    from paintit.render.environment import load_environment
    from paintit.run.asset import load_asset
    from paintit.run.folder import check_writable

    check_output(target, given.overwrite)
    check_writable(target.parent)
    load_environment(given.light, 1.0)
    asset = load_asset(Path(given.path))
    console.note(f"rendering {asset.note}")
    if target.suffix.lower() == ".webp":
        frames = given.views if given.views > 1 else 36
        write_turntable(target, _pictures(asset, given, frames))
    else:
        images = _pictures(asset, given, given.views)
        data = io.BytesIO()
        sheet(images, math.ceil(math.sqrt(len(images)))).save(data, "PNG")
        with atomic(target) as temporary:
            temporary.write_bytes(data.getvalue())
    return Result(str(target), {"image": str(target), "views": given.views, "size": given.size})


def _pictures(asset: Asset, given: RenderArguments, count: int) -> list[Image]:
    """``count`` views evenly all round, from ``--azimuth`` on."""
    import torch
    from PIL import Image

    from paintit.export.preview import BACKGROUND, EXPOSURE
    from paintit.render.camera import look_at
    from paintit.render.environment import load_environment
    from paintit.render.geometry import Geometry
    from paintit.render.light import prefilter
    from paintit.render.render import render_image

    light = prefilter(load_environment(given.light, EXPOSURE))
    geometry = Geometry.from_mesh(asset.mesh)
    azimuth = torch.tensor([given.azimuth + 360.0 * i / count for i in range(count)]).deg2rad()
    elevation = torch.full((count,), math.radians(given.elevation))
    cameras = look_at(azimuth, elevation, 3.25, math.radians(45.0))
    images = []
    for i in range(count):
        pixels = render_image(
            geometry, cameras[i : i + 1], asset.maps, light, given.size, supersample=2,
            rotation=math.radians(given.rotation), background=BACKGROUND,
        )  # fmt: skip
        images.append(Image.fromarray(pixels[0]))
    return images
