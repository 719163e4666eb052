"""Convolving an environment once: irradiance, and radiance under the GGX lobe at several roughnesses (N = V = R).

Both live on octahedral maps whose samples sit on the *corners* of the grid, borders included: the two halves of a
folded border edge are then the same directions, so bilinear lookups are continuous everywhere without guard texels.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import torch
import torch.nn.functional as F
from torch import Tensor

from paintit.render.environment import direction_to_uv, texel_directions

#: Stored roughness levels, evenly spaced from 0 to 1.
LEVELS = 11
DIFFUSE_SIZE = 65
#: Below this microfacet width the lobe is narrow against a dense texel: sample it on filtered environments.
DENSE_ALPHA = 0.1
#: From this width on, half the resolution is enough.
BROAD_ALPHA = 0.4
#: Rings around the lobe's axis and samples on each; rings, so that no sample pulls the lobe off its axis.
RINGS, SPOKES = 12, 8


def octahedral_uv(direction: Tensor) -> Tensor:
    """Directions (..., 3), any length > 0 -> (..., 2) in [-1, 1]: the octahedral map around +Y.

    Continuous; differentiable except across the fold lines, where one-sided gradients are returned.
    """
    x, y, z = (direction / direction.abs().sum(-1, keepdim=True)).unbind(-1)
    sign_x, sign_z = torch.where(x >= 0, 1.0, -1.0).to(x), torch.where(z >= 0, 1.0, -1.0).to(z)
    below = y < 0
    u = torch.where(below, (1 - z.abs()) * sign_x, x)
    v = torch.where(below, (1 - x.abs()) * sign_z, z)
    return torch.stack([u, v], -1)


def octahedral_directions(size: int) -> Tensor:
    """(size, size, 3) float32 unit directions of a corner-sampled octahedral map; row is v (z), column u (x)."""
    line = torch.linspace(-1, 1, size)
    v, u = torch.meshgrid(line, line, indexing="ij")
    y = 1 - u.abs() - v.abs()
    fold = (-y).clamp_min(0)
    x = u - torch.sign(u) * fold
    z = v - torch.sign(v) * fold
    return F.normalize(torch.stack([x, y, z], -1), dim=-1)


def shrink(radiance: Tensor, height: int) -> Tensor:
    """A latitude-longitude map (h, w, 3) averaged by solid angle down to at most ``height`` rows; energy is kept."""
    if radiance.shape[0] <= height:
        return radiance
    weight = texel_directions(radiance.shape[0], radiance.shape[1])[1][..., None]
    size = (height, 2 * height)
    pooled = F.adaptive_avg_pool2d(torch.cat([radiance * weight, weight], -1).movedim(-1, 0), size).movedim(0, -1)
    return pooled[..., :3] / pooled[..., 3:]


def lookup(padded: Tensor, direction: Tensor) -> Tensor:
    """Bilinear (..., 3) radiance of a latitude-longitude map padded by :func:`pad_columns`, (1, 3, h, w + 2)."""
    uv = direction_to_uv(direction)
    width = padded.shape[-1] - 2
    grid = torch.stack([(uv[..., 0] * width + 1) / (width + 2), uv[..., 1]], -1) * 2 - 1
    values = F.grid_sample(padded.to(grid.dtype), grid.reshape(1, 1, -1, 2), padding_mode="border", align_corners=False)
    return values[0, :, 0].T.reshape(direction.shape)


def pad_columns(radiance: Tensor) -> Tensor:
    """(h, w, 3) -> (1, 3, h, w + 2) with the last column before the first and the first after the last."""
    return F.pad(radiance.movedim(-1, 0)[None], (1, 1, 0, 0), mode="circular").contiguous()


def diffuse_map(radiance: Tensor) -> Tensor:
    """(3, s, s) irradiance / pi for every normal of an octahedral map, by quadrature over ``radiance``."""
    normal = octahedral_directions(DIFFUSE_SIZE).reshape(-1, 3)
    values = _convolve(normal, shrink(radiance, DIFFUSE_SIZE - 1), lambda cosine: cosine.clamp_min(0))
    return values.T.reshape(3, DIFFUSE_SIZE, DIFFUSE_SIZE)


def specular_maps(radiance: Tensor) -> Tensor:
    """(3, LEVELS, s, s) radiance prefiltered with the GGX lobe of N = V = R, weighted by N.L and normalised.

    Level i holds perceptual roughness i / (LEVELS - 1); level 0 is the environment itself.
    """
    environment = shrink(radiance, 256)
    # Twice the environment's rows: resampling then blurs little.
    size = 1 + min(256, max(32, 2 << (environment.shape[0] - 1).bit_length()))
    pyramid = [environment]
    while pyramid[-1].shape[0] > 2:
        pyramid.append(shrink(pyramid[-1], pyramid[-1].shape[0] // 2))
    padded = [pad_columns(level) for level in pyramid]
    levels = [lookup(padded[0], octahedral_directions(size)).movedim(-1, 0)]
    for index in range(1, LEVELS):
        alpha = (index / (LEVELS - 1)) ** 2
        if alpha < DENSE_ALPHA:
            coarse = size if alpha < 0.02 else size // 2 + 1
            values = _sample_lobe(octahedral_directions(coarse).reshape(-1, 3), padded, alpha)
        else:
            # N.H of N = V is cos of half the angle to L: N.H^2 = (1 + N.L) / 2.
            lobe = lambda c, a2=alpha**2: c.clamp_min(0) / ((a2 - 1) * (0.5 + 0.5 * c) + 1).square()  # noqa: E731
            coarse = 33 if alpha > BROAD_ALPHA else 65
            values = _convolve(octahedral_directions(coarse).reshape(-1, 3), shrink(environment, coarse - 1), lobe)
        level = values.T.reshape(1, 3, coarse, coarse)
        levels.append(F.interpolate(level, (size, size), mode="bilinear", align_corners=True)[0])
    return torch.stack(levels, 1)


def _convolve(direction: Tensor, radiance: Tensor, kernel: Callable[[Tensor], Tensor]) -> Tensor:
    """(m, 3): for each direction the mean of ``radiance`` weighted by ``kernel(cosine)`` times solid angle."""
    toward, solid_angle = texel_directions(radiance.shape[0], radiance.shape[1])
    source = torch.cat([radiance, torch.ones_like(radiance[..., :1])], -1) * solid_angle[..., None]
    source, toward = source.reshape(-1, 4), toward.reshape(-1, 3)
    parts = [kernel((chunk @ toward.T).clamp(-1, 1)) @ source for chunk in direction.split(512)]
    total = torch.cat(parts)
    return total[:, :3] / total[:, 3:]


def _sample_lobe(normal: Tensor, padded: list[Tensor], alpha: float) -> Tensor:
    """(m, 3) importance-sampled GGX lobe, each sample read from the environment blurred to the sample's solid angle."""
    ring, spoke = (axis.flatten() for axis in torch.meshgrid(
        torch.arange(RINGS, dtype=torch.float64), torch.arange(SPOKES, dtype=torch.float64), indexing="ij"
    ))  # fmt: skip
    # The lobe's tail is long: squared steps of the quantile put more rings there, each of less weight.
    tail = 1 - (ring + 0.5) / RINGS
    u, share_of = 1 - tail.square(), 2 * tail / (RINGS * SPOKES)
    phi = (spoke + 0.5 * (ring % 2)) * (2 * math.pi / SPOKES)
    cos2 = (1 - u) / (1 + (alpha**2 - 1) * u)
    density = alpha**2 / (math.pi * ((alpha**2 - 1) * cos2 + 1).square()) / 4
    texel = 4 * math.pi / (padded[0].shape[-2] * (padded[0].shape[-1] - 2))
    mips = (0.5 * torch.log2(share_of / (density * texel))).clamp(0, len(padded) - 1.001)
    helper = torch.where(normal[:, 1:2].abs() < 0.9, torch.tensor([[0.0, 1.0, 0.0]]), torch.tensor([[1.0, 0.0, 0.0]]))
    tangent = F.normalize(torch.linalg.cross(helper, normal), dim=-1)
    bitangent = torch.linalg.cross(normal, tangent)
    total, weights = torch.zeros_like(normal), 0.0
    for c2, angle, mip, weight in zip(cos2.tolist(), phi.tolist(), mips.tolist(), share_of.tolist(), strict=True):
        cosine = 2 * c2 - 1
        if cosine <= 0:
            continue
        sine = math.sqrt(1 - cosine * cosine)
        toward = normal * cosine + tangent * (sine * math.cos(angle)) + bitangent * (sine * math.sin(angle))
        low, share = int(mip), mip - int(mip)
        total += weight * cosine * ((1 - share) * lookup(padded[low], toward) + share * lookup(padded[low + 1], toward))
        weights += weight * cosine
    return total / weights
