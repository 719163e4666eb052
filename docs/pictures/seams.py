"""The picture and the table of docs/design/seams.md: the worst seam of four painted meshes, before and after.

    python docs/pictures/seams.py [--runs outputs/showcase]

Reads the run folders of docs/pictures/showcase.py, as trained, and finishes their maps without and with closed seams.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np
import torch
from PIL import Image, ImageDraw, ImageFont

from paintit import api
from paintit.export.finish import filled, finish
from paintit.export.preview import EXPOSURE
from paintit.export.seams import SeamFigure, seam_figure
from paintit.mesh.mesh import Mesh
from paintit.render.camera import Cameras, look_at
from paintit.render.environment import load_environment
from paintit.render.geometry import Geometry
from paintit.render.light import prefilter
from paintit.render.render import render_image
from paintit.run.paint import prepare
from paintit.run.request import Request, settings_of
from paintit.texture.maps import TextureMaps

ROOT = Path(__file__).parents[2]
NAMES = ("koala", "spot", "teapot", "bob")
SIZE = 264
#: Normalised units from the camera to the seam, and its field of view in degrees: about 0.4 units across.
DISTANCE, FOV = 1.0, 22.0


def maps_of(run: Path) -> tuple[Mesh, TextureMaps, TextureMaps]:
    """The mesh of a run, its maps finished without closing seams, and with it."""
    job = prepare(Request(None, None, settings_of(run), resume=run))
    result = api.result_of(job.painter, job.prompt, (), 0.0, stopped=True)
    before = TextureMaps.unpacked(torch.from_numpy(filled(result.mesh, result.maps, result.support)))
    return result.mesh, before, finish(result.mesh, result.maps, result.support)


def camera_at(mesh: Mesh, point: tuple[float, float, float]) -> Cameras:
    """Looks straight at a point of the surface."""
    corners = mesh.vertices[mesh.faces]
    near = np.linalg.norm(corners.mean(1) - np.array(point), axis=-1).argsort()[:6]
    x, y, z = mesh.normals[near].mean((0, 1)).tolist()
    target = tuple(((np.array(point) - mesh.center) * 2 / mesh.extent).tolist())
    azimuth, elevation = torch.tensor([math.atan2(x, z)]), torch.tensor([math.atan2(y, math.hypot(x, z))])
    return look_at(azimuth, elevation, DISTANCE, math.radians(FOV), target)


def row(name: str, figures: list[SeamFigure]) -> str:
    """One line of the table."""
    cells = [f"{f.ratio:.2f} ({f.seams:.2f} / {f.interior:.2f})" for f in figures]
    return f"| {name} | {figures[0].edges} | {' | '.join(cells)} | {figures[0].worst:.1f} | {figures[1].worst:.1f} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=Path, default=ROOT / "outputs" / "showcase", help="where the run folders are")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "img" / "seams.png")
    options = parser.parse_args()
    light = prefilter(load_environment("default", EXPOSURE))
    band = 18
    sheet = Image.new("RGB", (SIZE * len(NAMES), 2 * (SIZE + band)), "white")
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(12)
    for column, name in enumerate(NAMES):
        mesh, *both = maps_of(options.runs / f"{name}.paintit")
        figures = [figure for maps in both if (figure := seam_figure(mesh, maps))]
        geometry, camera = Geometry.from_mesh(mesh), camera_at(mesh, figures[0].worst_at)
        for line, (maps, word) in enumerate(zip(both, ("before", "after"), strict=True)):
            (image,) = render_image(geometry, camera, maps, light, SIZE, supersample=3, background=0.6)
            x, y = column * SIZE, line * (SIZE + band)
            sheet.paste(Image.fromarray(image), (x, y))
            draw.text((x + 4, y + SIZE + 2), f"{name}, {word}: {figures[line].ratio:.2f}", "black", font)
        print(row(name, figures), flush=True)
    sheet.save(options.out, optimize=True)
    print(options.out)


if __name__ == "__main__":
    main()
