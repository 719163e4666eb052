"""kill -9 at five random moments of the real command, each resumed: the same bytes as without."""

from __future__ import annotations

import hashlib
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

STEPS = 24
TIMES = 5
SETTINGS = ("--texture-size", "128", "--steps", str(STEPS), "--seed", "7", "--preview", "none")


def command(*arguments: str | Path) -> list[str]:
    return [sys.executable, "-m", "paintit", "paint", *map(str, arguments)]


def digests(folder: Path) -> dict[str, str]:
    files = [folder / "spot.glb", *sorted((folder / "spot.paintit" / "textures").iterdir())]
    return {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in files}


def logged_steps(run: Path) -> int:
    log = run / "log.jsonl"
    return len(log.read_text().splitlines()) if log.exists() else 0


@pytest.mark.slow
def test_killed_at_random_steps_and_resumed(assets: Path, tmp_path: Path) -> None:
    mesh = assets / "meshes/spot/spot.obj"
    for name in ("whole", "again"):
        subprocess.run(command(mesh, "a rusty iron cow", "-o", tmp_path / name / "spot.glb", *SETTINGS), check=True)
    expected = digests(tmp_path / "whole")
    assert digests(tmp_path / "again") == expected  # two runs, one seed

    moments = random.Random().sample(range(1, STEPS), TIMES)
    for number, moment in enumerate(moments):
        folder = tmp_path / str(number)
        process = subprocess.Popen(command(mesh, "a rusty iron cow", "-o", folder / "spot.glb", *SETTINGS))
        while logged_steps(folder / "spot.paintit") < moment:
            assert process.poll() is None, f"it ended before step {moment}"
            time.sleep(0.002)
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        assert not (folder / "spot.glb").exists()
        subprocess.run(command("--resume", folder / "spot.paintit", "--preview", "none"), check=True)
        assert digests(folder) == expected, f"killed at step {moment}"
        print(f"killed at step {moment}: same bytes")
