"""What every way of painting has in common: its parts, its records, what ``run``, ``api`` and checkpoints ask of it."""

from __future__ import annotations

import math
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from paintit.config import PaintConfig
from paintit.device import choose_device
from paintit.guidance.load import load_prior
from paintit.guidance.losses import Words
from paintit.guidance.prior import Prior, Reader, TextReleasing
from paintit.guidance.prompt import Prompts
from paintit.guidance.schedule import with_scales
from paintit.mesh.mesh import Mesh
from paintit.paint.footprint import loading_for
from paintit.paint.gutters import Gutters
from paintit.paint.placement import Placement
from paintit.paint.views import Views, focus_note, focus_regions
from paintit.render.geometry import Geometry
from paintit.render.light import Light, load_environment, prefilter
from paintit.rng import Streams
from paintit.texture.fixed import grey
from paintit.texture.maps import TextureMaps


@dataclass(frozen=True)
class Step:
    """What one step did. Norms, never a loss: the score-distillation gradient is injected and has none."""

    index: int
    """1 for the first step."""
    total: int
    t: float
    """Noise level, the fraction of the prior's schedule; the highest one where a step samples a whole view."""
    guidance_norm: float
    """L2 norm of the score-distillation gradient on the prior's input; 0 for projection, which has no gradient."""
    gradient_norm: float
    """L2 norm of the gradient on the field's parameters, before clipping; 0 for projection."""
    learning_rate: float
    """0 for projection."""
    seconds: float
    timings: Mapping[str, float]
    """Seconds of each stage: ``network``, ``render``, ``guidance``, ``backward``, ``optimiser``; for projection
    ``view``, ``render``, ``sampling``, ``projection``."""
    painted: float | None = None
    """For projection, the share of the pixels on the mesh that this view painted, new or anew; else None."""

    @property
    def summary(self) -> str:
        """The number to watch, in words."""
        if self.painted is not None:
            return f"{self.painted:.0%} of the view painted"
        return f"gradient norm {self.gradient_norm:.3g}"


class Method(ABC):
    """Paints one mesh by one sentence: an iterator of :class:`Step` over a state that can be saved between two steps.

    Args:
        mesh: the mesh, with texture coordinates.
        prompt: the sentence.
        config: every setting; the seed in it decides every random number.
        prior: the diffusion prior; by default the one that ``config.guidance`` names.
        light: the prefiltered light; by default the one that ``config.light`` names.
        fixed: maps of the layers that are not painted, in their order, of ``config.texture.size``; by default grey.
        profile: wait for the device after each stage so that ``Step.timings`` are true on a GPU.

    Attributes:
        config: the settings, with the prior's own numbers for the scales that are ``auto``.
        step, total: steps done, and in all.
        profile: as given; may be changed between two steps.
        support: (layers, h, w) how much of the views each texel has been. An exporter takes texels that were next to
            none from their neighbours.
    """

    step: int
    total: int
    support: Tensor

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
        self.prompts = Prompts.of(prompt, config, [region.name for region in focus_regions(mesh, config.views)])
        self.device, self.device_reason = choose_device(config.device)
        self.streams = Streams(config.seed)
        self.prior = prior or load_prior(config.guidance.prior, loading_for(mesh, config, self.device))
        self.config = with_scales(config, self.prior.spec.guidance_scale)
        environment = light or prefilter(load_environment(config.light.path, config.light.exposure), self.device)
        self.light = environment.to(self.device)
        self.geometry = Geometry.from_mesh(mesh, self.device)
        moved = config.guidance.placement == "seed" and self.prior.spec.movable
        self.place = Placement(self.streams["placement"] if moved else None)
        self._painted = [layer.painted for layer in mesh.layers]
        size = config.texture.size
        fixed = fixed or grey(self._painted.count(False), size)
        self._fixed = TextureMaps.unpacked(fixed.packed().detach().to(self.device))
        self.fill_gutters = Gutters(mesh, size, self.device)
        self.support = torch.zeros(len(mesh.layers), size, size, device=self.device)
        self.step = 0
        self.profile = profile
        self._text = {text: self.prior.encode_text([text]) for text in self.sent_prompts}
        if prior is None and isinstance(self.prior, TextReleasing):
            self.prior.release_texts()

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

    @abstractmethod
    def _advance(self) -> Step:
        """One step."""

    @abstractmethod
    def maps(self) -> TextureMaps:
        """The texture maps as they stand, detached."""

    @abstractmethod
    def state_dict(self) -> dict[str, Any]:
        """Everything that the next step depends on; ``load_state_dict`` of it continues bit for bit.

        ``step`` an int; ``field`` and ``streams`` tensors by name; ``optimizer`` tensors by index and name; ``support``
        a tensor.
        """

    @abstractmethod
    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """The inverse of :meth:`state_dict`."""

    def _embed(self, views: Views) -> Words:
        """The embedded texts of each view."""
        cameras = views.cameras
        front = math.radians(self.config.views.front)
        texts = self.prompts.for_views(cameras.azimuth - front, cameras.elevation, views.focus)

        def embedded(texts: Sequence[str]) -> Tensor:
            return torch.cat([self._text[text] for text in texts])

        prompts, count = self.prompts, len(texts)
        return Words(
            embedded(texts),
            embedded([prompts.negative] * count),
            embedded([""] * count) if prompts.empty else None,
            embedded([prompts.with_source(text) for text in texts]) if prompts.source else None,
        )


class Clock:
    """Seconds between calls, by name.

    Args:
        synchronize: wait for the device first.
    """

    def __init__(self, device: torch.device, synchronize: bool) -> None:
        self._gpu = device if synchronize and device.type == "cuda" else None
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def __call__(self, name: str) -> None:
        if self._gpu:
            torch.cuda.synchronize(self._gpu)
        now = time.perf_counter()
        self.seconds[name] = now - self._last
        self._last = now
