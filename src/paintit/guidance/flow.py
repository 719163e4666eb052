"""Rectified-flow models as priors: what Stable Diffusion 3 and 3.5, FLUX.2-klein and Z-Image share.

A flow model learns the velocity of the straight path from a picture to noise (Liu 2022, eq. 1; Esser 2024, sec. 3):

    x_s = (1 - s) x + s epsilon,    v = dx_s / ds = epsilon - x,    hence    epsilon-hat = x_s + (1 - s) v-hat.

Each family's prior stands on the family's own diffusers pipeline object: its text encoding, its transformer, its
autoencoder and its scheduler's configuration.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Protocol, Self

import torch
from torch import Tensor

from paintit.guidance import hub
from paintit.guidance.autoencoder import LatentCodec
from paintit.guidance.families import FAMILIES
from paintit.guidance.prior import PriorSpec, ReadChannel, SeeChannel


class Codec(Protocol):
    """Pictures to what is denoised, and back; :class:`~paintit.guidance.autoencoder.LatentCodec` is one."""

    factor: int
    """Pixels per latent, a side."""

    def encode(self, shaded: Tensor, side: int) -> Tensor:
        """(n, h, w, 3), sRGB-coded in [0, 1] -> (n, c, h', w'), at least float32, of a picture ``side`` pixels wide."""
        ...

    def decode(self, x: Tensor) -> Tensor:
        """(n, c, h', w') -> (n, h, w, 3) in [0, 1]."""
        ...


class FlowPrior(ABC):
    """What the flow families share, behind the :class:`~paintit.guidance.prior.Prior` contract.

    Reads ``shaded`` alone; sees no geometry. t is a fraction of the scheduler's training schedule, whose entries
    are shifted: the share of noise is s(t), see :meth:`noise_share`, and any t in (0, 1] will do, not only its entries.

    A model distilled to few steps has guidance built into its one prediction, and was never trained to be guided
    further: the default scale of such a model is 1, which computes the conditional half alone. Others take 100, the
    scale at which Yang 2024 (RFDS) distils Stable Diffusion 3.

    Args:
        pipeline: an instance of the diffusers class ``pipeline``, whole.
        id: a model whose pipeline does not say that it is distilled is taken for it where this contains "turbo".
        chunk: most latents that go through the transformer at once, to save memory; 0 for no limit.
    """

    family: ClassVar[str]
    pipeline: ClassVar[str]
    """Name of the diffusers class."""
    parts: ClassVar[Mapping[str, str]]
    """Its parts -> names of their diffusers or transformers classes."""
    reads: tuple[ReadChannel, ...] = ("shaded",)
    sees: tuple[SeeChannel, ...] = ()
    bound: float = math.inf

    def __init__(self, pipeline: Any, *, id: str, revision: str = "", licence: str = "", chunk: int = 0) -> None:
        self.pipe, self.transformer = pipeline, pipeline.transformer
        for part in pipeline.components.values():
            if isinstance(part, torch.nn.Module):
                part.requires_grad_(False).eval()
        self.chunk = chunk
        self._schedule: Mapping[str, Any] = pipeline.scheduler.config
        self.codec = self._codec(pipeline.vae)
        self._texts: dict[str, Tensor] = {}
        distilled = bool(pipeline.config.get("is_distilled")) or "turbo" in id.lower()
        self.spec = PriorSpec(
            id=id,
            family=self.family,
            revision=revision,
            licence=licence,
            resolution=self._resolution(),
            prediction_type="flow",
            guidance_scale=1.0 if distilled else 100.0,
        )

    @classmethod
    def load(
        cls,
        source: str | Path,
        *,
        device: str | torch.device = "cpu",
        dtype: str = "auto",
        revision: str = "",
        allow_download: bool = False,
        licence: str = "",
        chunk: int = 0,
    ) -> Self:
        """The checkpoint in the folder ``source``, or with the hub id ``source``.

        Args:
            dtype: ``auto`` is float32 on a CPU or MPS and, on CUDA, bfloat16 or, where the card has none, float16. The
                autoencoder keeps float32 beside a float16 transformer.
            revision: commit, tag or branch of a hub id.
            allow_download: without it, a hub id must already be in the local cache.

        Raises:
            PriorError: the extra is not installed, the checkpoint is not there, or it is of another kind.
        """
        family = FAMILIES[cls.family]
        hub.require_extra(family.about)
        import diffusers
        import transformers

        found = hub.open_checkpoint(source, family, revision=revision, allow_download=allow_download)
        precision = hub.precision(torch.device(device), dtype)
        parts: dict[str, Any] = dict.fromkeys(cls.parts)
        for name, kind in cls.parts.items():
            if name in family.optional and not found.has(name):
                continue
            weights = hub.vae_precision(precision) if name == "vae" else precision
            source_of = diffusers if hasattr(diffusers, kind) else transformers
            parts[name] = found.part(getattr(source_of, kind), name, weights if name in family.weights else None)
        if "is_distilled" in found.index:
            parts["is_distilled"] = found.index["is_distilled"]
        pipeline = _quiet_class(cls.pipeline)(**parts)
        pipeline.to(device, silence_dtype_warnings=True)
        return cls(pipeline, id=found.id, revision=found.revision, licence=licence, chunk=chunk)

    def _codec(self, vae: Any) -> Codec:
        return LatentCodec(vae)

    def _resolution(self) -> int:
        """Side of the picture in pixels; the autoencoder's configuration holds it where the transformer's does not."""
        return int(self.pipe.vae.config.sample_size)

    @abstractmethod
    def _encode(self, prompt: str) -> Tensor:
        """(1, ...) embedding of one prompt."""

    @abstractmethod
    def velocity(self, x_s: Tensor, s: float, text: Tensor) -> Tensor:
        """v-hat = epsilon-hat - x-hat at the share of noise s, same shape as ``x_s``, in the transformer's type."""

    @torch.no_grad()
    def encode_text(self, prompts: Sequence[str]) -> Tensor:
        """(n, rows, d) embeddings, packed as the class says; each distinct prompt is encoded once and kept."""
        for prompt in dict.fromkeys(prompts):
            if prompt not in self._texts:
                self._texts[prompt] = self._encode(prompt)
        return torch.cat([self._texts[prompt] for prompt in prompts])

    def encode_image(self, channels: Mapping[str, Tensor]) -> Tensor:
        """``shaded`` (n, h, w, 3), sRGB-coded in [0, 1] -> latents (n, c, h', w') float32."""
        return self.codec.encode(channels["shaded"], self.spec.resolution)

    def decode_image(self, x: Tensor) -> dict[str, Tensor]:
        """Latents (n, c, h', w') -> ``shaded`` (n, h, w, 3) in [0, 1]."""
        return {"shaded": self.codec.decode(x)}

    def encode_geometry(self, channels: Mapping[str, Tensor]) -> Tensor | None:
        """None: the model sees no geometry."""
        return None

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
        s, dtype, chunk = self.noise_share(t), self.transformer.dtype, self.chunk or len(x_t)
        native = torch.cat(
            [
                self.velocity(part.to(dtype), s, words.to(dtype))
                for part, words in zip(x_t.split(chunk), text.split(chunk), strict=True)
            ]
        )
        return x_t + (1 - s) * native.to(x_t)

    def weight(self, t: float) -> float:
        """s^2 / ((1 - s)^2 + s^2).

        Divided by ((1 - s)^2 + s^2)^1/2, x_t lies on the path of a variance-preserving diffusion with the same
        signal-to-noise ratio, and this is its 1 - alphabar, the paper's m(t). Since epsilon-hat - epsilon is the error
        of x-hat times the signal-to-noise ratio on both paths, a denoiser gives the same gradient behind either.
        """
        s = self.noise_share(t)
        return s**2 / ((1 - s) ** 2 + s**2)


def _quiet_class(name: str) -> Any:
    """A class of diffusers. Importing one can make transformers warn of image processors that are of no use here."""
    import diffusers
    from transformers.utils import logging

    level = logging.get_verbosity()
    logging.set_verbosity_error()
    try:
        return getattr(diffusers, name)
    finally:
        logging.set_verbosity(level)
