"""Split-sum shading of the metallic-roughness model (paper 3.4, eq. 2), differentiable in every input.

    L = k_d (1 - m) E(n) / pi  +  prefiltered(R, roughness) * (k_s A(n.v, roughness) + B(n.v, roughness))
    k_s = 0.04 (1 - m) + m k_d

GGX distribution with alpha = roughness^2, height-correlated Smith masking-shadowing, Schlick's Fresnel. (A, B) are
integrated here, once per process.
"""

from __future__ import annotations

import math
from functools import lru_cache

import torch
import torch.nn.functional as F
from torch import Tensor

from paintit.render.light import Light

#: Reflectance of a dielectric at normal incidence.
DIELECTRIC = 0.04
TABLE_SIZE = 64
#: Half-width of the bend that keeps n.v above zero.
_BEND = 1e-2


def shade(
    base_color: Tensor,
    roughness: Tensor,
    metallic: Tensor,
    normal: Tensor,
    view: Tensor,
    light: Light,
    rotation: float | Tensor = 0.0,
    corrected: bool = False,
    occlusion: Tensor | None = None,
) -> Tensor:
    """Outgoing linear radiance (..., 3), any leading shape, float32 or float64.

    Args:
        base_color: (..., 3) linear in [0, 1].
        roughness: (..., 1) perceptual, in [0, 1].
        metallic: (..., 1) in [0, 1].
        normal: (..., 3) unit shading normal, world space.
        view: (..., 3) unit direction toward the eye.
        light: the prefiltered environment.
        rotation: radians the environment is turned about +Y; a tensor lines up with the leading dimensions.
        corrected: with two corrections that bring rough metals to what a path tracer shows: light scattered more than
            once between microfacets (specular reflectance times 1 + k_s (1 / (A + B) - 1), Turquin 2019), and a rough
            lobe's middle turned from R toward the normal (Lagarde and de Rousiers 2014). False is the paper's equation:
            under it a white metal of roughness 1 reflects a third of the light.
        occlusion: (..., 1) share of the surroundings that the point sees, in [0, 1], as glTF's occlusion texture stores
            it; None is 1. All light here comes from the surroundings, so it dims both terms.
    """
    cosine = (normal * view).sum(-1, keepdim=True)
    reflected = 2 * cosine * normal - view
    at_normal = base_color * metallic + DIELECTRIC * (1 - metallic)
    scale, bias = environment_brdf(_above_zero(cosine), roughness)
    reflectance = at_normal * scale + bias
    if corrected:
        reflectance = reflectance * (1 + at_normal * (1 / (scale + bias) - 1))
        reflected = _lobe_middle(normal, reflected, roughness)
    diffuse = base_color * (1 - metallic) * light.diffuse(normal, rotation)
    specular = light.specular(reflected, roughness, rotation) * reflectance
    if occlusion is not None:
        diffuse = diffuse * occlusion
        specular = specular * specular_occlusion(occlusion, cosine, roughness)
    return diffuse + specular


def specular_occlusion(occlusion: Tensor, cosine: Tensor, roughness: Tensor) -> Tensor:
    """Share of the specular lobe that is not occluded, in [0, 1] (Lagarde and de Rousiers 2014, listing 26).

    A rough lobe is occluded as much as the diffuse one is, a smooth one less.
    """
    exponent = torch.exp2(-16 * roughness - 1)
    return ((cosine.clamp_min(0) + occlusion).pow(exponent) - 1 + occlusion).clamp(0, 1)


def _lobe_middle(normal: Tensor, reflected: Tensor, roughness: Tensor) -> Tensor:
    """Where a GGX lobe's middle lies: at R for a mirror, at N for alpha = 1 (Lagarde and de Rousiers 2014, 4.9.3)."""
    alpha = roughness.square()
    smooth = (1 - alpha).clamp_min(1e-6)
    return F.normalize(torch.lerp(normal, reflected, smooth * (smooth.sqrt() + alpha)), dim=-1)


