"""What the families with a discrete noise schedule share (Ho 2020, eq. 4): levels and conversions."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Self

import torch
from torch import Tensor

from paintit.errors import PriorError
from paintit.guidance import controlnet, reference
from paintit.guidance.additions import on_record
from paintit.guidance.diffusers_prior import DiffusersPrior
from paintit.guidance.economy import Footprint
from paintit.guidance.hub import Checkpoint
from paintit.guidance.loading import Loading

PREDICTIONS = ("epsilon", "v_prediction", "sample")


class DdpmPrior(DiffusersPrior):
    """x_t = alpha x + sigma epsilon at the model's own training timesteps, alpha^2 = alphabar, sigma^2 = 1 - alphabar.

    t is rounded to the nearest timestep. A family says how one prompt is encoded and what its network predicts.

    Attributes:
        controls: ControlNets beside the network, which then sees what they need; None for none.
    """

    controls: controlnet.Controls | None = None

    def __init__(self, pipeline: Any, *, id: str, revision: str = "", loading: Loading | None = None) -> None:
        self.unet = pipeline.unet
        self.alphas_cumprod: list[float] = pipeline.scheduler.alphas_cumprod.double().tolist()
        super().__init__(pipeline, id=id, revision=revision, loading=loading)

    @classmethod
    def load(cls, source: str | Path, loading: Loading | None = None) -> Self:
        """As :meth:`DiffusersPrior.load`, with the ControlNets that ``loading.control`` names.

        Raises:
            PriorError: also where one of them is not there, or does not fit.
        """
        loading = loading or Loading()
        found = controlnet.find(loading)  # before gigabytes are read
        prior = super().load(source, loading)
        if found:
            prior._control(found, loading)
        return prior

    @classmethod
    def footprint(cls, found: Checkpoint, loading: Loading) -> Footprint:
        """What the checkpoint takes in memory, and the ControlNets; an IP-Adapter is a part of the network."""
        plain = super().footprint(found, loading)
        network = plain.network + reference.weigh(loading)
        return replace(plain, network=network, controls=controlnet.weigh(loading))

    def _control(self, found: list[Checkpoint], loading: Loading) -> None:
        """Put ControlNets beside the network, and on the record."""
        if self.sees:
            hint = "leave --control out, or choose the text-to-image model of the same family"
            raise PriorError("prior.control", f"'{self.spec.id}' sees {self.sees[0]} by itself", hint)
        self.controls = controlnet.Controls.load(
            found, self.unet, loading, id=self.spec.id, side=self.spec.resolution, factor=self.codec.factor
        )
        self.sees = self.controls.sees
        pairs = zip(loading.control, found, strict=True)
        words = (on_record(f"{control.kind} control", net.id, control.scale, net.revision) for control, net in pairs)
        self.spec = replace(self.spec, added=(*self.spec.added, *words))

    @abstractmethod
    def _denoise(self, x_t: Tensor, timestep: Tensor, text: Tensor, geometry: Tensor | None) -> Tensor:
        """What the network predicts, in its own terms and any floating type, shaped like x_t.

        Args:
            geometry: from ``encode_geometry``; None where the model sees none.
        """

    def _unpack(self, text: Tensor) -> tuple[Tensor, list[Tensor]]:
        """What a family packed, and the rows of the reference picture (b, 1, r, d); none where there is no picture."""
        if self.reference is None:
            return text, []
        words, picture = self.reference.split(text)
        return words, [picture[:, None]]

    def encode_geometry(self, channels: Mapping[str, Tensor]) -> Tensor | None:
        """None, or the pictures (n, 3 per ControlNet, resolution, resolution) that the ControlNets look at."""
        return self.controls.draw(channels) if self.controls else None

    def pace(self, progress: float) -> None:
        """The ControlNets' scale at this share of the paint."""
        if self.controls:
            self.controls.pace(progress)

    def timestep(self, t: float) -> int:
        """The training timestep nearest to the fraction t of the schedule."""
        return min(round(t * len(self.alphas_cumprod)), len(self.alphas_cumprod) - 1)

    def alpha_sigma(self, t: float) -> tuple[float, float]:
        """sqrt(alphabar) and sqrt(1 - alphabar)."""
        alphabar = self.alphas_cumprod[self.timestep(t)]
        return alphabar**0.5, (1 - alphabar) ** 0.5

    def add_noise(self, x: Tensor, noise: Tensor, t: float) -> Tensor:
        alpha, sigma = self.alpha_sigma(t)
        return alpha * x + sigma * noise

    @torch.no_grad()
    def predict_noise(self, x_t: Tensor, t: float, text: Tensor, geometry: Tensor | None = None) -> Tensor:
        """epsilon-hat, in the type of ``x_t``, whatever the model predicts.

        Raises:
            ValueError: there is no ``geometry`` and the model sees some, or the other way round.
        """
        if bool(self.sees) != (geometry is not None):
            raise ValueError(f"'{self.spec.id}' sees {self.sees or 'no geometry'}")
        # A tensor: for a number, torch.compile would trace the network anew at every noise level.
        step = torch.tensor(self.timestep(t), device=x_t.device)

        def predict(x_t: Tensor, text: Tensor, geometry: Tensor | None = None) -> Tensor:
            return self._denoise(x_t, step, text, geometry)

        native = self._by_chunks(predict, x_t, text, *(() if geometry is None else (geometry,)))
        return to_epsilon(native.to(x_t), x_t, *self.alpha_sigma(t), self.spec.prediction_type)

    def weight(self, t: float) -> float:
        """1 - alphabar(t), as the official script."""
        return 1 - self.alphas_cumprod[self.timestep(t)]


def to_epsilon(native: Tensor, x_t: Tensor, alpha: float, sigma: float, prediction_type: str) -> Tensor:
    """epsilon of x_t = alpha x + sigma epsilon, from a prediction of it, of x, or of v = alpha epsilon - sigma x."""
    match prediction_type:
        case "v_prediction":
            return alpha * native + sigma * x_t
        case "sample":
            return (x_t - alpha * native) / sigma
        case _:
            return native


def prediction_of(scheduler: Any, id: str) -> str:
    """What the model ``id`` predicts by its scheduler's configuration, one of :data:`PREDICTIONS`.

    Raises:
        PriorError: something else.
    """
    kind = str(scheduler.config["prediction_type"])
    if kind not in PREDICTIONS:
        raise PriorError("prior.prediction", f"'{id}' predicts '{kind}'", "choose an epsilon or v model")
    return kind
