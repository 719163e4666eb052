"""The mesh on the device, per face corner, in normalised space: what never changes while its textures are painted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from paintit.mesh.mesh import Mesh, remembered
from paintit.render.visibility import Tracer


@dataclass(frozen=True)
class Geometry:
    """f triangles in normalised space: bounding box centred at the origin, longest edge 2. float32, on ``device``.

    Attributes:
        corners: (f, 3, 3) positions.
        normals: (f, 3, 3) unit shading normals.
        tangents: (f, 3, 4) tangents, w = +-1.
        uvs: (f, 3, 2) texture coordinates, origin top left, each face moved by whole units to lie near [0, 1].
        layer: (f,) int64 texture layer of each face.
        face_normal: (f, 3) unit geometric normal, on the side of the shading normals; zero for degenerate faces.
        tracer: the bounding volume hierarchy for :func:`paintit.render.visibility.cast`.
        center, scale: normalised = (file units - center) * scale; center is (3,) float64 on the CPU.
    """

    corners: Tensor
    normals: Tensor
    tangents: Tensor
    uvs: Tensor
    layer: Tensor
    face_normal: Tensor
    tracer: Tracer
    center: Tensor
    scale: float

    @classmethod
    def from_mesh(cls, mesh: Mesh, device: str | torch.device = "cpu") -> Geometry:
        """Normalise in float64, so that an origin far away costs no precision, then move to ``device`` as float32.

        Made once for a mesh and a device.
        """
        return _geometry(mesh, torch.device(device))

    @property
    def device(self) -> torch.device:
        return self.corners.device

    def to_normalised(self, points: Tensor) -> Tensor:
        """Points (..., 3) in the file's units -> normalised space, float32 on this device."""
        return ((points.to("cpu", torch.float64) - self.center) * self.scale).to(self.device, torch.float32)

    def interpolate(self, attribute: Tensor, face: Tensor, barycentric: Tensor) -> Tensor:
        """Corner attribute (f, 3, c) at points of faces (m,) with barycentric coordinates (m, 3) -> (m, c)."""
        return (attribute[face] * barycentric[..., None]).sum(-2)


@remembered
def _geometry(mesh: Mesh, device: torch.device) -> Geometry:
    center, extent = mesh.center, mesh.extent
    scale = 2.0 / extent if extent > 0 else 1.0
    vertices = ((mesh.vertices - center) * scale).astype(np.float32)
    uvs = mesh.corner_uvs
    # The lookup repeats, so whole units may go; float32 then resolves texels of far repeats too.
    uvs = uvs - np.floor(uvs.min(1, keepdims=True))

    def move(array: np.ndarray, dtype: torch.dtype = torch.float32) -> Tensor:
        return torch.from_numpy(np.array(array)).to(device, dtype).contiguous()

    corners = move(vertices[mesh.faces])
    normals = move(mesh.normals)
    face_normal = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    face_normal = face_normal / face_normal.norm(dim=-1, keepdim=True).clamp_min(1e-30)
    toward = (face_normal * normals.sum(1)).sum(-1, keepdim=True)
    return Geometry(
        corners=corners,
        normals=normals,
        tangents=move(mesh.tangents),
        uvs=move(uvs),
        layer=move(mesh.face_layer, torch.int64),
        face_normal=torch.where(toward < 0, -face_normal, face_normal),
        tracer=Tracer(move(vertices), move(mesh.faces, torch.int32)),
        center=torch.from_numpy(np.array(center)),
        scale=float(scale),
    )
