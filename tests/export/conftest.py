"""Shared by the exporter's tests: assets, maps with known values, the Khronos validator, Blender."""

from __future__ import annotations

import functools
import importlib.util
import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from paintit.mesh.mesh import Mesh
from paintit.mesh.read import read_mesh
from paintit.texture.maps import TextureMaps

TESTS = Path(__file__).parents[1]
ASSETS = TESTS.parent / "assets" / "meshes"


@functools.cache
def asset(name: str, unwrap: str = "auto") -> Mesh:
    return read_mesh(ASSETS / name, unwrap)  # pyright: ignore[reportArgumentType]


def known_maps(mesh: Mesh, size: int = 32) -> TextureMaps:
    """Random texels, every value exactly representable in 8 bits after the files' coding."""
    draw = np.random.default_rng(7).integers
    shape = (len(mesh.layers), size, size)
    coded = torch.from_numpy(draw(0, 256, (*shape, 3)).astype(np.float32)) / 255
    rm = torch.from_numpy(draw(0, 256, (*shape, 2)).astype(np.float32)) / 255
    linear = torch.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4)
    tilt = torch.from_numpy(draw(-12, 13, (*shape, 2)).astype(np.float32)) / 127.5
    normal = torch.cat([tilt, (1 - tilt.square().sum(-1, keepdim=True)).sqrt()], -1)
    return TextureMaps(linear, rm[..., :1], rm[..., 1:], normal)


def validator_report(path: Path) -> dict[str, Any]:
    """The Khronos validator's report; skips where node or the package is absent (`npm ci` in tests/)."""
    if shutil.which("node") is None or not (TESTS / "node_modules" / "gltf-validator").is_dir():
        pytest.skip("the Khronos validator is not installed: run `npm ci` in tests/")
    done = subprocess.run(["node", str(TESTS / "validate_gltf.mjs"), str(path)], capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def errors_of(path: Path) -> list[str]:
    """Codes of the validator's errors."""
    return [m["code"] for m in validator_report(path)["issues"]["messages"] if m["severity"] == 0]


def blender_report(path: Path) -> dict[str, Any]:
    """What Blender sees in a file, asked in a process of its own; skips where bpy is absent."""


    if importlib.util.find_spec("bpy") is None:
        pytest.skip("Blender (bpy) is not installed")
    done = subprocess.run([sys.executable, str(Path(__file__).with_name("blender_report.py")), str(path)],
                          capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout.splitlines()[-1])
