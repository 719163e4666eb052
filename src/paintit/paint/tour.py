"""Which views a projection samples: once round the mesh, then wherever a view improves most texels."""

from __future__ import annotations

import dataclasses
import math

import torch
from torch import Tensor

from paintit.config import PaintConfig
from paintit.mesh.mesh import Mesh
from paintit.paint.backproject import pixel_quality
from paintit.paint.views import Views, ViewSampler
from paintit.render.camera import look_at
from paintit.render.gbuffer import GBuffer, rasterize
from paintit.render.geometry import Geometry
from paintit.render.sample import sample

#: Azimuth from the front and share of the allowed elevation of the first views: neighbours overlap, so that each grows
#: onto the last, and the back closes the ring; then from above and from below.
ROUND: tuple[tuple[float, float], ...] = (
    (0, 0), (45, 0), (-45, 0), (90, 0), (-90, 0), (135, 0), (-135, 0), (180, 0), (0, 1), (180, 1), (0, -1), (180, -1),
)  # fmt: skip
#: Random views that are compared for each next one, and the pixels along each side that they are compared at.
CANDIDATES, LOOK = 16, 32


@dataclasses.dataclass(frozen=True)
class Trust:
    """What pixels know of what they show.

    Attributes:
        now: (n, h, w) how well this view sees it (:func:`paintit.paint.backproject.quality`).
        before: (n, h, w) how well the best view so far did; 0 where none.
        unseen: (n, h, w) bool: on the mesh, and mostly not painted yet.
        badly: (n, h, w) bool: painted, but this view sees it much better.
    """

    now: Tensor
    before: Tensor
    unseen: Tensor
    badly: Tensor


def trust(gbuffer: GBuffer, best: Tensor, radius: float, better: float) -> Trust:
    """Compare views with the best ones so far.

    Args:
        best: (layers, h, w) each texel's best quality, gutters filled, 0 where it is not painted yet.
        better: how many times better is much better.
    """
    mask = gbuffer.mask
    known = torch.stack([best, (best > 0).to(best)], -1)
    found = torch.zeros(*mask.shape, 2, device=best.device)
    found[mask] = sample(known, gbuffer.layer[mask], gbuffer.uv[mask], gbuffer.footprint[mask])
    before, painted = found[..., 0] / found[..., 1].clamp_min(1e-6), found[..., 1]
    now = pixel_quality(gbuffer, radius)
    unseen = mask & (painted < 0.5)
    return Trust(now, before, unseen, mask & ~unseen & (now > better * before))


class Tour:
    """Hands out one view after another.

    Args:
        count: views in all.
    """

    def __init__(self, mesh: Mesh, geometry: Geometry, config: PaintConfig) -> None:
        self._geometry, self._config = geometry, config
        views = config.views
        self._sample = ViewSampler(
            mesh,
            dataclasses.replace(views, count=CANDIDATES, close_up=1.0 if views.close_up else 0.0, front_first=False),
        )

    def __call__(self, index: int, best: Tensor, generator: torch.Generator) -> Views:
        """The view number ``index``, from 0; ``best`` as for :func:`trust`."""
        return self._all_round(index) if index < len(ROUND) else self._most_improving(best, generator)

    def _all_round(self, index: int) -> Views:
        views = self._config.views
        turn, rise = ROUND[index]
        low, high = views.elevation
        elevation = rise * high if rise >= 0 else -rise * low
        azimuth, elevation = (torch.tensor([math.radians(angle)]) for angle in (views.front + turn, elevation))
        return Views(look_at(azimuth, elevation, views.radius, math.radians(views.fov)), ("",))

    def _most_improving(self, best: Tensor, generator: torch.Generator) -> Views:
        drawn = self._sample(generator)
        gbuffer = rasterize(self._geometry, drawn.cameras, LOOK)
        views = self._config.views
        found = trust(gbuffer, best, views.radius, self._config.projection.better)
        # Seen at a grazing angle, an unseen texel is hardly improved.
        worth = found.unseen * found.now.clamp_max(1) + found.badly.to(found.now)
        texels = torch.linalg.det(gbuffer.footprint).abs()
        gain = (worth * texels).double().sum((1, 2))
        pick = int(gain.argmax())
        return Views(drawn.cameras[pick : pick + 1], drawn.focus[pick : pick + 1])
