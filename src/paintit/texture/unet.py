"""The convolutional generator: Deep Image Prior's hourglass with skip connections (paper 3.3, supp. A.1).

Channels first throughout. The network knows nothing of PBR: noise (layers, c, h, w) in, logits (layers, c', h, w) out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

from paintit.device import native_bfloat16
from paintit.errors import UsageError

#: Slope of every LeakyReLU for negative values.
SLOPE = 0.2


def reflect(x: Tensor) -> Tensor:
    """Reflection padding by one pixel, (n, c, h, w) -> (n, c, h + 2, w + 2)."""
    # Elsewhere than on the CPU the backward pass of torch's own padding adds in no fixed order.
    return functional.pad(x, (1, 1, 1, 1), mode="reflect") if x.device.type == "cpu" else reflect_slices(x)


def reflect_slices(x: Tensor) -> Tensor:
    """:func:`reflect` from joined slices: slower, but its gradient is the same at every run on every device."""
    x = torch.cat([x[:, :, 1:2], x, x[:, :, -2:-1]], 2)
    return torch.cat([x[..., 1:2], x, x[..., -2:-1]], 3)


class Conv(nn.Module):
    """A 1x1 or reflection-padded 3x3 convolution whose weights come from ``generator`` alone.

    Weights, and the bias where there is one, start as U(-1, 1) / sqrt(fan in).
    """

    def __init__(
        self, inputs: int, outputs: int, size: int, generator: torch.Generator, *, stride: int = 1, bias: bool = False
    ) -> None:
        super().__init__()
        self.stride = stride
        bound = 1 / math.sqrt(inputs * size * size)

        def uniform(*shape: int) -> nn.Parameter:
            return nn.Parameter(bound * (2 * torch.rand(shape, generator=generator) - 1))

        self.weight = uniform(outputs, inputs, size, size)
        self.bias = uniform(outputs) if bias else None

    def forward(self, x: Tensor) -> Tensor:
        if self.weight.shape[-1] == 3:
            x = reflect(x)
        return functional.conv2d(x, self.weight, self.bias, self.stride)


class Norm(nn.Module):
    """Instance normalisation: each channel to zero mean and unit variance over its pixels, then scale and shift.

    The official script's BatchNorm, always in training mode with a batch of one, is exactly this. There are no running
    statistics: evaluation is the same. The batch must be of one sample (:meth:`UNet.forward` sees to it).
    """

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.ones(channels))
        self.bias = nn.Parameter(torch.zeros(channels))

    def forward(self, x: Tensor) -> Tensor:
        return functional.batch_norm(x, None, None, self.weight, self.bias, training=True, eps=1e-5)


def activate(x: Tensor) -> Tensor:
    # In place: a normalisation, whose output this always is, keeps only its input for the backward pass.
    return functional.leaky_relu(x, SLOPE, inplace=True)


def upsample_conv(x: Tensor, weight: Tensor) -> Tensor:
    """Nearest upsampling by 2 and then a reflection-padded 3x3 convolution: (n, c, h, w) -> (n, o, 2h, 2w).

    Of the 3x3 pixels that an output pixel reads, those with one source are summed into one tap: four kernels on the
    coarse grid, one for each place in a 2x2 block. Nothing of the fine size is held but the output. Reflecting the
    upsampled image repeats the border of the coarse one.
    """
    # [place in the block, coarse tap, fine tap]: an even pixel reads one tap of its left neighbour and two of its own
    # source, an odd pixel two of its own and one of the right neighbour.
    taps = weight.new_tensor([[[1, 0, 0], [0, 1, 1], [0, 0, 0]], [[0, 0, 0], [1, 1, 0], [0, 0, 1]]])
    kernels = torch.einsum("pak,qbl,oikl->opqiab", taps, taps, weight).flatten(0, 2)
    x = torch.cat([x[:, :, :1], x, x[:, :, -1:]], 2)
    x = torch.cat([x[..., :1], x, x[..., -1:]], 3)
    return functional.pixel_shuffle(functional.conv2d(x, kernels), 2)


class Level(nn.Module):
    """One resolution of the hourglass. The next coarser level runs between :meth:`down` and :meth:`up`."""

    def __init__(self, inputs: int, width: int, skip_width: int, coarser: int, generator: torch.Generator) -> None:
        super().__init__()
        if skip_width:
            self.skip = Conv(inputs, skip_width, 1, generator)
            self.skip_norm = Norm(skip_width)
            self.joined_skip_norm = Norm(skip_width)
        self.skip_width = skip_width
        self.down_1 = Conv(inputs, width, 3, generator, stride=2)
        self.down_1_norm = Norm(width)
        self.down_2 = Conv(width, width, 3, generator)
        self.down_2_norm = Norm(width)
        self.joined_norm = Norm(coarser)
        self.up_1 = Conv(skip_width + coarser, width, 3, generator)
        self.up_1_norm = Norm(width)
        self.up_2 = Conv(width, width, 1, generator)
        self.up_2_norm = Norm(width)

    def down(self, x: Tensor) -> Tensor:
        """(n, inputs, h, w) -> (n, width, h / 2, w / 2)."""
        x = activate(self.down_1_norm(self.down_1(x)))
        return activate(self.down_2_norm(self.down_2(x)))

    def up(self, x: Tensor, coarse: Tensor) -> Tensor:
        """``x`` as given to :meth:`down` and (n, coarser, h / 2, w / 2) from below -> (n, width, h, w)."""
        # The published network upsamples, concatenates the skip, normalises and convolves. Normalisation is per channel
        # and nearest upsampling changes neither mean nor variance, so each half is normalised apart, the coarse one
        # while it is small; and a convolution of a concatenation is the sum of the convolutions of its parts.
        skip_weight, coarse_weight = self.up_1.weight.split([self.skip_width, coarse.shape[1]], 1)
        joined = upsample_conv(self.joined_norm(coarse), coarse_weight)
        if self.skip_width:
            skip = self.joined_skip_norm(activate(self.skip_norm(self.skip(x))))
            joined = joined + functional.conv2d(reflect(skip), skip_weight)
        x = activate(self.up_1_norm(joined))
        return activate(self.up_2_norm(self.up_2(x)))


class UNet(nn.Module):
    """Hourglass with skip connections: noise (n, input_channels, h, w) -> logits (n, output_channels, h, w) float32.

    With the official hyper-parameters (five levels of 128 channels down, up and skip; 3 channels in, 8 out) it has
    2,962,952 parameters. The public architecture counts 2,966,152: it also has biases in front of normalisations,
    which cancel them exactly.

    Args:
        widths: channels at each level, finest first.
        skip_widths: channels of the 1x1 skip connection at each level; 0 for none (supp. B.2).
        generator: the only source of the initial weights.
        precision: ``float32``; ``bfloat16`` computes in it, keeping weights, statistics and output in float32; ``auto``
            takes bfloat16 where the device has it.

    Raises:
        UsageError: widths that do not describe a network.
    """

    def __init__(
        self,
        input_channels: int,
        output_channels: int,
        widths: Sequence[int],
        skip_widths: Sequence[int],
        generator: torch.Generator,
        *,
        precision: str = "float32",
    ) -> None:
        super().__init__()
        if not widths or min(widths) < 1:
            raise UsageError("texture.widths", f"the U-Net's widths are {tuple(widths)}", "give positive widths")
        if len(skip_widths) != len(widths) or min(skip_widths) < 0:
            raise UsageError(
                "texture.skip_widths",
                f"{len(widths)} levels have skip widths {tuple(skip_widths)}",
                "give one number for each level, 0 for no skip connection",
            )
        if input_channels < 1:
            raise UsageError("texture.input_channels", f"the noise has {input_channels} channels", "give 1 or more")
        self.precision = precision
        inputs = [input_channels, *widths[:-1]]
        coarser = [*widths[1:], widths[-1]]
        self.levels = nn.ModuleList(
            Level(i, w, s, c, generator) for i, w, s, c in zip(inputs, widths, skip_widths, coarser, strict=True)
        )
        self.head = Conv(widths[0], output_channels, 1, generator, bias=True)

    def forward(self, noise: Tensor) -> Tensor:
        """``noise`` (n, input_channels, h, w); h and w are multiples of 2 to the number of levels, at least twice that.

        Samples go through one by one, so each is normalised by its own statistics and none depends on the others.
        """
        return torch.cat([self._one(sample) for sample in noise.split(1)])

    def _one(self, noise: Tensor) -> Tensor:
        low = self.precision == "bfloat16" or (self.precision == "auto" and native_bfloat16(noise.device))
        with torch.autocast(noise.device.type, torch.bfloat16, enabled=low):
            x = noise.contiguous(memory_format=torch.channels_last)
            levels = [level for level in self.levels if isinstance(level, Level)]
            inputs = []
            for level in levels:
                inputs.append(x)
                x = level.down(x)
            for level, finer in zip(reversed(levels), reversed(inputs), strict=True):
                x = level.up(finer, x)
        # A 1x1 convolution of few channels is quicker as the matrix product that it is.
        head = self.head
        pixels = x.to(head.weight.dtype).movedim(1, -1)
        return functional.linear(pixels, head.weight[:, :, 0, 0], head.bias).movedim(-1, 1)
