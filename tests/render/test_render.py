"""render() as a whole: composition, encoding, gradients, rotation, previews."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
import torch
from torch import Tensor

from paintit.color import decode_srgb, encode_srgb
from paintit.mesh.mesh import Mesh
from paintit.render.camera import orbit
from paintit.render.gbuffer import GBuffer, rasterize
from paintit.render.geometry import Geometry
from paintit.render.light import Light
from paintit.render.render import Channels, render, render_image
from paintit.texture.maps import TextureMaps


def flat_maps(
    base: tuple[float, float, float] = (0.6, 0.4, 0.2), rough: float = 0.5, metal: float = 0.0
) -> TextureMaps:
    one = torch.ones(1, 16, 16, 1)
    return TextureMaps(one * torch.tensor(base), one * rough, one * metal, one * torch.tensor([0.0, 0, 1]))


@pytest.fixture(scope="module")
def geometry(sphere: Callable[[int], Mesh]) -> Geometry:
    return Geometry.from_mesh(sphere(24))


@pytest.fixture(scope="module")
def gbuffer(geometry: Geometry) -> GBuffer:
    return rasterize(geometry, orbit(2), 24)


def test_composition_and_encoding(gbuffer: GBuffer, varied_light: Light) -> None:
    channels = render(gbuffer, flat_maps(), varied_light, background=0.3)
    off = ~gbuffer.mask
    assert (channels.shaded[off] == 0.3).all()
    assert (channels.mask[..., 0] == gbuffer.mask).all()
    base = channels.base_color[gbuffer.mask]
    torch.testing.assert_close(base, torch.tensor([0.6, 0.4, 0.2]).expand_as(base))
    encoded = channels.encoded()
    assert set(encoded) == {"shaded", "base_color", "roughness", "metallic"}
    for name, image in encoded.items():
        assert image.shape == (2, 24, 24, 3 if name in ("shaded", "base_color") else 1)
        assert float(image.min()) >= 0
        assert float(image.max()) <= 1
        if name != "shaded":
            assert (image[off] == 0.5).all()
    torch.testing.assert_close(encoded["shaded"][off], encode_srgb(channels.shaded[off]))
    torch.testing.assert_close(encoded["base_color"][gbuffer.mask], encode_srgb(base))
    geometry = channels.geometry()
    widths = {name: image.shape[-1] for name, image in geometry.items()}
    assert widths == {"normal": 3, "depth": 1, "mask": 1, "position": 3, "normal_object": 3}
    assert all((image[off] == 0).all() for image in geometry.values())


def test_furnace(gbuffer: GBuffer, white_light: Light) -> None:
    """A white rough dielectric in a white room of 1.5: diffuse 1.5 and at most the specular reflection above it."""
    shaded = render(gbuffer, flat_maps((1, 1, 1)), white_light).shaded[gbuffer.mask]
    assert float(shaded.min()) > 1.5
    assert float(shaded.max()) < 1.5 * 2


def test_gradients_against_finite_differences(geometry: Geometry, varied_light: Light) -> None:
    small = rasterize(geometry, orbit(2), 5)
    g = torch.Generator().manual_seed(0)
    packed = (0.2 + 0.6 * torch.rand(1, 4, 4, 8, generator=g, dtype=torch.float64)).requires_grad_()
    rotation = torch.tensor([0.3, 2.0], dtype=torch.float64)

    def run(values: Tensor) -> tuple[Tensor, ...]:
        encoded = render(small, TextureMaps.unpacked(values), varied_light, rotation=rotation).encoded()
        return tuple(encoded.values())

    assert torch.autograd.gradcheck(run, (packed,), eps=1e-6, atol=1e-4, rtol=1e-4)


def test_rotation_per_view(gbuffer: GBuffer, varied_light: Light) -> None:
    both = render(gbuffer, flat_maps(metal=1.0), varied_light, rotation=torch.tensor([0.5, 4.0])).shaded
    for view, angle in enumerate((0.5, 4.0)):
        alone = render(gbuffer, flat_maps(metal=1.0), varied_light, rotation=angle).shaded
        torch.testing.assert_close(both[view], alone[view])
    assert (both[0] - render(gbuffer, flat_maps(metal=1.0), varied_light).shaded[0]).abs().max() > 0.02


def test_turning_light_and_camera_together_changes_nothing(geometry: Geometry, varied_light: Light) -> None:
    def view(start: float, rotation: float) -> Tensor:
        gbuffer = rasterize(geometry, orbit(1, start_deg=start), 24)
        return render(gbuffer, flat_maps(rough=0.3, metal=1.0), varied_light, rotation=rotation).shaded

    # A quarter turn is a symmetry of the sphere's triangles too.
    difference = (view(90, math.pi / 2) - view(0, 0.0)).abs()
    assert float(difference.quantile(0.98)) < 1e-3
    assert float((view(90, 0.0) - view(0, 0.0)).abs().max()) > 0.02


def test_normal_map_tilts(plane: Mesh, varied_light: Light) -> None:
    gbuffer = rasterize(Geometry.from_mesh(plane), orbit(1, elevation_deg=0.0), 8)
    maps = flat_maps()
    tilted = TextureMaps(maps.base_color, maps.roughness, maps.metallic, maps.normal + torch.tensor([1.0, 0, 0]))
    normal = render(gbuffer, tilted, varied_light).normal[gbuffer.mask]
    lean = 1 / math.sqrt(2)
    torch.testing.assert_close(normal, torch.tensor([lean, 0, lean]).expand_as(normal))


def test_layers_keep_apart(plane: Mesh, white_light: Light) -> None:
    from dataclasses import replace

    gbuffer = rasterize(Geometry.from_mesh(replace(plane, face_layer=np.array([0, 1]))), orbit(1), 16)
    a, b = flat_maps((1, 0, 0)), flat_maps((0, 1, 0))
    maps = TextureMaps.unpacked(torch.cat([a.packed(), b.packed()]))
    base = render(gbuffer, maps, white_light).base_color
    expected = torch.where((gbuffer.layer == 0)[..., None], torch.tensor([1.0, 0, 0]), torch.tensor([0.0, 1, 0]))
    torch.testing.assert_close(base[gbuffer.mask], expected[gbuffer.mask])


def test_nothing_in_view(geometry: Geometry, varied_light: Light) -> None:
    cameras = orbit(1, radius=3.25)
    away = type(cameras)(cameras.eye, 2 * cameras.eye, cameras.azimuth, cameras.elevation, cameras.fov)
    channels: Channels = render(rasterize(geometry, away, 8), flat_maps(), varied_light)
    assert (channels.shaded == 0.25).all()


def test_image(geometry: Geometry, varied_light: Light) -> None:
    image = render_image(geometry, orbit(2), flat_maps(), varied_light, (20, 30), background=1.0)
    assert image.shape == (2, 20, 30, 3)
    assert image.dtype == np.uint8
    assert (image[:, 0, 0] == 255).all()
    # The middle is what render() shows there, sRGB-coded.
    plain = render(rasterize(geometry, orbit(2), (20, 30)), flat_maps(), varied_light).encoded()["shaded"]
    assert np.abs(image[:, 10, 15] / 255.0 - plain[:, 10, 15].numpy()).max() < 0.02
    # Supersampling leaves values between mesh and background on the outline.
    hard = render_image(geometry, orbit(2), flat_maps(), varied_light, (20, 30), background=1.0, supersample=1)
    white = lambda a: (a == 255).all(-1).sum()  # noqa: E731
    assert white(hard) > white(image)


def test_transparent_image(geometry: Geometry, varied_light: Light) -> None:
    """Alpha is the share of a pixel that is covered; colour is that of the covered part, not darkened at the edge."""
    image = render_image(geometry, orbit(2), flat_maps(), varied_light, 40, background="transparent", supersample=4)
    assert image.shape == (2, 40, 40, 4)
    alpha = image[..., 3] / 255.0
    mask = rasterize(geometry, orbit(2), 160).mask.float()
    share = torch.nn.functional.avg_pool2d(mask, 4).numpy()
    assert np.abs(alpha - share).max() < 0.003
    edge = (alpha > 0.2) & (alpha < 0.8)
    on_white = render_image(geometry, orbit(2), flat_maps(), varied_light, 40, background=1.0, supersample=4)
    linear = lambda coded: decode_srgb(torch.from_numpy(coded / 255.0)).numpy()  # noqa: E731
    mixed = linear(image[edge][:, :3]) * alpha[edge][:, None] + 1 - alpha[edge][:, None]
    assert np.abs(mixed - linear(on_white[edge])).max() < 0.01


def test_emission_is_added(geometry: Geometry, varied_light: Light) -> None:
    black = flat_maps((0.0, 0.0, 0.0), 1.0, 1.0)
    glow = torch.ones(1, 16, 16, 3) * torch.tensor([0.5, 0.0, 0.2])
    dark, lit = (render_image(geometry, orbit(1), black, varied_light, 16, emission=e) for e in (None, glow))
    change = decode_srgb(torch.from_numpy(lit / 255.0)) - decode_srgb(torch.from_numpy(dark / 255.0))
    np.testing.assert_allclose(change[0, 8, 8].numpy(), [0.5, 0.0, 0.2], atol=0.01)


@pytest.mark.parametrize(("rough", "metal", "left"), [(1.0, 0.0, 0.5), (1.0, 1.0, 0.5), (0.1, 1.0, 0.569)])
def test_occlusion_dims(geometry: Geometry, white_light: Light, rough: float, metal: float, left: float) -> None:
    """Half occluded and seen head-on, a rough surface shows half of its light, a smooth one 1.5^(2^-2.6) - 0.5."""
    share = torch.full((1, 16, 16, 1), 0.5)
    image = partial(render_image, geometry, orbit(1), flat_maps((0.5, 0.5, 0.5), rough, metal), white_light, 16)
    open_, dimmed = (decode_srgb(torch.from_numpy(image(occlusion=o)[0, 8, 8] / 255)) for o in (None, share))
    torch.testing.assert_close(dimmed, left * open_, atol=0.005, rtol=0.01)
    glow = torch.full((1, 16, 16, 3), 0.2)
    lit = decode_srgb(torch.from_numpy(image(emission=glow, occlusion=share)[0, 8, 8] / 255))
    torch.testing.assert_close(lit, dimmed + 0.2, atol=0.01, rtol=0.01)


def test_a_white_metal_in_a_white_room_vanishes(geometry: Geometry, white_light: Light) -> None:
    """Pictures for people lose no light between microfacets: a rough white metal shows the room's 1.5, clipped."""
    image = render_image(geometry, orbit(1), flat_maps((1.0, 1.0, 1.0), 1.0, 1.0), white_light, 16, background=1.0)
    assert (image == 255).all()
    assert float(render(rasterize(geometry, orbit(1), 16), flat_maps((1.0, 1.0, 1.0), 1.0, 1.0), white_light)
                 .shaded[0, 8, 8, 0]) < 1.0  # fmt: skip


def test_image_before_its_environment(geometry: Geometry, varied_light: Light) -> None:
    cameras = orbit(1, elevation_deg=0.0)
    image = render_image(
        geometry, cameras, flat_maps(), varied_light, 16, background="light", supersample=1, rotation=0.7
    )
    _, direction = cameras.rays(16, 16)
    sky = encode_srgb(varied_light.background(direction, 0.7))[0, 0, 0]
    assert np.abs(image[0, 0, 0] / 255.0 - sky.numpy()).max() < 0.005
