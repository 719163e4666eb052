"""The picture of docs/priors.md: what ControlNets are shown of two meshes.

python docs/pictures/control.py
"""

from __future__ import annotations

import math
from pathlib import Path

import torch
from PIL import Image
from torch import Tensor

from paintit.guidance.controlnet import depth_picture, normal_picture
from paintit.mesh.read import read_mesh
from paintit.render.camera import fitted, look_at
from paintit.render.gbuffer import rasterize
from paintit.render.geometry import Geometry

ROOT = Path(__file__).parents[2]
SIZE = 256


def shown(mesh: str, azimuth: float, elevation: float) -> Tensor:
    """(3, SIZE, 2 SIZE): depth and normals of one view, in degrees."""
    camera = look_at(
        torch.tensor([math.radians(azimuth)]), torch.tensor([math.radians(elevation)]), 3.25, math.radians(45)
    )
    geometry = Geometry.from_mesh(read_mesh(ROOT / "assets/meshes" / mesh))
    gbuffer = rasterize(geometry, fitted(camera, geometry.corners), SIZE)
    mask = gbuffer.mask[..., None].float()
    pictures = depth_picture(gbuffer.depth[..., None], mask, SIZE), normal_picture(gbuffer.normal_view(), mask, SIZE)
    return torch.cat([picture[0] for picture in pictures], 2)


def main() -> None:
    rows = [[shown("spot/spot.obj", 180, 0), shown("spot/spot.obj", 215, 50)],
            [shown("koala.ply", 0, 0), shown("koala.ply", 35, 50)]]  # fmt: skip
    sheet = torch.cat([torch.cat(row, 2) for row in rows], 1)
    image = Image.fromarray((255 * sheet).round().byte().permute(1, 2, 0).numpy())
    image.save(ROOT / "docs/img/control.png")


if __name__ == "__main__":
    main()
