"""The ruler: what a painted mesh is measured against, and in what units. Every published figure goes through here.

The truth of a sentence is what the data generator means by it: its material, drawn many times, on the texels of the very
mesh that was painted. Statistics are over the texels that a camera sees.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from meanings import meaning
from materials import Points, evaluate, noise_volume
from surfaces import Material
from torch import Tensor

from paintit.color import encode_srgb
from paintit.config import ViewConfig
from paintit.evaluate.color_difference import ciede2000
from paintit.export.finish import visibility
from paintit.guidance.pocket import STACK
from paintit.mesh.mesh import Mesh
from paintit.mesh.read import read_mesh
from paintit.mesh.uv import fill_gutters
from paintit.paint.views import ViewSampler
from paintit.render.camera import Cameras, look_at
from paintit.render.environment import load_environment
from paintit.render.gbuffer import GBuffer, rasterize
from paintit.render.geometry import Geometry
from paintit.render.light import Light, prefilter
from paintit.render.render import render
from paintit.render.texels import texel_points
from paintit.texture.maps import TextureMaps

ROOT = Path(__file__).parents[2]
PLAIN = (
    "glossy red plastic",
    "matte blue plastic",
    "polished gold",
    "brushed steel",
    "white porcelain",
    "black rubber",
)
PATTERNS = (
    "a zebra",
    "red brick",
    "black and white checkered plastic",
    "red fabric with white polka dots",
    "leopard fur",
    "oak wood with visible grain",
)
PROMPTS = (*PLAIN, *PATTERNS)
#: Draws of the generator's material that make up the truth of a sentence, and texels that each is evaluated at.
DRAWS, TRUTH_TEXELS = 32, 2048
#: An environment that no paint was lit by.
UNSEEN_LIGHT = ROOT / "assets" / "envmaps" / "venice_sunset_512.hdr"
#: Pixels along each side of the views that the recogniser and the pattern score look at.
STACK_VIEW, PATTERN_VIEW = 64, 256
FULL_VIEWS = CLOSE_UPS = 4
_XYZ = ((0.4124564, 0.3575761, 0.1804375), (0.2126729, 0.7151522, 0.0721750), (0.0193339, 0.1191920, 0.9503041))
_WHITE_D65 = (0.95047, 1.0, 1.08883)


def lab(linear: Tensor) -> Tensor:
    """Linear Rec. 709 (..., 3) in [0, 1] -> CIE L*a*b* (..., 3) under D65."""
    xyz = linear @ linear.new_tensor(_XYZ).T / linear.new_tensor(_WHITE_D65)
    f = torch.where(xyz > 216 / 24389, xyz.clamp_min(1e-9) ** (1 / 3), (24389 / 27 * xyz + 16) / 116)
    return torch.stack([116 * f[..., 1] - 16, 500 * (f[..., 0] - f[..., 1]), 200 * (f[..., 1] - f[..., 2])], -1)


def chroma(linear: Tensor) -> Tensor:
    """C*ab (...) of linear Rec. 709 (..., 3): how colourful, 0 for greys, about 100 for the primaries."""
    return lab(linear)[..., 1:].norm(dim=-1)


@dataclass(frozen=True)
class Subject:
    """A mesh that is measured, with all that does not change from paint to paint.

    Attributes:
        seen: (layers, size, size) bool, texels that some camera sees.
        position, normal: (layers, size, size, 3) of covered texels, normalised space.
        covered: (layers, size, size) bool.
        cameras: four all round, then four close-ups.
        stack_views, pattern_views: their g-buffers at two sizes.
    """

    mesh: Mesh
    geometry: Geometry
    seen: Tensor
    covered: Tensor
    position: Tensor
    normal: Tensor
    cameras: Cameras
    stack_views: GBuffer
    pattern_views: GBuffer


def find_mesh(name: str) -> Path:
    """The bundled mesh called ``name``."""
    path = next((ROOT / "assets" / "meshes").glob(f"{name}*"))
    return path if path.is_file() else path / f"{name}.obj"


@lru_cache(maxsize=4)
def subject(name: str, size: int = 512) -> Subject:
    """The bundled mesh ``name`` made ready for maps of ``size`` texels a side."""
    mesh = read_mesh(find_mesh(name))
    geometry = Geometry.from_mesh(mesh)
    covered, position, normal = texel_points(mesh, geometry, size)
    cameras = measuring_cameras(mesh)
    return Subject(
        mesh,
        geometry,
        torch.from_numpy(visibility(mesh, geometry, size)) & covered,
        covered,
        position,
        normal,
        cameras,
        rasterize(geometry, cameras, STACK_VIEW),
        rasterize(geometry, cameras, PATTERN_VIEW),
    )


def measuring_cameras(mesh: Mesh) -> Cameras:
    """Four views all round and four close-ups, the same for every paint of a mesh."""
    azimuth = torch.tensor([35.0 + 90.0 * i for i in range(FULL_VIEWS)]).deg2rad()
    elevation = torch.tensor([20.0, 5.0] * (FULL_VIEWS // 2)).deg2rad()
    full = look_at(azimuth, elevation, ViewConfig.radius, math.radians(ViewConfig.fov))
    sampler = ViewSampler(mesh, ViewConfig(count=CLOSE_UPS, close_up=1.0))
    near = sampler(torch.Generator().manual_seed(20)).cameras
    parts = [torch.cat([getattr(full, n), getattr(near, n)]) for n in ("eye", "target", "azimuth", "elevation")]
    return Cameras(parts[0], parts[1], parts[2], parts[3], full.fov)


def generated(position: Tensor, normal: Tensor, materials: Sequence[Material], rng: np.random.Generator) -> Tensor:
    """(materials, n, 5) linear base colour, roughness, metalness of each material at surface points (n, 3).

    A mesh says nothing of parts, and its curvature is not asked for: no material of the prompts needs them.
    """
    b, n = len(materials), len(position)
    where, facing = position.repeat(b, 1), normal.repeat(b, 1)
    sample = torch.arange(b).repeat_interleave(n)
    even = torch.zeros(b * n)
    points = Points(
        position=where, normal=facing, part=even.to(torch.uint8), curvature=even, turn=even, view=facing, sample=sample
    )
    return evaluate(list(materials), points, noise_volume(), rng)[0].reshape(b, n, 5)


def true_maps(on: Subject, material: Material, rng: np.random.Generator) -> TextureMaps:
    """The generator's material itself on the texels of a mesh: the paint that nothing can beat."""
    values = torch.zeros(*on.covered.shape, 5)
    values[on.covered] = generated(on.position[on.covered], on.normal[on.covered], [material], rng)[0]
    return maps_of(torch.from_numpy(fill_gutters(values.numpy(), on.covered.numpy())))


