"""One prior on several devices at once, each with its share of the views."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

import torch
from torch import Tensor

from paintit.guidance.prior import Decoder, Paced, Prior, Reader, TextReleasing


class Replicas:
    """Copies of one prior behind the :class:`~paintit.guidance.prior.Prior` contract.

    Views are split evenly and in order; a thread for each device, since PyTorch lets go of Python's lock while it
    computes. Results are joined on the first device, where everything else lives, and gradients find their way back.
    Text, geometry and pictures, which cost little, are the first copy's work.

    Args:
        priors: the copies, equal but for their devices.
        devices: where each of them is.
    """

    def __init__(self, priors: Sequence[Prior], devices: Sequence[str | torch.device]) -> None:
        self.priors = tuple(priors)
        self.devices = tuple(torch.device(device) for device in devices)
        first = self.priors[0]
        self.spec, self.reads, self.sees = first.spec, first.reads, first.sees
        self.encode_text, self.encode_geometry = first.encode_text, first.encode_geometry
        self.add_noise, self.weight = first.add_noise, first.weight
        if isinstance(first, Decoder):
            self.bound, self.decode_image = first.bound, first.decode_image
        if isinstance(first, Reader):
            self.readings = first.readings
        if isinstance(first, Paced):
            self.pace = self._to_all("pace")
        if isinstance(first, TextReleasing):
            self.release_texts = self._to_all("release_texts")
        self._threads = ThreadPoolExecutor(len(self.priors), "replica")

    def encode_image(self, channels: Mapping[str, Tensor]) -> Tensor:
        """Differentiable: the ``reads`` channels, each (n, h, w, c) -> (n, c, h', w') on the first device."""
        names = [name for name in self.reads if name in channels]

        def encode(prior: Prior, *parts: Tensor) -> Tensor:
            return prior.encode_image(dict(zip(names, parts, strict=True)))

        return self._together(encode, *(channels[name] for name in names))

    @torch.no_grad()
    def predict_noise(self, x_t: Tensor, t: float, text: Tensor, geometry: Tensor | None = None) -> Tensor:
        """epsilon-hat(x_t; text, t), same shape as ``x_t``, on the first device."""

        def predict(prior: Prior, x_t: Tensor, text: Tensor, geometry: Tensor | None = None) -> Tensor:
            return prior.predict_noise(x_t, t, text, geometry)

        return self._together(predict, x_t, text, *(() if geometry is None else (geometry,)))

    def _to_all(self, method: str) -> Callable[..., None]:
        """A call of ``method`` of every copy."""

        def tell(*arguments: float) -> None:
            for prior in self.priors:
                getattr(prior, method)(*arguments)

        return tell

    def _together(self, call: Callable[..., Tensor], *batches: Tensor) -> Tensor:
        """``call(prior, *shares)`` on all devices at once, joined; each batch is (n, ...), cut alike."""
        gradients = torch.is_grad_enabled()
        shares = zip(*(batch.tensor_split(len(self.priors)) for batch in batches), strict=True)

        def work(prior: Prior, device: torch.device, share: tuple[Tensor, ...]) -> Tensor:
            with torch.set_grad_enabled(gradients):  # which each thread decides for itself
                return call(prior, *(part.to(device) for part in share)).to(self.devices[0])

        jobs = [
            self._threads.submit(work, prior, device, share)
            for prior, device, share in zip(self.priors, self.devices, shares, strict=True)
            if len(share[0])
        ]
        return torch.cat([job.result() for job in jobs])
