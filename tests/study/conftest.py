"""Shared by the study's tests: a small study, and its page served by the real command."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from PIL import Image, ImageDraw
from PIL.PngImagePlugin import PngInfo
from tests.cli.conftest import cube, paintit  # noqa: F401 (fixtures)

from paintit.study.create import create
from paintit.study.questions import read_study

METHODS = ("alpha-method", "beta-method", "gamma-method")
PROMPTS = {"cup": "a blue & white cup", "hat": "a <straw> hat", "shoe": "a worn leather shoe"}


def make_pictures(folder: Path, method: int, names: tuple[str, ...], size: int = 64) -> Path:
    """One PNG per name, whose grey and whose metadata tell the method."""
    folder.mkdir(parents=True)
    told = PngInfo()
    told.add_text("Software", folder.name)
    for i, name in enumerate(names):
        image = Image.new("RGB", (size, size), (200, 200, 200))
        ImageDraw.Draw(image).ellipse((size // 8, size // 8, size * 7 // 8, size * 7 // 8), fill=shade(method, i))
        image.save(folder / f"{name}.png", pnginfo=told)
    return folder


def shade(method: int, question: int) -> tuple[int, int, int]:
    """The colour in the middle of the picture."""
    return (60 * method, 90, 40 * question)


@pytest.fixture
def study(tmp_path: Path) -> Path:
    """Three questions on three methods, made by ``create``."""
    folders = {m: make_pictures(tmp_path / m, i, tuple(PROMPTS)) for i, m in enumerate(METHODS)}
    bare = make_pictures(tmp_path / "bare", 4, tuple(PROMPTS))
    create(tmp_path / "study", folders, untextured=bare, prompts=PROMPTS, seed=3)
    for question in read_study(tmp_path / "study").questions:
        for method, path in question.pictures.items():  # as a study made by hand has them: with metadata
            shutil.copy(folders[method] / f"{question.name}.png", path)
    return tmp_path / "study"


class Served:
    """``paintit study serve`` in a process of its own."""

    def __init__(self, study: Path, answers: Path, port: int = 0) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "paintit", "study", "serve", study, "-o", answers, "--port", str(port)],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env={**os.environ, "OMP_NUM_THREADS": "1"},
        )  # fmt: skip
        assert self.process.stderr
        line = self.process.stderr.readline()
        found = re.search(r"http://127\.0\.0\.1:(\d+)/", line)
        assert found, line + self.process.stderr.read()
        self.url, self.port = found[0].rstrip("/"), int(found[1])

    def kill(self) -> None:
        """As a power cut would: nothing is flushed, nothing is closed."""
        os.kill(self.process.pid, signal.SIGKILL)
        self.process.communicate()

    def stop(self) -> tuple[str, str, int]:
        """Ctrl-C: what is left on stdout and stderr, and the exit code."""
        self.process.send_signal(signal.SIGINT)
        out, err = self.process.communicate(timeout=20)
        return out, err, self.process.returncode


@pytest.fixture
def served(study: Path, tmp_path: Path) -> Iterator[Served]:
    server = Served(study, tmp_path / "answers.sqlite")
    yield server
    server.process.kill()
    server.process.communicate()
