"""The maps of a real asset, recovered by DC-PBR from renders of them."""

from __future__ import annotations

from pathlib import Path

import pytest
from benchmarks.ground_truth import LIGHT_EXPOSURE, fit

from paintit.export.read_maps import read_maps
from paintit.mesh.read import read_mesh
from paintit.render.environment import load_environment
from paintit.render.light import prefilter


@pytest.mark.slow
def test_a_fit_through_the_renderer_recovers_the_maps(assets: Path) -> None:
    mesh = read_mesh(assets / "meshes" / "avocado.glb")
    light = prefilter(load_environment("default", LIGHT_EXPOSURE))
    *_, last = fit(mesh, read_maps(mesh, 128), light, 300, views=3, pixels=128, lr=1e-2)
    assert float(last.visible.float().mean()) > 0.4
    assert last.errors.base_color_db >= 30
    assert last.errors.roughness < 0.05
    assert last.errors.metallic < 0.05
