"""A sphere whose texture is a map of the world, and cases painted on it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch
from torch import Tensor

from paintit.evaluate.protocol import Protocol
from paintit.mesh.mesh import Mesh
from paintit.texture.maps import TextureMaps

#: Few and small views; the second light is the first, so that one is prefiltered.
SMALL = Protocol(ring=4, size=64, relight="default")
#: Texels along each side of a map.
SIDE = 96
#: Share of the map left free at either end of the world, as a texture that repeats would have no seam.
MARGIN = 0.05


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
def sphere() -> Mesh:
    """Radius 1; u goes once around from +Z by +X, v from the top down; one seam, at azimuth 0."""
    rows = 24
    theta, phi = np.meshgrid(np.linspace(0, np.pi, rows + 1), np.linspace(0, 2 * np.pi, 2 * rows + 1), indexing="ij")
    position = np.stack([np.sin(theta) * np.sin(phi), np.cos(theta), np.sin(theta) * np.cos(phi)], -1).reshape(-1, 3)
    uvs = np.stack([MARGIN + (1 - 2 * MARGIN) * phi / (2 * np.pi), theta / np.pi], -1).reshape(-1, 2)
    row, column = np.meshgrid(np.arange(rows), np.arange(2 * rows), indexing="ij")
    a = (row * (2 * rows + 1) + column).reshape(-1)
    b, c, d = a + 2 * rows + 1, a + 2 * rows + 2, a + 1
    lower, upper = row.reshape(-1) < rows - 1, row.reshape(-1) > 0
    corners = np.concatenate([np.stack([a, b, c], -1)[lower], np.stack([a, c, d], -1)[upper]])
    # The first and the last column are one place: the same vertices, other texture coordinates.
    _, vertex = np.unique(position.round(9) + 0.0, axis=0, return_inverse=True)
    vertices = np.zeros((vertex.max() + 1, 3))
    vertices[vertex] = position
    around = np.stack([np.cos(phi), 0 * phi, -np.sin(phi), 0 * phi + 1], -1).reshape(-1, 4)
    return Mesh(
        vertices, vertex[corners], uvs, corners, position[corners].astype(np.float32),
        around[corners].astype(np.float32), np.zeros(len(corners), np.int64),
    )  # fmt: skip


@pytest.fixture(scope="session")
def painted() -> Callable[..., TextureMaps]:
    """``painted(color, roughness, metallic)``: flat maps of a colour (3,) or of a picture (h, w, 3), linear."""

    def make(color: Tensor, roughness: float = 0.6, metallic: float = 0.0) -> TextureMaps:
        color = color.expand(SIDE, SIDE, 3) if color.ndim == 1 else color
        rest = torch.tensor([roughness, metallic, 0.0, 0.0, 1.0]).expand(*color.shape[:2], 5)
        return TextureMaps.unpacked(torch.cat([color, rest], -1)[None])

    return make


def around() -> tuple[Tensor, Tensor]:
    """Azimuth and polar angle in radians at the texels of a map of the sphere, each (side, side)."""
    v, u = torch.meshgrid(*[(torch.arange(SIDE) + 0.5) / SIDE] * 2, indexing="ij")
    return (u - MARGIN) / (1 - 2 * MARGIN) * 2 * torch.pi, v * torch.pi


def faces(*azimuths_deg: float) -> Tensor:
    """(side, side, 3) skin with two eyes and a mouth at each azimuth."""
    azimuth, polar = around()
    picture = torch.tensor([0.7, 0.5, 0.35]).expand(SIDE, SIDE, 3).clone()
    for centre in torch.tensor(azimuths_deg).deg2rad():
        x = torch.remainder(azimuth - centre + torch.pi, 2 * torch.pi) - torch.pi
        y = torch.pi / 2 - polar
        eyes = ((x.abs() - 0.3) / 0.14) ** 2 + ((y - 0.25) / 0.2) ** 2 < 1
        mouth = (x / 0.35) ** 2 + ((y + 0.4) / 0.12) ** 2 < 1
        picture[eyes] = torch.tensor([0.02, 0.02, 0.05])
        picture[mouth] = torch.tensor([0.5, 0.02, 0.03])
    return picture
