"""The generator and the trainer run where only torch and numpy are: imports of anything else are refused."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

FOLDER = Path(__file__).parents[2] / "training" / "pocket"
PROGRAM = """
import sys, importlib.abc
import numpy, torch  # these may bring what they like
allowed = {"paintit", *sys.stdlib_module_names, *(name.partition(".")[0] for name in sys.modules)}
class Refuse(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        top = name.partition(".")[0]
        if top not in allowed and not (own / f"{top}.py").exists():
            raise ImportError(f"{name} is not torch, numpy or ours")
from pathlib import Path
own = Path(sys.argv[1])
sys.path.insert(0, sys.argv[1])
sys.meta_path.insert(0, Refuse())
import gbuffers, data, train
data.load_environment("default", 1.0)
if len(sys.argv) > 2:
    __import__(sys.argv[2])
"""


def run(*extra: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", PROGRAM, str(FOLDER), *extra]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_torch_and_numpy_suffice() -> None:
    done = run()
    assert done.returncode == 0, done.stderr


def test_the_refusal_refuses() -> None:
    assert "safetensors is not torch" in run("safetensors").stderr
