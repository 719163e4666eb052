"""Shared by all tests: where the assets are."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def assets() -> Path:
    """The folder of real meshes and lights."""
    return Path(__file__).parent.parent / "assets"
