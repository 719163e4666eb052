"""Solid materials: a periodic noise volume, split masks, layers blended at hit points, the package's own shading."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
import torch.nn.functional as F
from patterns import COARSE, FINE, OTHER, Surface, cover
from surfaces import Layer, Material
from torch import Tensor

from paintit.color import decode_srgb, encode_srgb
from paintit.render.light import Light
from paintit.render.shade import shade

VOLUME = 96


@lru_cache(maxsize=1)
def noise_volume(seed: int = 7, side: int = VOLUME) -> Tensor:
    """(1, 7, side, side, side), periodic, each ranked over [0, 1]: the channels that ``patterns`` names, in that order."""
    rng = np.random.default_rng(seed)
    frequency = np.fft.fftfreq(side) * side
    radius = np.sqrt(sum(f**2 for f in np.meshgrid(frequency, frequency, frequency, indexing="ij")))

    def power(low: float, high: float, slope: float) -> np.ndarray:
        gain = np.where((radius >= low) & (radius <= high), np.maximum(radius, 1) ** slope, 0)
        return np.fft.ifftn(np.fft.fftn(rng.normal(size=(side,) * 3)) * gain).real

    cells = 6
    jitter = (
        np.stack(np.meshgrid(*[np.arange(cells)] * 3, indexing="ij"), -1) + rng.uniform(0.1, 0.9, (cells,) * 3 + (3,))
    ) / cells
    values = rng.uniform(size=cells**3)
    axis = (np.arange(side) + 0.5) / side
    points = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1)
    home = np.floor(points * cells).astype(int)
    distances, owners = [], []
    for offset in np.ndindex(3, 3, 3):
        cell = home + np.array(offset) - 1
        wrapped = cell % cells
        centre = jitter[wrapped[..., 0], wrapped[..., 1], wrapped[..., 2]] + (cell - wrapped) / cells
        distances.append(np.linalg.norm(points - centre, axis=-1))
        owners.append(wrapped @ np.array([cells * cells, cells, 1]))
    stacked = np.stack(distances)
    order = np.sort(stacked, 0)
    nearest = np.take_along_axis(np.stack(owners), stacked.argmin(0)[None], 0)[0]

    def ranked(x: np.ndarray) -> np.ndarray:
        out = np.empty(x.size, np.float32)
        out[np.argsort(x, axis=None)] = np.linspace(0, 1, x.size, dtype=np.float32)
        return out.reshape(x.shape)

    channels = [
        ranked(power(3, 20, -2.2)),
        ranked(power(10, 48, -1.5)),
        ranked(order[0]),
        ranked(order[1] - order[0]),
        values[nearest].astype(np.float32),
        ranked(power(1, 5, -1.0)),
        ranked(power(3, 16, -2.2)),
    ]
    return torch.from_numpy(np.stack(channels))[None].float()


@dataclass
class Points(Surface):
    """Hit points of a batch, flattened: a surface, the direction to the eye (N, 3), which sample each belongs to (N,)."""

    view: Tensor
    sample: Tensor

    def of(self, mine: slice) -> Surface:
        """The points ``mine``."""
        return Surface(self.position[mine], self.normal[mine], self.part[mine], self.curvature[mine], self.turn[mine])


def _lookup(volume: Tensor, coordinates: Tensor) -> Tensor:
    """(N, 7) values of the periodic volume at coordinates (N, 3) in periods."""
    wrapped = coordinates - coordinates.floor()
    grid = (wrapped * 2 - 1).reshape(1, 1, 1, -1, 3)
    return F.grid_sample(volume, grid, mode="bilinear", padding_mode="border", align_corners=False)[0, :, 0, 0].T


def _table(layers: list[Layer]) -> Tensor:
    """(b, 11): decoded colour and second colour, vary, grain, roughness, metalness, roughness variation."""
    rows = torch.tensor([[*x.color, *x.second, x.vary, x.grain, x.rough, x.metal, x.rough_vary] for x in layers])
    return torch.cat([decode_srgb(rows[:, :6]), rows[:, 6:]], 1)


def _evaluate(rows: Tensor, noise: Tensor) -> Tensor:
    """(N, 5) linear base colour, roughness, metalness of layer rows (N, 11) under noise (N, 7)."""
    mix = (rows[:, 6:7] * (0.6 * noise[:, COARSE : COARSE + 1] + 0.4 * noise[:, FINE : FINE + 1])).clamp(0, 1)
    color = rows[:, :3] + (rows[:, 3:6] - rows[:, :3]) * mix
    rough = (rows[:, 8:9] + rows[:, 10:11] * 2 * (noise[:, OTHER : OTHER + 1] - 0.5)).clamp(0.05, 0.98)
    return torch.cat([color, rough, rows[:, 9:10]], 1)


def evaluate(materials: list[Material], p: Points, volume: Tensor, rng: np.random.Generator) -> tuple[Tensor, Tensor]:
    """Base colour, roughness, metalness (N, 5) and bumped unit normal (N, 3) of a batch of materials at its points."""
    b = len(materials)
    offset = torch.from_numpy(rng.uniform(size=(b, 3))).float()[p.sample]
    grain = torch.tensor([m.base.grain for m in materials])[p.sample, None]
    fine = _lookup(volume, p.position * grain * 0.3 + offset)
    out = _evaluate(_table([m.base for m in materials])[p.sample], fine)
    bounds = torch.searchsorted(p.sample, torch.arange(b + 1)).tolist()
    for i, material in enumerate(materials):
        mine = slice(bounds[i], bounds[i + 1])
        if bounds[i] == bounds[i + 1]:
            continue
        surface = p.of(mine)
        for layer, split in material.overlays:
            coarse = _lookup(volume, surface.position * split.scale * 0.22 + offset[mine].flip(-1))
            value = _evaluate(_table([layer]).expand(len(coarse), -1), fine[mine])
            out[mine] += (value - out[mine]) * cover(split, surface, coarse)[:, None]
    bump = torch.tensor([m.bump for m in materials])[p.sample, None]
    tilt = torch.stack([fine[:, FINE] - 0.5, fine[:, COARSE] - 0.5, fine[:, OTHER] - 0.5], -1)
    return out, F.normalize(p.normal + 2 * bump * tilt, dim=-1)


def rotate_y(vector: Tensor, angle: Tensor) -> Tensor:
    """(N, 3) turned by angle (N,) about +Y."""
    c, s = angle.cos(), angle.sin()
    x, y, z = vector.unbind(-1)
    return torch.stack([c * x + s * z, y, c * z - s * x], -1)


def render_stack(
    surface: Tensor,
    normal: Tensor,
    p: Points,
    light: Light,
    yaw: Tensor,
    gain: Tensor,
    mask: Tensor,
    background: Tensor,
) -> Tensor:
    """(b, 8, s, s) in [0, 1]: sRGB-coded shaded and base colour, roughness, metalness; material channels 0.5 off it.

    ``yaw`` and ``gain`` (b,) turn and scale each sample's light; ``background`` (b,) linear grey; ``mask`` (b, s, s).
    """
    turn = yaw[p.sample]
    radiance = shade(
        surface[:, :3], surface[:, 3:4], surface[:, 4:5], rotate_y(normal, turn), rotate_y(p.view, turn), light
    )
    b, height, width = mask.shape
    image = torch.empty(b, height, width, 8)
    image[..., :3] = encode_srgb(background)[:, None, None, None]
    image[..., 3:] = 0.5
    image[mask] = torch.cat(
        [encode_srgb(radiance * gain[p.sample, None]), encode_srgb(surface[:, :3]), surface[:, 3:]], 1
    )
    return image.permute(0, 3, 1, 2)
