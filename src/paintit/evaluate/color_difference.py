"""CIEDE2000, the colour difference that material accuracy is told in."""

from __future__ import annotations

import math

import torch
from torch import Tensor


def ciede2000(one: Tensor, two: Tensor) -> Tensor:
    """Colour difference (...) of L*a*b* colours (..., 3), all weights 1 (Sharma, Wu and Dalal 2005).

    About 1 can just be seen side by side.
    """
    (l1, a1, b1), (l2, a2, b2) = one.double().unbind(-1), two.double().unbind(-1)
    mean = (torch.hypot(a1, b1) + torch.hypot(a2, b2)) / 2
    gain = 1.5 - 0.5 * (mean**7 / (mean**7 + 25.0**7)).sqrt()
    a1, a2 = gain * a1, gain * a2
    c1, c2 = torch.hypot(a1, b1), torch.hypot(a2, b2)
    h1, h2 = (torch.atan2(b, a) % (2 * math.pi) for a, b in ((a1, b1), (a2, b2)))
    grey = c1 * c2 == 0
    turn = h2 - h1
    turn = torch.where(turn > math.pi, turn - 2 * math.pi, torch.where(turn < -math.pi, turn + 2 * math.pi, turn))
    turn = torch.where(grey, 0.0, turn)
    lightness, colour, hue = l2 - l1, c2 - c1, 2 * (c1 * c2).sqrt() * (turn / 2).sin()
    l, c = (l1 + l2) / 2, (c1 + c2) / 2
    far = (h1 - h2).abs() > math.pi
    h = torch.where(far, (h1 + h2 + torch.where(h1 + h2 < 2 * math.pi, 2, -2) * math.pi) / 2, (h1 + h2) / 2)
    h = torch.where(grey, h1 + h2, h)
    degrees = math.pi / 180
    t = (
        1
        - 0.17 * (h - 30 * degrees).cos()
        + 0.24 * (2 * h).cos()
        + 0.32 * (3 * h + 6 * degrees).cos()
        - 0.20 * (4 * h - 63 * degrees).cos()
    )
    blue = 30 * degrees * (-(((h / degrees - 275) / 25) ** 2)).exp()
    rotation = -(2 * blue).sin() * 2 * (c**7 / (c**7 + 25.0**7)).sqrt()
    lightness = lightness / (1 + 0.015 * (l - 50) ** 2 / (20 + (l - 50) ** 2).sqrt())
    colour, hue = colour / (1 + 0.045 * c), hue / (1 + 0.015 * c * t)
    return (lightness.square() + colour.square() + hue.square() + rotation * colour * hue).clamp_min(0).sqrt()
