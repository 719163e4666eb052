"""Pictures of a painted mesh: a few views side by side, and a turntable. The renderer and the light of the painting."""

from __future__ import annotations

import io
import math
from collections.abc import Callable
from pathlib import Path

import torch
from PIL import Image

from paintit.errors import UsageError
from paintit.export.image import check_layers
from paintit.files import write_files
from paintit.mesh.mesh import Mesh
from paintit.render.camera import Cameras, fitted, look_at, orbit
from paintit.render.environment import load_environment
from paintit.render.geometry import Geometry
from paintit.render.light import Light, prefilter
from paintit.render.render import Background, render_image
from paintit.texture.maps import TextureMaps

#: Mean radiance of a white diffuse sphere under the light: the base colours come out about as bright as they are.
EXPOSURE = 0.8
#: Linear grey behind the mesh: light, so that dark materials stand out and white ones still do.
BACKGROUND = 0.6
#: Distance of the camera from the box's centre, where the mesh's longest edge is 2.
RADIUS = 3.25
#: Vertical field of view in degrees.
FOV = 45.0


def preview_cameras(views: int = 4) -> Cameras:
    """Views for a contact sheet: the first is the front from 35 degrees to the right, then evenly around; from above by
    20 degrees, every second one by 5."""
    azimuth = torch.tensor([35.0 + 360.0 * i / views for i in range(views)]).deg2rad()
    elevation = torch.tensor([20.0 if i % 2 == 0 else 5.0 for i in range(views)]).deg2rad()
    return look_at(azimuth, elevation, RADIUS, math.radians(FOV))


def preview(
    mesh: Mesh,
    maps: TextureMaps,
    light_path: str = "default",
    size: int = 512,
    views: int = 4,
    *,
    exposure: float = EXPOSURE,
    rotation_deg: float = 0.0,
    background: Background = BACKGROUND,
    supersample: int = 2,
    columns: int | None = None,
) -> Image.Image:
    """``views`` pictures of ``size`` pixels in one sheet, left to right, top to bottom; the mesh nearly fills them.

    Args:
        light_path: ``"default"``, an .hdr or an .exr file.
        exposure: mean radiance of a white diffuse sphere under the light; 0 keeps the file's values.
        rotation_deg: the light turned about the vertical axis.
        background: linear grey behind the mesh, "light" for the environment itself, or "transparent".
        columns: pictures in a row; None: two where there are four, else all in one row.

    Raises:
        LightError: the light cannot be read.
        UsageError: ``"preview.size"``, no views or no pixels.
    """
    cameras = fitted(preview_cameras(_positive(views, "views")), Geometry.from_mesh(mesh).corners)
    images = pictures(
        mesh, maps, cameras, light_path, size,
        exposure=exposure, rotation_deg=rotation_deg, background=background, supersample=supersample,
    )  # fmt: skip
    return sheet(images, columns or (2 if views == 4 else views))


def turntable(
    mesh: Mesh,
    maps: TextureMaps,
    light_path: str = "default",
    size: int = 384,
    frames: int = 36,
    *,
    elevation_deg: float = 15.0,
    exposure: float = EXPOSURE,
    rotation_deg: float = 0.0,
    background: Background = BACKGROUND,
    supersample: int = 2,
    on_frame: Callable[[int, int], None] | None = None,
) -> list[Image.Image]:
    """Frames of one full turn of the camera, the front first. ``on_frame(done, frames)`` is called after each.

    Raises: as :func:`preview`.
    """
    around = orbit(_positive(frames, "frames"), elevation_deg, RADIUS, FOV)
    cameras = fitted(around, Geometry.from_mesh(mesh).corners)
    return pictures(
        mesh, maps, cameras, light_path, size,
        exposure=exposure, rotation_deg=rotation_deg, background=background, supersample=supersample, on_frame=on_frame,
    )  # fmt: skip


def write_turntable(path: Path, frames: list[Image.Image], frames_per_second: float = 12.0) -> None:
    """Write frames as an endless animated WebP.

    Raises:
        OutputError: the file system refuses.
    """
    out = io.BytesIO()
    frames[0].save(
        out,
        format="WEBP",
        save_all=True,
        append_images=frames[1:],
        loop=0,
        duration=round(1000 / frames_per_second),
        quality=85,
        method=4,
    )
    write_files({Path(path): out.getvalue()})


def sheet(images: list[Image.Image], columns: int) -> Image.Image:
    """Images of one size in rows of ``columns``."""
    width, height = images[0].size
    rows = -(-len(images) // columns)
    out = Image.new(images[0].mode, (width * min(columns, len(images)), height * rows), "white")
    for i, image in enumerate(images):
        out.paste(image, (i % columns * width, i // columns * height))
    return out


def _positive(value: int, name: str) -> int:
    if value < 1:
        raise UsageError("preview.size", f"{name} is {value}", f"choose {name} of at least 1")
    return value


def pictures(
    mesh: Mesh,
    maps: TextureMaps,
    cameras: Cameras,
    light_path: str = "default",
    size: int = 512,
    *,
    exposure: float = EXPOSURE,
    rotation_deg: float = 0.0,
    background: Background = BACKGROUND,
    supersample: int = 2,
    emission: torch.Tensor | None = None,
    occlusion: torch.Tensor | None = None,
    on_frame: Callable[[int, int], None] | None = None,
) -> list[Image.Image]:
    """One picture of ``size`` pixels a side from each camera; ``on_frame(done, all)`` is called after each.

    No tone curve: radiance is clipped to [0, 1] and sRGB-coded (:func:`paintit.render.render.render_image`). RGB, or
    RGBA where the background is transparent. ``emission`` and ``occlusion`` as :mod:`paintit.export.read_maps` gives
    them.

    Raises: as :func:`preview`.
    """
    check_layers(mesh, maps)
    _positive(size, "size")
    geometry = Geometry.from_mesh(mesh)
    maps = TextureMaps.unpacked(maps.packed().detach().to("cpu", torch.float32))
    light: Light = prefilter(load_environment(light_path, exposure))
    images = []
    for i in range(len(cameras)):
        pixels = render_image(
            geometry, cameras[i : i + 1], maps, light, size,
            supersample=supersample, rotation=math.radians(rotation_deg), background=background,
            emission=emission, occlusion=occlusion,
        )  # fmt: skip
        images.append(Image.fromarray(pixels[0]))
        if on_frame is not None:
            on_frame(i + 1, len(cameras))
    return images
