"""What ``guidance.control`` says. No torch: settings are checked with it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

from paintit.errors import UsageError
from paintit.scaled import scaled

#: What a ControlNet can be shown of the mesh.
KINDS = ("depth", "normal")
#: Largest scale; 0.5 to 1 is usual.
LIMIT = 10.0


@dataclass(frozen=True)
class Control:
    """One entry of ``guidance.control``: a ControlNet beside the prior, and what it is shown."""

    kind: str
    """One of :data:`KINDS`."""
    scale: float = 1.0
    """Of what it adds to the network's features, 0 to :data:`LIMIT`."""
    model: str = ""
    """Folder or hub id; empty for the one that belongs to the prior."""

    @classmethod
    def parse(cls, text: str) -> Self:
        """``KIND[=FOLDER_OR_ID][:SCALE]``.

        Raises:
            UsageError: it is anything else.
        """
        name, scale = scaled(text, "guidance.control")
        kind, equals, model = name.partition("=")
        if kind not in KINDS or (equals and not model.strip()):
            forms = "depth, normal, depth:0.8 or depth=FOLDER_OR_ID:0.8"
            raise UsageError("config.value", f'guidance.control is "{text}"', f"write {forms}")
        if not 0 <= scale <= LIMIT:
            raise UsageError("config.value", f'guidance.control is "{text}"', f"its scale must be from 0 to {LIMIT:g}")
        return cls(kind, scale, model)
