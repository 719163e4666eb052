"""DC-PBR recovers known PBR maps from renders of them (the paper's task of section 4.1, through the renderer).

The truth is a glTF file's own maps; each of its materials has a network of its own, as each texture of the paper has.
Each step renders truth and fields from the same random views under the same light, turned at random, and takes the
squared difference of the images that a prior would read: ``shaded``, base colour, roughness and metalness, coded as a
prior gets them. Coded, not linear: in that space the figures are taken, and dark texels count as the eye counts them.
``--channels shaded`` compares what a camera sees and nothing else. That is inverse rendering: under soft light a rough
metal and a diffuse surface of another colour look almost alike, so base colour and metalness trade against each other
although the images agree.

    python benchmarks/ground_truth.py --mesh avocado --steps 300 --picture avocado.png

Prints, over the texels that some camera could see: PSNR by step (of stored values, peak 1), then the errors of all
maps. Roughness and metalness are judged by RMS, normals by the mean angle.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from paintit.color import encode_srgb
from paintit.config import POCKET, TextureConfig, ViewConfig
from paintit.export.read_maps import read_maps
from paintit.mesh.mesh import Mesh
from paintit.mesh.read import read_mesh
from paintit.paint.views import ViewSampler
from paintit.render.environment import load_environment
from paintit.render.gbuffer import rasterize
from paintit.render.geometry import Geometry
from paintit.render.light import Light, prefilter
from paintit.render.render import render
from paintit.render.texels import seen, texel_points
from paintit.rng import Streams, uniform
from paintit.settings import merge
from paintit.texture.field import make_field
from paintit.texture.maps import TextureMaps

MESHES = Path(__file__).parent.parent / "assets" / "meshes"
#: Of the light, as painting has it.
LIGHT_EXPOSURE = 0.7


@dataclass(frozen=True)
class Errors:
    """Over visible texels: PSNR of the stored base colour, of all layers together and of each; RMS of roughness and
    metalness; degrees of the normal."""

    base_color_db: float
    layers_db: tuple[float, ...]
    roughness: float
    metallic: float
    normal_deg: float

    def __str__(self) -> str:
        each = ", ".join(f"{layer:.1f}" for layer in self.layers_db)
        return (
            f"base colour {self.base_color_db:5.2f} dB ({each}), roughness {self.roughness:.3f}, "
            f"metalness {self.metallic:.3f} (RMS), normal {self.normal_deg:.1f} degrees"
        )


@dataclass(frozen=True)
class Progress:
    """One report of a fit."""

    step: int
    seconds: float
    loss: float
    errors: Errors
    maps: TextureMaps
    visible: Tensor


def errors(found: TextureMaps, truth: TextureMaps, visible: Tensor) -> Errors:
    """``visible``: (layers, h, w) bool."""
    squared = (encode_srgb(found.base_color) - encode_srgb(truth.base_color)).square()
    cosine = (found.normal * truth.normal).sum(-1)[visible].clamp(-1, 1)
    return Errors(
        _decibels(squared[visible]),
        tuple(_decibels(layer[mask]) for layer, mask in zip(squared, visible, strict=True)),
        float((found.roughness - truth.roughness)[visible].square().mean().sqrt()),
        float((found.metallic - truth.metallic)[visible].square().mean().sqrt()),
        float(cosine.acos().mean().rad2deg()),
    )


def _decibels(squared: Tensor) -> float:
    return -10 * math.log10(max(float(squared.mean()), 1e-10))


def texture_config(size: int) -> TextureConfig:
    """The pocket preset's field at full resolution, wide enough for detail, with normals that tilt as real ones do."""
    texture = {"size": size, "upsample": 1, "widths": [16, 32, 64, 64, 64], "skip_widths": [8, 16, 32, 64, 64]}
    values = {f"texture.{name}": value for name, value in texture.items()}
    return merge(POCKET, {**values, "texture.normal_strength": 0.6, "texture.min_roughness": 0.0}).texture


