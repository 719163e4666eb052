"""How results are looked at: fixed views, a light, a second light that nothing was painted under, a grey behind.

Text2Tex (Chen et al. 2023), whose protocol the paper follows, compares pictures of 512 pixels from 20 fixed views;
the paper does not say which. Ours: two rings of ten, 15 and 45 degrees from above, the second turned by half a step, so
that no side is seen more than another; underneath is not judged.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from paintit.mesh.mesh import Mesh
from paintit.render.camera import Cameras, look_at
from paintit.render.environment import Environment, from_radiance, load_environment, texel_directions
from paintit.render.gbuffer import rasterize
from paintit.render.geometry import Geometry
from paintit.render.light import Light, prefilter
from paintit.render.render import Channels, render, render_image
from paintit.texture.maps import TextureMaps

#: Name of the second light: a low warm sun, a blue sky, brown ground; computed, so that it needs no file.
SUNSET = "sunset"


@dataclass(frozen=True)
class Protocol:
    """What stays the same for all that is compared. Figures of two protocols cannot be compared."""

    ring: int = 10
    """Views in each ring, evenly all round; the first ring begins at the front."""
    elevations: tuple[float, ...] = (15.0, 45.0)
    """Degrees from above, one ring each; every ring is turned by half a step against the one before."""
    size: int = 512
    """Pixels along each side of a picture."""
    radius: float = 3.25
    """Distance of the camera, where the mesh's longest edge is 2."""
    fov: float = 45.0
    """Vertical field of view in degrees."""
    light: str = "default"
    """The light in the package, or an .hdr or .exr file."""
    relight: str = SUNSET
    """The held-out light: ``sunset``, or an .hdr or .exr file."""
    exposure: float = 0.8
    """Mean radiance of a white diffuse sphere under either light."""
    background: float = 0.6
    """Linear grey behind the mesh: black and white objects both stand out from it."""

    @property
    def views(self) -> int:
        return self.ring * len(self.elevations)

    def cameras(self) -> Cameras:
        """All views, ring by ring."""
        step = 2 * math.pi / self.ring
        turns = [(k % 2) / 2 for k in range(len(self.elevations))]
        azimuth = torch.tensor([(i + turn) * step for turn in turns for i in range(self.ring)])
        elevation = torch.tensor([e for e in self.elevations for _ in range(self.ring)]).deg2rad()
        return look_at(azimuth, elevation, self.radius, math.radians(self.fov))


def turntable(protocol: Protocol, views: int) -> Cameras:
    """Level views evenly all round; the first looks at the front."""
    azimuth = torch.arange(views) * (2 * math.pi / views)
    return look_at(azimuth, torch.zeros(views), protocol.radius, math.radians(protocol.fov))


@lru_cache(maxsize=8)
def light_of(path: str, exposure: float) -> Light:
    """The prefiltered light of a name or a file.

    Raises:
        LightError: the file cannot be read.
    """
    return prefilter(sunset(exposure) if path == SUNSET else load_environment(path, exposure))


def sunset(exposure: float) -> Environment:
    """The held-out light (64 x 128): sun 15 degrees high, 60 degrees to the right of the front."""
    direction, _ = texel_directions(64, 128)
    sun = torch.tensor([0.8365, 0.2588, 0.4830])
    up = direction[..., 1:2]
    sky = torch.tensor([0.25, 0.38, 0.70]) * (0.4 + 0.6 * up.clamp_min(0).sqrt())
    glow = torch.tensor([1.0, 0.5, 0.2]) * (4 * (direction @ sun - 1)).exp()[..., None]
    ground = torch.tensor([0.16, 0.11, 0.07]).expand_as(sky)
    disc = torch.tensor([60.0, 34.0, 14.0]) * (400 * (direction @ sun - 1)).exp()[..., None]
    return from_radiance(torch.where(up > 0, sky + glow, ground + 0.3 * glow) + disc, SUNSET, exposure)


@torch.no_grad()
def pictures(
    mesh: Mesh, maps: TextureMaps, protocol: Protocol, cameras: Cameras | None = None, *, relit: bool = False
) -> NDArray[np.uint8]:
    """(views, size, size, 3) sRGB-coded pictures, smoothed 2 x 2.

    Args:
        cameras: other views than the protocol's.
        relit: under the held-out light.
    """
    light = light_of(protocol.relight if relit else protocol.light, protocol.exposure)
    return render_image(
        Geometry.from_mesh(mesh), cameras or protocol.cameras(), maps, light, protocol.size,
        background=protocol.background,
    )  # fmt: skip


@torch.no_grad()
def surface(mesh: Mesh, maps: TextureMaps, protocol: Protocol, size: int = 128, *, relit: bool = False) -> Channels:
    """What the protocol's views see of the material, pixel by pixel: the sample that figures about it are over."""
    light = light_of(protocol.relight if relit else protocol.light, protocol.exposure)
    gbuffer = rasterize(Geometry.from_mesh(mesh), protocol.cameras(), size)
    return render(gbuffer, maps, light, background=protocol.background)


def as_images(views: NDArray[np.uint8]) -> Tensor:
    """(n, h, w, 3) uint8 -> (n, 3, h, w) uint8, as networks read them."""
    return torch.from_numpy(views).permute(0, 3, 1, 2)
