"""Meshes as they come: sizes, places and normals that would break a careless reader or renderer."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch
from tests.mesh.glb_builder import Builder

from paintit.mesh.inspect import summarize
from paintit.mesh.mesh import Mesh
from paintit.mesh.read import read_mesh
from paintit.render.camera import look_at
from paintit.render.gbuffer import rasterize
from paintit.render.geometry import Geometry


def ball(n: int = 24, normals: str = "right", inside_out: bool = False, **node: object) -> Builder:
    """A unit ball of radius 1 with texture coordinates."""
    b = Builder()
    u, v = (g.ravel() for g in np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, n // 2 + 1)))
    theta, phi = math.pi * v, 2 * math.pi * u
    points = np.stack([np.sin(theta) * np.sin(phi), np.cos(theta), np.sin(theta) * np.cos(phi)], 1)
    i = np.arange(len(points)).reshape(n // 2 + 1, n + 1)
    faces = np.stack([i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, :-1], i[1:, 1:], i[:-1, 1:]], -1).reshape(-1, 3)
    given = points.copy()
    if normals == "zero":
        given[::2] = 0
    elif normals == "nan":
        given[::2] = math.nan
    elif normals == "inverted":
        given = -given
    attributes = {"POSITION": b.accessor(points), "TEXCOORD_0": b.accessor(np.stack([u, v], 1))}
    if normals != "none":
        attributes["NORMAL"] = b.accessor(given)
    indices = b.accessor((faces[:, ::-1] if inside_out else faces).ravel(), "H")
    b.json["meshes"] = [{"primitives": [{"attributes": attributes, "indices": indices}]}]
    b.json["nodes"] = [{"mesh": 0, **node}]
    return b


def seen(mesh: Mesh) -> tuple[torch.Tensor, torch.Tensor]:
    """Mask and world normals of the view from the front."""
    cameras = look_at(torch.zeros(1), torch.zeros(1), 3.25, math.radians(45.0))
    found = rasterize(Geometry.from_mesh(mesh), cameras, 64)
    return found.mask[0], found.normal[0]


def toward_the_camera(mesh: Mesh) -> float:
    """Mean z of the normals in the view from the front; 2/3 for a ball (disc-weighted), less at a distance."""
    mask, normal = seen(mesh)
    assert int(mask.sum()) > 1000
    assert torch.isfinite(normal).all()
    return float(normal[mask][:, 2].mean())


@pytest.mark.parametrize("normals", ["right", "none", "zero", "nan"])
@pytest.mark.parametrize("inside_out", [False, True])
def test_normals_and_winding(tmp_path: Path, normals: str, inside_out: bool) -> None:
    mesh = read_mesh(ball(normals=normals, inside_out=inside_out).glb(tmp_path / "a.glb"))
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=-1), 1, atol=1e-5)
    assert np.isfinite(mesh.tangents).all()
    assert 0.55 < toward_the_camera(mesh) < 0.9


@pytest.mark.parametrize("scale", [1e-6, 1e-3, 1e3, 1e6])
def test_every_size_looks_the_same(tmp_path: Path, scale: float) -> None:
    """From a micrometre to a thousand kilometres: same mask, same normals, same texture coordinates."""
    here = read_mesh(ball().glb(tmp_path / "a.glb"))
    mesh = read_mesh(ball(scale=[scale] * 3).glb(tmp_path / "b.glb"))
    assert mesh.extent == pytest.approx(2 * scale)
    assert mesh.report == here.report
    np.testing.assert_array_equal(mesh.corner_uvs, here.corner_uvs)
    for a, b in zip(seen(mesh), seen(here), strict=True):
        assert float((a.float() - b.float()).abs().mean()) < 1e-3
    assert summarize(mesh, 64).area == pytest.approx(summarize(here, 64).area * scale**2, rel=1e-6)


def test_a_small_thing_far_away(tmp_path: Path) -> None:
    """A ball of one centimetre ten thousand kilometres from the origin: float32 there has steps of a metre."""
    here = read_mesh(ball().glb(tmp_path / "a.glb"))
    b = ball(scale=[0.01] * 3)
    b.json["nodes"].append({"children": [0], "translation": [1e7, -2e7, 3e7]})
    mesh = read_mesh(b.glb(tmp_path / "b.glb"))
    np.testing.assert_allclose(mesh.center, [1e7, -2e7, 3e7], atol=1e-6)
    for a, b_ in zip(seen(mesh), seen(here), strict=True):
        assert float((a.float() - b_.float()).abs().mean()) < 1e-3
    np.testing.assert_allclose(mesh.normals, here.normals, atol=1e-6)
