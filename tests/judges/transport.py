"""Mitsuba tells apart what the split sum leaves out: an asset's shadows on itself, and light that it throws on itself.

Three pictures of one scene with the same surfaces (Mitsuba's ``principled``, the file's maps): each point under the
whole environment, as though nothing else were there; with shadows; and with all light that goes from surface to
surface. What shades the first is what a split sum approximates; the other two are beyond it.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from tests.judges.scene import Pixels, Scene

from paintit.color import decode_srgb, encode_srgb
from paintit.export.read_maps import read_maps
from paintit.mesh.mesh import Mesh
from paintit.mesh.read import read_mesh
from paintit.texture.maps import TextureMaps

Floats = NDArray[np.float32]
#: Texels along each side: pictures are small.
TEXTURE_SIZE = 512
#: Most surfaces that a path meets.
MAX_DEPTH = 8
#: Radiance below which a ratio is noise.
DARK = 1e-3


@dataclass(frozen=True)
class Transport:
    """(h, w, 3) linear radiance of one view, black behind the asset."""

    alone: Floats
    shadowed: Floats
    whole: Floats


def transport(scene: Scene, samples: int = 128) -> list[Transport]:
    """What Mitsuba makes of each view of ``scene``; blended materials are opaque, as in `paintit render`."""
    import mitsuba as mi

    mi.set_variant("scalar_rgb")  # slow, but it needs no LLVM
    mesh = read_mesh(scene.glb)
    maps = read_maps(mesh, TEXTURE_SIZE)
    found: list[Transport] = []
    with tempfile.TemporaryDirectory() as folder:
        job = scene.job(Path(folder))
        shapes = {f"layer_{i}": _layer(Path(folder), mesh, maps, i) for i in np.unique(mesh.face_layer)}
        light = {"type": "envmap", "filename": job["light"], "scale": job["factor"]}
        world: Any = mi.load_dict({"type": "scene", "light": light, **shapes})
        integrators: list[Any] = [
            mi.load_dict({"type": "direct", "hide_emitters": True}),
            mi.load_dict({"type": "path", "max_depth": MAX_DEPTH, "hide_emitters": True}),
        ]
        for eye in job["eyes"]:
            sensor: Any = mi.load_dict(_sensor(scene, eye, job, samples))
            shadowed, whole = (np.array(mi.render(world, sensor=sensor, integrator=i)) for i in integrators)
            alone = _alone(world, sensor, whole[..., 3] > 0, samples)
            found.append(Transport(alone, shadowed[..., :3], whole[..., :3]))
    return found


def with_transport(image: Pixels, alone: Floats, more: Floats) -> Pixels:
    """``image``, dimmed and lit pixel by pixel as ``more`` is against ``alone``."""
    ratio = np.where(alone > DARK, more / np.maximum(alone, DARK), 1.0)
    linear = decode_srgb(torch.from_numpy(image[..., :3] / np.float32(255)))
    coded = encode_srgb((linear * torch.from_numpy(ratio)).clamp(0, 1)).numpy()
    return np.concatenate([(coded * 255 + 0.5).astype(np.uint8), image[..., 3:]], -1)


def _alone(world: Any, sensor: Any, covered: NDArray[np.bool_], samples: int) -> Floats:
    """Each surface point under the whole environment, whatever stands in the way: by samples of its BSDF."""
    import mitsuba as mi

    context, light = mi.BSDFContext(), world.environment()
    sampler: Any = mi.load_dict({"type": "independent"})
    escape = mi.SurfaceInteraction3f()
    out = np.zeros((*covered.shape, 3), np.float32)
    for row, column in np.argwhere(covered):
        total = mi.Color3f(0.0)
        for _ in range(samples):
            offset = sampler.next_2d()
            place = [(column + offset.x) / covered.shape[1], (row + offset.y) / covered.shape[0]]
            ray, _ = sensor.sample_ray(0.0, 0.5, place, [0.5, 0.5])
            hit = world.ray_intersect(ray)
            if hit.is_valid():
                sample, weight = hit.bsdf().sample(context, hit, sampler.next_1d(), sampler.next_2d())
                escape.wi = -hit.to_world(sample.wo)
                total += weight * light.eval(escape)
        out[row, column] = np.array(total).reshape(3) / samples
    return out


def _sensor(scene: Scene, eye: list[float], job: dict[str, Any], samples: int) -> dict[str, Any]:
    import mitsuba as mi

    return {
        "type": "perspective",
        "fov": job["fov"],
        "fov_axis": "y",
        "near_clip": job["near"],
        "far_clip": job["far"],
        "to_world": mi.ScalarTransform4f().look_at(origin=eye, target=job["target"], up=[0, 1, 0]),
        "film": {
            "type": "hdrfilm", "width": scene.size, "height": scene.size, "pixel_format": "rgba",
            "rfilter": {"type": "box"}, "component_format": "float32",
        },
        "sampler": {"type": "independent", "sample_count": samples},
    }  # fmt: skip


def _layer(folder: Path, mesh: Mesh, maps: TextureMaps, layer: int) -> dict[str, Any]:
    """One layer as a Mitsuba shape: a PLY file, and its maps on the ``principled`` BSDF."""
    import mitsuba as mi

    mine = mesh.face_layer == layer
    path = folder / f"{layer}.ply"
    _write_ply(path, mesh.vertices[mesh.faces[mine]], mesh.normals[mine], mesh.uvs[mesh.face_uvs[mine]])

    def texture(values: torch.Tensor) -> dict[str, Any]:
        return {"type": "bitmap", "bitmap": mi.Bitmap(values[layer].contiguous().numpy()), "raw": True}

    surface = {
        "type": "principled",
        "base_color": texture(maps.base_color),
        "roughness": texture(maps.roughness),
        "metallic": texture(maps.metallic),
    }
    bumped = {"type": "normalmap", "normalmap": texture(maps.normal / 2 + 0.5), "bsdf": surface}
    return {"type": "ply", "filename": str(path), "bsdf": {"type": "twosided", "bsdf": bumped}}


def _write_ply(path: Path, corners: NDArray[np.float64], normals: Floats, uvs: NDArray[np.float64]) -> None:
    """Triangles that share no vertices: (n, 3, 3), (n, 3, 3), (n, 3, 2)."""
    count = len(corners)
    vertices = np.concatenate([corners, normals, uvs], -1).reshape(-1, 8).astype("<f4")
    faces = np.zeros(count, [("size", "u1"), ("index", "<i4", 3)])
    faces["size"], faces["index"] = 3, np.arange(3 * count).reshape(-1, 3)
    names = "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz", "u", "v"))
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {3 * count}\n{names}"
        f"element face {count}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    path.write_bytes(header.encode() + vertices.tobytes() + faces.tobytes())
