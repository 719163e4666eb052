"""Between the islands during painting: the nearest island's value, and gradients that find their way back to it."""

from __future__ import annotations

import numpy as np
import torch

from paintit.mesh.read import read_mesh
from paintit.mesh.uv import fill_gutters, rasterize_uv
from paintit.paint.gutters import Gutters
from paintit.texture.maps import TextureMaps

SIZE = 64


def test_gutters_while_painting_are_those_of_the_export(assets) -> None:
    mesh = read_mesh(assets / "meshes/koala.ply")
    packed = torch.rand(1, SIZE, SIZE, 8, generator=torch.Generator().manual_seed(0), requires_grad=True)
    filled = Gutters(mesh, SIZE, torch.device("cpu"))(TextureMaps.unpacked(packed)).packed()
    covered = rasterize_uv(mesh, SIZE).covered
    np.testing.assert_array_equal(filled.detach().numpy(), fill_gutters(packed.detach().numpy(), covered))
    filled.sum().backward()
    assert packed.grad is not None
    outside = torch.from_numpy(~covered)
    assert outside.any()
    assert (packed.grad[outside] == 0).all(), "a gutter texel is shown nowhere"
    torch.testing.assert_close(packed.grad.sum(), torch.tensor(float(packed.numel())))
