"""Make the training set: ``python data.py --samples 150000`` renders captioned stacks into ``work/data/``.

Each sample: 8 channels of shaded RGB, base colour, roughness and metalness, 32x32 uint8, box-filtered from 64x64; the
number of the view whose geometry it has; a caption; and the mean of each channel over the object, for the text
encoder's first lesson. Torch and numpy, no mesh file, no picture.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from captions import random_caption
from gbuffers import ARCHETYPES, MISS, WORK
from materials import Points, evaluate, noise_volume, render_stack
from surfaces import Material
from torch import Tensor

from paintit.guidance.pocket_net import pack_geometry
from paintit.render.environment import from_radiance, load_environment
from paintit.render.light import Light, prefilter

ENVIRONMENTS = Path(__file__).parents[2] / "assets" / "envmaps"
EXPOSURE = 0.7
SIDE = 32
#: Shapes drawn more often than they were traced: their captions have most to say.
FAVOUR = {"figure": 1.6, "quadruped": 1.4, "bird": 1.4, "ring": 1.5}


@dataclass(frozen=True)
class Source:
    """The traced views, memory-mapped; arrays as ``gbuffers.rows`` made them."""

    arrays: dict[str, np.ndarray]

    @classmethod
    def open(cls, folder: Path = WORK / "gbuffers") -> Source:
        names = ("position", "normal", "part", "curvature", "eye", "frame", "turn", "archetype")
        return cls({name: np.load(folder / f"{name}.npy", mmap_mode="r") for name in names})

    def __len__(self) -> int:
        return len(self.arrays["archetype"])

    def archetype(self, index: int) -> str:
        return ARCHETYPES[int(self.arrays["archetype"][index])]

    def mask(self, index: np.ndarray) -> Tensor:
        """(b, h, w) bool."""
        return torch.from_numpy(self.arrays["part"][index]) != MISS

    def points(self, index: np.ndarray) -> tuple[Points, Tensor]:
        """Hit points of the views ``index`` (b,) and their mask (b, h, w)."""
        take = lambda name: torch.from_numpy(self.arrays[name][index])  # noqa: E731
        part = take("part")
        mask = part != MISS
        sample = mask.nonzero()[:, 0]
        position = take("position")[mask].float()
        normal = F.normalize(take("normal")[mask].float(), dim=-1)
        view = F.normalize(take("eye")[sample] - position, dim=-1)
        curvature = take("curvature")[mask].float() / 127
        return Points(position, normal, part[mask], curvature, take("turn")[sample], view, sample), mask

    def geometry(self, index: np.ndarray) -> Tensor:
        """(b, 10, 32, 32) what the prior sees of the views ``index``."""
        take = lambda name: torch.from_numpy(self.arrays[name][index])  # noqa: E731
        mask = self.mask(index)[..., None].float()
        normal = F.normalize(take("normal").float(), dim=-1)
        seen = torch.einsum("bij,bhwj->bhwi", take("frame"), normal)
        return pack_geometry(seen, mask, take("position").float(), normal, SIDE)


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


def render_materials(
    source: Source,
    index: np.ndarray,
    materials: Sequence[Material],
    rng: np.random.Generator,
    lights: Sequence[Light],
    volume: Tensor,
) -> tuple[Tensor, Tensor]:
    """Stacks (b, 8, 32, 32) in [0, 1] of the views ``index`` (b,) under one random light, and channel means (b, 8)."""
    points, mask = source.points(index)
    surface, bumped = evaluate(list(materials), points, volume, rng)
    draw = partial(_uniform, rng, len(index))
    light = lights[int(rng.integers(len(lights)))]
    yaw, gain, background = draw(0, 2 * np.pi), torch.exp(draw(-0.25, 0.25)), draw(0.2, 0.9)
    stack = render_stack(surface, bumped, points, light, yaw, gain, mask, background)
    weight = mask[:, None].float()
    return F.avg_pool2d(stack, 2), (stack * weight).sum((2, 3)) / weight.sum((2, 3)).clamp_min(1)


def make(job: tuple[int, int, int, str, str, int, float, int]) -> None:
    """Render one chunk of samples to ``<out>/<chunk>.npz``."""
    chunk, count, batch, views, folder, seed, focus, synthetic = job
    torch.set_num_threads(1)
    rng = np.random.default_rng([seed, chunk])
    source = Source.open(Path(views))
    odds = np.array([FAVOUR.get(source.archetype(i), 1.0) for i in range(len(source))])
    odds /= odds.sum()
    volume, lights = noise_volume(), make_lights(synthetic)
    stacks, chosen, means, captions = [], [], [], []
    while len(captions) < count:
        index = np.sort(rng.choice(len(odds), min(batch, len(odds)), replace=False, p=odds))
        index = index[(source.mask(index).flatten(1).float().mean(1) > 0.02).numpy()]
        pairs = [random_caption(rng, source.archetype(i), focus) for i in index]
        stack, mean = render_materials(source, index, [m for _, m in pairs], rng, lights, volume)
        stacks.append((stack.clamp(0, 1) * 255).round().to(torch.uint8).numpy())
        chosen.append(index.astype(np.int32))
        means.append(mean.half().numpy())
        captions += [text for text, _ in pairs]
    np.savez(
        Path(folder) / f"{chunk:04d}.npz",
        stack=np.concatenate(stacks)[:count],
        view=np.concatenate(chosen)[:count],
        mean=np.concatenate(means)[:count],
    )
    (Path(folder) / f"{chunk:04d}.json").write_text(json.dumps(captions[:count]))


def _uniform(rng: np.random.Generator, count: int, low: float, high: float) -> Tensor:
    return torch.from_numpy(rng.uniform(low, high, count)).float()


def load(folder: Path) -> tuple[Tensor, Tensor, Tensor, list[str]]:
    """Stacks (n, 8, s, s) uint8, view numbers (n,), mean channels (n, 8), captions."""
    files = sorted(folder.glob("*.json"))
    arrays = [np.load(f.with_suffix(".npz")) for f in files]
    captions = [text for f in files for text in json.loads(f.read_text())]
    join = lambda name: torch.from_numpy(np.concatenate([a[name] for a in arrays]))  # noqa: E731
    return join("stack"), join("view").long(), join("mean").float(), captions


def load_geometry(folder: Path) -> Tensor:
    """(views, 10, 32, 32) float16 geometry of every view."""
    source = Source.open(folder)
    return torch.cat([source.geometry(i).half() for i in np.array_split(np.arange(len(source)), len(source) // 64 + 1)])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", type=int, default=150_000)
    parser.add_argument("--chunk", type=int, default=2_000)
    parser.add_argument("--batch", type=int, default=40)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--first", type=int, default=0, help="number of the first chunk, to add to a set")
    parser.add_argument("--focus", type=float, default=0.0, help="share of captions of the kinds that are too rare")
    parser.add_argument("--synthetic", type=int, default=12, help="lights that are made up, besides the captured ones")
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--gbuffers", type=Path, default=WORK / "gbuffers")
    parser.add_argument("--out", type=Path, default=WORK / "data")
    a = parser.parse_args()
    a.out.mkdir(parents=True, exist_ok=True)
    make_lights(a.synthetic)  # prefiltered once, before the processes ask for them
    rest = (a.batch, str(a.gbuffers), str(a.out), a.seed, a.focus, a.synthetic)
    jobs = [(a.first + i, min(a.chunk, a.samples - i * a.chunk), *rest) for i in range(-(-a.samples // a.chunk))]
    jobs = [job for job in jobs if not (a.out / f"{job[0]:04d}.json").exists()]
    with multiprocessing.get_context("spawn").Pool(a.processes) as pool:
        pool.map(make, jobs, chunksize=1)


if __name__ == "__main__":
    main()
