"""The convolutional generator: size, agreement with a plain twin, determinism, independence of samples."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor
from torch.nn import functional

from paintit.config import PAPER, POCKET
from paintit.errors import UsageError
from paintit.texture.unet import Level, UNet, reflect, reflect_slices


def seeded(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def small(skip_widths: tuple[int, ...] = (4, 6, 8), **options: bool) -> UNet:
    return UNet(3, 8, (8, 12, 16), skip_widths, seeded(), **options)


def noise(count: int = 1, size: int = 32) -> Tensor:
    return torch.randn(count, 3, size, size, generator=seeded(1))


def twin(net: UNet, x: Tensor) -> Tensor:
    """The published architecture as its figure has it: upsample, concatenate, normalise, convolve."""

    def norm(x: Tensor, *parts: torch.nn.Module) -> Tensor:
        weight = torch.cat([part.weight for part in parts])
        bias = torch.cat([part.bias for part in parts])
        mean, variance = x.mean((2, 3), keepdim=True), x.var((2, 3), correction=0, keepdim=True)
        return (x - mean) / (variance + 1e-5).sqrt() * weight[:, None, None] + bias[:, None, None]

    def conv(x: Tensor, weight: Tensor, stride: int = 1) -> Tensor:
        pad = weight.shape[-1] // 2
        return functional.conv2d(functional.pad(x, (pad,) * 4, mode="reflect"), weight, stride=stride)

    def act(x: Tensor) -> Tensor:
        return torch.where(x > 0, x, 0.2 * x)

    def hourglass(x: Tensor, levels: list[Level]) -> Tensor:
        level, *deeper = levels
        down = act(norm(conv(x, level.down_1.weight, 2), level.down_1_norm))
        down = act(norm(conv(down, level.down_2.weight), level.down_2_norm))
        coarse = hourglass(down, deeper) if deeper else down
        joined, norms = coarse.repeat_interleave(2, 2).repeat_interleave(2, 3), [level.joined_norm]
        if level.skip_width:
            joined = torch.cat([act(norm(conv(x, level.skip.weight), level.skip_norm)), joined], 1)
            norms = [level.joined_skip_norm, *norms]
        up = act(norm(conv(norm(joined, *norms), level.up_1.weight), level.up_1_norm))
        return act(norm(conv(up, level.up_2.weight), level.up_2_norm))

    out = hourglass(x, [level for level in net.levels if isinstance(level, Level)])
    return functional.conv2d(out, net.head.weight, net.head.bias)


def parameters(net: UNet) -> int:
    return sum(parameter.numel() for parameter in net.parameters())


def test_official_parameter_count() -> None:
    texture = PAPER.texture
    net = UNet(texture.input_channels, 8, texture.widths, texture.skip_widths, seeded())
    first = 3 * 128 + 3 * 128 * 9  # skip, first down: 3 channels in
    others = 128 * 128 + 128 * 128 * 9
    each = 128 * 128 * 9 + 256 * 128 * 9 + 128 * 128  # second down, 3x3 up on the concatenation, 1x1 up
    norms = 2 * (128 + 128 + 128 + 256 + 128 + 128)
    assert parameters(net) == first + 4 * others + 5 * (each + norms) + 128 * 8 + 8 == 2_962_952


@pytest.mark.parametrize("skip_widths", [(4, 6, 8), (0, 0, 0), (4, 0, 8)])
def test_agrees_with_the_plain_twin(skip_widths: tuple[int, ...]) -> None:
    net, z = small(skip_widths).double(), noise().double()
    for i, parameter in enumerate(net.parameters()):  # away from unit scale and zero shift
        parameter.data += 0.1 * torch.randn(parameter.shape, generator=seeded(i), dtype=torch.float64)
    fast, slow = net(z), twin(net, z)
    assert slow.std() > 0.1
    torch.testing.assert_close(fast, slow, rtol=0, atol=1e-10)
    direction = torch.randn(slow.shape, generator=seeded(2), dtype=torch.float64)
    parts = list(net.parameters())
    got = torch.autograd.grad((fast * direction).sum(), parts)
    wanted = torch.autograd.grad((slow * direction).sum(), parts)
    for a, b in zip(got, wanted, strict=True):
        torch.testing.assert_close(a, b, rtol=1e-7, atol=1e-9)


def test_without_skips_there_are_no_skip_parameters() -> None:
    net = small((0, 0, 0))
    assert not [name for name, _ in net.named_parameters() if "skip" in name]
    # skip convolutions, their norms, the norms after joining, and what the 3x3 reads of them
    skips = (3 * 4 + 8 * 6 + 12 * 8) + 4 * (4 + 6 + 8) + 9 * (4 * 8 + 6 * 12 + 8 * 16)
    assert parameters(small()) - parameters(net) == skips


def test_output_shape_and_type() -> None:
    out = UNet(16, 8, POCKET.texture.widths, POCKET.texture.skip_widths, seeded())(torch.randn(2, 16, 64, 96))
    assert out.shape == (2, 8, 64, 96)
    assert out.dtype == torch.float32


def test_weights_come_from_the_generator_alone() -> None:
    before = torch.get_rng_state()
    a, b, other = small(), small(), UNet(3, 8, (8, 12, 16), (4, 6, 8), seeded(5))
    assert torch.equal(before, torch.get_rng_state()), "torch's global generator is left alone"
    assert all(torch.equal(p, q) for p, q in zip(a.parameters(), b.parameters(), strict=True))
    assert not torch.equal(a.head.weight, other.head.weight)
    assert torch.equal(a(noise()), b(noise()))


def test_gradients_are_the_same_twice() -> None:
    grads = []
    for _ in range(2):
        net = small()
        net(noise()).square().sum().backward()
        grads.append([p.grad for p in net.parameters()])
    assert all(torch.equal(p, q) for p, q in zip(*grads, strict=True))


def test_samples_do_not_know_each_other() -> None:
    net, z = small(), noise(3)
    changed = z.clone()
    changed[1] *= 3 * torch.linspace(0, 1, 32)
    assert torch.equal(net(z)[0], net(changed)[0])
    assert torch.equal(net(z)[2], net(z[2:])[0]), "a sample alone gives what it gives among others"
    assert not torch.equal(net(z)[1], net(changed)[1])


def test_evaluation_is_the_same_as_training() -> None:
    net = small()
    assert torch.equal(net.train()(noise()), net.eval()(noise()))


def test_bfloat16_is_near_and_returns_float32() -> None:
    exact, coarse = small()(noise()), small(precision="bfloat16")(noise())
    assert coarse.dtype == torch.float32
    assert not torch.equal(exact, coarse)
    assert (exact - coarse).norm() / exact.norm() < 0.05


def test_reflection_by_slices_is_reflection() -> None:
    x = torch.arange(24.0).reshape(1, 2, 3, 4)
    assert torch.equal(reflect_slices(x), functional.pad(x, (1, 1, 1, 1), mode="reflect"))
    assert torch.equal(reflect(x), reflect_slices(x))


@pytest.mark.parametrize(
    ("channels", "widths", "skips", "value"),
    [
        (3, (), (), "()"),
        (3, (8, 0), (4, 4), "(8, 0)"),
        (3, (8, 8), (4,), "(4,)"),
        (3, (8,), (-1,), "(-1,)"),
        (0, (8,), (4,), "0 channels"),
    ],
)
def test_widths_that_describe_no_network(channels: int, widths: tuple, skips: tuple, value: str) -> None:
    with pytest.raises(UsageError) as caught:
        UNet(channels, 8, widths, skips, seeded())
    assert value in caught.value.message
