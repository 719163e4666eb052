"""Make the training set: ``python data.py --samples 80000`` renders captioned stacks into ``work/data/``.

Each sample: 8 channels of shaded RGB, base colour, roughness, metalness and 4 of view normal and mask, 32x32 uint8,
box-filtered from 64x64, and a caption. Also the mean of each channel over the object, for checks and for the text
encoder's first lesson.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
from functools import partial
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from captions import random_caption
from gbuffers import ARCHETYPES, MISS, WORK
from materials import Points, evaluate, noise_volume, render_stack
from torch import Tensor

from paintit.render.environment import from_radiance, load_environment
from paintit.render.light import Light, prefilter

ENVIRONMENTS = Path(__file__).parents[2] / "assets" / "envmaps"
EXPOSURE = 0.7
#: Shapes drawn more often than they were traced: their captions have most to say.
FAVOUR = {"figure": 2.5, "quadruped": 1.4, "bird": 1.4, "headgear": 1.3, "ring": 1.5}


def gradient_environment(rng: np.random.Generator) -> Tensor:
    """(32, 64, 3) sky, ground and a few soft lamps."""
    y = np.linspace(1, -1, 32)[:, None, None]
    sky, ground = rng.uniform(0.2, 1.0, 3) * rng.uniform(0.3, 1.2), rng.uniform(0.1, 0.8, 3) * 0.4
    radiance = np.where(y > 0, sky * (0.5 + 0.5 * np.abs(y)), ground) * np.ones((32, 64, 1))
    theta, phi = np.meshgrid(np.linspace(0, np.pi, 32), np.linspace(-np.pi, np.pi, 64), indexing="ij")
    direction = np.stack([np.sin(theta) * np.sin(phi), np.cos(theta), np.sin(theta) * np.cos(phi)], -1)
    for _ in range(rng.integers(1, 5)):
        lamp = rng.normal(size=3) + np.array([0, 0.6, 0])
        width = rng.uniform(8, 60)
        radiance = (
            radiance + rng.uniform(2, 12) * np.exp(width * (direction @ (lamp / np.linalg.norm(lamp)) - 1))[..., None]
        )
    return torch.from_numpy(radiance).float()


def make_lights(synthetic: int = 12) -> list[Light]:
    """The captured environments four times over and some synthetic ones."""
    captured = [prefilter(load_environment(str(path), EXPOSURE)) for path in sorted(ENVIRONMENTS.glob("*.hdr"))]
    captured.append(prefilter(load_environment("default", EXPOSURE)))
    rng = np.random.default_rng(11)
    made = [prefilter(from_radiance(gradient_environment(rng), f"gradient-{i}", EXPOSURE)) for i in range(synthetic)]
    return captured * 4 + made


def make(job: tuple[int, int, int, str, int, float]) -> None:
    """Render one chunk of samples to ``<out>/<chunk>.npz``."""
    chunk, count, batch, folder, seed, focus = job
    torch.set_num_threads(1)
    rng = np.random.default_rng([seed, chunk])
    source = {
        name: np.load(WORK / "gbuffers" / f"{name}.npy", mmap_mode="r")
        for name in ("position", "normal", "part", "eye", "frame", "archetype")
    }
    odds = np.array([FAVOUR.get(ARCHETYPES[int(i)], 1.0) for i in source["archetype"]])
    odds /= odds.sum()
    volume, lights = noise_volume(), make_lights()
    stacks, geometries, means, captions = [], [], [], []
    while len(captions) < count:
        index = np.sort(rng.choice(len(odds), batch, replace=False, p=odds))
        part = torch.from_numpy(source["part"][index])
        mask = part != MISS
        keep = mask.flatten(1).float().mean(1) > 0.02
        index, part, mask = index[keep.numpy()], part[keep], mask[keep]
        b = len(index)
        frame = torch.from_numpy(source["frame"][index])
        sample = mask.nonzero()[:, 0]
        position = torch.from_numpy(source["position"][index])[mask].float()
        normal = F.normalize(torch.from_numpy(source["normal"][index])[mask].float(), dim=-1)
        view = F.normalize(torch.from_numpy(source["eye"][index])[sample] - position, dim=-1)
        points = Points(position, normal, view, part[mask], sample)
        pairs = [random_caption(rng, ARCHETYPES[int(source["archetype"][i])], focus) for i in index]
        surface, bumped = evaluate([m for _, m in pairs], points, volume, rng)
        draw = partial(_uniform, rng, b)
        light = lights[int(rng.integers(len(lights)))]
        stack = render_stack(
            surface, bumped, points, light, draw(0, 2 * np.pi), torch.exp(draw(-0.25, 0.25)), mask, draw(0.2, 0.9)
        )
        shown = torch.zeros(b, *mask.shape[1:], 4)
        shown[mask] = torch.cat(
            [(frame[sample] @ normal[:, :, None])[..., 0] * 0.5 + 0.5, torch.ones(len(sample), 1)], 1
        )
        shown[~mask] = torch.tensor([0.5, 0.5, 0.5, 0.0])
        stacks.append(_bytes(F.avg_pool2d(stack, 2)))
        geometries.append(_bytes(F.avg_pool2d(shown.permute(0, 3, 1, 2), 2)))
        weight = mask[:, None].float()
        means.append(((stack * weight).sum((2, 3)) / weight.sum((2, 3))).half().numpy())
        captions += [text for text, _ in pairs]
    np.savez(
        Path(folder) / f"{chunk:04d}.npz",
        stack=np.concatenate(stacks)[:count],
        geometry=np.concatenate(geometries)[:count],
        mean=np.concatenate(means)[:count],
    )
    (Path(folder) / f"{chunk:04d}.json").write_text(json.dumps(captions[:count]))


def _uniform(rng: np.random.Generator, count: int, low: float, high: float) -> Tensor:
    return torch.from_numpy(rng.uniform(low, high, count)).float()


def _bytes(x: Tensor) -> np.ndarray:
    return (x.clamp(0, 1) * 255).round().to(torch.uint8).numpy()


def load(folder: Path) -> tuple[Tensor, Tensor, Tensor, list[str]]:
    """Stacks (n, 8, s, s) uint8, geometry (n, 4, s, s) uint8, mean channels (n, 8), captions."""
    files = sorted(folder.glob("*.json"))
    arrays = [np.load(f.with_suffix(".npz")) for f in files]
    captions = [text for f in files for text in json.loads(f.read_text())]
    join = lambda name: torch.from_numpy(np.concatenate([a[name] for a in arrays]))  # noqa: E731
    return join("stack"), join("geometry"), join("mean").float(), captions


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", type=int, default=80_000)
    parser.add_argument("--chunk", type=int, default=2_000)
    parser.add_argument("--batch", type=int, default=40)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--first", type=int, default=0, help="number of the first chunk, to add to a set")
    parser.add_argument("--focus", type=float, default=0.0, help="share of captions of the kinds that are too rare")
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--out", type=Path, default=WORK / "data")
    a = parser.parse_args()
    a.out.mkdir(parents=True, exist_ok=True)
    make_lights()
    jobs = [
        (a.first + i, min(a.chunk, a.samples - i * a.chunk), a.batch, str(a.out), a.seed, a.focus)
        for i in range(-(-a.samples // a.chunk))
    ]
    jobs = [job for job in jobs if not (a.out / f"{job[0]:04d}.json").exists()]
    with multiprocessing.get_context("spawn").Pool(a.processes) as pool:
        pool.map(make, jobs, chunksize=1)


if __name__ == "__main__":
    main()