def fit(
    mesh: Mesh, truth: TextureMaps, light: Light, steps: int, *, views: int = 4, pixels: int = 192, lr: float = 5e-3,
    close_up: float = 0.5, shaded_only: bool = False, every: int = 50, seed: int = 0,
) -> Iterator[Progress]:  # fmt: skip
    """Fit a field for each layer to ``truth`` (square maps) from renders; reports every ``every`` steps, and last."""
    size = truth.size[0]
    streams, geometry = Streams(seed), Geometry.from_mesh(mesh)
    fields = torch.nn.ModuleList(make_field(texture_config(size), 1, streams["field"]) for _ in mesh.layers)
    sampler = ViewSampler(mesh, ViewConfig(count=views, elevation=(-60.0, 60.0), close_up=close_up))
    optimizer = torch.optim.Adam(fields.parameters(), lr)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps, eta_min=lr / 20)
    covered, _, _ = texel_points(mesh, geometry, size)
    visible = seen(mesh, geometry, size) & covered
    start = time.perf_counter()

    def found() -> TextureMaps:
        return TextureMaps.unpacked(torch.cat([field().packed() for field in fields]))

    for step in range(1, steps + 1):
        gbuffer = rasterize(geometry, sampler(streams["views"]).cameras, pixels)
        rotation = uniform(0, 2 * math.pi, views, streams["light"])
        with torch.no_grad():
            target = render(gbuffer, truth, light, rotation=rotation).encoded()
        image = render(gbuffer, found(), light, rotation=rotation).encoded()
        names = ("shaded",) if shaded_only else tuple(image)
        pixels_seen = gbuffer.mask.sum()
        loss = torch.stack([(image[name] - target[name]).square().sum() for name in names]).sum() / (3 * pixels_seen)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()
        if step % every == 0 or step == steps:
            with torch.no_grad():
                maps = found().detach()
            seconds = time.perf_counter() - start
            yield Progress(step, seconds, float(loss.detach()), errors(maps, truth, visible), maps, visible)


def picture(found: TextureMaps, truth: TextureMaps, visible: Tensor) -> Image.Image:
    """A row for each layer: base colour, roughness, metalness, normals; the truth, then as found; grey where unseen."""

    def columns(maps: TextureMaps) -> Tensor:
        grey = [value.expand(-1, -1, -1, 3) for value in (maps.roughness, maps.metallic)]
        tiles = [encode_srgb(maps.base_color), *grey, maps.normal / 2 + 0.5]
        return torch.cat([torch.where(visible[..., None], tile, 0.5) for tile in tiles], 2)

    pixels = torch.cat([columns(truth), columns(found)], 2).flatten(0, 1)
    return Image.fromarray((pixels.clamp(0, 1) * 255 + 0.5).to(torch.uint8).numpy().astype(np.uint8))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--mesh", default="avocado", help="a name in assets/meshes, or a .glb with PBR maps")
    parser.add_argument("--steps", type=int, default=300)
    parser.add_argument("--size", type=int, default=128, help="texels along each side (default: %(default)s)")
    parser.add_argument("--views", type=int, default=3)
    parser.add_argument("--pixels", type=int, default=128, help="along each side of a view (default: %(default)s)")
    parser.add_argument("--close-up", type=float, default=0.5, help="share of views from near (default: %(default)s)")
    parser.add_argument("--lr", type=float, default=1e-2)
    parser.add_argument("--channels", choices=["all", "shaded"], default="all")
    parser.add_argument("--light", default="default", help="'default' or an .hdr file")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--picture", type=Path, help="where the maps of truth and fit are drawn")
    given = parser.parse_args()
    path = Path(given.mesh) if given.mesh.endswith(".glb") else MESHES / f"{given.mesh}.glb"
    mesh = read_mesh(path)
    truth = read_maps(mesh, given.size)
    light = prefilter(load_environment(given.light, LIGHT_EXPOSURE))
    print(
        f"{path.name}: {len(mesh.layers)} layers of {given.size} x {given.size}, {given.views} views of "
        f"{given.pixels} pixels ({given.close_up:.0%} close), {given.channels}, light {light.name}, seed {given.seed}"
    )
    for report in fit(mesh, truth, light, given.steps, views=given.views, pixels=given.pixels, lr=given.lr,
                      close_up=given.close_up, shaded_only=given.channels == "shaded", seed=given.seed):  # fmt: skip
        print(f"step {report.step:5}  {report.seconds:6.0f} s  loss {report.loss:.2e}  {report.errors}", flush=True)
        if given.picture:
            picture(report.maps, truth, report.visible).save(given.picture)


if __name__ == "__main__":
    main()
