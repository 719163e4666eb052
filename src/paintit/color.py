"""Colour: the sRGB transfer function, luminance, exposure. Pure functions on tensors of any shape.

The renderer is linear throughout. Two doors encode: images handed to a diffusion prior, and the base colour file.
"""

from __future__ import annotations

import torch
from torch import Tensor

#: Rec. 709 luminance weights for linear RGB.
LUMINANCE = (0.2126, 0.7152, 0.0722)


def encode_srgb(linear: Tensor) -> Tensor:
    """Linear [0, 1] -> sRGB-coded [0, 1] (IEC 61966-2-1); values outside are clamped. Gradient is finite at 0."""
    x = linear.clamp(0.0, 1.0)
    return torch.where(x <= 0.0031308, 12.92 * x, 1.055 * x.clamp_min(0.0031308).pow(1 / 2.4) - 0.055)


def decode_srgb(coded: Tensor) -> Tensor:
    """sRGB-coded [0, 1] -> linear [0, 1] (IEC 61966-2-1)."""
    return torch.where(coded <= 0.04045, coded / 12.92, ((coded.clamp_min(0.04045) + 0.055) / 1.055).pow(2.4))


def luminance(linear: Tensor) -> Tensor:
    """Rec. 709 luminance of linear RGB, (..., 3) -> (...)."""
    return (linear * linear.new_tensor(LUMINANCE)).sum(-1)


#: Linear Rec. 709 RGB -> CIE XYZ, each row over the white point's (D65) value.
_XYZ = ((0.433950, 0.376210, 0.189840), (0.212673, 0.715152, 0.072175), (0.017757, 0.109468, 0.872775))


def lab(linear: Tensor) -> Tensor:
    """Linear RGB [0, 1] -> CIELAB under D65 (CIE 1976), (..., 3) -> (..., 3). White is (100, 0, 0)."""
    xyz = linear @ linear.new_tensor(_XYZ).T
    f = torch.where(xyz > (6 / 29) ** 3, xyz.clamp_min(1e-9).pow(1 / 3), xyz * (29 / 6) ** 2 / 3 + 4 / 29)
    x, y, z = f.unbind(-1)
    return torch.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], -1)
