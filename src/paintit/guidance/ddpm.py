"""What the families with a discrete noise schedule share (Ho 2020, eq. 4): levels, conversions, texts, chunks."""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor, nn

from paintit.errors import PriorError
from paintit.guidance.prior import PriorSpec, ReadChannel, SeeChannel

if TYPE_CHECKING:
    from diffusers.schedulers.scheduling_ddim import DDIMScheduler
    from diffusers.schedulers.scheduling_ddpm import DDPMScheduler
    from transformers import PreTrainedTokenizerBase

log = logging.getLogger(__name__)

PREDICTIONS = ("epsilon", "v_prediction", "sample")


class DdpmPrior(ABC):
    """x_t = alpha x + sigma epsilon at the model's own training timesteps, alpha^2 = alphabar, sigma^2 = 1 - alphabar.

    t is rounded to the nearest timestep. A family says how one prompt is encoded and what its network predicts.

    Args:
        scheduler: source of ``alphas_cumprod``.
        models: every module of the family; they are frozen.
        chunk: most views that go through the network at once, to save memory; 0 for no limit.
    """

    reads: tuple[ReadChannel, ...] = ("shaded",)
    sees: tuple[SeeChannel, ...] = ()

    def __init__(
        self, spec: PriorSpec, scheduler: DDIMScheduler | DDPMScheduler, models: Sequence[nn.Module], chunk: int = 0
    ) -> None:
        self.spec = spec
        self.chunk = chunk
        self.alphas_cumprod: list[float] = scheduler.alphas_cumprod.double().tolist()
        for model in models:
            model.requires_grad_(False).eval()
        self._texts: dict[str, Tensor] = {}

    @abstractmethod
    def _encode(self, prompt: str) -> Tensor:
        """(1, ...) embedding of one prompt."""

    @abstractmethod
    def _denoise(self, inputs: Tensor, timestep: int, text: Tensor) -> Tensor:
        """What the network predicts, in its own terms and any floating type, shaped like x_t.

        Args:
            inputs: x_t, and behind it the channels of the geometry that the model sees.
        """

    @torch.no_grad()
    def encode_text(self, prompts: Sequence[str]) -> Tensor:
        """(n, ...) embeddings; each distinct prompt is encoded once and kept."""
        for prompt in dict.fromkeys(prompts):
            if prompt not in self._texts:
                self._texts[prompt] = self._encode(prompt)
        return torch.cat([self._texts[prompt] for prompt in prompts])

    def encode_geometry(self, channels: Mapping[str, Tensor]) -> Tensor | None:
        """None: most of these models see no geometry."""
        return None

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
        size, step = self.chunk or len(x_t), self.timestep(t)
        native = torch.cat(
            [self._denoise(part, step, words) for part, words in zip(inputs.split(size), text.split(size), strict=True)]
        )
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


def prediction_of(scheduler: DDIMScheduler | DDPMScheduler, id: str) -> str:
    """What the model ``id`` predicts, one of :data:`PREDICTIONS`.

    Raises:
        PriorError: something else.
    """
    kind = str(scheduler.config["prediction_type"])
    if kind not in PREDICTIONS:
        raise PriorError("prior.prediction", f"'{id}' predicts '{kind}'", "choose an epsilon or v model")
    return kind


def token_ids(tokenizer: PreTrainedTokenizerBase, prompt: str, limit: int) -> Any:
    """``input_ids`` and ``attention_mask``, each (1, limit), padded; what does not fit is cut."""
    return tokenizer(prompt, padding="max_length", max_length=limit, truncation=True, return_tensors="pt")


def report_cut(tokenizer: PreTrainedTokenizerBase, prompt: str, limit: int, id: str) -> None:
    """A warning where the prompt does not fit."""
    needed = len(tokenizer(prompt).input_ids)
    if needed > limit:
        log.warning("the prompt takes %d tokens, of which %s reads %d: '%s'", needed, id, limit, prompt)
