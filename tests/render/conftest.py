"""Meshes and lights built by hand, and a cache folder of the tests' own."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch

from paintit.mesh.mesh import Mesh
from paintit.render.light import Light, from_radiance, prefilter


@pytest.fixture(autouse=True, scope="session")
def cache(tmp_path_factory: pytest.TempPathFactory):
    """No test reads or leaves anything in the user's cache; tensors are small, so one thread is quickest."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PAINTIT_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield
    torch.set_num_threads(threads)


@pytest.fixture(scope="session")
def sphere() -> Callable[[int], Mesh]:
    """``sphere(rows)``: radius 1, smooth normals, u once around from +Z by +X, v from the top down."""

    def make(rows: int) -> Mesh:
        theta, phi = np.linspace(0, np.pi, rows + 1), np.linspace(0, 2 * np.pi, 2 * rows + 1)
        t, p = np.meshgrid(theta, phi, indexing="ij")
        vertices = np.stack([np.sin(t) * np.sin(p), np.cos(t), np.sin(t) * np.cos(p)], -1).reshape(-1, 3)
        uvs = np.stack([p / (2 * np.pi), t / np.pi], -1).reshape(-1, 2)
        row, column = np.meshgrid(np.arange(rows), np.arange(2 * rows), indexing="ij")
        a = (row * (2 * rows + 1) + column).reshape(-1)
        b, c, d = a + 2 * rows + 1, a + 2 * rows + 2, a + 1
        lower, upper = row.reshape(-1) < rows - 1, row.reshape(-1) > 0
        faces = np.concatenate([np.stack([a, b, c], -1)[lower], np.stack([a, c, d], -1)[upper]])
        normals = vertices[faces].astype(np.float32)
        around = np.stack([np.cos(p), 0 * p, -np.sin(p), 0 * p + 1], -1).reshape(-1, 4)[faces].astype(np.float32)
        return Mesh(vertices, faces, uvs, faces.copy(), normals, around, np.zeros(len(faces), np.int64))

    return make


@pytest.fixture(scope="session")
def plane() -> Mesh:
    """The square [-1, 1]^2 in z = 0, facing +Z, its texture upright: u to the right, v down."""
    vertices = np.array([[-1.0, 1, 0], [-1, -1, 0], [1, -1, 0], [1, 1, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    uvs = np.array([[0.0, 0], [0, 1], [1, 1], [1, 0]])
    normals = np.tile(np.float32([0, 0, 1]), (2, 3, 1))
    tangents = np.tile(np.float32([1, 0, 0, 1]), (2, 3, 1))
    return Mesh(vertices, faces, uvs, faces.copy(), normals, tangents, np.zeros(2, np.int64))


@pytest.fixture(scope="session")
def varied_light() -> Light:
    """A small environment with different light from everywhere, prefiltered."""
    generator = torch.Generator().manual_seed(3)
    return prefilter(from_radiance(torch.rand(16, 32, 3, generator=generator).square() * 2, "varied"))


@pytest.fixture(scope="session")
def white_light() -> Light:
    """Radiance 1.5 from everywhere."""
    return prefilter(from_radiance(torch.full((16, 32, 3), 1.5), "white"))
