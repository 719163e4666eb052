"""Pattern score: band energies and orientations of the painted base colour against those of the true material.

Each of the eight views is cut into overlapping windows on the mesh, and the power spectrum of a window's lightness is
summed over five octaves and four orientations. So the score asks how coarse, how contrasty and which way the pattern
runs at each place, and does not ask that an edge falls on the same pixel. 1 is the true material, 0 no more like it
than the other patterns of the evaluation, and its own colours in random patches, are on average.
"""

from __future__ import annotations

import math
import statistics
from functools import lru_cache

import numpy as np
import torch
import torch.nn.functional as F
from classes import DECOYS, RETRIEVAL
from meanings import meaning
from ruler import PATTERNS, Subject, generated, subject
from torch import Tensor

from paintit.render.gbuffer import GBuffer
from paintit.render.sample import build_pyramid, lookup
from paintit.texture.maps import TextureMaps

WINDOW, STRIDE = 32, 16
#: Share of a window that has to lie on the mesh.
COVERAGE = 0.8
#: Edges of the octaves in cycles per window; the last reaches the corner of the spectrum.
OCTAVES = (1.0, 2.0, 4.0, 8.0, 16.0, 23.0)
ORIENTATIONS = 4
#: Draws of the true material whose energies are averaged.
REFERENCES = 3


def lightness(linear: Tensor) -> Tensor:
    """L* / 100 (...) of linear Rec. 709 (..., 3)."""
    y = (linear * linear.new_tensor([0.2126729, 0.7151522, 0.0721750])).sum(-1)
    return torch.where(y > 216 / 24389, 1.16 * y.clamp_min(1e-9) ** (1 / 3) - 0.16, 24389 / 2700 * y)


@lru_cache(maxsize=1)
def _rings() -> Tensor:
    """(octaves * orientations, WINDOW * WINDOW) 0 or 1: which frequencies each band holds."""
    frequency = torch.fft.fftfreq(WINDOW) * WINDOW
    y, x = torch.meshgrid(frequency, frequency, indexing="ij")
    radius = (x.square() + y.square()).sqrt()
    sector = ((torch.atan2(y, x) / math.pi * ORIENTATIONS + 0.5).floor() % ORIENTATIONS).long()
    low, high = torch.tensor(OCTAVES[:-1]), torch.tensor(OCTAVES[1:])
    octave = (radius[None] >= low[:, None, None]) & (radius[None] < high[:, None, None])
    turned = sector[None] == torch.arange(ORIENTATIONS)[:, None, None]
    return (octave[:, None] & turned[None]).flatten(0, 1).flatten(1).float()


def band_energies(image: Tensor, mask: Tensor) -> Tensor:
    """(windows, 20) spectral energy of each octave and orientation in the windows of images (n, h, w) on ``mask``."""
    cut = lambda x: F.unfold(x[:, None].float(), WINDOW, stride=STRIDE).transpose(1, 2)  # noqa: E731
    inside = cut(mask)
    kept = inside.mean(-1) >= COVERAGE
    inside, value = inside[kept], cut(image)[kept]
    value = inside * (value - (inside * value).sum(-1, keepdim=True) / inside.sum(-1, keepdim=True))
    taper = torch.hann_window(WINDOW, periodic=False)
    windows = value.reshape(-1, WINDOW, WINDOW) * taper[:, None] * taper
    return torch.fft.fft2(windows).abs().square().flatten(1) / WINDOW**4 @ _rings().T


def similarity(one: Tensor, two: Tensor) -> float:
    """Of two sets of energies, in [0, 1]: 2 a.b / (a.a + b.b) of amplitudes. 1 only where all are equal.

    Unlike a cosine it tells a faint pattern from a strong one: an even colour scores 0.
    """
    a, b = one.clamp_min(0).sqrt().flatten(), two.clamp_min(0).sqrt().flatten()
    return float(2 * (a @ b) / (a @ a + b @ b).clamp_min(1e-12))


def painted_energies(on: Subject, maps: TextureMaps) -> Tensor:
    """(windows, 20) band energies of the painted base colour in the eight views."""
    views = on.pattern_views
    base = lookup(build_pyramid(maps.base_color), *(a[views.mask] for a in (views.layer, views.uv, views.footprint)))
    return _energies(views, base)


@lru_cache(maxsize=256)
def reference_energies(prompt: str, mesh: str) -> Tensor:
    """(windows, 20) mean energies of draws of the true material, evaluated at the pixels of the same views."""
    views = subject(mesh).pattern_views
    rng = np.random.default_rng(900)
    position, normal = views.position[views.mask], views.normal[views.mask]
    materials = [meaning(prompt, rng) for _ in range(REFERENCES)]
    drawn = generated(position, normal, materials, rng)
    return torch.stack([_energies(views, values[:, :3]) for values in drawn]).mean(0)


def others(prompt: str) -> tuple[str, ...]:
    """What a pattern may be mistaken for: the other patterns, and its own colours in no order."""
    own = next(name for name, wordings in RETRIEVAL.items() if prompt in wordings)
    return (*(p for p in PATTERNS if p != prompt), *(decoy for decoy, of in DECOYS.items() if of == own))


@lru_cache(maxsize=256)
def chance(prompt: str, mesh: str) -> float:
    """Mean similarity of the others' references to that of ``prompt``."""
    own = reference_energies(prompt, mesh)
    return statistics.mean(similarity(own, reference_energies(text, mesh)) for text in others(prompt))


def _energies(views: GBuffer, base: Tensor) -> Tensor:
    """Of linear base colours at the covered pixels, each 2 x 2 of them averaged: single samples alias."""
    image = torch.zeros(views.mask.shape)
    image[views.mask] = lightness(base)
    mask = F.avg_pool2d(views.mask[:, None].float(), 2)[:, 0]
    return band_energies(F.avg_pool2d(image[:, None], 2)[:, 0], mask == 1)


@torch.no_grad()
def pattern_figures(mesh: str, maps: TextureMaps, prompt: str) -> dict[str, float]:
    """``pattern``: the score; ``decoy``: likeness on the same scale to the likest of the others."""
    energies = painted_energies(subject(mesh, maps.size[0]), maps)
    even = chance(prompt, mesh)
    score = lambda text: (similarity(energies, reference_energies(text, mesh)) - even) / (1 - even)  # noqa: E731
    decoy = max(score(other) for other in others(prompt))
    return {"pattern": max(0.0, score(prompt)), "decoy": max(0.0, decoy)}
