"""Paint-it, the algorithm: score distillation trains a convolutional network that is the texture (paper 3).

``Painter`` is an iterator of records. It has no path, no progress bar, no print; ``run.py`` turns its records into
files and ``cli`` into a bar.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from paintit.config import PaintConfig
from paintit.errors import PaintitError
from paintit.guidance.losses import distil, require
from paintit.guidance.prior import Paced, Prior
from paintit.guidance.schedule import choose_scale, choose_t
from paintit.mesh.mesh import Mesh
from paintit.paint.method import Clock, Method, Step
from paintit.paint.views import Views, ViewSampler
from paintit.render.gbuffer import GBuffer, rasterize
from paintit.render.light import Light
from paintit.render.render import Channels, render
from paintit.render.sample import contributions
from paintit.render.texels import texel_points
from paintit.rng import uniform
from paintit.texture.field import make_field
from paintit.texture.fixed import with_fixed
from paintit.texture.maps import TextureMaps


class Painter(Method):
    """Paints one mesh by one sentence.

    >>> painter = Painter(mesh, "a rusty iron kettle", config)      # doctest: +SKIP
    >>> for step in painter: print(step.index, step.gradient_norm)  # doctest: +SKIP
    >>> maps = painter.maps()                                       # doctest: +SKIP

    Arguments as for :class:`Method`.

    Attributes:
        support: (layers, h, w) how much of the views each texel has been, in pixels, summed over the steps.
    """

    def __init__(
        self,
        mesh: Mesh,
        prompt: str,
        config: PaintConfig,
        prior: Prior | None = None,
        light: Light | None = None,
        fixed: TextureMaps | None = None,
        *,
        profile: bool = False,
    ) -> None:
        super().__init__(mesh, prompt, config, prior, light, fixed, profile=profile)
        require(self.prior, config.guidance.loss)
        self.sample_views = ViewSampler(mesh, config.views)
        points = self._points() if config.texture.kind == "points" else None
        self.field = make_field(config.texture, sum(self._painted), self.streams["field"], points).to(self.device)
        self.optimizer = torch.optim.Adam(self.field.parameters(), lr=config.optim.lr, fused=True)
        self.total = config.optim.steps

    def _advance(self) -> Step:
        """One step of Paint-it."""
        config, streams, clock = self.config, self.streams, Clock(self.device, self.profile)

        maps = with_fixed(self.field(), self._fixed, self._painted)  # T_theta(z), 3.3
        clock("network")
        views = self.sample_views(streams["views"])  # supp. A.2
        image = self._render(self.fill_gutters(maps), views)  # eq. 2
        self.support += _support(image.gbuffer, self.support)
        clock("render")
        x = self.prior.encode_image(self._read(image))
        progress = self.step / max(self.total - 1, 1)
        guidance = config.guidance
        t = choose_t(guidance, progress, streams["t"])
        noise = torch.randn((1, *x.shape[1:]), generator=streams["noise"]).to(x)  # one epsilon for all views
        words = self._embed(views)
        if isinstance(self.prior, Paced):
            self.prior.pace(progress)
        scale = choose_scale(guidance, progress)
        geometry = self.prior.encode_geometry(self.place(image.geometry()))
        gradient, record = distil(guidance, self.prior, x, words, t, noise, scale, progress, geometry)  # eq. 1 and 3
        clock("guidance")
        self.optimizer.zero_grad(set_to_none=True)
        roots, seeds = [x], [gradient]
        regularization = self.field.regularization()  # eq. 4, pixels only
        if regularization.requires_grad:
            roots, seeds = [x, regularization], [gradient, torch.ones_like(regularization)]
        torch.autograd.backward(roots, seeds)
        clock("backward")
        norm = self._update()
        clock("optimiser")

        self.step += 1
        return Step(
            self.step, self.total, t, record.gradient_norm, norm, self._learning_rate(self.step - 1),
            sum(clock.seconds.values()), clock.seconds,
        )  # fmt: skip

    def _points(self) -> Tensor:
        """(painted layers, size, size, 3) where each texel lies on the surface, NaN where on none; on the CPU."""
        covered, position, _ = texel_points(self.mesh, self.geometry, self.config.texture.size)
        return position.masked_fill(~covered[..., None], math.nan)[self._painted].cpu()

    def _render(self, maps: TextureMaps, views: Views) -> Channels:
        light, size = self.config.light, self.config.views.size
        if light.rotation is None:
            rotation = float(uniform(0.0, 2 * math.pi, 1, self.streams["light"]))
        else:
            rotation = math.radians(light.rotation)
        gbuffer = rasterize(self.geometry, views.cameras, size)
        return render(gbuffer, maps, self.light, rotation=rotation, background=self.config.views.background)

    def _read(self, image: Channels) -> dict[str, Tensor]:
        """The channels for the prior, encoded for display; those that ``guidance.reads`` leaves out get no gradient."""
        wanted = self.config.guidance.reads or self.prior.reads
        return {name: value if name in wanted else value.detach() for name, value in image.encoded().items()}

    def _learning_rate(self, step: int) -> float:
        optim = self.config.optim
        return optim.lr * optim.decay ** (step // optim.decay_every)

    def _update(self) -> float:
        """Clip, then one Adam step; the norm before clipping.

        Raises:
            PaintitError: the gradient is not finite. The parameters are left as they were.
        """
        limit = self.config.optim.clip or math.inf
        norm = float(torch.nn.utils.clip_grad_norm_(self.field.parameters(), limit))
        if not math.isfinite(norm):
            raise PaintitError(
                "paint.diverged", f"the gradient became {norm} at step {self.step + 1}",
                "lower --optim.lr or --guidance.scale; the last checkpoint is intact",
            )  # fmt: skip
        for group in self.optimizer.param_groups:
            group["lr"] = self._learning_rate(self.step)
        self.optimizer.step()
        return norm

    @torch.no_grad()
    def maps(self) -> TextureMaps:
        """The texture maps as they stand, detached."""
        return with_fixed(self.field(), self._fixed, self._painted).detach()

    def state_dict(self) -> dict[str, Any]:
        return {
            "step": self.step,
            "field": self.field.state_dict(),
            "optimizer": self.optimizer.state_dict()["state"],
            "streams": self.streams.state_dict(),
            "support": self.support,
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        self.step = state["step"]
        self.field.load_state_dict(state["field"])
        self.optimizer.load_state_dict({**self.optimizer.state_dict(), "state": state["optimizer"]})
        self.streams.load_state_dict(state["streams"])
        self.support.copy_(state["support"])


def _support(gbuffer: GBuffer, like: Tensor) -> Tensor:
    """(layers, h, w) pixels' worth of each texel in these views."""
    layers, height, width = like.shape
    mask = gbuffer.mask
    return contributions((layers, height, width), gbuffer.layer[mask], gbuffer.uv[mask], gbuffer.footprint[mask])
