"""Where texels lie on the surface, and which of them any camera could see."""

from __future__ import annotations

import math

import torch
import torch.nn.functional as F
from torch import Tensor

from paintit.mesh.mesh import Mesh
from paintit.render.geometry import Geometry
from paintit.render.visibility import cast

#: How far above the surface rays start, in normalised units.
_LIFT = 5e-4
_GOLDEN = (math.sqrt(5) - 1) / 2


def texel_points(mesh: Mesh, geometry: Geometry, size: int) -> tuple[Tensor, Tensor, Tensor]:
    """Surface point under each texel centre.

    Returns:
        covered (layers, size, size) bool, position (layers, size, size, 3) in normalised space and unit normal
        (layers, size, size, 3), zero where not covered, on the geometry's device.
    """
    face, barycentric = _rasterized(mesh, geometry, size)
    covered = face >= 0
    position, normal = (torch.zeros(*face.shape, 3, device=geometry.device) for _ in range(2))
    position[covered] = geometry.interpolate(geometry.corners, face[covered], barycentric[covered])
    interpolated = geometry.interpolate(geometry.normals, face[covered], barycentric[covered])
    normal[covered] = F.normalize(interpolated, dim=-1)
    return covered, position, normal


def view_directions(count: int = 64, elevation_deg: tuple[float, float] = (-60.0, 60.0)) -> Tensor:
    """(count, 3) unit directions spread evenly over the sphere between two elevations, any prefix spread evenly too."""
    index = torch.arange(count, dtype=torch.float64)
    low, high = (math.sin(math.radians(angle)) for angle in elevation_deg)
    # Base 2 radical inverse against multiples of the golden ratio: even in both, in any order of stopping.
    height = torch.tensor([int(f"{i:032b}"[::-1], 2) / 2**32 for i in range(count)], dtype=torch.float64)
    y = low + (high - low) * (height + 0.5 / count)
    azimuth = 2 * math.pi * _GOLDEN * index
    radius = (1 - y * y).clamp_min(0).sqrt()
    return torch.stack([radius * azimuth.sin(), y, radius * azimuth.cos()], -1).float()


@torch.no_grad()
def exposure(
    mesh: Mesh, geometry: Geometry, size: int, directions: Tensor | None = None, radius: float = 3.25
) -> Tensor:
    """(layers, size, size) how much cameras all round see of each covered texel, from either side of the face.

    The mean over cameras of the cosine between the face's normal and the way to the camera, 0 where it is hidden:
    about 0.25 in the open, near 0 in a fold. Each texel of a 2 x 2 block tries one quarter of the directions, a run of
    consecutive ones, and the covered texels around are averaged in.

    Args:
        directions: (k, 3) unit directions from the origin to the cameras; :func:`view_directions` where None.
        radius: distance of the cameras from the origin, normalised units.
    """
    face, barycentric = _rasterized(mesh, geometry, size)
    covered = face >= 0
    faces = face[covered]
    position = geometry.interpolate(geometry.corners, faces, barycentric[covered])
    normal = geometry.face_normal[faces]
    _, row, column = covered.nonzero(as_tuple=True)
    turn = 2 * (row % 2) + column % 2
    eyes = radius * (view_directions() if directions is None else directions).to(geometry.device)
    total = torch.zeros(len(faces), device=geometry.device)
    for index, eye in enumerate(eyes):
        (mine,) = (turn == 4 * index // len(eyes)).nonzero(as_tuple=True)
        toward = eye - position[mine]
        cosine = (normal[mine] * F.normalize(toward, dim=-1)).sum(-1)
        side = torch.where(cosine < 0, -1.0, 1.0)
        hits = cast(geometry, position[mine] + _LIFT * side[:, None] * normal[mine], toward)
        total[mine] += cosine.abs() * (hits.distance >= 1)
    out, weight = (torch.zeros(covered.shape, device=geometry.device) for _ in range(2))
    out[covered], weight[covered] = total * (4 / len(eyes)), 1.0
    around = F.avg_pool2d(torch.stack([out, weight], 1), 3, stride=1, padding=1)
    return torch.where(covered, around[:, 0] / around[:, 1].clamp_min(1e-9), 0.0)


def seen(mesh: Mesh, geometry: Geometry, size: int, directions: Tensor | None = None, radius: float = 3.25) -> Tensor:
    """(layers, size, size) bool: covered texels that take part in what some camera sees, see :func:`exposure`.

    Covered neighbours of a seen texel count as seen: filtering reads them.
    """
    return exposure(mesh, geometry, size, directions, radius) > 0


def _rasterized(mesh: Mesh, geometry: Geometry, size: int) -> tuple[Tensor, Tensor]:
    from paintit.mesh.uv import rasterize_uv

    texels = rasterize_uv(mesh, size)
    face = torch.from_numpy(texels.face).to(geometry.device, torch.int64)
    return face, torch.from_numpy(texels.barycentric).to(geometry.device, torch.float32)
