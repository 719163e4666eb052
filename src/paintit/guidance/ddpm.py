"""What the families with a discrete noise schedule share (Ho 2020, eq. 4): levels and conversions."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import torch
from torch import Tensor

from paintit.errors import PriorError
from paintit.guidance.diffusers_prior import DiffusersPrior
from paintit.guidance.loading import Loading

PREDICTIONS = ("epsilon", "v_prediction", "sample")


class DdpmPrior(DiffusersPrior):
    """x_t = alpha x + sigma epsilon at the model's own training timesteps, alpha^2 = alphabar, sigma^2 = 1 - alphabar.

    t is rounded to the nearest timestep. A family says how one prompt is encoded and what its network predicts.
    """

    def __init__(self, pipeline: Any, *, id: str, revision: str = "", loading: Loading | None = None) -> None:
        self.unet = pipeline.unet
        self.alphas_cumprod: list[float] = pipeline.scheduler.alphas_cumprod.double().tolist()
        super().__init__(pipeline, id=id, revision=revision, loading=loading)

    @abstractmethod
    def _denoise(self, inputs: Tensor, timestep: int, text: Tensor) -> Tensor:
        """What the network predicts, in its own terms and any floating type, shaped like x_t.

        Args:
            inputs: x_t, and behind it the channels of the geometry that the model sees.
        """

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
        inputs = x_t if geometry is None else torch.cat([x_t, geometry.to(x_t)], 1)
        step = self.timestep(t)
        native = self._by_chunks(lambda part, words: self._denoise(part, step, words), inputs, text)
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
