"""How a checkpoint is brought into memory. No torch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

from paintit.config import PaintConfig


@dataclass(frozen=True)
class Loading:
    """What a family's ``load`` is told beside the name of a checkpoint."""

    device: str = "cpu"
    """``cpu``, ``cuda``, ``cuda:N`` or ``mps``."""
    dtype: str = "auto"
    """Of the network that denoises and of the text encoders: ``float32``, ``bfloat16``, ``float16``, ``float64``, or
    ``auto``, see :func:`paintit.guidance.hub.precision`. The autoencoder keeps float32 beside float16, in which SDXL's
    own overflows (``force_upcast``) and the gradients of any may; bfloat16 has the range."""
    revision: str = ""
    """Commit, tag or branch of a hub id."""
    allow_download: bool = False
    """Without it a hub id must already be in the local cache."""
    licence: str = ""
    """Of the weights, for the record."""
    chunk: int = 0
    """Most views that go through the network at once, to save memory; 0 for no limit."""

    @classmethod
    def of(cls, config: PaintConfig, device: object = "cpu", allow_download: bool = False) -> Self:
        """As the settings of a paint want it."""
        return cls(str(device), config.dtype, config.guidance.revision, allow_download)
