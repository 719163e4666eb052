"""Split-sum shading against a closed form with an independent integral, finite differences, and symmetries."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from torch import Tensor

from paintit.render.light import Light, rotate_about_y
from paintit.render.shade import environment_brdf, perturb, shade


def specular_albedo(n_v: float, roughness: float, f0: float, steps: int = 600) -> float:
    """Reflectance of a GGX surface under a unit environment: the integral of f cos over all light directions.

    Written out over half-vectors with the Jacobian dl = 4 v.h dh; numpy, sharing nothing with the package.
    """
    a2 = roughness**4
    quantile = (np.arange(steps) + 0.5) / steps
    tan2 = a2 * quantile / (1 - quantile)
    cos_h = 1 / np.sqrt(1 + tan2)
    phi = (np.arange(steps) + 0.5) / steps * np.pi
    h = np.stack(
        np.broadcast_arrays(np.sqrt(1 - cos_h**2)[:, None] * np.cos(phi), np.sqrt(1 - cos_h**2)[:, None] * np.sin(phi),
                            cos_h[:, None]), -1)  # fmt: skip
    v = np.array([math.sqrt(1 - n_v**2), 0, n_v])
    v_h = h @ v
    n_l = 2 * v_h * h[..., 2] - n_v
    ok = (v_h > 0) & (n_l > 0)
    lam = lambda c: (np.sqrt(1 + a2 * (1 / np.maximum(c, 1e-9) ** 2 - 1)) - 1) / 2  # noqa: E731
    g2 = 1 / (1 + lam(n_v) + lam(n_l))
    fresnel = f0 + (1 - f0) * (1 - v_h) ** 5
    # density of h is D cos_h, so the D of f = D F G / (4 n_l n_v) is divided out.
    integrand = np.where(ok, fresnel * g2 / (4 * np.maximum(n_l, 1e-9) * n_v) * n_l * 4 * v_h / h[..., 2], 0)
    return float(integrand.mean())


@pytest.mark.parametrize("roughness", [0.1, 0.3, 0.5, 0.75, 1.0])
@pytest.mark.parametrize("metallic", [0.0, 0.25, 0.5, 0.75, 1.0])
def test_constant_environment(white_light: Light, roughness: float, metallic: float) -> None:
    base = torch.tensor([0.9, 0.5, 0.1])
    for n_v in (1.0, 0.8, 0.4, 0.2):
        normal = torch.tensor([0.0, 0.6, 0.8])
        view = n_v * normal + math.sqrt(1 - n_v**2) * torch.tensor([1.0, 0.0, 0.0])
        found = shade(base, torch.tensor([roughness]), torch.tensor([metallic]), normal, view, white_light)
        for channel in range(3):
            k_d = float(base[channel])
            f0 = 0.04 * (1 - metallic) + metallic * k_d
            expected = 1.5 * (k_d * (1 - metallic) + specular_albedo(n_v, roughness, f0))
            assert float(found[channel]) == pytest.approx(expected, rel=1e-2)


@pytest.mark.parametrize("roughness", [0.1, 0.5, 1.0])
def test_corrected_metals_keep_all_light(white_light: Light, roughness: float) -> None:
    """White reflects everything; a colour reflects more than in single scattering, and is more saturated than white."""
    normal = torch.tensor([0.0, 0.6, 0.8])
    one, rough = torch.ones(1), torch.tensor([roughness])
    for n_v in (1.0, 0.5, 0.2):
        view = n_v * normal + math.sqrt(1 - n_v**2) * torch.tensor([1.0, 0.0, 0.0])
        white = shade(torch.ones(3), rough, one, normal, view, white_light, corrected=True)
        torch.testing.assert_close(white, torch.full((3,), 1.5), rtol=1e-3, atol=0)
        color = torch.tensor([0.9, 0.5, 0.1])
        plain = shade(color, rough, one, normal, view, white_light)
        more = shade(color, rough, one, normal, view, white_light, corrected=True) / plain
        assert bool((more >= 1).all())
        assert float(more[0]) > float(more[1]) > float(more[2])


def test_a_corrected_rough_lobe_leans_to_the_normal(varied_light: Light) -> None:
    """A mirror looks along R; at roughness 1 the light comes from around N whatever the view."""
    normal = torch.tensor([0.0, 0.6, 0.8])
    view = F.normalize(normal + torch.tensor([1.5, 0.0, 0.0]), dim=0)
    one, white = torch.ones(1), torch.ones(3)
    reflected = 2 * (normal @ view) * normal - view
    mirror = shade(white, torch.zeros(1), one, normal, view, varied_light, corrected=True)
    torch.testing.assert_close(mirror, varied_light.specular(reflected, torch.zeros(1)), rtol=1e-2, atol=1e-3)
    rough = shade(white, one, one, normal, view, varied_light, corrected=True)
    torch.testing.assert_close(rough, varied_light.specular(normal, one), rtol=1e-2, atol=1e-3)
    assert float((rough - varied_light.specular(reflected, one)).abs().max()) > 0.02


def test_reflectance_stays_below_one() -> None:
    """A white metal never reflects more than it receives (single scattering loses energy, never gains)."""
    cosine, roughness = torch.meshgrid(torch.linspace(0.005, 1, 60), torch.linspace(0, 1, 50), indexing="ij")
    scale, bias = environment_brdf(cosine[..., None], roughness[..., None])
    assert (scale >= 0).all()
    assert (bias >= 0).all()
    assert float((scale + bias).max()) <= 1.0 + 1e-6
    assert float((scale + bias)[:, 0].min()) > 0.98


def inputs(count: int, seed: int = 0) -> dict[str, Tensor]:
    g = torch.Generator().manual_seed(seed)
    unit = lambda: F.normalize(torch.randn(count, 3, generator=g, dtype=torch.float64), dim=-1)  # noqa: E731
    normal = unit()
    view = unit()
    view = view * torch.where((view * normal).sum(-1, keepdim=True) < 0, -1.0, 1.0)
    rand = lambda c: 0.1 + 0.8 * torch.rand(count, c, generator=g, dtype=torch.float64)  # noqa: E731
    return {"base_color": rand(3), "roughness": rand(1), "metallic": rand(1), "normal": normal, "view": view}


@pytest.mark.parametrize("name", ["base_color", "roughness", "metallic", "normal", "view"])
def test_gradients_against_finite_differences(varied_light: Light, name: str) -> None:
    values = inputs(12)
    rotation = torch.linspace(0, 3, 12, dtype=torch.float64)

    def run(value: Tensor) -> Tensor:
        return shade(**(values | {name: value}), light=varied_light, rotation=rotation)

    assert torch.autograd.gradcheck(run, (values[name].requires_grad_(),), eps=1e-7, atol=1e-5, rtol=1e-5)


def test_float64_agrees_with_float32(varied_light: Light) -> None:
    values = inputs(200)
    single = shade(**{k: v.float() for k, v in values.items()}, light=varied_light)
    assert single.dtype == torch.float32
    torch.testing.assert_close(single.double(), shade(**values, light=varied_light), atol=1e-4, rtol=1e-4)


def test_gradient_at_grazing_and_turned_away_is_finite(varied_light: Light) -> None:
    values = {k: v[:3].clone().float().requires_grad_() for k, v in inputs(3).items()}
    values["normal"] = torch.tensor([[0.0, 0, 1]] * 3).requires_grad_()
    values["view"] = torch.tensor([[1.0, 0, 0], [0.8, 0, -0.6], [0, 0, 1]]).requires_grad_()
    out = shade(**values, light=varied_light)
    out.sum().backward()
    assert out.isfinite().all()
    assert (out >= 0).all()
    assert all(v.grad is not None and v.grad.isfinite().all() for v in values.values())


@pytest.mark.parametrize("degrees", [90.0, 200.0])
def test_rotating_the_light_equals_rotating_the_scene(varied_light: Light, degrees: float) -> None:
    angle = math.radians(degrees)
    values = inputs(300)
    still = shade(**values, light=varied_light)
    turned = {k: rotate_about_y(v, angle) if k in ("normal", "view") else v for k, v in values.items()}
    torch.testing.assert_close(shade(**turned, light=varied_light, rotation=angle), still, atol=1e-9, rtol=0)
    assert (shade(**values, light=varied_light, rotation=angle) - still).abs().max() > 0.01


def test_perturb_frame() -> None:
    """+X of the texel leans along the tangent, +Y along w * cross(n, t); a flat texel changes nothing."""
    normal, tangent = torch.tensor([0.0, 0, 1]), torch.tensor([1.0, 0, 0, 1])
    mirrored = torch.tensor([1.0, 0, 0, -1])
    lean = 1 / math.sqrt(2)
    torch.testing.assert_close(perturb(normal, tangent, torch.tensor([0.0, 0, 1])), normal)
    torch.testing.assert_close(perturb(normal, tangent, torch.tensor([1.0, 0, 1])), torch.tensor([lean, 0, lean]))
    torch.testing.assert_close(perturb(normal, tangent, torch.tensor([0.0, 1, 1])), torch.tensor([0, lean, lean]))
    torch.testing.assert_close(perturb(normal, mirrored, torch.tensor([0.0, 1, 1])), torch.tensor([0, -lean, lean]))


def test_perturb_gradient() -> None:
    values = inputs(6)
    tangent = torch.cat([values["view"], torch.ones(6, 1, dtype=torch.float64)], -1)
    texel = (values["base_color"] - 0.5 + torch.tensor([0.0, 0, 1])).requires_grad_()
    assert torch.autograd.gradcheck(lambda t: perturb(values["normal"], tangent, t), (texel,))