def constant_maps(value: Tensor, like: Tensor) -> TextureMaps:
    """Maps that hold one value (5,) everywhere: linear base colour, roughness, metalness. ``like`` (layers, h, w)."""
    return maps_of(value.float().expand(*like.shape, 5))


def maps_of(values: Tensor) -> TextureMaps:
    """Maps without relief of (layers, h, w, 5) linear base colour, roughness, metalness."""
    flat = values.new_tensor([0.0, 0.0, 1.0]).expand(*values.shape[:-1], 3)
    return TextureMaps.unpacked(torch.cat([values, flat], -1))


@dataclass(frozen=True)
class Truth:
    """What a sentence means: means over draws and texels. ``base`` (3,) linear."""

    base: Tensor
    roughness: float
    metallic: float
    chroma: float

    @property
    def value(self) -> Tensor:
        """(5,) linear base colour, roughness, metalness."""
        return torch.cat([self.base, torch.tensor([self.roughness, self.metallic])])


@lru_cache(maxsize=512)
def truth_of(prompt: str, mesh: str = "spot", size: int = 512) -> Truth:
    """The mean of ``DRAWS`` of the generator's materials for ``prompt`` over texels of ``mesh`` that a camera sees."""
    on = subject(mesh, size)
    rng = np.random.default_rng(500)
    seen = on.seen.flatten().nonzero()[:, 0]
    seen = seen[torch.from_numpy(rng.integers(len(seen), size=TRUTH_TEXELS))]
    materials = [meaning(prompt, rng) for _ in range(DRAWS)]
    values = generated(on.position.reshape(-1, 3)[seen], on.normal.reshape(-1, 3)[seen], materials, rng).flatten(0, 1)
    mean = values.mean(0)
    return Truth(mean[:3], float(mean[3]), float(mean[4]), float(chroma(values[:, :3]).mean()))


def stacks(on: Subject, maps: TextureMaps, light: Light) -> Tensor:
    """(8 views, 8, 32, 32) in [0, 1]: the eight views as the pocket prior reads them."""
    encoded = render(on.stack_views, maps, light, background=0.5).encoded()
    image = torch.cat([encoded[name] for name in STACK], -1).permute(0, 3, 1, 2)
    return F.adaptive_avg_pool2d(image, 32)


@lru_cache(maxsize=4)
def light_of(path: str) -> Light:
    """A prefiltered environment at the exposure that paints are made under."""
    return prefilter(load_environment(path, 0.7))


@torch.no_grad()
def relighting_error(on: Subject, maps: TextureMaps, truth: Truth) -> float:
    """Mean absolute error, sRGB-coded in [0, 1], of the four full views under an unseen light.

    Against the same mesh made of the sentence's mean material: for plain materials, which have no pattern to differ in.
    """
    light = light_of(str(UNSEEN_LIGHT))
    painted = render(on.stack_views, maps, light, background=0.5)
    plain = render(on.stack_views, constant_maps(truth.value, on.seen), light, background=0.5)
    inside = painted.mask[:FULL_VIEWS, ..., 0] > 0
    return float((encode_srgb(painted.shaded) - encode_srgb(plain.shaded))[:FULL_VIEWS][inside].abs().mean())


@torch.no_grad()
def channel_figures(on: Subject, maps: TextureMaps, truth: Truth) -> dict[str, float]:
    """Errors of the means over seen texels against the truth.

    ``delta_e`` CIEDE2000 of the mean base colour; ``roughness``, ``metallic`` the means and ``roughness_error`` the
    absolute error; ``chroma`` mean C* over texels less the true one; ``saturation`` their ratio, NaN for greys.
    """
    base = maps.base_color[on.seen]
    mean, colourful = base.mean(0), float(chroma(base).mean())
    roughness, metallic = float(maps.roughness[on.seen].mean()), float(maps.metallic[on.seen].mean())
    red, green, blue = encode_srgb(mean).tolist()
    return {
        "red": red, "green": green, "blue": blue,
        "delta_e": float(ciede2000(lab(mean), lab(truth.base))),
        "roughness": roughness,
        "roughness_error": abs(roughness - truth.roughness),
        "metallic": metallic,
        "chroma": colourful - truth.chroma,
        "saturation": colourful / truth.chroma if truth.chroma > 10 else math.nan,
    }  # fmt: skip
