"""Named random streams from one seed: the same views, noise and weights whatever else is drawn, on every device.

Everything is drawn on the CPU from its own ``torch.Generator`` and moved; torch's global generator is never touched.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping

import torch
from torch import Tensor


class Streams:
    """Independent generators, one per name, each seeded from ``(seed, name)``.

    >>> streams = Streams(seed=0)
    >>> streams["views"] is streams["views"]
    True
    """

    def __init__(self, seed: int) -> None:
        self.seed = seed
        self._generators: dict[str, torch.Generator] = {}

    def __getitem__(self, name: str) -> torch.Generator:
        if name not in self._generators:
            digest = hashlib.sha256(f"{self.seed}/{name}".encode()).digest()
            self._generators[name] = torch.Generator("cpu").manual_seed(int.from_bytes(digest[:8], "little") >> 1)
        return self._generators[name]

    def state_dict(self) -> dict[str, Tensor]:
        """Name -> uint8 generator state, for exact resume."""
        return {name: generator.get_state() for name, generator in self._generators.items()}

    def load_state_dict(self, state: Mapping[str, Tensor]) -> None:
        """Restore every stream in ``state``; streams not in it start afresh from the seed."""
        self._generators.clear()
        for name, value in state.items():
            self[name].set_state(value)


def uniform(low: float, high: float, count: int, generator: torch.Generator) -> Tensor:
    """(count,) float32 samples of U(low, high), drawn on the CPU."""
    return low + (high - low) * torch.rand(count, generator=generator)
