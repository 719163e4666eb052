"""One asset, one light, some views: what `paintit render` makes of them, and how far another picture is from it.

The judges (``viewers.py``) get the same asset as a file, the same .hdr, and cameras in the file's own units. Pictures
are 8 bit, sRGB-coded, with straight alpha; a PSNR is of the coded values, over pixels that are wholly inside the
silhouette on both sides.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from paintit.export.gltf import write_gltf
from paintit.export.preview import FOV, RADIUS, pictures
from paintit.export.read_maps import read_emission, read_maps, read_occlusion
from paintit.mesh.mesh import Mesh
from paintit.mesh.read import read_mesh
from paintit.render.camera import Cameras, look_at
from paintit.render.environment import DEFAULT, load_environment
from paintit.texture.maps import TextureMaps

#: Azimuth and elevation in degrees: all four sides, from above and from below.
VIEWS = ((35.0, 15.0), (125.0, 40.0), (215.0, -20.0), (305.0, 5.0))
Pixels = NDArray[np.uint8]


@dataclass(frozen=True)
class Scene:
    """What is rendered.

    Attributes:
        glb: the asset.
        light: ``"default"`` or an .hdr file. exposure: as in ``paintit render``. rotation: degrees, likewise.
        views: (azimuth, elevation) in degrees.
        size: pixels along each side.
        backdrop: the light is seen behind the asset; else the picture is transparent there.
        unoccluded: the asset casts no shadow on itself and is not reflected in itself; occlusion textures are ignored.
    """

    glb: Path
    light: str = DEFAULT
    exposure: float = 0.8
    rotation: float = 0.0
    views: tuple[tuple[float, float], ...] = VIEWS
    size: int = 512
    backdrop: bool = False
    unoccluded: bool = False

    def cameras(self) -> Cameras:
        azimuth, elevation = torch.tensor(self.views).deg2rad().T
        return look_at(azimuth, elevation, RADIUS, math.radians(FOV))

    def job(self, out: Path) -> dict[str, Any]:
        """The scene for a judge, which writes its pictures to ``out``: eyes and target in the file's units."""
        mesh = read_mesh(self.glb)
        half = mesh.extent / 2
        light = Path(str(resources.files("paintit.render").joinpath("data", "default_light.hdr")))
        return {
            "glb": str(self.glb.resolve()),
            "light": str(light if self.light == DEFAULT else Path(self.light).resolve()),
            "factor": load_environment(self.light, self.exposure).exposure_factor,
            "rotation": self.rotation,
            "eyes": (mesh.center + half * self.cameras().eye.double().numpy()).tolist(),
            "target": mesh.center.tolist(),
            "fov": FOV,
            "near": half / 20,
            "far": half * 20,
            "size": self.size,
            "backdrop": self.backdrop,
            "unoccluded": self.unoccluded,
            "out": str(out),
        }

    def ours(self) -> list[Pixels]:
        """(h, w, 4) of each view, by the function behind ``paintit render``."""
        mesh = read_mesh(self.glb)
        maps = read_maps(mesh)
        images = pictures(
            mesh, maps, self.cameras(), self.light, self.size, exposure=self.exposure, rotation_deg=self.rotation,
            background="light" if self.backdrop else "transparent", emission=read_emission(mesh, maps.size[0]),
            occlusion=None if self.unoccluded else read_occlusion(mesh, maps.size[0]),
        )  # fmt: skip
        return [np.asarray(image.convert("RGBA")) for image in images]


def inside(*images: Pixels) -> NDArray[np.bool_]:
    """(h, w) pixels that all of the pictures cover wholly."""
    return np.logical_and.reduce([image[..., 3] == 255 for image in images])


def overlap(a: Pixels, b: Pixels) -> float:
    """Intersection over union of two silhouettes: a PSNR of what both cover says nothing where it is low."""
    return float(np.minimum(a, b)[..., 3].sum(dtype=np.int64) / np.maximum(a, b)[..., 3].sum(dtype=np.int64))


def psnr(a: Pixels, b: Pixels) -> float:
    """dB between two pictures inside the silhouette, of sRGB-coded values, peak 1."""
    both = inside(a, b)
    error = (a[both, :3].astype(np.float64) - b[both, :3]) / 255
    return -10 * math.log10(max(float(np.square(error).mean()), 1e-10))


def sphere_mesh(rows: int = 96) -> Mesh:
    """Radius 1, smooth normals, u once around from +Z by +X, v from the top down."""
    t, p = np.meshgrid(np.linspace(0, np.pi, rows + 1), np.linspace(0, 2 * np.pi, 2 * rows + 1), indexing="ij")
    vertices = np.stack([np.sin(t) * np.sin(p), np.cos(t), np.sin(t) * np.cos(p)], -1, dtype=np.float64).reshape(-1, 3)
    uvs = np.stack([p / (2 * np.pi), t / np.pi], -1).reshape(-1, 2)
    row, column = (index.reshape(-1) for index in np.meshgrid(np.arange(rows), np.arange(2 * rows), indexing="ij"))
    a = row * (2 * rows + 1) + column
    b, c, d = a + 2 * rows + 1, a + 2 * rows + 2, a + 1
    faces = np.concatenate([np.stack([a, b, c], -1)[row < rows - 1], np.stack([a, c, d], -1)[row > 0]])
    around = np.stack([np.cos(p), 0 * p, -np.sin(p), 0 * p + 1], -1).reshape(-1, 4)[faces].astype(np.float32)
    layer = np.zeros(len(faces), np.int64)
    return Mesh(vertices, faces, uvs, faces.copy(), vertices[faces].astype(np.float32), around, layer)


@dataclass(frozen=True)
class Ball:
    """A sphere of one material: linear base colour, roughness, metalness."""

    name: str
    base_color: tuple[float, float, float]
    roughness: float
    metallic: float

    def write(self, folder: Path) -> Path:
        """Its GLB."""
        one = torch.ones(1, 16, 16, 1)
        base_color, up = torch.tensor(self.base_color), torch.tensor([0.0, 0.0, 1.0])
        maps = TextureMaps(one * base_color, one * self.roughness, one * self.metallic, one * up)
        path = folder / f"{self.name}.glb"
        write_gltf(path, sphere_mesh(), maps, {})
        return path


DIFFUSE = (
    Ball("white", (0.8, 0.8, 0.8), 1.0, 0.0),
    Ball("grey", (0.18, 0.18, 0.18), 1.0, 0.0),
    Ball("red", (0.6, 0.05, 0.03), 1.0, 0.0),
    Ball("green", (0.1, 0.4, 0.08), 1.0, 0.0),
    Ball("blue", (0.03, 0.08, 0.5), 1.0, 0.0),
)
METALS = (
    Ball("silver 0.1", (0.95, 0.93, 0.88), 0.1, 1.0),
    Ball("gold 0.25", (1.0, 0.71, 0.29), 0.25, 1.0),
    Ball("copper 0.5", (0.93, 0.6, 0.5), 0.5, 1.0),
    Ball("iron 0.75", (0.53, 0.51, 0.49), 0.75, 1.0),
    Ball("silver 1.0", (0.95, 0.93, 0.88), 1.0, 1.0),
)
