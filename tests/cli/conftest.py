"""Shared by the command line's tests: run a command in this process or another, tiny meshes, tiny settings."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from paintit.cli.main import main

CUBE = """o cube
v -1 -1 -1
v 1 -1 -1
v 1 1 -1
v -1 1 -1
v -1 -1 1
v 1 -1 1
v 1 1 1
v -1 1 1
vt 0.1 0.1
vt 0.3 0.1
vt 0.3 0.3
vt 0.1 0.3
vt 0.4 0.1
vt 0.6 0.1
vt 0.6 0.3
vt 0.4 0.3
vt 0.7 0.1
vt 0.9 0.1
vt 0.9 0.3
vt 0.7 0.3
vt 0.1 0.4
vt 0.3 0.4
vt 0.3 0.6
vt 0.1 0.6
vt 0.4 0.4
vt 0.6 0.4
vt 0.6 0.6
vt 0.4 0.6
vt 0.7 0.4
vt 0.9 0.4
vt 0.9 0.6
vt 0.7 0.6
f 5/1 6/2 7/3 8/4
f 2/5 1/6 4/7 3/8
f 6/9 2/10 3/11 7/12
f 1/13 5/14 8/15 4/16
f 8/17 7/18 3/19 4/20
f 1/21 2/22 6/23 5/24
"""

#: Everything small: a U-Net of two narrow levels, two views of 32 pixels, three steps.
TINY = [
    "--texture-size", "32", "--texture.widths", "8", "8", "--texture.skip-widths", "4", "4",
    "--texture.input-channels", "4", "--views", "2", "--render-size", "32", "--steps", "3", "--preview", "none",
]  # fmt: skip


@dataclass(frozen=True)
class Ran:
    """How a command ended."""

    code: int
    out: str
    err: str

    @property
    def errors(self) -> list[str]:
        return [line for line in self.err.splitlines() if line]


@pytest.fixture
def paintit(capsys: pytest.CaptureFixture[str]) -> Callable[..., Ran]:
    """Run a command line in this process."""

    def run(*arguments: str | Path) -> Ran:
        capsys.readouterr()
        try:
            code = main([str(argument) for argument in arguments])
        except SystemExit as stop:
            code = int(stop.code or 0)
        captured = capsys.readouterr()
        return Ran(code, captured.out, captured.err)

    return run


@pytest.fixture
def cube(tmp_path: Path) -> Path:
    """A cube with its own texture coordinates."""
    path = tmp_path / "cube.obj"
    path.write_text(CUBE)
    return path


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working folder beside the meshes."""
    folder = tmp_path / "work"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


def start(*arguments: str | Path, folder: Path) -> subprocess.Popen[str]:
    """Start a command line in a process of its own."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONUNBUFFERED": "1"}
    return subprocess.Popen(
        [sys.executable, "-m", "paintit", *map(str, arguments)],
        cwd=folder, env=environment, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip


def everything(folder: Path) -> list[Path]:
    """All that is under ``folder``."""
    return sorted(folder.rglob("*"))
