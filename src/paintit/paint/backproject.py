"""From a picture of one view to the texels that it shows.

Texels look up the picture, not the other way round: a 32-pixel picture of a 512-texel map then leaves no holes, and a
texel is written once, in no particular order.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor

from paintit.mesh.mesh import Mesh
from paintit.render.camera import Cameras
from paintit.render.gbuffer import GBuffer
from paintit.render.geometry import Geometry
from paintit.render.texels import texel_points
from paintit.render.visibility import cast

#: Exponent k of cos^k in :func:`quality`.
POWER = 2
#: How far above the surface rays toward the eye start, in normalised units.
_LIFT = 5e-4
#: A pixel speaks for a texel that lies within so many of its own widths on the surface.
_REACH = 2.0
#: Below this cosine a pixel's width on the surface grows no more.
_GRAZING = 0.25
#: Share of a pixel that must show the mesh.
_WHOLE = 0.999


def quality(cosine: Tensor, depth: Tensor, radius: float) -> Tensor:
    """How well a surface is seen: cos^k over the width of a pixel, 1 where it faces a camera at distance ``radius``."""
    return cosine.clamp(0, 1) ** POWER * (radius / depth.clamp_min(1e-6))


def pixel_quality(gbuffer: GBuffer, radius: float) -> Tensor:
    """:func:`quality` of what each pixel shows, (n, h, w), 0 off the mask."""
    cosine = (gbuffer.normal * gbuffer.view).sum(-1).abs()
    return torch.where(gbuffer.mask, quality(cosine, gbuffer.depth, radius), 0.0)


@dataclass(frozen=True)
class Seen:
    """The k texels that one camera sees.

    Attributes:
        index: (k,) into the flattened (layers h w) texels.
        place: (k, 2) where in the picture, from -1 to 1, x to the right and y down.
        position: (k, 3) in normalised space.
        depth, cosine: (k,) along the camera's axis; between normal and the way to the eye, from either side.
    """

    index: Tensor
    place: Tensor
    position: Tensor
    depth: Tensor
    cosine: Tensor


class Texels:
    """The texels of a mesh as points on its surface.

    Attributes:
        covered: (layers, size, size) bool.
    """

    def __init__(self, mesh: Mesh, geometry: Geometry, size: int) -> None:
        self._geometry = geometry
        self.covered, position, normal = texel_points(mesh, geometry, size)
        self._index = self.covered.flatten().nonzero()[:, 0]
        self._position, self._normal = position[self.covered], normal[self.covered]

    @torch.no_grad()
    def seen_by(self, camera: Cameras) -> Seen:
        """What one camera with a square picture sees of them."""
        right, up, backward = (axis[0].to(self._position) for axis in camera.frame())
        eye = camera.eye[0].to(self._position)
        toward = eye - self._position
        depth = toward @ backward
        half = depth * math.tan(camera.fov / 2)
        place = torch.stack([-(toward @ right), toward @ up], -1) / half[:, None]
        (inside,) = ((depth > 0) & (place.abs() < 1).all(-1)).nonzero(as_tuple=True)
        toward, normal = toward[inside], self._normal[inside]
        cosine = (normal * F.normalize(toward, dim=-1)).sum(-1)
        side = torch.where(cosine < 0, -1.0, 1.0)[:, None]
        start = self._position[inside] + _LIFT * side * normal
        open_ = cast(self._geometry, start, eye - start).distance >= 1
        kept = inside[open_]
        return Seen(self._index[kept], place[kept], self._position[kept], depth[kept], cosine[open_].abs())


@dataclass(frozen=True)
class Pixels:
    """Which pixels of one picture may speak, and where on the surface they lie.

    Attributes:
        valid: (h, w) in [0, 1]; 0 silences a pixel.
        position: (h, w, 3) mean surface point.
    """

    valid: Tensor
    position: Tensor

    @classmethod
    def of(cls, gbuffer: GBuffer, free: Tensor, size: tuple[int, int]) -> Pixels:
        """Pixels of a picture of ``size`` that show the mesh alone and are ``free`` (h, w) bool to be painted.

        Args:
            gbuffer: one view, of any resolution.
            free: of the g-buffer's resolution.
        """
        mask = gbuffer.mask[0].to(gbuffer.position)
        packed = torch.cat([gbuffer.position[0].movedim(-1, 0), mask[None], (free.to(mask) * mask)[None]])
        mean = F.adaptive_avg_pool2d(packed[None], size)[0]
        position, cover = mean[:3] / mean[3].clamp_min(1e-6), mean[3]
        return cls(torch.where(cover >= _WHOLE, mean[4], 0.0), position.movedim(0, -1))


def look_up(image: Tensor, pixels: Pixels, seen: Seen, fov: float) -> tuple[Tensor, Tensor]:
    """Bilinear values of a picture (h, w, c) at the seen texels, from valid pixels of the same piece of surface only.

    Returns:
        values (k, c), 0 where no pixel speaks, and their weight (k,) in [0, 1]: 1 where all four pixels around do.
    """
    height, width, channels = image.shape
    pixel = seen.depth * (2 * math.tan(fov / 2) / height)
    reach = _REACH * pixel / seen.cosine.clamp_min(_GRAZING)
    x = (seen.place[:, 0] + 1) / 2 * width - 0.5
    y = (seen.place[:, 1] + 1) / 2 * height - 0.5
    left, top = x.floor(), y.floor()
    total, weight = image.new_zeros(len(x), channels), image.new_zeros(len(x))
    for down in (0, 1):
        for along in (0, 1):
            row, column = (top + down).long(), (left + along).long()
            inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
            row, column = row.clamp(0, height - 1), column.clamp(0, width - 1)
            near = (pixels.position[row, column] - seen.position).norm(dim=-1) < reach
            share = (1 - (x - left - along).abs()) * (1 - (y - top - down).abs())
            share = share * pixels.valid[row, column] * (inside & near)
            total += share[:, None] * image[row, column]
            weight += share
    return total / weight.clamp_min(1e-6)[:, None], weight
