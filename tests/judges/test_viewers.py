"""Cycles and three.js show what `paintit render` shows: the same light, camera, colours (docs/design/viewers.md)."""

from __future__ import annotations

import dataclasses
import importlib.util
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.judges.scene import DIFFUSE, METALS, Ball, Pixels, Scene, overlap, psnr
from tests.judges.viewers import MODULES, browser, cycles, model_viewer, three

pytestmark = [pytest.mark.slow, pytest.mark.judge]
SIZE, SAMPLES = 128, 64
#: dB, per view.
DIFFUSE_BOUND, METAL_BOUND = 24.0, 20.0


def by_cycles(scene: Scene) -> list[Pixels]:
    if importlib.util.find_spec("bpy") is None:
        pytest.skip("Blender (bpy) is not installed")
    return cycles(scene, SAMPLES)


def _need_browser() -> None:
    if browser() is None or not (MODULES / "three").is_dir():
        pytest.skip("three.js needs a Chromium and `npm ci` in tests/")


def by_three(scene: Scene) -> list[Pixels]:
    _need_browser()
    return three(scene)


Judge = Callable[[Scene], list[Pixels]]
JUDGES = pytest.mark.parametrize("judge", [by_cycles, by_three])


def agree(scene: Scene, judge: Judge, bound: float) -> None:
    found = list(zip(scene.ours(), judge(scene), strict=True))
    assert min(overlap(a, b) for a, b in found) > 0.97
    assert min(psnr(a, b) for a, b in found) >= bound


@JUDGES
@pytest.mark.parametrize("ball", DIFFUSE, ids=lambda ball: ball.name)
def test_diffuse_spheres(ball: Ball, judge: Judge, tmp_path: Path) -> None:
    agree(Scene(ball.write(tmp_path), size=SIZE), judge, DIFFUSE_BOUND)


@JUDGES
@pytest.mark.parametrize("ball", METALS, ids=lambda ball: ball.name)
def test_metal_spheres(ball: Ball, judge: Judge, tmp_path: Path) -> None:
    agree(Scene(ball.write(tmp_path), size=SIZE), judge, METAL_BOUND)


REAL = {"avocado": DIFFUSE_BOUND, "water_bottle": METAL_BOUND, "flight_helmet": METAL_BOUND}


@JUDGES
@pytest.mark.parametrize("name", REAL)
def test_real_maps(name: str, judge: Judge, assets: Path) -> None:
    agree(Scene(assets / "meshes" / f"{name}.glb", size=SIZE), judge, REAL[name])


@JUDGES
@pytest.mark.parametrize("name", REAL)
def test_real_maps_without_shadows(name: str, judge: Judge, assets: Path) -> None:
    """What the split sum leaves: no program lets the asset shade itself."""
    agree(Scene(assets / "meshes" / f"{name}.glb", size=SIZE, unoccluded=True), judge, DIFFUSE_BOUND)


def spot_light(path: Path, row: int, column: int) -> Path:
    """A flat (uncompressed) .hdr of 64 x 32 pixels, dim but for one block of 2 x 2."""
    pixels = np.zeros((32, 64, 4), np.uint8)
    pixels[...] = (128, 128, 128, 124)  # 1/32
    pixels[row : row + 2, column : column + 2] = (128, 128, 128, 134)  # 32
    path.write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 32 +X 64\n" + pixels.tobytes())
    return path


def highlight(image: Pixels) -> NDArray[np.float64]:
    """(x, y) of the middle of the brightest part, in pixels."""
    bright = (image[..., :3].sum(-1, dtype=np.int64) > 600) & (image[..., 3] == 255)
    assert 4 <= bright.sum() <= 0.2 * bright.size
    y, x = bright.nonzero()
    return np.array([x.mean(), y.mean()])


@JUDGES
@pytest.mark.parametrize("rotation", [0.0, 35.0, 90.0])
def test_a_lamp_is_reflected_in_the_same_place(rotation: float, judge: Judge, tmp_path: Path) -> None:
    """One bright block, right of the middle and above the horizon: it can be mistaken for no mirrored or turned one."""
    ball = Ball("mirror", (0.9, 0.9, 0.9), 0.1, 1.0).write(tmp_path)
    light = spot_light(tmp_path / "lamp.hdr", 10, 36)
    scene = Scene(ball, str(light), 0.0, rotation, ((0.0, 0.0), (60.0, 20.0)), SIZE)
    for a, b in zip(scene.ours(), judge(scene), strict=True):
        assert np.abs(highlight(a) - highlight(b)).max() < 1.5
    turned = dataclasses.replace(scene, rotation=rotation + 20.0).ours()
    assert np.abs(highlight(turned[0]) - highlight(scene.ours()[0])).max() > 3


def test_model_viewer_shows_it_too(tmp_path: Path) -> None:
    """It cannot turn its light, and lays it as three.js does: 90 degrees from ours."""
    _need_browser()
    scene = Scene(METALS[1].write(tmp_path), rotation=90.0, size=SIZE)
    agree(scene, model_viewer, METAL_BOUND)