def perturb(normal: Tensor, tangent: Tensor, texel_normal: Tensor) -> Tensor:
    """Unit shading normal (..., 3) of a tangent-space texel (glTF's frame: bitangent = w * cross(normal, tangent)).

    Args:
        normal: (..., 3) unit interpolated normal.
        tangent: (..., 4) interpolated tangent, w = +-1; any length, need not be orthogonal to the normal.
        texel_normal: (..., 3) tangent-space normal, +Y up, need not be unit (filtered lookups are not).
    """
    along = tangent[..., :3]
    bitangent = tangent[..., 3:] * torch.linalg.cross(normal, along, dim=-1)
    x, y, z = texel_normal.split(1, -1)
    return F.normalize(x * along + y * bitangent + z * normal, dim=-1)


def environment_brdf(cosine: Tensor, roughness: Tensor) -> tuple[Tensor, Tensor]:
    """(A, B), each (..., 1): reflectance of a unit environment is ``k_s A + B``. ``cosine`` = n.v in (0, 1]."""
    # The axis is sqrt(n.v): the table bends most at grazing angles.
    grid = torch.cat([2 * cosine.sqrt() - 1, 2 * roughness - 1], -1)
    table = _table(grid.dtype, str(grid.device))
    values = F.grid_sample(table, grid.reshape(1, 1, -1, 2), padding_mode="border", align_corners=True)
    scale, bias = values.reshape(2, -1)
    return scale.reshape(cosine.shape), bias.reshape(cosine.shape)


def _above_zero(cosine: Tensor) -> Tensor:
    """n.v bent smoothly to stay positive: 1 stays 1, 0 becomes about ``_BEND / 2``."""
    return (cosine + (cosine.square() + _BEND**2).sqrt()) / (1 + math.sqrt(1 + _BEND**2))


@lru_cache(maxsize=8)
def _table(dtype: torch.dtype, device: str) -> Tensor:
    """(1, 2, size, size): rows are roughness 0..1, columns sqrt(n.v) 0..1."""
    if device == "cpu" and dtype == torch.float64:
        axis = torch.linspace(0, 1, TABLE_SIZE, dtype=torch.float64)
        roughness, root = torch.meshgrid(axis, axis, indexing="ij")
        return torch.stack(integrate_brdf(root.square().clamp_min(1e-5), roughness))[None]
    return _table(torch.float64, "cpu").to(device, dtype)


def integrate_brdf(cosine: Tensor, roughness: Tensor, polar: int = 32, angular: int = 24) -> tuple[Tensor, Tensor]:
    """(A, B) by quadrature over the half-vectors that the viewer sees, ``cosine`` in (0, 1], ``roughness`` in [0, 1].

    Visible GGX half-vectors are uniform points of a spherical cap stretched by alpha (Dupuy and Benyoub 2023); what is
    left of the integrand is Fresnel times G2 / G1, smooth and at most 1, so that a few hundred midpoints suffice.
    """
    alpha = roughness.square().clamp_min(1e-4)[..., None, None]
    n_v = cosine[..., None, None]
    sine = (1 - n_v.square()).clamp_min(0).sqrt()
    stretched = torch.hypot(alpha * sine, n_v)
    x, z = alpha * sine / stretched, n_v / stretched
    # Squared steps: smooth surfaces have all their loss in the thin rim of the cap that faces away.
    step = ((torch.arange(polar, dtype=cosine.dtype) + 0.5) / polar)[:, None]
    cap = (1 + z) * step.square() - z
    phi = (torch.arange(angular, dtype=cosine.dtype) + 0.5) * (math.pi / angular)
    radius = (1 - cap.square()).clamp_min(0).sqrt()
    h_x, h_y, h_z = alpha * (radius * phi.cos() + x), alpha * radius * phi.sin(), cap + z
    length = (h_x.square() + h_y.square() + h_z.square()).sqrt().clamp_min(1e-12)
    v_h = (sine * h_x + n_v * h_z) / length
    n_l = 2 * v_h * h_z / length - n_v
    smith_v, smith_l = ((1 + (alpha / c).square() - alpha.square()).sqrt() for c in (n_v, n_l.clamp_min(1e-6)))
    # G2 = 2 / (s_v + s_l) (height-correlated Smith), G1 = 2 / (1 + s_v).
    weight = 2 * step * torch.where(n_l > 0, (1 + smith_v) / (smith_v + smith_l), 0.0)
    fresnel = (1 - v_h.clamp(0, 1)).pow(5)
    return ((1 - fresnel) * weight).mean((-2, -1)), (fresnel * weight).mean((-2, -1))
