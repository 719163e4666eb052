"""render(): what a g-buffer, maps and a light look like; and supersampled images for people."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor

from paintit.color import encode_srgb
from paintit.render.camera import Cameras
from paintit.render.gbuffer import GBuffer, rasterize
from paintit.render.geometry import Geometry
from paintit.render.light import Light
from paintit.render.sample import Pyramid, build_pyramid, lookup
from paintit.render.shade import perturb, shade
from paintit.texture.maps import TextureMaps

#: What is behind the mesh in an image for people: a linear grey, the environment, or nothing (an alpha channel).
Background = float | Literal["light", "transparent"]
#: What material channels hold off the mask: grey, neither of the extremes.
_NEUTRAL = 0.5
#: Covered pixels shaded at once in :func:`render_image`.
_CHUNK = 1 << 17


@dataclass(frozen=True)
class Channels:
    """n rendered views, all float, differentiable in the maps.

    Attributes:
        shaded: (n, h, w, 3) linear radiance over the grey background; not clamped.
        base_color: (n, h, w, 3) linear. roughness, metallic: (n, h, w, 1). normal: (n, h, w, 3) world space, with the
            normal map. All zero off the mask.
        mask: (n, h, w, 1), 1 where the mesh is seen.
        gbuffer: the geometry behind them.
    """

    shaded: Tensor
    base_color: Tensor
    roughness: Tensor
    metallic: Tensor
    normal: Tensor
    mask: Tensor
    gbuffer: GBuffer

    def encoded(self) -> dict[str, Tensor]:
        """What a prior reads, in [0, 1]: ``shaded`` and ``base_color`` sRGB-coded, ``roughness`` and ``metallic`` as
        they are; the material channels are 0.5 off the mask."""
        outside = _NEUTRAL * (1 - self.mask)
        return {
            "shaded": encode_srgb(self.shaded),
            "base_color": encode_srgb(self.base_color) * self.mask + outside,
            "roughness": self.roughness + outside,
            "metallic": self.metallic + outside,
        }

    def geometry(self) -> dict[str, Tensor]:
        """What may condition a prior: ``normal`` (n, h, w, 3) of the bare mesh in camera axes, ``depth`` (n, h, w, 1)
        along the camera's axis, ``mask`` (n, h, w, 1), ``position`` (n, h, w, 3) and ``normal_object`` (n, h, w, 3) of
        the bare mesh in normalised space; zero off the mask."""
        gbuffer = self.gbuffer
        return {
            "normal": gbuffer.normal_view(),
            "depth": gbuffer.depth[..., None],
            "mask": self.mask,
            "position": gbuffer.position,
            "normal_object": gbuffer.normal,
        }


def render(
    gbuffer: GBuffer, maps: TextureMaps, light: Light, *, rotation: float | Tensor = 0.0, background: float = 0.25
) -> Channels:
    """Sample and shade every covered pixel.

    Args:
        gbuffer: n views.
        maps: textures of all layers.
        light: the prefiltered environment.
        rotation: radians the environment is turned about +Y, one for all or (n,) one per view.
        background: linear grey behind the mesh.
    """
    packed = maps.packed()
    mask = gbuffer.mask
    index = mask.flatten().nonzero()[:, 0]
    texels, normal, radiance = _shade_pixels(gbuffer, build_pyramid(packed), light, rotation, index)

    def spread(values: Tensor) -> Tensor:
        flat = values.new_zeros(mask.numel(), values.shape[-1]).index_copy(0, index, values)
        return flat.reshape(*mask.shape, -1)

    base_color, roughness, metallic, _ = spread(texels).split([3, 1, 1, 3], -1)
    covered = mask[..., None].to(packed)
    return Channels(
        shaded=spread(radiance) + background * (1 - covered),
        base_color=base_color,
        roughness=roughness,
        metallic=metallic,
        normal=spread(normal),
        mask=covered,
        gbuffer=gbuffer,
    )


def _shade_pixels(
    gbuffer: GBuffer, pyramid: Pyramid, light: Light, rotation: float | Tensor, index: Tensor, corrected: bool = False
) -> tuple[Tensor, Tensor, Tensor]:
    """Texels (m, c), shading normals (m, 3), radiance (m, 3) of the covered pixels ``index`` (m,) into (n h w).

    ``pyramid``: c = 8, the maps; or 12, the maps, emission (not added here) and occlusion.
    """
    pick = lambda tensor: tensor.flatten(0, 2)[index]  # noqa: E731
    texels = lookup(pyramid, pick(gbuffer.layer), pick(gbuffer.uv), pick(gbuffer.footprint))
    base_color, roughness, metallic, texel_normal = texels[..., :8].split([3, 1, 1, 3], -1)
    occlusion = texels[..., 11:] if texels.shape[-1] > 8 else None
    normal = perturb(pick(gbuffer.normal).to(texels), pick(gbuffer.tangent).to(texels), texel_normal)
    if isinstance(rotation, Tensor) and rotation.ndim:
        rotation = rotation.to(index.device)[index // gbuffer.mask[0].numel()]
    view = pick(gbuffer.view).to(texels)
    radiance = shade(base_color, roughness, metallic, normal, view, light, rotation, corrected, occlusion)
    return texels, normal, radiance


@torch.no_grad()
def render_image(
    geometry: Geometry,
    cameras: Cameras,
    maps: TextureMaps,
    light: Light,
    size: int | tuple[int, int],
    *,
    supersample: int = 2,
    rotation: float = 0.0,
    background: Background = 0.25,
    emission: Tensor | None = None,
    occlusion: Tensor | None = None,
) -> NDArray[np.uint8]:
    """Images for people: (n, h, w, 3) uint8, sRGB-coded; (n, h, w, 4) with straight alpha where transparent.

    There is no tone curve: radiance is clipped to [0, 1] and sRGB-coded, which is Blender's view transform "Standard"
    and three.js's NoToneMapping. Rough metals look as they do there, too (``corrected`` of
    :func:`paintit.render.shade.shade`); :func:`render`, which priors read, keeps to the paper's equation.

    Args:
        size: pixels along each side, or (height, width), after averaging ``supersample`` x ``supersample`` samples.
        background: linear grey behind the mesh (1: white), "light" for the environment, or "transparent".
        emission: (layers, h, w, 3) linear radiance of the surface's own, of the maps' size; not lit, not painted.
        occlusion: (layers, h, w, 1) share of the surroundings that a texel sees, of the maps' size; None is 1.
    """
    height, width = (size, size) if isinstance(size, int) else size
    fine = (height * supersample, width * supersample)
    packed = maps.packed().detach()
    if emission is not None or occlusion is not None:
        emission = packed.new_zeros(*packed.shape[:3], 3) if emission is None else emission.to(packed)
        occlusion = packed.new_ones(*packed.shape[:3], 1) if occlusion is None else occlusion.to(packed)
        packed = torch.cat([packed, emission, occlusion], -1)
    pyramid = build_pyramid(packed)
    images = []
    for view in range(len(cameras)):
        gbuffer = rasterize(geometry, cameras[view : view + 1], fine)
        if background == "light":
            linear = light.background(-gbuffer.view, rotation).reshape(-1, 3)
        else:
            grey = 0.0 if background == "transparent" else background
            linear = torch.full((gbuffer.mask.numel(), 3), grey, device=geometry.device)
        for index in gbuffer.mask.flatten().nonzero()[:, 0].split(_CHUNK):
            texels, _, radiance = _shade_pixels(gbuffer, pyramid, light, rotation, index, corrected=True)
            linear[index] = (radiance if emission is None else radiance + texels[..., 8:11]).to(linear)
        # Clamped before averaging: one very bright sample must not undo the smoothing of its pixel's edge.
        linear = F.avg_pool2d(linear.clamp(0, 1).reshape(1, *fine, 3).movedim(-1, 1), supersample)
        if background == "transparent":
            cover = F.avg_pool2d(gbuffer.mask[:, None].to(linear), supersample)
            coded = torch.cat([encode_srgb(linear / cover.clamp_min(1e-9)), cover], 1)
        else:
            coded = encode_srgb(linear)
        images.append((coded * 255 + 0.5).to(torch.uint8).movedim(1, -1))
    return torch.cat(images).cpu().numpy()
