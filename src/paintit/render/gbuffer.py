"""What each pixel sees: position, normal, tangent, uv and its footprint. Geometry is fixed: no gradients."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor

from paintit.render.camera import Cameras
from paintit.render.geometry import Geometry
from paintit.render.visibility import cast

#: Largest uv step per pixel that is kept; grazing and degenerate faces have no finite one.
_MAX_FOOTPRINT = 16.0


@dataclass(frozen=True)
class GBuffer:
    """Per pixel of n views, row 0 at the top; zero off the mask (face: -1) except ``view``.

    Attributes:
        mask: (n, h, w) bool, the mesh is seen.
        face: (n, h, w) int64. barycentric: (n, h, w, 3).
        position: (n, h, w, 3) normalised space.
        normal: (n, h, w, 3) unit shading normal, world space. Faces are two-sided: one that is seen from behind has its
            whole tangent frame negated, as glTF viewers do.
        tangent: (n, h, w, 4) unit tangent and bitangent sign.
        uv: (n, h, w, 2).
        footprint: (n, h, w, 2, 2) derivatives of uv by pixel steps: [..., 0, :] one to the right, [..., 1, :] one down.
        layer: (n, h, w) int64.
        view: (n, h, w, 3) unit, from the surface toward the eye (from far away off the mask).
        depth: (n, h, w) distance from the eye along the camera's axis.
        rotation: (n, 3, 3) world to camera: rows right, up, backward.
    """

    mask: Tensor
    face: Tensor
    barycentric: Tensor
    position: Tensor
    normal: Tensor
    tangent: Tensor
    uv: Tensor
    footprint: Tensor
    layer: Tensor
    view: Tensor
    depth: Tensor
    rotation: Tensor

    def normal_view(self) -> Tensor:
        """(n, h, w, 3) normals in camera axes (x right, y up, z toward the viewer), zero off the mask."""
        return torch.einsum("nij,nhwj->nhwi", self.rotation, self.normal)


@torch.no_grad()
def rasterize(geometry: Geometry, cameras: Cameras, size: int | tuple[int, int]) -> GBuffer:
    """Cast one ray through each pixel centre and gather what it meets.

    Args:
        geometry: the mesh; its device holds the result.
        cameras: n views.
        size: pixels along each side, or (height, width).
    """
    height, width = (size, size) if isinstance(size, int) else size
    device = geometry.device
    origin, direction = (tensor.to(device, torch.float32) for tensor in cameras.rays(height, width))
    rotation = torch.stack(cameras.frame(), 1).to(device, torch.float32)
    hits = cast(geometry, origin, direction)
    mask = hits.face >= 0
    view_index, _, _ = mask.nonzero(as_tuple=True)
    face, barycentric = hits.face[mask], hits.barycentric[mask]
    toward = -direction[mask]
    axes = rotation[view_index]

    corners = geometry.corners[face]
    geometric = geometry.face_normal[face]
    position = (corners * barycentric[..., None]).sum(-2)
    normal = F.normalize(geometry.interpolate(geometry.normals, face, barycentric), dim=-1)
    normal = torch.where(normal.norm(dim=-1, keepdim=True) < 0.5, geometric, normal)
    tangent = geometry.interpolate(geometry.tangents, face, barycentric)
    sign = torch.where(tangent[:, 3:] < 0, -1.0, 1.0)
    tangent = torch.cat([F.normalize(tangent[:, :3], dim=-1), sign], -1)
    side = torch.where((geometric * toward).sum(-1, keepdim=True) < 0, -1.0, 1.0)

    pixel = 2 * math.tan(cameras.fov / 2) / height
    steps = torch.stack([axes[:, 0], -axes[:, 1]], 1) * pixel
    along = (toward * axes[:, 2]).sum(-1, keepdim=True)
    footprint = uv_footprint(corners, geometry.uvs[face], origin[mask], -toward / along, steps)
    depth = ((origin[mask] - position) * axes[:, 2]).sum(-1)

    def spread(values: Tensor) -> Tensor:
        out = values.new_zeros(*mask.shape, *values.shape[1:])
        out[mask] = values
        return out

    return GBuffer(
        mask=mask,
        face=hits.face,
        barycentric=hits.barycentric,
        position=spread(position),
        normal=spread(normal * side),
        tangent=spread(tangent * side),
        uv=spread(geometry.interpolate(geometry.uvs, face, barycentric)),
        footprint=spread(footprint),
        layer=spread(geometry.layer[face]),
        view=-direction,
        depth=spread(depth),
        rotation=rotation,
    )


def uv_footprint(corners: Tensor, uvs: Tensor, origin: Tensor, direction: Tensor, steps: Tensor) -> Tensor:
    """Derivative of uv where a ray meets the plane of a triangle, as the ray's direction changes (Igehy 1999).

    Args:
        corners: (m, 3, 3) positions; uvs: (m, 3, 2).
        origin, direction: (m, 3); the direction reaches the image plane at distance 1, so that it is linear in pixels.
        steps: (m, k, 3) changes of the direction.

    Returns:
        (m, k, 2), finite: a plane seen edge on, or without area, gets a large but bounded footprint.
    """
    edge_1, edge_2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = F.normalize(torch.linalg.cross(edge_1, edge_2), dim=-1, eps=1e-30)
    facing = (direction * normal).sum(-1)
    facing = torch.where(facing < 0, facing.clamp_max(-1e-6), facing.clamp_min(1e-6))
    distance = ((corners[:, 0] - origin) * normal).sum(-1) / facing
    slide = (steps * normal[:, None]).sum(-1) / facing[:, None]
    moved = distance[:, None, None] * (steps - slide[..., None] * direction[:, None])
    a, b, c = (edge_1 * edge_1).sum(-1), (edge_1 * edge_2).sum(-1), (edge_2 * edge_2).sum(-1)
    determinant = (a * c - b * b).clamp_min(1e-30)[:, None]
    first, second = (moved * edge_1[:, None]).sum(-1), (moved * edge_2[:, None]).sum(-1)
    weight_1 = (c[:, None] * first - b[:, None] * second) / determinant
    weight_2 = (a[:, None] * second - b[:, None] * first) / determinant
    uv_1, uv_2 = (uvs[:, 1] - uvs[:, 0])[:, None], (uvs[:, 2] - uvs[:, 0])[:, None]
    footprint = weight_1[..., None] * uv_1 + weight_2[..., None] * uv_2
    return footprint.nan_to_num(0.0).clamp(-_MAX_FOOTPRINT, _MAX_FOOTPRINT)
