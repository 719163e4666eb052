"""The Warp ray caster against its readable twin and against plain geometry."""

from __future__ import annotations

import math

import torch
import torch.nn.functional as F

from paintit.render.camera import random_views
from paintit.render.geometry import Geometry
from paintit.render.visibility import cast, cast_reference


def test_twin_agrees_off_the_silhouette(sphere) -> None:
    geometry = Geometry.from_mesh(sphere(10))
    rays = random_views(3, torch.Generator().manual_seed(0)).rays(40, 40)
    fast, slow = cast(geometry, *rays), cast_reference(geometry, *rays)
    mask = (slow.face >= 0).float()
    # Band: pixels with both hits and misses among their eight neighbours.
    neighbours = F.avg_pool2d(mask[:, None], 3, stride=1, padding=1, count_include_pad=False)[:, 0]
    interior = (neighbours == mask) | (neighbours > 1 - 1e-6) | (neighbours < 1e-6)
    assert interior.float().mean() > 0.8
    assert torch.equal(fast.face[interior] >= 0, slow.face[interior] >= 0)
    # Faces may differ only where a ray meets a shared edge.
    assert (fast.face != slow.face)[interior].float().mean() < 1e-3
    same = interior & (fast.face == slow.face) & (slow.face >= 0)
    assert int(same.sum()) > 1000
    torch.testing.assert_close(fast.barycentric[same], slow.barycentric[same], atol=1e-3, rtol=0)
    torch.testing.assert_close(fast.distance[same], slow.distance[same], atol=1e-5, rtol=0)
    assert (fast.face != slow.face).float().mean() < 0.01


def test_barycentric_coordinates_give_the_point_hit(sphere) -> None:
    geometry = Geometry.from_mesh(sphere(16))
    origin, direction = random_views(2, torch.Generator().manual_seed(1)).rays(32, 32)
    hits = cast(geometry, origin, direction)
    hit = hits.face >= 0
    point = geometry.interpolate(geometry.corners, hits.face[hit], hits.barycentric[hit])
    torch.testing.assert_close(point, (origin + hits.distance[..., None] * direction)[hit], atol=1e-5, rtol=0)
    torch.testing.assert_close(hits.barycentric[hit].sum(-1), torch.ones(int(hit.sum())))


def test_misses_and_nothing() -> None:
    import numpy as np

    from paintit.mesh.mesh import Mesh

    one = np.tile(np.float32([0, 0, 1]), (1, 3, 1))
    tangent = np.tile(np.float32([1, 0, 0, 1]), (1, 3, 1))
    triangle = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    mesh = Mesh(triangle, np.array([[0, 1, 2]]), triangle[:, :2], np.array([[0, 1, 2]]), one, tangent, np.zeros(1, int))
    geometry = Geometry.from_mesh(mesh)
    for function in (cast, cast_reference):
        hits = function(geometry, torch.tensor([0.5, 0.5, 5.0]), torch.tensor([[0.0, 0, 1], [1, 0, 0]]))
        assert hits.face.tolist() == [-1, -1]
        assert hits.distance.isinf().all()
        assert (hits.barycentric == 0).all()
    assert cast(geometry, torch.zeros(0, 3), torch.zeros(0, 3)).face.shape == (0,)


def test_hits_from_both_sides_and_the_nearest_first(plane) -> None:
    geometry = Geometry.from_mesh(plane)
    ahead = torch.tensor([0.3, -0.2, 2.0])
    front = cast(geometry, ahead, torch.tensor([0.0, 0, -1]))
    back = cast(geometry, -ahead, torch.tensor([0.0, 0, 2]))
    assert front.face >= 0
    assert back.face >= 0
    assert math.isclose(float(front.distance), 2.0, rel_tol=1e-6)
    assert math.isclose(float(back.distance), 1.0, rel_tol=1e-6)


def test_normalisation_far_from_the_origin(sphere) -> None:
    """The same sphere in other units, a million away: the same geometry to float32 precision."""
    from dataclasses import replace

    near = sphere(12)
    far = replace(near, vertices=near.vertices * 40 + 1e6)
    a, b = Geometry.from_mesh(near), Geometry.from_mesh(far)
    torch.testing.assert_close(a.corners, b.corners, atol=1e-6, rtol=0)
    assert float(a.corners.amax()) == 1.0
    points = torch.from_numpy(far.vertices[far.faces])
    torch.testing.assert_close(b.to_normalised(points), b.corners)
