"""What every family of diffusers checkpoints shares: parts, text, pictures, and how a checkpoint becomes a prior."""

from __future__ import annotations

import logging
import math
import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self

import torch
from torch import Tensor, nn

from paintit.guidance import hub
from paintit.guidance.autoencoder import LatentCodec
from paintit.guidance.families import FAMILIES
from paintit.guidance.loading import Loading
from paintit.guidance.prior import PriorSpec, ReadChannel, SeeChannel

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

    def __init__(self, pipeline: Any, *, id: str, revision: str = "", loading: Loading | None = None) -> None:
        loading = loading or Loading()
        self.pipe = pipeline
        self.chunk = loading.chunk
        for part in pipeline.components.values():
            if isinstance(part, nn.Module):
                part.requires_grad_(False).eval()
        self._texts: dict[str, Tensor] = {}
        self.codec: Codec = self._codec()
        self.spec = self._spec(id, revision, loading.licence)

    @classmethod
    def load(cls, source: str | Path, loading: Loading | None = None) -> Self:
        """The checkpoint in the folder ``source``, or with the hub id ``source``; see :func:`hub.open_checkpoint`.

        Raises:
            PriorError: the extra is not installed, the checkpoint is not there, or it is of another kind.
        """
        loading = loading or Loading()
        family = FAMILIES[cls.family]
        hub.require_extra(family.about, cls.packages)
        import diffusers
        import transformers

        found = hub.open_checkpoint(source, family, revision=loading.revision, allow_download=loading.allow_download)
        precision = hub.precision(torch.device(loading.device), loading.dtype)
        parts: dict[str, Any] = dict.fromkeys(cls.parts)
        for name, kind in cls.parts.items():
            if name in family.optional and not found.has(name):
                continue
            weights = hub.vae_precision(precision) if name == "vae" else precision
            library: Any = diffusers if hasattr(diffusers, kind) else transformers
            parts[name] = found.part(getattr(library, kind), name, weights if name in family.weights else None)
        parts |= {name: found.index[name] for name in cls.from_index if name in found.index}
        pipeline = _quietly(lambda: getattr(diffusers, cls.pipeline)(**parts, **cls.settings))
        pipeline.to(loading.device, silence_dtype_warnings=True)
        return cls(pipeline, id=found.id, revision=found.revision, loading=loading)

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
        return LatentCodec(self.pipe.vae)

    @torch.no_grad()
    def encode_text(self, prompts: Sequence[str]) -> Tensor:
        """(n, ...) embeddings, packed as the class says; each distinct prompt is encoded once and kept."""
        for prompt in dict.fromkeys(prompts):
            if prompt not in self._texts:
                self._texts[prompt] = self._encode(prompt)
        return torch.cat([self._texts[prompt] for prompt in prompts])

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
        return torch.cat([predict(*parts) for parts in zip(*(batch.split(size) for batch in batches), strict=True)])


def token_ids(tokenizer: PreTrainedTokenizerBase, prompt: str, limit: int) -> Any:
    """``input_ids`` and ``attention_mask``, each (1, limit), padded; what does not fit is cut."""
    return tokenizer(prompt, padding="max_length", max_length=limit, truncation=True, return_tensors="pt")


def report_cut(tokenizer: PreTrainedTokenizerBase, prompt: str, limit: int, id: str) -> None:
    """A warning where the prompt does not fit."""
    needed = len(tokenizer(prompt).input_ids)
    if needed > limit:
        log.warning("the prompt takes %d tokens, of which %s reads %d: '%s'", needed, id, limit, prompt)


def _quietly(make: Callable[[], Any]) -> Any:
    """``make()`` without what the libraries say of image processors and schedulers, which are of no use here."""
    import diffusers
    import transformers

    libraries: list[Any] = [diffusers.utils.logging, transformers.utils.logging]
    levels = [library.get_verbosity() for library in libraries]
    for library in libraries:
        library.set_verbosity_error()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return make()
    finally:
        for library, level in zip(libraries, levels, strict=True):
            library.set_verbosity(level)
