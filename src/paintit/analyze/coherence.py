"""How far the gradients of nearly the same views agree (supp. A.2, "Why is SDS loss a noisy signal?").

A few cameras within a degree or two see all but the same picture. Prompt, noise level t and noise epsilon are the same
for all. Each view's score-distillation gradient is carried back to the base colour map; the paper finds these
gradients to be of high rank. The controls say how much of that has to do with the prior at all: epsilon lies on the
screen, so that a camera a degree further on carries the same noise onto other texels.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import torch
from torch import Tensor

from paintit.analyze.agreement import Agreement, agreement
from paintit.color import decode_srgb, encode_srgb
from paintit.errors import UsageError
from paintit.guidance.sds import sds_gradient
from paintit.paint.painter import Painter
from paintit.render.camera import Cameras, random_views
from paintit.render.gbuffer import rasterize
from paintit.render.render import render
from paintit.rng import Streams
from paintit.texture.maps import TextureMaps

#: What the gradient passes through: every channel that the prior reads, or the shaded picture alone, as in the paper.
Reads = Literal["stack", "rgb"]
#: ``guidance``: the gradient of eq. 1. Controls: ``noise``: epsilon alone, as if the prior always predicted nothing;
#: ``even``: the same number for every pixel, which leaves only the views themselves; ``random``: unrelated numbers on
#: the same texels; ``repeated``: the first view's gradient every time.
Kind = Literal["guidance", "noise", "even", "random", "repeated"]
CONTROLS: tuple[Kind, ...] = get_args(Kind)[1:]
#: The paper's ratios: Stable Diffusion, 5 views within 2 degrees, t and prompt not given (supp. A.2).
PAPER_RATIOS = (2.1868, 1.7937, 1.7838, 1.6689, 1.0000)


@dataclass(frozen=True)
class Row:
    """One matrix of gradients.

    Attributes:
        after: steps painted before.
        t, scale: None for controls, which depend on neither.
    """

    kind: Kind
    after: int
    reads: Reads
    seed: int
    t: float | None
    scale: float | None
    agreement: Agreement


def near_views(count: int, within: float, painter: Painter, generator: torch.Generator) -> Cameras:
    """``count`` cameras around the exact front; elevation and azimuth uniform within +-``within`` degrees."""
    views = painter.config.views
    return random_views(
        count, generator, elevation_deg=(-within, within), azimuth_deg=(views.front - within, views.front + within),
        radius=views.radius, fov_deg=views.fov,
    )  # fmt: skip


class NearViews:
    """The base colour map as ``painter`` has it now, seen by nearly the same cameras.

    Args:
        painter: at any step; it is not changed.
        within: degrees, see :func:`near_views`.
        reads: what the gradient passes through.

    Raises:
        UsageError: the prior does not read the shaded picture and ``reads`` asks for it alone.
    """

    def __init__(self, painter: Painter, count: int, within: float, reads: Reads) -> None:
        prior, config = painter.prior, painter.config
        if reads == "rgb" and "shaded" not in prior.reads:
            raise UsageError(
                "analyze.reads", f"the prior '{prior.spec.id}' does not read the shaded picture", "use --reads stack"
            )
        self.painter = painter
        # Streams of their own: every state, channel, t and scale is asked about the same views with the same epsilon.
        self._streams = Streams(config.seed)
        cameras = near_views(count, within, painter, self._streams["coherence views"])
        maps = painter.maps()
        self._coded = encode_srgb(maps.base_color).requires_grad_()
        maps = TextureMaps(decode_srgb(self._coded), maps.roughness, maps.metallic, maps.normal)
        image = render(
            rasterize(painter.geometry, cameras, config.views.size), painter.fill_gutters(maps), painter.light,
            rotation=math.radians(config.light.rotation or 0.0), background=config.views.background,
        )  # fmt: skip
        channels = image.encoded()
        if reads == "rgb":
            channels = {name: value if name == "shaded" else value.detach() for name, value in channels.items()}
        self._x = prior.encode_image(channels)
        self._noise = torch.randn((1, *self._x.shape[1:]), generator=self._streams["coherence noise"]).to(self._x)
        self._geometry = prior.encode_geometry(painter.place(image.geometry()))
        texts = painter.prompts.for_views(cameras.azimuth - math.radians(config.views.front), cameras.elevation)
        self._text = prior.encode_text(texts)
        self._negative = prior.encode_text([painter.prompts.negative])

    def gradients(self, t: float, scale: float) -> Tensor:
        """(views, texels x 3) of eq. 1 on the sRGB-coded base colour."""
        found, _ = sds_gradient(
            self.painter.prior, self._x, self._text, self._negative, t, self._noise, scale, self._geometry
        )
        return self._carried(found)

    def control(self, kind: Kind, like: Tensor) -> Tensor:
        """(views, texels x 3) of a control; ``like`` are gradients whose texels and first row it takes."""
        match kind:
            case "noise":
                return self._carried(self._noise.expand_as(self._x))
            case "even":
                return self._carried(torch.ones_like(self._x))
            case "random":
                drawn = torch.randn(like.shape, generator=self._streams["coherence random"]).to(like)
                return drawn * (like != 0).any(0)
            case _:
                return like[:1].expand_as(like)

    def _carried(self, gradient: Tensor) -> Tensor:
        """A gradient (n, c, h, w) on what the prior reads -> (n, texels x 3) on the map, one row per view."""
        return torch.stack([
            torch.autograd.grad(x, self._coded, seed, retain_graph=True)[0].flatten()
            for x, seed in zip(self._x, gradient.to(self._x), strict=True)
        ])  # fmt: skip


def rows(
    painter: Painter, *, count: int, within: float, reads: Reads, t: Sequence[float], scale: Sequence[float]
) -> Iterator[Row]:
    """The matrices of the painter's present state: each t with each scale, then the controls."""
    views, seed = NearViews(painter, count, within, reads), painter.config.seed
    like: Tensor | None = None
    for level in t:
        for s in scale:
            like = views.gradients(level, s)
            yield Row("guidance", painter.step, reads, seed, level, s, agreement(like))
    if like is not None:
        for kind in CONTROLS:
            yield Row(kind, painter.step, reads, seed, None, None, agreement(views.control(kind, like)))
