"""What every family of diffusers checkpoints shares: parts, text, pictures, and how a checkpoint becomes a prior."""

from __future__ import annotations

import dataclasses
import logging
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self

import torch
from torch import Tensor, nn

from paintit.errors import PriorError
from paintit.guidance import hub, tiny
from paintit.guidance.autoencoder import LatentCodec
from paintit.guidance.distilled import distillation
from paintit.guidance.economy import GB, Choice, choose
from paintit.guidance.families import FAMILIES
from paintit.guidance.footprint import Footprint, footprint, outline, outline_part
from paintit.guidance.hub import Checkpoint
from paintit.guidance.loading import Loading
from paintit.guidance.lora import add_loras
from paintit.guidance.prior import PriorSpec, ReadChannel, SeeChannel
from paintit.guidance.reference import Reference, add_reference
from paintit.guidance.settle import settle

if TYPE_CHECKING:
    from transformers import PreTrainedTokenizerBase

log = logging.getLogger(__name__)


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


class DiffusersPrior(ABC):
    """A diffusers checkpoint behind the :class:`~paintit.guidance.prior.Prior` contract.

    It stands on the family's own pipeline object, for its parts, its way with texts and its adapters; the pipeline is
    never run. Reads ``shaded`` alone, and sees no geometry unless the family says so.

    Args:
        pipeline: an instance of the diffusers class ``pipeline``, whole; its modules are frozen.
        id: hub id or folder.
        revision: commit, or fingerprint of a folder.
    """

    family: ClassVar[str]
    pipeline: ClassVar[str]
    """Name of the diffusers class."""
    parts: ClassVar[Mapping[str, str]]
    """Its parts -> names of their diffusers or transformers classes."""
    settings: ClassVar[Mapping[str, Any]] = {}
    """Further arguments of the class."""
    from_index: ClassVar[tuple[str, ...]] = ()
    """Arguments that it takes from ``model_index.json``, where they are there."""
    packages: ClassVar[tuple[str, ...]] = ("diffusers", "transformers")
    reads: tuple[ReadChannel, ...] = ("shaded",)
    sees: tuple[SeeChannel, ...] = ()
    bound: float = math.inf
    reference: Reference | None = None
    """The picture that is seen beside the words; its rows are the last ones of every text."""

    def __init__(self, pipeline: Any, *, id: str, revision: str = "", loading: Loading | None = None) -> None:
        loading = loading or Loading()
        self.pipe = pipeline
        self.economy = loading.economy
        self.chunk = loading.economy.chunk
        for part in pipeline.components.values():
            if isinstance(part, nn.Module):
                part.requires_grad_(False).eval()
        self._texts: dict[str, Tensor] = {}
        self.codec: Codec = self._codec()
        self.spec = dataclasses.replace(self._spec(id, revision, loading.licence), economy=loading.economy.words)

    @classmethod
    def load(cls, source: str | Path, loading: Loading | None = None) -> Self:
        """The checkpoint in the folder ``source``, or with the hub id ``source``; see :func:`hub.open_checkpoint`.

        Raises:
            PriorError: the extra is not installed, the checkpoint is not there, or it is of another kind.
        """
        loading = loading or Loading()
        family = FAMILIES[cls.family]
        hub.require_extra(family.about, cls.packages, cls.pipeline)
        found = hub.open_checkpoint(source, family, revision=loading.revision, allow_download=loading.allow_download)
        loading = cls._economised(found, loading)
        pipeline = cls._assemble(found, loading, found.part)
        added = add_loras(pipeline, loading, found.id)
        reference = add_reference(pipeline, loading, found.id)
        settle(pipeline, next(iter(family.weights)), loading.economy, loading.device)
        prior = cls(pipeline, id=found.id, revision=found.revision, loading=loading)
        prior.reference = reference
        prior.spec = dataclasses.replace(prior.spec, added=(*added, *(reference.record if reference else ())))
        if sign := distillation(found.id, found.scheduler, prior.denoiser.config):
            words = "%s is distilled to few steps (%s), a poorer teacher; its own guidance scale is 1"
            log.warning(words, found.id, sign)
            prior.spec = dataclasses.replace(prior.spec, guidance_scale=1.0)
        return prior

    @classmethod
    def _assemble(cls, found: Checkpoint, loading: Loading, make: Callable[[Any, str, Any], Any]) -> Any:
        """The pipeline of a checkpoint.

        Args:
            make: (class, name, type) -> a part with weights, as :meth:`Checkpoint.part`.
        """
        import diffusers
        import transformers

        family, precision = FAMILIES[cls.family], hub.precision(torch.device(loading.device), loading.dtype)
        parts: dict[str, Any] = dict.fromkeys(cls.parts)
        for name, kind in cls.parts.items():
            library: Any = diffusers if hasattr(diffusers, kind) else transformers
            if name in family.optional and not found.has(name):
                continue
            if name == "vae" and loading.economy.tiny:
                parts[name] = tiny.load(loading, found, hub.vae_precision(precision))
            elif name in family.weights:
                weights = hub.vae_precision(precision) if name == "vae" else precision
                parts[name] = make(getattr(library, kind), name, weights)
            else:
                parts[name] = found.part(getattr(library, kind), name)
        parts |= {name: found.index[name] for name in cls.from_index if name in found.index}
        with hub.quiet():
            return getattr(diffusers, cls.pipeline)(**parts, **cls.settings)

    @classmethod
    def _economised(cls, found: Checkpoint, loading: Loading) -> Loading:
        """``loading`` with an economy that keeps its budget, where there is one; what was chosen is logged."""
        if not loading.budget.limit:
            return dataclasses.replace(loading, economy=tiny.named(loading, found))
        choice = cls.choice(found, loading)
        log.warning("to keep to %g GB: %s", loading.budget.limit / GB, choice.words)
        if choice.economy.tiny and not loading.economy.tiny:
            log.warning("nothing else fits, and the tiny autoencoder %s changes the result", choice.economy.tiny)
        return dataclasses.replace(loading, economy=choice.economy)

    @classmethod
    def choice(cls, found: Checkpoint, loading: Loading) -> Choice:
        """What is done to keep ``loading.budget``, and what the paint then takes. No weights are read.

        Raises:
            PriorError: it cannot be kept.
        """
        budget = dataclasses.replace(loading.budget, tiny=tiny.stand_in(loading, found))
        return choose(cls.footprint(found, loading), budget, tiny.named(loading, found))

    @classmethod
    def footprint(cls, found: Checkpoint, loading: Loading) -> Footprint:
        """What the checkpoint takes in memory, from its configurations alone."""
        plain = dataclasses.replace(loading, economy=dataclasses.replace(loading.economy, tiny=""))

        def make(kind: Any, name: str, dtype: Any) -> Any:
            with outline():
                return outline_part(found.folder, kind, name, dtype)

        pipeline = cls._assemble(found, plain, make)
        small = tiny.outline(found) if cls.parts.get("vae") == tiny.STANDS_FOR else None
        return footprint(cls(pipeline, id=found.id, loading=Loading()), small)

    @property
    def denoiser(self) -> Any:
        """The network that denoises."""
        return getattr(self.pipe, next(iter(FAMILIES[self.family].weights)))

    @abstractmethod
    def _spec(self, id: str, revision: str, licence: str) -> PriorSpec:
        """What the checkpoint says of itself.

        Raises:
            PriorError: it is of another kind.
        """

    @abstractmethod
    def _encode(self, prompt: str) -> Tensor:
        """(1, ...) embedding of one prompt."""

    def _codec(self) -> Codec:
        return LatentCodec(self.pipe.vae, self.economy.recompute)

    @torch.no_grad()
    def encode_text(self, prompts: Sequence[str]) -> Tensor:
        """(n, ...) embeddings, packed as the class says; each distinct prompt is encoded once and kept.

        Raises:
            PriorError: a new prompt after :meth:`release_texts`.
        """
        for prompt in dict.fromkeys(prompts):
            if prompt not in self._texts:
                if self.pipe.text_encoder is None:
                    raise PriorError(
                        "prior.text", f"the text encoders of '{self.spec.id}' were let go before '{prompt}' was asked",
                        "load the prior yourself and hand it in, so that it is kept whole",
                    )  # fmt: skip
                packed = self._encode(prompt).to(self.denoiser.device)
                self._texts[prompt] = self.reference.behind(packed, prompt) if self.reference else packed
        return torch.cat([self._texts[prompt] for prompt in prompts])

    def release_texts(self) -> None:
        """Let the text encoders go, and their memory; what was encoded stays known."""
        for name in [name for name in self.pipe.components if name.startswith("text_encoder")]:
            setattr(self.pipe, name, None)
        if self.denoiser.device.type == "cuda":
            torch.cuda.empty_cache()

    def encode_image(self, channels: Mapping[str, Tensor]) -> Tensor:
        """``shaded`` (n, h, w, 3), sRGB-coded in [0, 1] -> latents (n, c, h', w'), at least float32."""
        return self.codec.encode(channels["shaded"], self.spec.resolution)

    def decode_image(self, x: Tensor) -> dict[str, Tensor]:
        """Latents (n, c, h', w') -> ``shaded`` (n, h, w, 3) in [0, 1]."""
        return {"shaded": self.codec.decode(x)}

    def encode_geometry(self, channels: Mapping[str, Tensor]) -> Tensor | None:
        """None: most of these models see no geometry."""
        return None

    def _by_chunks(self, predict: Callable[..., Tensor], *batches: Tensor) -> Tensor:
        """``predict`` of as many views at once as are allowed; each batch is (n, ...)."""
        size = self.chunk or len(batches[0])
        chunks = zip(*(batch.split(size) for batch in batches), strict=True)
        # A CUDA graph writes its results to the same place every time.
        return torch.cat([predict(*parts).clone() for parts in chunks])


def token_ids(tokenizer: PreTrainedTokenizerBase, prompt: str, limit: int) -> Any:
    """``input_ids`` and ``attention_mask``, each (1, limit), padded; what does not fit is cut."""
    return tokenizer(prompt, padding="max_length", max_length=limit, truncation=True, return_tensors="pt")


def report_cut(tokenizer: PreTrainedTokenizerBase, prompt: str, limit: int, id: str) -> None:
    """A warning where the prompt does not fit."""
    needed = len(tokenizer(prompt).input_ids)
    if needed > limit:
        log.warning("the prompt takes %d tokens, of which %s reads %d: '%s'", needed, id, limit, prompt)
