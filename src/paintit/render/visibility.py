"""Which triangle each ray meets first. One Warp kernel for CPU and CUDA, and a slow readable twin in PyTorch."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

if TYPE_CHECKING:
    from paintit.render.geometry import Geometry

#: Rays never reach further; normalised meshes fit in a sphere of radius 2.
MAX_DISTANCE = 1e6


@dataclass(frozen=True)
class Hits:
    """Where rays (...) met the mesh.

    Attributes:
        face: (...) int64, -1 where nothing was met.
        barycentric: (..., 3) float32 weights of the face's corners, zero where nothing was met.
        distance: (...) float32 along the ray in lengths of its direction, infinite where nothing was met.
    """

    face: Tensor
    barycentric: Tensor
    distance: Tensor


class Tracer:
    """A bounding volume hierarchy over triangles; built once, on the device of ``vertices``."""

    def __init__(self, vertices: Tensor, faces: Tensor) -> None:
        """``vertices``: (v, 3) float32. ``faces``: (f, 3) int32."""
        warp, _ = _warp()
        self.device = vertices.device
        # Warp reads the tensors' memory in place: they must live as long as the hierarchy.
        self._vertices, self._faces = vertices, faces
        self._mesh = warp.Mesh(
            points=warp.from_torch(vertices, dtype=warp.vec3), indices=warp.from_torch(faces.reshape(-1))
        )

    def cast(self, origins: Tensor, directions: Tensor) -> tuple[Tensor, Tensor]:
        """Origins and directions (m, 3) float32 contiguous -> face (m,) int32 and (m, 3) float32 of u, v, distance."""
        warp, kernel = _warp()
        face = torch.empty(len(origins), dtype=torch.int32, device=self.device)
        place = torch.empty(len(origins), 3, device=self.device)
        if len(origins) == 0:
            return face, place
        vectors = [warp.from_torch(tensor, dtype=warp.vec3) for tensor in (origins, directions, place)]
        stream = warp.stream_from_torch(self.device) if self.device.type == "cuda" else None
        warp.launch(
            kernel,
            dim=len(origins),
            inputs=[self._mesh.id, MAX_DISTANCE, vectors[0], vectors[1], warp.from_torch(face), vectors[2]],
            device=self._mesh.device,
            stream=stream,
        )
        return face, place


def cast(geometry: Geometry, origins: Tensor, directions: Tensor) -> Hits:
    """The nearest triangle along each ray, from either side.

    Args:
        geometry: the mesh; its device does the work and holds the result.
        origins, directions: (..., 3), any float type and device; directions need not be unit.
    """
    shape = directions.shape[:-1]
    flat = [tensor.expand(*shape, 3).to(geometry.device, torch.float32).reshape(-1, 3).contiguous()
            for tensor in (origins, directions)]  # fmt: skip
    face, place = geometry.tracer.cast(*flat)
    return _hits(face.long(), place[:, 0], place[:, 1], place[:, 2], shape)


def cast_reference(geometry: Geometry, origins: Tensor, directions: Tensor, chunk: int = 1 << 22) -> Hits:
    """The same by brute force: every ray against every triangle (Moller and Trumbore 1997), ``chunk`` pairs at once."""
    shape = directions.shape[:-1]
    a, b, c = geometry.corners.unbind(1)
    edge_1, edge_2 = b - a, c - a
    found: list[tuple[Tensor, Tensor, Tensor, Tensor]] = []
    flat = [tensor.expand(*shape, 3).to(a).reshape(-1, 3).split(max(1, chunk // len(a)))
            for tensor in (origins, directions)]  # fmt: skip
    for origin, direction in zip(*flat, strict=True):
        o, d = origin[:, None], direction[:, None]
        p = torch.linalg.cross(d, edge_2[None], dim=-1)
        determinant = (edge_1 * p).sum(-1)
        inverse = 1 / torch.where(determinant.abs() < 1e-20, torch.inf, determinant)
        t = o - a
        weight_b = (t * p).sum(-1) * inverse
        q = torch.linalg.cross(t, edge_1[None].expand_as(t), dim=-1)
        weight_c = (d * q).sum(-1) * inverse
        distance = (edge_2 * q).sum(-1) * inverse
        inside = (weight_b >= 0) & (weight_c >= 0) & (weight_b + weight_c <= 1) & (distance > 0) & (inverse != 0)
        nearest, face = torch.where(inside, distance, torch.inf).min(1)
        pick = face[:, None]
        weight_a = 1 - weight_b.gather(1, pick) - weight_c.gather(1, pick)
        face = torch.where(nearest.isinf(), -1, face)
        found.append((face, weight_a[:, 0], weight_b.gather(1, pick)[:, 0], nearest))
    face, first, second, distance = (torch.cat(parts) for parts in zip(*found, strict=True))
    return _hits(face, first, second, distance, shape)


def _hits(face: Tensor, first: Tensor, second: Tensor, distance: Tensor, shape: torch.Size) -> Hits:
    hit = face >= 0
    barycentric = torch.stack([first, second, 1 - first - second], -1).clamp(0, 1)
    barycentric = torch.where(hit[:, None], barycentric, 0.0)
    distance = torch.where(hit, distance, torch.inf)
    return Hits(face.reshape(shape), barycentric.reshape(*shape, 3), distance.reshape(shape))


@contextmanager
def _silent() -> Iterator[None]:
    """Nothing reaches the process's standard error: Warp's library complains there, past Python, of an absent GPU."""
    try:
        sys.stderr.flush()
        kept = os.dup(2)
    except (OSError, ValueError, AttributeError):
        yield
        return
    try:
        with open(os.devnull, "wb") as sink:
            os.dup2(sink.fileno(), 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


@cache
def _warp() -> tuple[Any, Any]:
    """Warp, started quietly on first use, and the kernel."""
    import warp

    if hasattr(warp, "LOG_WARNING"):
        warp.config.log_level = warp.LOG_WARNING
    else:
        setattr(warp.config, "quiet", True)  # noqa: B010 - the older name, unknown to newer versions
    with nullcontext() if torch.cuda.is_available() else _silent():
        warp.init()
    from paintit.render._cast_kernel import cast_kernel

    return warp, cast_kernel
