"""How a checkpoint is brought into memory. No torch."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Self

from paintit.config import LimitConfig, PaintConfig
from paintit.control import Control
from paintit.guidance.economy import Beside, Budget, Economy


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
    control: tuple[Control, ...] = ()
    """ControlNets beside the network; each with its model."""
    control_end: float = 0.0
    """Share of their scales at the last step."""
    lora: tuple[str, ...] = ()
    """LoRAs that are added to the weights, as in ``guidance.lora``."""
    reference: str = ""
    """Picture that is seen beside the words, as in ``guidance.reference``."""
    adapter: str = ""
    """The IP-Adapter for it."""
    megapixels: int = LimitConfig.image_megapixels
    """The most that it may have."""
    negative: str = ""
    """The text that, beside the empty one, is read without it."""
    source: str = ""
    """So are texts that end with these words, on how a paint looks so far."""
    economy: Economy = field(default_factory=Economy)
    """What is done to save memory and time."""
    budget: Budget = field(default_factory=Budget)
    """What a step has to fit into; where it has a limit, more is done than ``economy`` says, if that is needed."""
    tiny: str = ""
    """Hub id of the tiny autoencoder that belongs to the prior, where one is known."""
    replicas: tuple[str, ...] = ()
    """Further devices, each with a copy of the prior, see :class:`paintit.guidance.replicas.Replicas`."""

    @classmethod
    def of(
        cls, config: PaintConfig, device: object = None, allow_download: bool = False, beside: Beside | None = None
    ) -> Self:
        """As the settings of a paint want it; without ``device`` on the CPU alone, for a look at it.

        Args:
            beside: what a step takes apart from the prior.
        """
        replicas = tuple(config.device.split(",")[1:]) if device else ()
        return cls(
            str(device or "cpu"), config.dtype, config.guidance.revision, allow_download, replicas=replicas,
            control=tuple(map(Control.parse, config.guidance.control)), control_end=config.guidance.control_end,
            economy=Economy.of(config, str(device or "cpu")), budget=Budget.of(config, str(device or "cpu"), beside),
            lora=config.guidance.lora, reference=config.guidance.reference, adapter=config.guidance.adapter,
            megapixels=config.limits.image_megapixels, negative=config.prompt.negative, source=config.prompt.source,
        )  # fmt: skip
