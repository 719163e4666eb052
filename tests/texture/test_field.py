"""Texture fields: ranges, hand-worked values, determinism, layers, total variation, refusals."""

from __future__ import annotations

import dataclasses
import math

import pytest
import torch

from paintit.config import TextureConfig
from paintit.errors import UsageError
from paintit.texture.contract import decode
from paintit.texture.dcpbr import DCPBR, enlarge, enlarge_slices
from paintit.texture.field import TextureField, make_field
from paintit.texture.maps import TextureMaps
from paintit.texture.pixels import Pixels, total_variation

SMALL = TextureConfig(size=32, widths=(8, 12, 16), skip_widths=(4, 6, 8))
HALF = dataclasses.replace(SMALL, size=64, upsample=2)
PIXELS = dataclasses.replace(SMALL, kind="pixels", size=16)


def seeded(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def name(config: TextureConfig) -> str:
    return f"{config.kind}-{config.upsample}"


def test_zero_logits_by_hand() -> None:
    maps = decode(torch.zeros(1, 8, 2, 2), min_roughness=0.08, normal_strength=0.1)
    grey = ((0.5 + 0.055) / 1.055) ** 2.4  # 0.2140: sigmoid(0) is the sRGB-coded value
    assert maps.base_color.flatten().tolist() == pytest.approx([grey] * 12)
    assert maps.roughness.flatten().tolist() == pytest.approx([0.54] * 4)
    assert maps.metallic.flatten().tolist() == pytest.approx([0.5] * 4)
    assert maps.normal[0, 0, 0].tolist() == [0, 0, 1]


def test_channel_order_and_ends_of_the_ranges() -> None:
    logits = torch.tensor([40.0, -40, -40, 40, -40, 40, -40, -40]).reshape(1, 8, 1, 1)
    maps = decode(logits, min_roughness=0.08, normal_strength=0.1)
    assert maps.base_color.flatten().tolist() == pytest.approx([1, 0, 0], abs=1e-6)
    assert maps.roughness.item() == pytest.approx(1)
    assert maps.metallic.item() == pytest.approx(0, abs=1e-6)
    length = math.sqrt(0.1**2 + 0.1**2 + 0.9**2)
    assert maps.normal.flatten().tolist() == pytest.approx([0.1 / length, -0.1 / length, 0.9 / length])
    assert decode(-logits, 0.08, 0.1).roughness.item() == pytest.approx(0.08)


def test_gradient_against_finite_differences() -> None:
    """On both branches of the sRGB curve (it is linear below a logit of -3.2)."""
    logits = 3 * torch.randn(2, 8, 3, 5, generator=seeded(), dtype=torch.float64)
    logits[0, :3, 0] = -4 + 0.1 * logits[0, :3, 0]
    assert torch.autograd.gradcheck(lambda x: decode(x, 0.08, 0.1).packed(), logits.requires_grad_())


def test_packing_what_was_packed_costs_nothing_and_is_never_stale() -> None:
    packed = torch.rand(1, 4, 4, 8, generator=seeded())
    maps = TextureMaps.unpacked(packed)
    assert maps.packed() is packed
    white = dataclasses.replace(maps, base_color=torch.ones(1, 4, 4, 3))
    assert torch.equal(white.packed(), torch.cat([torch.ones(1, 4, 4, 3), packed[..., 3:]], -1))


@pytest.mark.parametrize("config", [SMALL, HALF, PIXELS], ids=name)
def test_maps_have_their_ranges_whatever_the_parameters(config: TextureConfig) -> None:
    field = make_field(config, 2, seeded())
    for parameter in field.parameters():
        parameter.data = 30 * torch.randn(parameter.shape, generator=seeded(1))
    maps = field()
    assert maps.layers == 2
    assert maps.size == (config.size, config.size)
    assert maps.packed().shape == (2, config.size, config.size, 8)
    assert maps.base_color.std() > 0.1, "the parameters reach far into both ends"
    assert maps.base_color.min() >= 0
    assert maps.base_color.max() <= 1
    assert maps.roughness.min() >= 0.08
    assert maps.roughness.max() <= 1
    assert maps.metallic.min() >= 0
    assert maps.metallic.max() <= 1
    torch.testing.assert_close(maps.normal.norm(dim=-1), torch.ones(2, config.size, config.size))
    assert maps.normal[..., 2].min() > 0.9
    assert maps.packed().dtype == torch.float32


@pytest.mark.parametrize("config", [SMALL, HALF, PIXELS], ids=name)
def test_one_seed_one_field(config: TextureConfig) -> None:
    before = torch.get_rng_state()
    a, b, other = (make_field(config, 2, seeded(s))().packed() for s in (0, 0, 1))
    assert torch.equal(before, torch.get_rng_state())
    assert torch.equal(a, b)
    assert not torch.equal(a, other)


@pytest.mark.parametrize("config", [SMALL, HALF, PIXELS], ids=name)
def test_state_restores_the_field(config: TextureConfig) -> None:
    field, fresh = make_field(config, 1, seeded()), make_field(config, 1, seeded())
    for parameter in field.parameters():
        parameter.data += 0.1
    assert not torch.equal(field().packed(), fresh().packed())
    fresh.load_state_dict(field.state_dict())
    assert torch.equal(field().packed(), fresh().packed())


def test_noise_is_standard_fixed_and_different_in_each_layer() -> None:
    field = make_field(SMALL, 2, seeded())
    assert isinstance(field, DCPBR)
    assert field.noise.shape == (2, 3, 32, 32)
    torch.testing.assert_close(field.noise.mean((2, 3)), torch.zeros(2, 3), atol=1e-6, rtol=0)
    torch.testing.assert_close(field.noise.std((2, 3)), torch.ones(2, 3))
    assert not torch.equal(field.noise[0], field.noise[1])
    assert not field.noise.requires_grad
    assert torch.equal(field().packed(), field().packed())


def test_layers_are_independent() -> None:
    field = make_field(SMALL, 2, seeded())
    assert isinstance(field, DCPBR)
    before = field().packed()
    field.noise[1] = field.noise[1].flip(-1) * torch.linspace(0, 2, 32)
    after = field().packed()
    assert torch.equal(before[0], after[0])
    assert not torch.equal(before[1], after[1])


def test_enlarging_by_hand() -> None:
    x = torch.tensor([[1.0, 3.0], [5.0, 7.0]]).reshape(1, 1, 2, 2)
    row = torch.tensor([1.0, 1.5, 2.5, 3.0])  # centres of the fine pixels at -1/4, 1/4, 3/4, 5/4 of the coarse ones
    assert torch.equal(enlarge(x, 2)[0, 0], row + torch.tensor([0.0, 1.0, 3.0, 4.0])[:, None])
    assert enlarge(x, 1) is x


@pytest.mark.parametrize("factor", [1, 2, 4, 8])
def test_enlarging_by_slices_is_enlarging(factor: int) -> None:
    x = torch.randn(2, 3, 5, 6, generator=seeded(), dtype=torch.float64, requires_grad=True)
    fast, slices = enlarge(x, factor), enlarge_slices(x, factor)
    assert fast.shape == (2, 3, 5 * factor, 6 * factor)
    torch.testing.assert_close(slices, fast)
    direction = torch.randn(fast.shape, generator=seeded(1), dtype=torch.float64)
    wanted, got = (torch.autograd.grad((y * direction).sum(), x)[0] for y in (fast, slices))
    torch.testing.assert_close(got, wanted)


def test_the_network_runs_at_the_size_over_upsample() -> None:
    half, full = make_field(HALF, 1, seeded()), make_field(SMALL, 1, seeded())
    assert isinstance(half, DCPBR)
    assert isinstance(full, DCPBR)
    assert torch.equal(half.noise, full.noise)
    logits = enlarge(full.unet(full.noise), 2)
    assert torch.equal(half().packed(), decode(logits, HALF.min_roughness, HALF.normal_strength).packed())


def test_upsampled_gradients_are_the_same_twice() -> None:
    grads = []
    for _ in range(2):
        field = make_field(HALF, 1, seeded())
        field().packed().square().sum().backward()
        grads.append([p.grad for p in field.parameters()])
    assert grads[0][0].abs().max() > 0
    assert all(torch.equal(p, q) for p, q in zip(*grads, strict=True))


def test_pixels_ignore_upsampling() -> None:
    config = dataclasses.replace(PIXELS, size=15, upsample=2)
    assert torch.equal(make_field(config, 1, seeded())().packed(),
                       make_field(dataclasses.replace(config, upsample=1), 1, seeded())().packed())  # fmt: skip


def test_pixels_start_mid_grey_and_move_alone() -> None:
    field = make_field(PIXELS, 1, seeded())
    assert isinstance(field, Pixels)
    maps = field()
    assert (maps.base_color - ((0.5 + 0.055) / 1.055) ** 2.4).abs().max() < 0.02
    assert maps.metallic.std() > 0
    maps.metallic[0, 3, 5, 0].backward()
    assert field.logits.grad is not None
    assert field.logits.grad.nonzero().tolist() == [[0, 4, 3, 5]]


def test_total_variation_by_hand() -> None:
    image = torch.tensor([[0.0, 1.0, 3.0], [0.5, 1.0, 1.0]]).reshape(1, 1, 2, 3)
    # horizontal |1|, |2|, |0.5|, |0| over 4; vertical |0.5|, |0|, |2| over 3
    assert total_variation(image).item() == pytest.approx(3.5 / 4 + 2.5 / 3)


def test_regularization_is_weighted_and_reads_base_colour_alone() -> None:
    field = make_field(dataclasses.replace(PIXELS, tv_weight=0.5), 1, seeded())
    assert isinstance(field, Pixels)
    field.logits.data.zero_()
    field.logits.data[:, 3:] = torch.randn(1, 5, 16, 16, generator=seeded())
    assert field.regularization().item() == 0
    field.logits.data[:, 0, :, 8:] = 40.0  # one step of 0.5 in one of 3 channels, in one of 15 columns of differences
    assert field.regularization().item() == pytest.approx(0.5 * 0.5 / 3 / 15, rel=1e-5)
    field.regularization().backward()
    assert field.logits.grad is not None
    assert field.logits.grad[:, 3:].abs().max() == 0


@pytest.mark.parametrize("config", [SMALL, HALF, PIXELS], ids=name)
def test_no_regularization_by_default(config: TextureConfig) -> None:
    assert make_field(config, 1, seeded()).regularization().item() == 0


@pytest.mark.parametrize("kind", ["dcpbr", "pixels"])
def test_gradient_descent_reaches_a_given_texture(kind: str) -> None:
    def target(size: int) -> torch.Tensor:
        ramp = torch.linspace(0.2, 0.8, size)
        return torch.stack([ramp.expand(size, size), ramp.expand(size, size).T, torch.full((size, size), 0.5)], -1)

    field: TextureField = make_field(dataclasses.replace(SMALL, kind=kind), 1, seeded())
    optimizer = torch.optim.Adam(field.parameters(), lr=0.02 if kind == "dcpbr" else 0.1)
    losses = []
    for _ in range(60):
        loss = (field().base_color[0] - target(32)).square().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(loss.item())
    assert losses[-1] < losses[0] / 20


@pytest.mark.parametrize(
    ("change", "code", "value"),
    [
        ({"size": 0}, "texture.size", "0"),
        ({"size": -512}, "texture.size", "-512"),
        ({"size": 36}, "texture.size", "36"),
        ({"size": 8}, "texture.size", "8"),
        ({"upsample": 0}, "texture.upsample", "0"),
        ({"upsample": 3}, "texture.upsample", "3"),
        ({"upsample": -2}, "texture.upsample", "-2"),
        ({"upsample": 2, "size": 40}, "texture.size", "40 does not suit a U-Net of 3 levels at 1/2 of it"),
        ({"upsample": 4}, "texture.size", "32"),
        ({"kind": "pixels", "size": 0}, "texture.size", "0"),
        ({"kind": "voxels"}, "texture.kind", "voxels"),
        ({"maps": "diffuse"}, "texture.maps", "diffuse"),
        ({"min_roughness": 1.5}, "texture.min_roughness", "1.5"),
        ({"normal_strength": -0.1}, "texture.normal_strength", "-0.1"),
        ({"normal_strength": math.nan}, "texture.normal_strength", "nan"),
        ({"tv_weight": -1.0, "kind": "pixels"}, "texture.tv_weight", "-1.0"),
        ({"tv_weight": 1.0}, "texture.tv_weight", "dcpbr"),
        ({"widths": (8, 12)}, "texture.skip_widths", "(4, 6, 8)"),
    ],
)
def test_refusals_name_the_value(change: dict, code: str, value: str) -> None:
    with pytest.raises(UsageError) as caught:
        make_field(dataclasses.replace(SMALL, **change), 1, seeded())
    assert caught.value.code == code
    assert value in caught.value.message
    assert caught.value.hint


def test_no_layers_is_refused() -> None:
    with pytest.raises(UsageError, match="0 texture layers"):
        make_field(SMALL, 0, seeded())


@pytest.mark.parametrize("kind", ["dcpbr", "pixels", "hash-grid", "points"])
def test_base_colour_alone_is_learned_on_a_matte_surface(kind: str) -> None:
    points = torch.rand(1, 32, 32, 3, generator=seeded())
    config = dataclasses.replace(SMALL, kind=kind, maps="base_color")
    field = make_field(config, 1, seeded(), points)
    whole = make_field(dataclasses.replace(config, maps="pbr"), 1, seeded(), points)
    count, more = (sum(p.numel() for p in f.parameters()) for f in (field, whole))
    assert count < more
    maps = field()
    assert maps.packed()[..., 3:].flatten(0, 2).unique(dim=0).tolist() == [[1, 0, 0, 0, 1]]
    assert maps.size == (32, 32)
    maps.base_color.sum().backward()
    assert all(p.grad is not None and p.grad.abs().max() > 0 for p in field.parameters())
