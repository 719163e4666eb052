"""The picture of docs/conventions.md: views and their words, the normal map's +Y, the light's rotation, UV's corner.

python docs/pictures/conventions.py
"""

from __future__ import annotations

import math
import tempfile
from pathlib import Path

import torch
from PIL import Image, ImageDraw, ImageFont

from paintit.guidance.prompt import view_word
from paintit.mesh.mesh import Mesh
from paintit.mesh.read import read_mesh
from paintit.render.camera import look_at
from paintit.render.environment import load_environment
from paintit.render.geometry import Geometry
from paintit.render.light import prefilter
from paintit.render.render import render_image
from paintit.texture.maps import TextureMaps

ROOT = Path(__file__).parents[2]
SIZE = 256


def sphere(rings: int = 48) -> Mesh:
    """A unit sphere, u eastward from the front's left, v downward from the north pole."""
    lines, columns = [], 2 * rings
    for i in range(rings + 1):
        for j in range(columns + 1):
            polar, azimuth = math.pi * i / rings, 2 * math.pi * j / columns - math.pi
            x, y, z = math.sin(polar) * math.sin(azimuth), math.cos(polar), math.sin(polar) * math.cos(azimuth)
            lines += [f"v {x} {y} {z}", f"vn {x} {y} {z}", f"vt {j / columns} {1 - i / rings}"]
    for i in range(rings):
        for j in range(columns):
            a, b = i * (columns + 1) + j + 1, (i + 1) * (columns + 1) + j + 1
            corners = [a, b, b + 1, a + 1]
            lines.append("f " + " ".join(f"{c}/{c}/{c}" for c in corners))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "sphere.obj"
        path.write_text("\n".join(lines))
        return read_mesh(path, "never")


def maps(
    color: torch.Tensor, roughness: float = 0.6, metallic: float = 0.0, normal: torch.Tensor | None = None
) -> TextureMaps:
    """Maps of one layer from (h, w, 3) linear base colour."""
    h, w, _ = color.shape
    flat = torch.tensor([0.0, 0.0, 1.0]).expand(h, w, 3) if normal is None else normal
    one = torch.ones(1, h, w, 1)
    return TextureMaps(color[None], roughness * one, metallic * one, flat[None])


def picture(mesh: Mesh, textures: TextureMaps, azimuth: float, elevation: float, rotation: float = 0.0,
            light: str = "default", text: str = "") -> Image.Image:  # fmt: skip
    camera = look_at(
        torch.tensor([math.radians(azimuth)]), torch.tensor([math.radians(elevation)]), 3.25, math.radians(45)
    )
    environment = prefilter(load_environment(light, 0.7))
    pixels = render_image(Geometry.from_mesh(mesh), camera, textures, environment, SIZE, background=0.6,
                          rotation=math.radians(rotation))  # fmt: skip
    image = Image.fromarray(pixels[0])
    ImageDraw.Draw(image).multiline_text((6, 4), text, "black", ImageFont.load_default(14))
    return image


def main() -> None:
    figure = read_mesh(ROOT / "assets/meshes/human.obj")
    clay = maps(torch.full((32, 32, 3), 0.5))
    images = []
    for azimuth, elevation in ((0, 0), (90, 0), (180, 0), (0, 60)):
        word = view_word(math.radians(azimuth), math.radians(elevation))
        images.append(
            picture(figure, clay, azimuth, elevation, text=f"azimuth {azimuth}, elevation {elevation}\n{word} view")
        )

    ball, v, u = sphere(), *torch.meshgrid(torch.arange(256) / 256, torch.arange(512) / 512, indexing="ij")
    ramp = torch.stack([u, v, torch.zeros_like(u)], -1)
    ramp = torch.nn.functional.interpolate(ramp.movedim(-1, 0)[None], (512, 512))[0].movedim(0, -1)
    images.append(picture(ball, maps(ramp), 0, 20, text="base colour (u, v, 0)\nv = 0 at the top"))
    # A raised dome in the middle of the map: its upper half tilts to +Y, so light from above catches it.
    y, x = torch.meshgrid(torch.linspace(1, -1, 512), torch.linspace(-1, 1, 512), indexing="ij")
    inside = ((4 * x) ** 2 + (2 * y) ** 2 < 1)[..., None]
    dome = torch.stack([4 * x * 0.8, 2 * y * 0.8, torch.ones_like(x)], -1)
    dome = torch.nn.functional.normalize(torch.where(inside, dome, torch.tensor([0.0, 0.0, 1.0])), dim=-1)
    images.append(
        picture(
            ball,
            maps(torch.full((512, 512, 3), 0.5), normal=dome),
            0,
            0,
            text="normal map: a dome,\n+Y is lit from above",
        )
    )
    sunset = str(ROOT / "assets/envmaps/venice_sunset_512.hdr")
    mirror = maps(torch.full((32, 32, 3), 0.9), 0.1, 1.0)
    for rotation in (0, 90):
        images.append(picture(ball, mirror, 0, 0, rotation, sunset, f"light rotation {rotation}"))
    sheet = Image.new("RGB", (4 * SIZE, 2 * SIZE))
    for i, image in enumerate(images):
        sheet.paste(image, (i % 4 * SIZE, i // 4 * SIZE))
    sheet.save(ROOT / "docs/img/conventions.png", optimize=True)


if __name__ == "__main__":
    main()
