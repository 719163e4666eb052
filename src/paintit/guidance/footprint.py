"""How much memory a prior takes, found out on fake tensors: they have shapes and types, and hold nothing."""

from __future__ import annotations

import contextlib
import weakref
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor, nn
from torch._subclasses.fake_tensor import (
    DataDependentOutputException,
    DynamicOutputShapeException,
    FakeTensorMode,
)
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

from paintit.guidance.economy import EncoderCost, Footprint

if TYPE_CHECKING:
    from paintit.guidance.diffusers_prior import DiffusersPrior

#: Values that a block of a transformer holds at once for each of its tokens and channels: what goes in and past it, its
#: normalised form, queries, keys, values, attention's output, and the four times wider inside of its perceptron, gated.
TRANSFORMER = 16


class Live(TorchDispatchMode):
    """Counts the bytes of tensors that are made while it is on, as long as they live.

    Args:
        known: what is there already: weights.

    Attributes:
        now: bytes alive.
        peak: the most there were.
    """

    def __init__(self, known: Iterable[Tensor] = ()) -> None:
        super().__init__()
        self.now = self.peak = 0
        self._known = {tensor.untyped_storage()._cdata for tensor in known}

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        made = func(*args, **(kwargs or {}))
        for tensor in tree_leaves(made):
            if isinstance(tensor, Tensor):
                self._count(tensor.untyped_storage())
        return made

    def _count(self, storage: torch.UntypedStorage) -> None:
        name, size = storage._cdata, storage.nbytes()
        if name in self._known:
            return
        self._known.add(name)
        self.now += size
        self.peak = max(self.peak, self.now)
        weakref.finalize(storage, self._forget, name, size)

    def _forget(self, name: int, size: int) -> None:
        self._known.discard(name)
        self.now -= size


@contextlib.contextmanager
def outline() -> Iterator[None]:
    """Inside, whatever torch makes has a shape and a type, and no contents."""
    with FakeTensorMode(allow_non_fake_inputs=True):
        yield


def outline_part(folder: Path, cls: Any, name: str, dtype: torch.dtype) -> Any:
    """``cls``, of diffusers or transformers, as the configuration in the subfolder ``name`` has it.

    To be called inside :func:`outline`.
    """
    before = torch.get_default_dtype()
    torch.set_default_dtype(dtype)
    try:
        if cls.__module__.startswith("transformers"):
            return cls(cls.config_class.from_pretrained(folder / name, local_files_only=True))
        return cls.from_config(cls.load_config(folder / name, local_files_only=True))
    finally:
        torch.set_default_dtype(before)


def footprint(prior: DiffusersPrior, tiny: Any = None) -> Footprint:
    """What ``prior`` takes, whose parts were made inside :func:`outline`; nothing is computed.

    Args:
        tiny: a tiny autoencoder that could stand in, made likewise.
    """
    with outline():
        network = prior.denoiser
        side = prior.spec.resolution
        texts = [part for name, part in prior.pipe.components.items() if name.startswith("text_encoder") and part]
        encoder, latents = _encoder(prior.encode_image, side, getattr(prior.pipe, "vae", None))
        return Footprint(
            network=_weights(network),
            layer=max(_weights(part) for part in network.modules() if not list(part.children())),
            texts=sum(_weights(part) for part in texts),
            predict=_predict(prior, latents),
            encoder=encoder,
            tiny=_encoder(lambda channels: _tiny(tiny, channels), side, tiny)[0] if tiny else None,
        )


def _encoder(
    encode: Callable[[dict[str, Tensor]], Tensor], side: int, vae: nn.Module | None
) -> tuple[EncoderCost, Tensor]:
    """The cost of ``encode``, which stands on ``vae``, and the latents that it gives."""
    weights = list(vae.parameters()) if vae else []
    picture = torch.empty(1, side, side, 3, requires_grad=True)
    with torch.no_grad(), Live(weights) as alone:
        encode({"shaded": picture})
    with Live(weights) as live:
        latents = encode({"shaded": picture})
        saved = live.now
        latents.backward(torch.empty_like(latents))
    return EncoderCost(_weights(vae), saved, alone.peak, live.peak), latents


def _tiny(vae: Any, channels: dict[str, Tensor]) -> Tensor:
    from paintit.guidance.autoencoder import LatentCodec

    return LatentCodec(vae).encode(channels["shaded"], channels["shaded"].shape[1])


def _predict(prior: Any, latents: Tensor) -> int:
    """Of one sample; by a rule where what is computed depends on the words themselves."""
    latents = latents.detach()
    try:
        text = prior.encode_text(["a"])
        with Live([*prior.denoiser.parameters(), latents, text]) as live:
            prior.predict_noise(latents, 0.5, text)
        return live.peak
    except (DataDependentOutputException, DynamicOutputShapeException):
        tokens = latents[0, 0].numel() // 4 + 512
        width = max(min(p.shape) for p in prior.denoiser.parameters() if p.ndim == 2)
        return TRANSFORMER * tokens * width * latents.new_empty(0, dtype=prior.denoiser.dtype).element_size()


def _weights(part: nn.Module | None) -> int:
    tensors = [*part.parameters(), *part.buffers()] if part else []
    return sum(tensor.numel() * tensor.element_size() for tensor in tensors)
