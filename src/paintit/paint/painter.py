"""Paint-it, the algorithm: score distillation trains a convolutional network that is the texture (paper 3).

``Painter`` is an iterator of records. It has no path, no progress bar, no print; ``run.py`` turns its records into
files and ``cli`` into a bar.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from paintit.config import PaintConfig
from paintit.device import choose_device
from paintit.errors import PaintitError
from paintit.guidance.load import load_prior
from paintit.guidance.prior import Prior, Reader
from paintit.guidance.prompt import Prompts
from paintit.guidance.schedule import sample_t, timestep_range
from paintit.guidance.sds import sds_gradient
from paintit.mesh.mesh import Mesh
from paintit.paint.gutters import Gutters
from paintit.paint.placement import Placement
from paintit.paint.views import Views, ViewSampler, focus_note, focus_regions
from paintit.render.gbuffer import GBuffer, rasterize
from paintit.render.geometry import Geometry
from paintit.render.light import Light, load_environment, prefilter
from paintit.render.render import Channels, render
from paintit.render.sample import contributions
from paintit.rng import Streams, uniform
from paintit.texture.field import make_field
from paintit.texture.fixed import grey, with_fixed
from paintit.texture.maps import TextureMaps


@dataclass(frozen=True)
class Step:
    """What one step did. Norms, never a loss: the score-distillation gradient is injected and has none."""

    index: int
    """1 for the first step."""
    total: int
    t: float
    """Noise level, the fraction of the prior's schedule."""
    guidance_norm: float
    """L2 norm of the score-distillation gradient on the prior's input."""
    gradient_norm: float
    """L2 norm of the gradient on the field's parameters, before clipping."""
    learning_rate: float
    seconds: float
    timings: Mapping[str, float]
    """Seconds in ``network``, ``render``, ``guidance``, ``backward``, ``optimiser``."""


class Painter:
    """Paints one mesh by one sentence.

    >>> painter = Painter(mesh, "a rusty iron kettle", config)      # doctest: +SKIP
    >>> for step in painter: print(step.index, step.gradient_norm)  # doctest: +SKIP
    >>> maps = painter.maps()                                       # doctest: +SKIP

    Args:
        mesh: the mesh, with texture coordinates.
        prompt: the sentence.
        config: every setting; the seed in it decides every random number.
        prior: the diffusion prior; by default the one that ``config.guidance`` names.
        light: the prefiltered light; by default the one that ``config.light`` names.
        fixed: maps of the layers that are not painted, in their order, of ``config.texture.size``; by default grey.
        profile: wait for the device after each stage so that ``Step.timings`` are true on a GPU.

    Attributes:
        support: (layers, h, w) how much of the views each texel has been, in pixels, summed over the steps. An exporter
            takes texels that were next to none from their neighbours.
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
        self.mesh = mesh
        self.config = config
        words = config.prompt
        regions = focus_regions(mesh, config.views)
        self.prompts = Prompts(prompt, words.template, words.negative, [region.name for region in regions])
        self.device, self.device_reason = choose_device(config.device)
        self.streams = Streams(config.seed)
        self.prior = prior or load_prior(
            config.guidance.prior, device=str(self.device), dtype=config.dtype, revision=config.guidance.revision
        )
        environment = light or prefilter(load_environment(config.light.path, config.light.exposure), self.device)
        self.light = environment.to(self.device)
        self.geometry = Geometry.from_mesh(mesh, self.device)
        self.sample_views = ViewSampler(mesh, config.views)
        moved = config.guidance.placement == "seed" and self.prior.spec.movable
        self.place = Placement(self.streams["placement"] if moved else None)
        self._painted = [layer.painted for layer in mesh.layers]
        self.field = make_field(config.texture, sum(self._painted), self.streams["field"]).to(self.device)
        fixed = fixed or grey(self._painted.count(False), config.texture.size)
        self._fixed = TextureMaps.unpacked(fixed.packed().detach().to(self.device))
        self.fill_gutters = Gutters(mesh, config.texture.size, self.device)
        size = config.texture.size
        self.support = torch.zeros(len(mesh.layers), size, size, device=self.device)
        self.optimizer = torch.optim.Adam(self.field.parameters(), lr=config.optim.lr)
        self.step = 0
        self.total = config.optim.steps
        self._profile = profile
        self._text = {text: self.prior.encode_text([text]) for text in self.sent_prompts}

    @property
    def sent_prompts(self) -> tuple[str, ...]:
        """Exactly the texts that the prior may be asked for, the negative one first."""
        return self.prompts.distinct()

    @property
    def notes(self) -> tuple[str, ...]:
        """What was found in the mesh, and what was chosen because of it."""
        chosen = focus_note(self.mesh, self.config.views)
        return (*self.mesh.report.notes, *([chosen] if chosen else []))

    @property
    def readings(self) -> dict[str, str]:
        """Words that the prior does not know -> what it takes them to mean; empty for priors that do not say."""
        if not isinstance(self.prior, Reader):
            return {}
        return {word: meaning for text in self.sent_prompts for word, meaning in self.prior.readings(text).items()}

    def __iter__(self) -> Iterator[Step]:
        """Run the remaining steps. Stop whenever you like; iterate again to go on."""
        while self.step < self.total:
            yield self._advance()

    def _advance(self) -> Step:
        """One step of Paint-it."""
        config, streams, clock = self.config, self.streams, _Clock(self.device, self._profile)

        maps = with_fixed(self.field(), self._fixed, self._painted)  # T_theta(z), 3.3
        clock("network")
        views = self.sample_views(streams["views"])  # supp. A.2
        image = self._render(self.fill_gutters(maps), views)  # eq. 2
        self.support += _support(image.gbuffer, self.support)
        clock("render")
        x = self.prior.encode_image(self._read(image))
        progress = self.step / max(self.total - 1, 1)
        guidance = config.guidance
        t = sample_t(timestep_range(guidance.schedule, progress, guidance.t_start, guidance.t_end), streams["t"])
        noise = torch.randn((1, *x.shape[1:]), generator=streams["noise"]).to(x)  # one epsilon for all views
        text, negative = self._embed(views)
        scale = guidance.scale
        if guidance.scale_end is not None:
            scale += progress * (guidance.scale_end - scale)
        geometry = self.prior.encode_geometry(self.place(image.geometry()))
        gradient, record = sds_gradient(self.prior, x, text, negative, t, noise, scale, geometry)  # eq. 1 and 3
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

    def _embed(self, views: Views) -> tuple[Tensor, Tensor]:
        cameras = views.cameras
        front = math.radians(self.config.views.front)
        texts = self.prompts.for_views(cameras.azimuth - front, cameras.elevation, views.focus)
        return (
            torch.cat([self._text[text] for text in texts]),
            torch.cat([self._text[self.prompts.negative]] * len(texts)),
        )

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
        """Everything that the next step depends on; ``load_state_dict`` of it continues bit for bit."""
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


class _Clock:
    """Seconds between calls, by name."""

    def __init__(self, device: torch.device, synchronize: bool) -> None:
        self._wait = synchronize and device.type == "cuda"
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def __call__(self, name: str) -> None:
        if self._wait:
            torch.cuda.synchronize()
        now = time.perf_counter()
        self.seconds[name] = now - self._last
        self._last = now
