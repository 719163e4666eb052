"""The contract between the painter and any diffusion model, whatever it predicts and wherever it lives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

from torch import Tensor

#: Channels a renderer can hand to a prior, each (n, h, w, c), encoded for display where they are colours:
#: ``shaded`` (3, sRGB-coded), ``base_color`` (3, sRGB-coded), ``roughness`` (1), ``metallic`` (1), all in [0, 1].
ReadChannel = Literal["shaded", "base_color", "roughness", "metallic"]
#: Geometry channels that may condition it, each zero where nothing is hit unless said otherwise: ``normal`` (3, view
#: space, in [-1, 1], x right, y up, z toward the camera), ``depth`` (1, distance along the camera's axis, normalised
#: space), ``mask`` (1, 1 where the mesh is seen), ``position`` (3, surface point in normalised space),
#: ``normal_object`` (3, unit normal of the bare mesh in normalised space).
SeeChannel = Literal["normal", "depth", "mask", "position", "normal_object"]


@dataclass(frozen=True)
class PriorSpec:
    """What a prior is and how it wants to be used; written into ``run.json``."""

    id: str
    """Short name or hub id or folder."""
    family: str
    """``"pocket"``, ``"stable-diffusion"``, ``"exact"``."""
    revision: str = ""
    """Pinned commit, or the SHA-256 of the weights."""
    licence: str = ""
    resolution: int = 512
    """Side of the square image that ``encode_image`` expects, in pixels; other sizes are resampled inside it."""
    prediction_type: str = "epsilon"
    guidance_scale: float = 7.5
    """Default s in uncond + s (cond - uncond)."""
    economy: str = ""
    """What is done to save memory and time, in words."""
    added: tuple[str, ...] = ()
    """What stands beside its network or was put into it, in words, with revisions: ControlNets, LoRAs, a picture."""
    movable: bool = False
    """Whether ``position`` and ``normal_object`` may be told in another frame, so that seeds differ."""


@runtime_checkable
class Prior(Protocol):
    """Noise level t is a float in (0, 1]: the fraction of the model's own training schedule.

    All predictions are converted to epsilon: x_t = alpha(t) x + sigma(t) epsilon, where alpha^2 + sigma^2 = 1, or
    alpha + sigma = 1 where ``spec.prediction_type`` is ``flow``.
    """

    spec: PriorSpec
    reads: tuple[ReadChannel, ...]
    sees: tuple[SeeChannel, ...]

    def encode_text(self, prompts: Sequence[str]) -> Tensor:
        """(n, ...) embeddings of n prompts, no gradient; ``""`` is the unconditional prompt."""
        ...

    def encode_image(self, channels: Mapping[str, Tensor]) -> Tensor:
        """Differentiable: the ``reads`` channels (each (n, h, w, c)) -> the (n, c, h', w') array that is denoised."""
        ...

    def encode_geometry(self, channels: Mapping[str, Tensor]) -> Tensor | None:
        """The ``sees`` channels (each (n, h, w, c)) -> conditioning (n, c, h', w'), or None where ``sees`` is empty."""
        ...

    def add_noise(self, x: Tensor, noise: Tensor, t: float) -> Tensor:
        """x_t = alpha(t) x + sigma(t) noise."""
        ...

    def predict_noise(self, x_t: Tensor, t: float, text: Tensor, geometry: Tensor | None = None) -> Tensor:
        """epsilon-hat(x_t; text, t), same shape as ``x_t``, no gradient."""
        ...

    def weight(self, t: float) -> float:
        """m(t) of eq. 1: sigma^2 / (alpha^2 + sigma^2), the official script's 1 - alphabar(t)."""
        ...


@runtime_checkable
class Decoder(Protocol):
    """A prior whose samples can be turned back into pictures: what projection needs."""

    bound: float
    """Largest magnitude of what it denoises, such as 1 where that is a picture in [-1, 1]; inf where there is none."""

    def decode_image(self, x: Tensor) -> dict[str, Tensor]:
        """Inverse of ``encode_image``: (n, c, h', w') -> the ``reads`` channels, each (n, h, w, c) in [0, 1]."""
        ...


@runtime_checkable
class Paced(Protocol):
    """A prior that changes over a paint."""

    def pace(self, progress: float) -> None:
        """Told before each step, 0 at the first and 1 at the last; nothing else is remembered from step to step."""
        ...


@runtime_checkable
class TextReleasing(Protocol):
    """A prior whose text encoders can be let go before it is."""

    def release_texts(self) -> None:
        """Free them. Texts that were encoded stay known; a new one is refused from now on."""
        ...


@runtime_checkable
class Reader(Protocol):
    """A prior with a small vocabulary, which says how it reads words outside it."""

    def readings(self, prompt: str) -> dict[str, str]:
        """Words as they stand in the prompt -> the known words that they are taken to mean."""
        ...


def signal_and_noise(prior: Prior, like: Tensor, t: float) -> tuple[float, float]:
    """alpha(t) and sigma(t), from what the prior does to a one and to a zero; ``like`` gives type and device."""
    one, zero = like.new_ones(1), like.new_zeros(1)
    return float(prior.add_noise(one, zero, t)), float(prior.add_noise(zero, one, t))
