"""The cameras of one step (supp. A.2)."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
import torch

from paintit.config import FocusConfig, ViewConfig
from paintit.mesh.mesh import Layer
from paintit.mesh.read import read_mesh
from paintit.paint.views import ViewSampler
from paintit.render.camera import look_at
from paintit.rng import Streams


@pytest.fixture(scope="module")
def spot(assets):
    return read_mesh(assets / "meshes/spot/spot.obj")


def draw(mesh, config, times=200, seed=0):
    sampler, generator = ViewSampler(mesh, config), Streams(seed)["views"]
    return [sampler(generator) for _ in range(times)]


def test_whole_views_cover_the_stated_ranges(spot):
    views = draw(spot, ViewConfig(count=4))
    elevation = torch.cat([v.cameras.elevation for v in views]).rad2deg()
    azimuth = torch.cat([v.cameras.azimuth for v in views]).rad2deg()
    assert -60 <= elevation.min() < -55
    assert 55 < elevation.max() <= 60
    assert 0 <= azimuth.min() < 5
    assert 355 < azimuth.max() <= 360
    distance = torch.cat([v.cameras.eye.norm(dim=-1) for v in views])
    torch.testing.assert_close(distance, torch.full_like(distance, 3.25))


def test_half_of_the_views_look_at_the_focus(spot):
    center, radius = (0.0, 0.7, 0.8), 0.3
    config = ViewConfig(count=8, focus=(FocusConfig(center, radius, "face"),))
    scale = 2 / spot.extent
    expected = torch.tensor((np.array(center) - spot.center) * scale, dtype=torch.float32)
    for views in draw(spot, config, 20):
        assert views.focus == ("",) * 4 + ("face",) * 4
        torch.testing.assert_close(views.cameras.target[4:], expected.expand(4, 3))
        distance = (views.cameras.eye - views.cameras.target)[4:].norm(dim=-1)
        torch.testing.assert_close(distance, torch.full((4,), 3.25 * radius * scale))
        assert (views.cameras.elevation[4:].rad2deg() >= -30 - 1e-3).all()


def test_front_first_is_the_exact_front(spot):
    for views in draw(spot, ViewConfig(front_first=True), 5):
        torch.testing.assert_close(views.cameras.eye[0], torch.tensor([0.0, 0.0, 3.25]))


def test_the_front_can_be_elsewhere(spot):
    for views in draw(spot, ViewConfig(front_first=True, front=180.0), 5):
        torch.testing.assert_close(views.cameras.eye[0], torch.tensor([0.0, 0.0, -3.25]), atol=1e-5, rtol=0)


def test_close_ups_meet_their_share_and_look_at_the_surface(spot):
    views = draw(spot, ViewConfig(count=4, close_up=0.3), 400)
    distance = torch.cat([(v.cameras.eye - v.cameras.target).norm(dim=-1) for v in views])
    share = float((distance < 3.0).float().mean())
    assert abs(share - 0.3) < 0.03
    targets = (
        torch.cat([v.cameras.target for v in views])[distance < 3.0].double().numpy() * spot.extent / 2 + spot.center
    )
    low, high = spot.bounds
    assert (targets >= low - 1e-5).all()
    assert (targets <= high + 1e-5).all()
    assert targets.std(0).min() > 0.1 * spot.extent / 2


def test_close_ups_look_at_what_is_painted(spot):
    upper = spot.vertices[spot.faces].mean(1)[:, 1] > spot.center[1]
    halves = dataclasses.replace(
        spot, face_layer=upper.astype(np.int64), layers=(Layer("lower", painted=False), Layer("upper"))
    )
    views = draw(halves, ViewConfig(count=4, close_up=1.0), 50)
    assert torch.cat([v.cameras.target for v in views])[:, 1].min() > -0.1


def test_one_seed_one_sequence(spot):
    config = ViewConfig(count=4, close_up=0.25)
    first, second, other = draw(spot, config, 5), draw(spot, config, 5), draw(spot, config, 5, seed=1)
    assert all(torch.equal(a.cameras.eye, b.cameras.eye) for a, b in zip(first, second, strict=True))
    assert not torch.equal(first[0].cameras.eye, other[0].cameras.eye)


def test_the_mesh_far_from_the_origin_is_seen_alike(spot):
    config = ViewConfig(count=4, close_up=1.0)
    far = dataclasses.replace(spot, vertices=spot.vertices * 1000 + 1e7)
    near, there = draw(spot, config, 3), draw(far, config, 3)
    for a, b in zip(near, there, strict=True):
        torch.testing.assert_close(a.cameras.eye, b.cameras.eye, atol=1e-4, rtol=0)
        assert math.isclose(a.cameras.fov, b.cameras.fov)


@pytest.mark.parametrize("elevation", [90.0, -90.0])
def test_straight_from_above_and_below_is_the_limit_of_almost(elevation):
    azimuth = torch.tensor([0.0, 1.0, 4.0])
    almost, exactly = (
        look_at(azimuth, torch.full((3,), math.radians(e)), 3.25, 0.8) for e in (elevation * 0.9995, elevation)
    )
    for a, b in zip(almost.frame(), exactly.frame(), strict=True):
        torch.testing.assert_close(a, b, atol=2e-3, rtol=0)
