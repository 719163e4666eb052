"""Rectified-flow models as priors: what Stable Diffusion 3 and 3.5, FLUX.2-klein and Z-Image share.

A flow model learns the velocity of the straight path from a picture to noise (Liu 2022, eq. 1; Esser 2024, sec. 3):

    x_s = (1 - s) x + s epsilon,    v = dx_s / ds = epsilon - x,    hence    epsilon-hat = x_s + (1 - s) v-hat.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from paintit.guidance.diffusers_prior import DiffusersPrior
from paintit.guidance.loading import Loading
from paintit.guidance.prior import PriorSpec


class FlowPrior(DiffusersPrior):
    """What the flow families share, behind the :class:`~paintit.guidance.prior.Prior` contract.

    Reads ``shaded`` alone; sees no geometry. t is a fraction of the scheduler's training schedule, whose entries
    are shifted: the share of noise is s(t), see :meth:`noise_share`, and any t in (0, 1] will do, not only its entries.

    A model distilled to few steps has guidance built into its one prediction, and was never trained to be guided
    further: the default scale of such a model is 1, which computes the conditional half alone. Others take 100, the
    scale at which Yang 2024 (RFDS) distils Stable Diffusion 3.

    Its pipeline says that it is distilled, or its name does: see :func:`paintit.guidance.distilled.distillation`.
    """

    from_index = ("is_distilled",)

    def __init__(self, pipeline: Any, *, id: str, revision: str = "", loading: Loading | None = None) -> None:
        self.transformer = pipeline.transformer
        self._schedule: Mapping[str, Any] = pipeline.scheduler.config
        super().__init__(pipeline, id=id, revision=revision, loading=loading)

    def _spec(self, id: str, revision: str, licence: str) -> PriorSpec:
        return PriorSpec(
            id=id,
            family=self.family,
            revision=revision,
            licence=licence,
            resolution=self._resolution(),
            prediction_type="flow",
            guidance_scale=1.0 if self.pipe.config.get("is_distilled") else 100.0,
        )

    def _resolution(self) -> int:
        """Side of the picture in pixels; the autoencoder's configuration holds it where the transformer's does not."""
        return int(self.pipe.vae.config.sample_size)

    @abstractmethod
    def velocity(self, x_s: Tensor, s: float, text: Tensor) -> Tensor:
        """v-hat = epsilon-hat - x-hat at the share of noise s, same shape as ``x_s``, in the transformer's type."""

    def noise_share(self, t: float) -> float:
        """s(t): the schedule's shift, which moves it towards noise (Esser 2024, eq. 23), applied to t.

        s = m t / (1 + (m - 1) t), where m is the configuration's ``shift``, or follows from the number of image tokens
        where the configuration shifts by resolution.
        """
        if not self._schedule["use_dynamic_shifting"]:
            m = self._schedule["shift"]
            return m * t / (1 + (m - 1) * t)
        return float(self.pipe.scheduler.time_shift(self._mu(self._image_tokens()), 1.0, t))

    def _image_tokens(self) -> int:
        """All three families join latents in 2 x 2 patches."""
        return (self.spec.resolution // (2 * self.codec.factor)) ** 2

    def _mu(self, tokens: int) -> float:
        """The scheduler's mu for so many image tokens: between two pairs of its configuration, on a line."""
        few, many = self._schedule["base_image_seq_len"], self._schedule["max_image_seq_len"]
        low, high = self._schedule["base_shift"], self._schedule["max_shift"]
        return low + (high - low) * (tokens - few) / (many - few)

    def add_noise(self, x: Tensor, noise: Tensor, t: float) -> Tensor:
        """x_t = (1 - s) x + s noise."""
        s = self.noise_share(t)
        return (1 - s) * x + s * noise

    @torch.no_grad()
    def predict_noise(self, x_t: Tensor, t: float, text: Tensor, geometry: Tensor | None = None) -> Tensor:
        """epsilon-hat = x_t + (1 - s) v-hat, in the type of ``x_t``.

        Raises:
            ValueError: there is ``geometry``.
        """
        if geometry is not None:
            raise ValueError(f"'{self.spec.id}' sees no geometry")
        s, dtype = self.noise_share(t), self.transformer.dtype
        native = self._by_chunks(lambda part, words: self.velocity(part.to(dtype), s, words.to(dtype)), x_t, text)
        return x_t + (1 - s) * native.to(x_t)

    def weight(self, t: float) -> float:
        """s^2 / ((1 - s)^2 + s^2).

        Divided by ((1 - s)^2 + s^2)^1/2, x_t lies on the path of a variance-preserving diffusion with the same
        signal-to-noise ratio, and this is its 1 - alphabar, the paper's m(t). Since epsilon-hat - epsilon is the error
        of x-hat times the signal-to-noise ratio on both paths, a denoiser gives the same gradient behind either.
        """
        s = self.noise_share(t)
        return s**2 / ((1 - s) ** 2 + s**2)
