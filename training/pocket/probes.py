"""The prior by itself, without painting: are its samples what was asked for, and what does it make of unseen words?"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from data import Source, make_lights, render_materials
from materials import noise_volume
from meanings import meaning
from ruler import FULL_VIEWS, PROMPTS, Truth, ciede2000, constant_maps, lab, light_of, subject, truth_of
from ruler_classifier import Recogniser, class_of
from torch import Tensor

from paintit.color import decode_srgb
from paintit.guidance.pocket import PocketPrior
from paintit.guidance.pocket_net import alpha_sigma
from paintit.render.render import render

#: Noise levels of a sample and guidance scale.
STEPS, SCALE = 20, 1.5
#: What a difference of 1 in roughness and in metalness weighs beside CIEDE2000 when meanings are told apart.
ROUGHNESS_WEIGHT, METAL_WEIGHT = 30.0, 60.0


@torch.no_grad()
def ddim(
    prior: PocketPrior, prompts: Sequence[str], geometry: Tensor | None, seed: int, scale: float = SCALE,
    steps: int = STEPS,
) -> Tensor:  # fmt: skip
    """(n, 8, 32, 32) samples in [0, 1], deterministic steps, one geometry (n, c, 32, 32) each or none at all."""
    n, side = len(prompts), prior.spec.resolution
    text, none = prior.encode_text(prompts), prior.encode_text([""]).expand(n, -1, -1)
    x = torch.randn(n, 8, side, side, generator=torch.Generator().manual_seed(seed))
    shown = None if geometry is None else torch.cat([geometry, geometry])
    times = torch.linspace(0.995, 0.0, steps + 1).tolist()
    for now, after in pairwise(times):
        without, asked = prior.predict_noise(torch.cat([x, x]), now, torch.cat([none, text]), shown).chunk(2)
        noise = without + scale * (asked - without)
        alpha, sigma = math.cos(now * math.pi / 2), math.sin(now * math.pi / 2)
        clean = ((x - sigma * noise) / alpha).clamp(-1, 1)
        noise = (x - alpha * clean) / sigma
        x = math.cos(after * math.pi / 2) * clean + math.sin(after * math.pi / 2) * noise
    return x * 0.5 + 0.5


def unseen_geometry(prior: PocketPrior) -> tuple[Tensor, Tensor]:
    """What the prior sees of spot and bob from all round, (8, c, 32, 32), and where they lie, (8, 32, 32) bool."""
    shown, inside = [], []
    for mesh in ("spot", "bob"):
        on = subject(mesh, 512)
        even = constant_maps(torch.full((5,), 0.5), on.seen)
        view = render(on.stack_views, even, light_of("default"))
        encoded = prior.encode_geometry(view.geometry())
        shown.append(encoded[:FULL_VIEWS])
        side = encoded.shape[-1]
        covered = torch.nn.functional.adaptive_avg_pool2d(view.mask.permute(0, 3, 1, 2), side)
        inside.append(covered[:FULL_VIEWS, 0] > 0.99)
    return torch.cat(shown), torch.cat(inside)


def sample_retrieval(
    prior: PocketPrior, recogniser: Recogniser, count: int, seed: int = 0, scale: float = SCALE
) -> tuple[dict[str, list[str]], float, Tensor]:
    """Names that samples without geometry were given, by prompt; the share of right ones; and the samples."""
    prompts = [PROMPTS[i % len(PROMPTS)] for i in range(count)]
    samples = torch.cat([ddim(prior, prompts[i : i + 16], None, seed + i, scale) for i in range(0, count, 16)])
    found = [recogniser.classes[int(i)] for i in recogniser.log_probabilities(samples).argmax(1)]
    named: dict[str, list[str]] = {}
    for prompt, name in zip(prompts, found, strict=True):
        named.setdefault(prompt, []).append(name)
    right = sum(name == class_of(prompt) for prompt, name in zip(prompts, found, strict=True))
    return named, right / count, samples


@torch.no_grad()
def explained(
    prior: PocketPrior, prompts: Sequence[str], times: Sequence[float], gbuffers: Path, count: int = 24, seed: int = 1
) -> dict[str, list[float]]:
    """Share of the base colour's variance over ``count`` traced views that one look at noise level t predicts.

    1: the pattern is where the generator puts it; 0: its mean colour and no pattern; below 0: wrong. At t near 1 only the
    text and the place are left to tell.
    """
    rng, source = np.random.default_rng(seed), Source.open(gbuffers)
    views = np.sort(rng.choice(len(source), count, replace=False))
    views = views[(source.mask(views).flatten(1).float().mean(1) > 0.05).numpy()]
    shown, lights, volume = source.geometry(views), make_lights(0)[:1], noise_volume()
    inside = (shown[:, 3:4] > 0.9).float()
    found: dict[str, list[float]] = {}
    for prompt in prompts:
        clean = render_materials(source, views, [meaning(prompt, rng) for _ in views], rng, lights, volume)[0] * 2 - 1
        noise = torch.randn(clean.shape, generator=torch.Generator().manual_seed(seed))
        base = clean[:, 3:6]
        spread = (base - (base * inside).sum((0, 2, 3), keepdim=True) / inside.sum()).square() * inside
        text = prior.encode_text([prompt]).expand(len(views), -1, -1)
        for t in times:
            x_t = prior.add_noise(clean, noise, t)
            alpha, sigma = alpha_sigma(t)
            guess = (x_t - sigma * prior.predict_noise(x_t, t, text, shown)) / alpha
            missed = ((guess[:, 3:6] - base).square() * inside).sum() / spread.sum()
            found.setdefault(prompt, []).append(1 - float(missed))
    return found


def distance(value: Tensor, truth: Truth) -> float:
    """Between a mean material (5,) (linear base colour, roughness, metalness) and a meaning, in units of CIEDE2000."""
    color = float(ciede2000(lab(value[:3]), lab(truth.base)))
    rough = ROUGHNESS_WEIGHT * (float(value[3]) - truth.roughness)
    metal = METAL_WEIGHT * (float(value[4]) - truth.metallic)
    return math.sqrt(color**2 + rough**2 + metal**2)


def mean_sample(prior: PocketPrior, prompt: str, seed: int, scale: float = SCALE) -> Tensor:
    """(5,) linear base colour, roughness and metalness of eight samples on shapes that no training data held."""
    shown, inside = unseen_geometry(prior)
    x = ddim(prior, [prompt] * len(shown), shown, seed, scale).permute(0, 2, 3, 1)[inside]
    return torch.cat([decode_srgb(x[:, 3:6].clamp(0, 1)), x[:, 6:]], 1).mean(0)


def unseen_words(prior: PocketPrior, file: Path, seed: int = 0, scale: float = SCALE) -> list[dict[str, object]]:
    """What each word of the file comes out as: ``nearest`` of the meanings, and whether that is ``right``.

    The file is a list of ``{"word": what is asked, "means": a phrase that the generator knows}``, each optionally with
    ``"among"``: the phrases to choose from, by default the meanings of all words in the file.
    """
    entries = json.loads(file.read_text())
    everything = list(dict.fromkeys(str(entry["means"]) for entry in entries))
    rows = []
    for entry in entries:
        value = mean_sample(prior, entry["word"], seed, scale)
        among = list(dict.fromkeys([entry["means"], *entry.get("among", everything)]))
        near = sorted((distance(value, truth_of(phrase)), phrase) for phrase in among)
        rows.append(
            {
                "word": entry["word"],
                "means": entry["means"],
                "nearest": near[0][1],
                "right": near[0][1] == entry["means"],
                "distance": round(distance(value, truth_of(entry["means"])), 1),
                "base_linear": [round(float(v), 3) for v in value[:3]],
                "roughness": round(float(value[3]), 3),
                "metallic": round(float(value[4]), 3),
            }
        )
    return rows
