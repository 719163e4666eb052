"""``paintit render``: pictures of a painted asset."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from paintit.cli.console import Console, Result
from paintit.cli.parse import check_range, parse
from paintit.config import LimitConfig, PaintConfig
from paintit.errors import UsageError
from paintit.settings import validate

if TYPE_CHECKING:
    from PIL.Image import Image

    from paintit.render.render import Background
    from paintit.run.asset import Asset

ABOUT = """Make a picture or a turntable of a painted asset, with the renderer that painted it.

There is no tone curve: radiance is clipped and sRGB-coded, as by Blender's view transform 'Standard' and by three.js
without tone mapping. The camera looks at the middle of the asset's bounding box, up is +Y.

Examples:  paintit render chair.glb -o chair.png --views 4
           paintit render chair.glb -o chair.png --light sunset.hdr --exposure 0 --background light
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
    radius: float = 3.25
    """Distance of the camera, where the asset's longest edge is 2."""
    fov: float = 45.0
    """Vertical field of view in degrees."""
    light: str = "default"
    """The light in the package, or an .hdr or .exr file."""
    exposure: float = 0.8
    """Brightness that a white diffuse sphere would show on average; 0 keeps the file's own values."""
    rotation: float = 0.0
    """Degrees by which the light is turned about the vertical axis; at 90 it lies as Blender and three.js lay it."""
    background: Annotated[str, tyro.conf.arg(metavar="GREY|light|transparent")] = "0.6"
    """Linear grey from 0 to 1, ``light`` for the light itself, or ``transparent``."""
    pose: str = "rest"
    """A moment of a glTF animation to show: NAME@SECONDS, NAME or its number, @SECONDS of the first."""
    overwrite: tyro.conf.FlagCreatePairsOff[bool] = False
    """Replace what is there."""
    limits: LimitConfig = field(default_factory=LimitConfig)
    """What the file may ask for."""


def main(arguments: Sequence[str], console: Console) -> Result:
    given = parse(RenderArguments, arguments, "paintit render", ABOUT)
    validate(PaintConfig(limits=given.limits))
    if given.path is None:
        raise UsageError("usage.no_path", "no run or asset is given", "write: paintit render PATH -o picture.png")
    check_range("--views", given.views, 1, 360)
    check_range("--size", given.size, 8, 8192)
    check_range("--elevation", given.elevation, -89.9, 89.9)
    check_range("--azimuth", given.azimuth, -720, 720)
    check_range("--rotation", given.rotation, -720, 720)
    check_range("--radius", given.radius, 0.1, 1000)
    check_range("--fov", given.fov, 1, 150)
    check_range("--exposure", given.exposure, 0, 1000)
    background = _background(given.background)
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
    asset = load_asset(Path(given.path), given.limits, given.pose)
    console.note(f"rendering {asset.note}")
    if target.suffix.lower() == ".webp":
        frames = given.views if given.views > 1 else 36
        write_turntable(target, _pictures(asset, given, frames, background))
    else:
        images = _pictures(asset, given, given.views, background)
        data = io.BytesIO()
        sheet(images, math.ceil(math.sqrt(len(images)))).save(data, "PNG")
        with atomic(target) as temporary:
            temporary.write_bytes(data.getvalue())
    return Result(str(target), {"image": str(target), "views": given.views, "size": given.size})


def _background(text: str) -> Background:
    """What ``--background`` says.

    Raises:
        UsageError: it is neither a word nor a grey from 0 to 1.
    """
    if text == "light" or text == "transparent":
        return text
    try:
        grey = float(text)
    except ValueError:
        hint = "give a grey from 0 to 1, 'light' or 'transparent'"
        raise UsageError("usage.background", f"--background is '{text}'", hint) from None
    check_range("--background", grey, 0, 1)
    return grey


def _pictures(asset: Asset, given: RenderArguments, count: int, background: Background) -> list[Image]:
    """``count`` views evenly all round, from ``--azimuth`` on."""
    from paintit.export.preview import pictures
    from paintit.export.read_maps import read_emission, read_occlusion
    from paintit.render.camera import orbit

    mesh, side = asset.mesh, asset.maps.size[0]
    cameras = orbit(count, given.elevation, given.radius, given.fov, given.azimuth)
    return pictures(
        mesh, asset.maps, cameras, given.light, given.size,
        exposure=given.exposure, rotation_deg=given.rotation, background=background,
        emission=read_emission(mesh, side), occlusion=read_occlusion(mesh, side),
    )  # fmt: skip
