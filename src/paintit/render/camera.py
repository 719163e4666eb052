"""Cameras around a mesh: random training views, orbits, and the angles that prompts are worded from."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import torch
from torch import Tensor

from paintit.rng import uniform


@dataclass(frozen=True)
class Cameras:
    """A batch of n perspective cameras in normalised space (the mesh's bounding box centred, longest edge 2).

    Attributes:
        eye: (n, 3) position.
        target: (n, 3) point looked at. Up is +Y.
        azimuth, elevation: (n,) radians; azimuth 0 looks at the front (+Z), 90 degrees at the +X side; elevation is
            positive from above.
        fov: vertical field of view in radians.
    """

    eye: Tensor
    target: Tensor
    azimuth: Tensor
    elevation: Tensor
    fov: float

    def __len__(self) -> int:
        return self.eye.shape[0]

    def __getitem__(self, index: slice) -> Cameras:
        return Cameras(self.eye[index], self.target[index], self.azimuth[index], self.elevation[index], self.fov)

    def frame(self) -> tuple[Tensor, Tensor, Tensor]:
        """Right, up and backward unit axes, each (n, 3): rows of the world-to-camera rotation (it looks at -Z)."""
        backward = torch.nn.functional.normalize(self.eye - self.target, dim=-1)
        # Straight from above or below +Y says nothing: up is what it is just before, away from the viewer's side.
        side = torch.stack([self.azimuth.sin(), torch.zeros_like(self.azimuth), self.azimuth.cos()], -1).to(backward)
        pole = (backward[:, 1:2].abs() > 1 - 1e-6).to(backward)
        world_up = torch.tensor([0.0, 1.0, 0.0]).to(backward) - pole * backward[:, 1:2].sign() * side
        right = torch.nn.functional.normalize(torch.linalg.cross(world_up, backward), dim=-1)
        return right, torch.linalg.cross(backward, right), backward

    def rays(self, height: int, width: int) -> tuple[Tensor, Tensor]:
        """Origins and unit directions through pixel centres, each (n, height, width, 3); row 0 is the top."""
        right, up, backward = self.frame()
        half = math.tan(self.fov / 2)
        y = half * (1 - 2 * (torch.arange(height, dtype=self.eye.dtype) + 0.5) / height)
        x = half * (width / height) * (2 * (torch.arange(width, dtype=self.eye.dtype) + 0.5) / width - 1)
        y, x = torch.meshgrid(y, x, indexing="ij")
        axis = lambda a: a[:, None, None, :]  # noqa: E731
        direction = axis(right) * x[None, ..., None] + axis(up) * y[None, ..., None] - axis(backward)
        direction = torch.nn.functional.normalize(direction, dim=-1)
        return axis(self.eye).expand_as(direction), direction


def look_at(
    azimuth: Tensor, elevation: Tensor, radius: float, fov: float, target: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> Cameras:
    """Cameras on a sphere around ``target``. Angles (n,) and ``fov`` in radians, ``radius`` in normalised units."""
    toward = torch.stack([elevation.cos() * azimuth.sin(), elevation.sin(), elevation.cos() * azimuth.cos()], -1)
    centre = torch.tensor(target, dtype=azimuth.dtype).expand_as(toward)
    return Cameras(centre + radius * toward, centre, azimuth, elevation, fov)


def fitted(cameras: Cameras, points: Tensor, fill: float = 0.92) -> Cameras:
    """The same cameras with the one field of view in which ``points`` (..., 3) reach ``fill`` of the way from the
    middle of the frame to its edge, in the view where they reach farthest. No point may be beside or behind an eye."""
    slope, points = 0.0, points.reshape(-1, 3)
    for eye, right, up, backward in zip(cameras.eye, *cameras.frame(), strict=True):
        offset = points - eye.to(points)
        across = torch.maximum((offset @ right.to(points)).abs(), (offset @ up.to(points)).abs())
        slope = max(slope, float((across / -(offset @ backward.to(points))).max()))
    return dataclasses.replace(cameras, fov=2 * math.atan(slope / fill))


def orbit(
    count: int, elevation_deg: float = 15.0, radius: float = 3.25, fov_deg: float = 45.0, start_deg: float = 0.0
) -> Cameras:
    """``count`` cameras evenly around the vertical axis at one elevation, the first at azimuth ``start_deg``."""
    azimuth = math.radians(start_deg) + torch.arange(count, dtype=torch.float32) * (2 * math.pi / count)
    return look_at(azimuth, torch.full_like(azimuth, math.radians(elevation_deg)), radius, math.radians(fov_deg))


def random_views(
    count: int,
    generator: torch.Generator,
    *,
    elevation_deg: tuple[float, float] = (-60.0, 60.0),
    azimuth_deg: tuple[float, float] = (0.0, 360.0),
    radius: float = 3.25,
    fov_deg: float = 45.0,
    target: tuple[float, float, float] = (0.0, 0.0, 0.0),
    first_deg: float | None = None,
) -> Cameras:
    """Random cameras, elevation and azimuth uniform in angle (supp. A.2).

    ``first_deg`` puts view 0 at this azimuth, level: the official script's first view is always the exact front.
    """
    elevation = uniform(math.radians(elevation_deg[0]), math.radians(elevation_deg[1]), count, generator)
    azimuth = uniform(math.radians(azimuth_deg[0]), math.radians(azimuth_deg[1]), count, generator)
    if first_deg is not None:
        elevation[0], azimuth[0] = 0.0, math.radians(first_deg)
    return look_at(azimuth, elevation, radius, math.radians(fov_deg), target)
