"""An analytic prior whose optimum is known, for tests of the whole loop: Gaussian data around a known surface colour.

Its images are x ~ N(mu, s^2 I) in each view, where mu is a function of the visible surface point. The best noise
prediction is then closed form at every t, and score distillation drives any field to mu, whatever prompt and scale.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import torch
from torch import Tensor

from paintit.guidance.prior import PriorSpec, ReadChannel, SeeChannel

#: Positions (..., 3) in normalised space -> (..., 5): sRGB-coded base colour, roughness, metalness, in [0, 1].
Target = Callable[[Tensor], Tensor]


def smooth_target(position: Tensor) -> Tensor:
    """A smooth colour field: base colour in [0.15, 0.85], roughness and metalness in [0.3, 0.7], from sines."""
    x, y, z = position.unbind(-1)
    base_color = 0.5 + 0.35 * torch.stack([torch.sin(3 * x + y), torch.sin(3 * y + z), torch.sin(3 * z + x)], -1)
    material = 0.5 + 0.2 * torch.stack([torch.sin(2 * x - z), torch.cos(2 * y + x)], -1)
    return torch.cat([base_color, material], -1)


class ExactPrior:
    """Denoises base colour, roughness and metalness as (n, 5, h, w) in [-1, 1], at the size they are rendered.

    Text is ignored: the conditional and the unconditional prediction are the same, so the guidance scale is without
    effect and the optimum is ``target`` alone.

    Args:
        target: the optimum, as a function of the surface point.
        deviation: s; 0 makes every gradient noise-free, more leaves the noise that a real prior's spread causes.
    """

    reads: tuple[ReadChannel, ...] = ("base_color", "roughness", "metallic")
    sees: tuple[SeeChannel, ...] = ("position", "mask")
    bound: float = math.inf

    def __init__(self, target: Target = smooth_target, deviation: float = 0.0) -> None:
        self.target = target
        self.deviation = deviation
        self.spec = PriorSpec(id="exact", family="exact", licence="Apache-2.0", resolution=64, guidance_scale=1.0)

    def encode_text(self, prompts: Sequence[str]) -> Tensor:
        """(n, 1) zeros."""
        return torch.zeros(len(prompts), 1)

    def encode_image(self, channels: Mapping[str, Tensor]) -> Tensor:
        """[0, 1] channels (n, h, w, c) -> (n, 5, h, w) in [-1, 1]."""
        return 2 * torch.cat([channels[name] for name in self.reads], -1).permute(0, 3, 1, 2) - 1

    def decode_image(self, x: Tensor) -> dict[str, Tensor]:
        """(n, 5, h, w) in [-1, 1] -> the ``reads`` channels (n, h, w, c) in [0, 1]."""
        base_color, roughness, metallic = ((x.movedim(1, -1) + 1) / 2).clamp(0, 1).split([3, 1, 1], -1)
        return {"base_color": base_color, "roughness": roughness, "metallic": metallic}

    def encode_geometry(self, channels: Mapping[str, Tensor]) -> Tensor:
        """mu of each view, (n, 5, h, w) in [-1, 1]; 0, mid grey, off the mask."""
        mask = channels["mask"]
        mu = torch.where(mask > 0, 2 * self.target(channels["position"]) - 1, 0.0)
        return mu.permute(0, 3, 1, 2).detach()

    def alpha_sigma(self, t: float) -> tuple[float, float]:
        """Signal and noise levels of the cosine schedule."""
        return math.cos(math.pi / 2 * t), math.sin(math.pi / 2 * t)

    def add_noise(self, x: Tensor, noise: Tensor, t: float) -> Tensor:
        alpha, sigma = self.alpha_sigma(t)
        return alpha * x + sigma * noise

    @torch.no_grad()
    def predict_noise(self, x_t: Tensor, t: float, text: Tensor, geometry: Tensor | None = None) -> Tensor:
        """E[epsilon | x_t] = sigma (x_t - alpha mu) / (alpha^2 s^2 + sigma^2): the posterior mean for Gaussian data."""
        if geometry is None:
            raise ValueError("the exact prior needs the geometry of the views")
        alpha, sigma = self.alpha_sigma(t)
        return sigma * (x_t - alpha * geometry) / (alpha**2 * self.deviation**2 + sigma**2)

    def weight(self, t: float) -> float:
        """sigma(t)^2 = 1 - alphabar(t)."""
        return self.alpha_sigma(t)[1] ** 2
