"""What the network is taught before it learns to denoise: what a sentence says, and where a pattern lies.

Denoising teaches both, but slowly: most of its loss is about noise. The first lesson is text alone, on as many fresh
sentences as it likes; the second is the last layers alone, at the noise level where nothing but text and place is left.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as F
from captions import random_caption
from gbuffers import ARCHETYPES
from patterns import KINDS
from surfaces import Layer, Material
from torch import Tensor, nn

from paintit.guidance.pocket_net import PocketNet, sinusoids

#: Columns of a sentence's target: base layer, first overlay, log frequency and share of where it lies.
COLUMNS = 5 + 5 + 2
#: Variance of the material channels, in [-1, 1], under which a pattern counts as faint.
FAINT = 0.01
Log = Callable[[dict[str, object]], None]


def _layer(layer: Layer) -> list[float]:
    return [*(2 * c - 1 for c in layer.color), 2 * layer.rough - 1, 2 * layer.metal - 1]


@dataclass(frozen=True)
class Said:
    """What a batch of sentences says: targets (n, COLUMNS), their weights, and the kind of the overlay (n,), 0 none."""

    values: Tensor
    weights: Tensor
    kind: Tensor


def said(materials: list[Material]) -> Said:
    """Targets of a batch."""
    values, weights, kinds = [], [], []
    for m in materials:
        other, split = m.overlays[0] if m.overlays else (m.base, None)
        where = [math.log(split.scale), 2 * split.share - 1] if split else [0.0, 0.0]
        values.append([*_layer(m.base), *_layer(other), *where])
        weights.append([1.0] * 5 + [float(split is not None)] * (COLUMNS - 5))
        kinds.append(KINDS.index(split.kind) if split else 0)
    return Said(torch.tensor(values), torch.tensor(weights), torch.tensor(kinds))


class Sentences:
    """Endless fresh captions with their materials."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng([seed, 77])

    def __call__(self, count: int) -> tuple[list[str], Said]:
        pairs = [random_caption(self.rng, ARCHETYPES[int(self.rng.integers(len(ARCHETYPES)))]) for _ in range(count)]
        return [text for text, _ in pairs], said([m for _, m in pairs])


class Reading(nn.Module):
    """Linear answers from the summary token; the better they are, the plainer the sentence lies in it."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.values, self.kind = nn.Linear(width, COLUMNS), nn.Linear(width, len(KINDS))

    def loss(self, summary: Tensor, target: Said) -> Tensor:
        device = summary.device
        error = F.smooth_l1_loss(self.values(summary), target.values.to(device), beta=0.1, reduction="none")
        kind = F.cross_entropy(self.kind(summary), target.kind.to(device))
        return (error * target.weights.to(device)).mean() + 0.1 * kind


def teach(
    name: str, loss: Callable[[], Tensor], parameters: list[nn.Parameter], steps: int, fall: Callable[[float], float],
    log: Log,
) -> None:  # fmt: skip
    """AdamW on fresh losses; the rate is 2e-3 after a warm-up, times ``fall`` of the share of steps done."""
    optimizer = torch.optim.AdamW(parameters, lr=2e-3, weight_decay=1e-4, fused=True)
    total = 0.0
    for step in range(steps):
        for group in optimizer.param_groups:
            group["lr"] = 2e-3 * min(1, (step + 1) / 50) * fall(step / steps)
        value = loss()
        optimizer.zero_grad()
        value.backward()
        nn.utils.clip_grad_norm_(parameters, 1.0)
        optimizer.step()
        total += float(value.detach())
        if (step + 1) % 50 == 0:
            log({"lesson": name, "step": step + 1, "loss": round(total / 50, 4)})
            total = 0.0


def text_lesson(
    net: PocketNet, reading: Reading, sentences: Sentences, steps: int, generator: torch.Generator, log: Log
) -> None:
    """Regress base layer, overlay and where it lies from the summary token of fresh sentences."""
    device = net.text.summary.device

    def loss() -> Tensor:
        texts, target = sentences(256)
        with torch.autocast(device.type, torch.bfloat16):
            summary = net.text(texts, 0.1, generator)[:, 0, :-1].float()
        return reading.loss(summary, target)

    teach("text", loss, [*net.text.parameters(), *reading.parameters()], steps, lambda share: 1 - 0.85 * share, log)


def place_lesson(net: PocketNet, draw: Callable[[], tuple[Tensor, Tensor, list[str]]], steps: int, log: Log) -> None:
    """Regress the clean stack from text and place by the pixel head alone, at t = 1, where v = -x.

    ``draw`` gives clean stacks (n, 8, s, s) in [-1, 1], their geometry (n, 10, s, s), and captions. The error of each
    sample counts in proportion to its own variance, or brick, oak and tiles would be drowned by black and white.
    """

    def loss() -> Tensor:
        x, geometry, captions = draw()
        low = torch.bfloat16
        with torch.autocast(x.device.type, low):
            tokens = net.text(captions)[..., :-1]
            time = net.time(sinusoids(torch.full((len(x),), 1000.0, device=x.device), 64, 10000.0).to(tokens.dtype))
            condition = F.silu(time + net.summary(tokens[:, 0]))
            places = net.places(geometry, low).flatten(1, 2)
            noise = torch.randn_like(x).movedim(1, -1).flatten(1, 2).to(low)
            pixels = torch.cat([torch.zeros_like(noise).repeat(1, 1, 2), noise], -1)
            v = net.head(pixels, places, condition).unflatten(1, x.shape[2:]).movedim(-1, 1)
        weight = geometry[:, 3:4]
        area = weight.sum((1, 2, 3))
        centred = (x - ((x * weight).sum((2, 3)) / area[:, None])[..., None, None])[:, 3:].square() * weight
        variance = centred.sum((1, 2, 3)) / (5 * area)
        error = ((v.float() + x)[:, 3:].square() * weight).sum((1, 2, 3)) / (5 * area)
        return (error / (variance + FAINT)).mean() * FAINT * 10

    parameters = [*net.head.parameters(), *net.summary.parameters(), *net.text.parameters()]
    fall = lambda share: 0.05 + 0.95 * (0.5 + 0.5 * math.cos(math.pi * share))  # noqa: E731
    teach("place", loss, parameters, steps, fall, log)
