"""A hub on this machine, seen by ``huggingface_hub`` in this process."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.guidance.fake_hub import FakeHub, local_hub


@pytest.fixture
def hub(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[FakeHub]:
    """Serves nothing yet; the cache is empty."""
    with local_hub(tmp_path / "hub-cache", monkeypatch) as served:
        yield served
