"""The prefiltered light against closed forms and brute force; rotation; the cache."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
import torch
import torch.nn.functional as F
from torch import Tensor

from paintit.render import light as light_module
from paintit.render import prefilter as convolution
from paintit.render.environment import from_radiance, texel_directions
from paintit.render.light import Light, cache_folder, prefilter, rotate_about_y


def directions(count: int, seed: int = 0, dtype: torch.dtype = torch.float32) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    return F.normalize(torch.randn(count, 3, generator=generator, dtype=torch.float64), dim=-1).to(dtype)


def test_octahedral_map_is_its_own_inverse() -> None:
    size = 33
    line = torch.linspace(-1, 1, size)
    v, u = torch.meshgrid(line, line, indexing="ij")
    there = convolution.octahedral_directions(size)
    torch.testing.assert_close(there.norm(dim=-1), torch.ones(size, size))
    back = convolution.octahedral_uv(there)
    inner = slice(1, -1)
    torch.testing.assert_close(back[inner, inner], torch.stack([u, v], -1)[inner, inner], atol=1e-5, rtol=0)


def test_lookup_is_continuous_across_the_fold(varied_light: Light) -> None:
    """Just above and just below the horizon, and on both sides of the seam of the lower half, the light is the same."""
    phi = torch.linspace(0, 2 * math.pi, 200)
    ring = torch.stack([phi.sin(), torch.zeros_like(phi), phi.cos()], -1)
    step = torch.tensor([0.0, 1e-4, 0.0])
    torch.testing.assert_close(varied_light.diffuse(ring + step), varied_light.diffuse(ring - step), atol=1e-3, rtol=0)
    low = F.normalize(torch.stack([torch.zeros(50), -torch.linspace(0.2, 3, 50), torch.ones(50)], -1), dim=-1)
    side = torch.tensor([1e-4, 0.0, 0.0])
    rough = torch.full((50, 1), 0.3)
    left, right = (varied_light.specular(low + s * side, rough) for s in (-1, 1))
    torch.testing.assert_close(left, right, atol=2e-2, rtol=0)


def test_constant_environment_stays_constant(white_light: Light) -> None:
    d = directions(500)
    roughness = torch.rand(500, 1, generator=torch.Generator().manual_seed(1))
    expected = torch.full((500, 3), 1.5)
    torch.testing.assert_close(white_light.diffuse(d), expected)
    torch.testing.assert_close(white_light.specular(d, roughness), expected)
    torch.testing.assert_close(white_light.background(d), expected)


def test_irradiance_of_a_gradient_environment() -> None:
    """Radiance 1 + w.a has irradiance / pi of 1 + 2/3 n.a (Ramamoorthi and Hanrahan 2001: A_1 / pi = 2/3)."""
    toward, _ = texel_directions(32, 64)
    axis = F.normalize(torch.tensor([0.3, 0.5, -0.8]), dim=0)
    light = prefilter(from_radiance((1 + toward @ axis)[..., None].expand(-1, -1, 3)))
    normal = directions(300)
    expected = (1 + 2 / 3 * (normal @ axis))[:, None].expand(-1, 3)
    torch.testing.assert_close(light.diffuse(normal), expected, atol=3e-3, rtol=0)


@pytest.fixture(scope="module")
def pattern() -> tuple[Tensor, Light]:
    """Radiance (h w, 3) in float64: waves along x and y, and a hard edge across z; and its light."""
    toward = texel_directions(128, 256, torch.float64)[0].reshape(-1, 3)
    radiance = torch.stack([(6 * toward[:, 0]).sin() + 1, (toward[:, 1] * 8).cos() + 1, (toward[:, 2] > 0.2) * 2.0], -1)
    return radiance, prefilter(from_radiance(radiance.reshape(128, 256, 3).float()))


@pytest.mark.parametrize("level", [1, 2, 3, 4, 7, 10])
def test_specular_levels_against_brute_force(pattern: tuple[Tensor, Light], level: int) -> None:
    """Both ways of prefiltering against the defining sum over every texel."""
    radiance, light = pattern
    toward, solid_angle = (t.reshape(-1, *t.shape[2:]) for t in texel_directions(128, 256, torch.float64))
    roughness = level / (convolution.LEVELS - 1)
    d = directions(40, seed=level, dtype=torch.float64)
    cosine = d @ toward.T
    n_h2 = (1 + cosine) / 2
    alpha2 = roughness**4
    weight = alpha2 / (n_h2 * (alpha2 - 1) + 1).square() * cosine.clamp_min(0) * solid_angle
    expected = (weight @ radiance) / weight.sum(-1, keepdim=True)
    found = light.specular(d.float(), torch.full((40, 1), roughness)).double()
    # Smooth channels everywhere; the channel with a hard edge on average (a point on the edge reads the texel's slope).
    assert (found - expected)[:, :2].abs().max() < 0.03
    assert (found - expected)[:, 2].abs().mean() < 0.02


def test_mirror_level_is_the_environment(pattern: tuple[Tensor, Light]) -> None:
    d = directions(400)
    error = (pattern[1].specular(d, torch.zeros(400, 1)) - pattern[1].background(d)).abs()
    assert error[:, :2].max() < 0.01
    assert error.mean() < 0.01


@pytest.mark.parametrize("degrees", [90.0, 33.0, -150.0])
def test_rotation_turns_the_light(varied_light: Light, degrees: float) -> None:
    angle = math.radians(degrees)
    d = directions(200)
    turned = rotate_about_y(d, angle)
    roughness = torch.full((200, 1), 0.35)
    torch.testing.assert_close(varied_light.diffuse(turned, angle), varied_light.diffuse(d), atol=1e-4, rtol=0)
    torch.testing.assert_close(
        varied_light.specular(turned, roughness, angle), varied_light.specular(d, roughness), atol=1e-4, rtol=0
    )
    torch.testing.assert_close(varied_light.background(turned, angle), varied_light.background(d), atol=1e-4, rtol=0)


def test_quarter_turn_takes_z_to_x() -> None:
    turned = rotate_about_y(torch.tensor([0.0, 0.0, 1.0]), math.pi / 2)
    torch.testing.assert_close(turned, torch.tensor([1.0, 0.0, 0.0]), atol=1e-6, rtol=0)


def test_one_rotation_per_view(varied_light: Light) -> None:
    d = directions(2 * 3 * 5).reshape(2, 3, 5, 3)
    both = varied_light.diffuse(d, torch.tensor([0.4, 2.0]))
    torch.testing.assert_close(both[0], varied_light.diffuse(d[0], 0.4))
    torch.testing.assert_close(both[1], varied_light.diffuse(d[1], 2.0))


def test_exposure_scales_everything() -> None:
    values = torch.rand(16, 32, 3, generator=torch.Generator().manual_seed(9))
    plain, bright = (prefilter(from_radiance(values, exposure=exposure)) for exposure in (0.0, 1.4))
    d, rough = directions(50), torch.full((50, 1), 0.5)
    factor = bright.exposure_factor
    torch.testing.assert_close(bright.diffuse(d), plain.diffuse(d) * factor)
    torch.testing.assert_close(bright.specular(d, rough), plain.specular(d, rough) * factor)
    torch.testing.assert_close(bright.background(d), plain.background(d) * factor)
    # A white diffuse sphere averages the exposure.
    many = bright.diffuse(directions(20000)).mean(0)
    assert float(many @ torch.tensor([0.2126, 0.7152, 0.0722])) == pytest.approx(1.4, rel=0.01)


class TestCache:
    environment = from_radiance(torch.rand(8, 16, 3, generator=torch.Generator().manual_seed(5)))

    @pytest.fixture
    def path(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
        monkeypatch.setenv("PAINTIT_CACHE", str(tmp_path))
        prefilter(self.environment)
        (path,) = (cache_folder() / "lights").iterdir()
        return path

    def test_is_read_back_equal(self, path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        cached = prefilter(self.environment)
        monkeypatch.setattr(light_module, "_read_cache", lambda *_: None)
        fresh = prefilter(self.environment)
        assert torch.equal(cached.specular_maps, fresh.specular_maps)
        assert torch.equal(cached.diffuse_map, fresh.diffuse_map)

    def test_is_used(self, path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        def refuse(*_: object) -> None:
            raise AssertionError("prefiltered again")

        monkeypatch.setattr(convolution, "specular_maps", refuse)
        prefilter(self.environment)

    @pytest.mark.parametrize("damage", ["empty", "truncated", "garbage", "other"])
    def test_damaged_file_is_made_again(self, path: Path, damage: str) -> None:
        good = path.read_bytes()
        other = prefilter(from_radiance(torch.ones(8, 16, 3)))
        others = next(file for file in path.parent.iterdir() if file != path)
        cut, foreign = good[: len(good) // 2], others.read_bytes()
        bad = {"empty": b"", "truncated": cut, "garbage": b"\xff" * 999, "other": foreign}
        path.write_bytes(bad[damage])
        light = prefilter(self.environment)
        assert not torch.equal(light.diffuse_map, other.diffuse_map)
        assert path.read_bytes() == good

    def test_is_done_without_where_it_cannot_be_written(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        (tmp_path / "file").write_text("in the way")
        monkeypatch.setenv("PAINTIT_CACHE", str(tmp_path / "file"))
        assert prefilter(self.environment).diffuse_map.isfinite().all()
