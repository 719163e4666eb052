"""The cameras of one step: all round, close to the focus, and close to the surface (supp. A.2)."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from paintit.config import FocusConfig, ViewConfig
from paintit.mesh.mesh import Mesh
from paintit.render.camera import Cameras, look_at, random_views
from paintit.rng import uniform

#: Close-ups stand at this share of the full view's distance.
CLOSE_UP_DISTANCE = (0.3, 0.6)
#: Close-ups look along the surface normal, off by up to this angle, so that the point is in sight.
CLOSE_UP_TILT_DEG = 30.0


@dataclass(frozen=True)
class Views:
    """Cameras of one step.

    Attributes:
        cameras: n cameras.
        focus: per camera, the name of the focus region it looks at, or "" for a view of the whole.
    """

    cameras: Cameras
    focus: tuple[str, ...]


def focus_regions(mesh: Mesh, config: ViewConfig) -> tuple[FocusConfig, ...]:
    """The places to look at closely: those that the settings name, else the head where the mesh knows it."""
    if config.focus or not config.auto_focus or mesh.head is None:
        return config.focus
    return (FocusConfig(mesh.head.center, mesh.head.radius),)


def focus_note(mesh: Mesh, config: ViewConfig) -> str:
    """What the views look at without having been told to, in words; empty where there is nothing."""
    chosen = mesh.head is not None and focus_regions(mesh, config) != config.focus
    return f"focus on the head (joint '{mesh.head.joint}'); --no-focus turns it off" if chosen and mesh.head else ""


class ViewSampler:
    """Draws the views of a step. Normalised space: bounding box centred, longest edge 2.

    Args:
        mesh: the mesh in file units; focus regions are given in them.
        config: counts, ranges and focus regions.
    """

    def __init__(self, mesh: Mesh, config: ViewConfig) -> None:
        self.config = config
        scale = 2.0 / mesh.extent if mesh.extent > 0 else 1.0
        self._focus = [
            (
                region.name,
                _point((np.asarray(region.center) - mesh.center) * scale),
                region.radius * scale,
            )
            for region in focus_regions(mesh, config)
        ]
        painted = np.array([layer.painted for layer in mesh.layers])[mesh.face_layer]
        corners = (mesh.vertices[mesh.faces[painted]] - mesh.center) * scale
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        self._corners = torch.from_numpy(corners.astype(np.float32))
        self._area = torch.from_numpy(np.cumsum(np.linalg.norm(cross, axis=-1)))
        self._normal = torch.from_numpy(
            (cross / np.maximum(np.linalg.norm(cross, axis=-1, keepdims=True), 1e-30)).astype(np.float32)
        )

    def __call__(self, generator: torch.Generator) -> Views:
        """The views of the next step: half of them on the focus where there is one, some close-ups, the rest whole."""
        config = self.config
        on_focus = config.count // 2 if self._focus else 0
        rest = config.count - on_focus
        # A fractional share is met on average: 0.25 of 3 views is one close-up in three steps of four.
        close = min(rest, math.floor(config.close_up * rest + float(torch.rand((), generator=generator))))
        batches: list[Cameras] = []
        if rest > close:
            batches.append(
                random_views(
                    rest - close, generator, elevation_deg=config.elevation, azimuth_deg=config.azimuth,
                    radius=config.radius, fov_deg=config.fov, first_deg=config.front if config.front_first else None,
                )
            )  # fmt: skip
        batches += [self._close_up(generator) for _ in range(close)]
        names = [""] * rest
        for i in range(on_focus):
            name, center, radius = self._focus[i % len(self._focus)]
            names.append(name)
            batches.append(
                random_views(
                    1, generator, elevation_deg=config.focus_elevation, azimuth_deg=config.azimuth,
                    radius=config.radius * radius, fov_deg=config.fov, target=center,
                )
            )  # fmt: skip
        return Views(_concatenate(batches), tuple(names))

    def _close_up(self, generator: torch.Generator) -> Cameras:
        """One camera near a point drawn uniformly over what is painted, looking roughly against its normal."""
        pick = torch.rand(3, generator=generator, dtype=torch.float64)
        face = int(torch.searchsorted(self._area, pick[0] * self._area[-1]).clamp_max(len(self._area) - 1))
        u, v = pick[1:].float()
        u, v = (u, v) if u + v <= 1 else (1 - u, 1 - v)
        a, b, c = self._corners[face]
        point = a + u * (b - a) + v * (c - a)
        x, y, z = self._normal[face]
        tilt = math.radians(CLOSE_UP_TILT_DEG)
        azimuth = torch.atan2(x, z) + uniform(-tilt, tilt, 1, generator)
        low, high = map(math.radians, self.config.elevation)
        elevation = (torch.asin(y.clamp(-1, 1)) + uniform(-tilt, tilt, 1, generator)).clamp(low, high)
        distance = self.config.radius * float(uniform(*CLOSE_UP_DISTANCE, 1, generator))
        return look_at(azimuth, elevation, distance, math.radians(self.config.fov), _point(point.tolist()))


def _point(values: Iterable[float]) -> tuple[float, float, float]:
    x, y, z = map(float, values)
    return x, y, z


def _concatenate(batches: list[Cameras]) -> Cameras:
    def joined(name: str) -> Tensor:
        return torch.cat([getattr(batch, name) for batch in batches])

    return Cameras(joined("eye"), joined("target"), joined("azimuth"), joined("elevation"), batches[0].fov)
