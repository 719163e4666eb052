"""Train the feature network of ``paintit evaluate``: ``python train.py`` renders, learns, checks, and ships it.

It learns to name the ruler's materials (``training/pocket/classes.py``) in shaded pictures of 64 x 64 pixels under random
lights, turns, gains and greys behind, and is checked on shapes that it has not seen. It wants the views that
``training/pocket/gbuffers.py`` traces. About eight minutes of one core.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from safetensors.torch import save_file
from torch import Tensor

from paintit.evaluate.classifier import ClassifierNet

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "training" / "pocket"))  # its scripts are programs beside the package

from classes import RETRIEVAL, material_of  # noqa: E402
from data import Source, make_lights  # noqa: E402
from materials import evaluate, noise_volume, render_stack  # noqa: E402
from ruler_classifier import split_views  # noqa: E402

CLASSES = tuple(RETRIEVAL)
WEIGHTS = ROOT / "src" / "paintit" / "evaluate" / "classifier.safetensors"
#: Renders that share one light.
TOGETHER = 20
BATCH = 64


def render_classes(source: Source, views: np.ndarray, per_class: int, seed: int) -> tuple[Tensor, Tensor]:
    """Pictures (n, 3, 64, 64) uint8 and labels (n,) of ``per_class`` fresh draws of each class on random ``views``."""
    rng = np.random.default_rng([seed, 64])
    lights, volume = make_lights(), noise_volume()
    labels = rng.permutation(np.repeat(np.arange(len(CLASSES)), per_class))
    images = []
    for some in np.array_split(labels, -(-len(labels) // TOGETHER)):
        index = np.sort(rng.choice(views, len(some), replace=False))
        points, mask = source.points(index)
        surface, bumped = evaluate([material_of(CLASSES[k], rng) for k in some], points, volume, rng)
        stack = render_stack(
            surface, bumped, points, lights[int(rng.integers(len(lights)))],
            uniform(rng, len(some), 0, 2 * np.pi), torch.exp(uniform(rng, len(some), -0.3, 0.3)), mask,
            uniform(rng, len(some), 0.1, 1.0),
        )  # fmt: skip
        images.append((stack[:, :3].clamp(0, 1) * 255).round().to(torch.uint8))
    return torch.cat(images), torch.from_numpy(labels).long()


def uniform(rng: np.random.Generator, count: int, low: float, high: float) -> Tensor:
    return torch.from_numpy(rng.uniform(low, high, count)).float()


def augment(images: Tensor, generator: torch.Generator) -> Tensor:
    """Mirrored, and some a little blurred. Never noisy: the features shall tell noise from a clean surface."""
    draw = lambda: torch.rand(len(images), 1, 1, 1, generator=generator)  # noqa: E731
    images = torch.where(draw() < 0.5, images.flip(-1), images)
    soft = F.avg_pool2d(F.pad(images, (1, 1, 1, 1), mode="replicate"), 3, stride=1)
    return images + (soft - images) * (draw() * 1.6 - 0.6).clamp_min(0)


def fit(images: Tensor, labels: Tensor, epochs: int, seed: int) -> ClassifierNet:
    """A network trained on pictures (n, 3, 64, 64) uint8, ready to be asked; ``seed`` decides all that is drawn."""
    generator = torch.Generator().manual_seed(seed)
    steps = max(1, len(labels) // BATCH)
    with torch.random.fork_rng(devices=[]):  # initial weights draw from the global generator
        torch.manual_seed(seed)
        net = ClassifierNet(len(CLASSES))
    optimizer = torch.optim.AdamW(net.parameters(), lr=3e-3, weight_decay=0.05)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, 6e-3, total_steps=epochs * steps, pct_start=0.2)
    for epoch in range(epochs):
        began, total = time.perf_counter(), 0.0
        for index in torch.randperm(len(labels), generator=generator).split(BATCH)[:steps]:
            loss = F.cross_entropy(
                net(augment(images[index].float() / 255, generator)), labels[index], label_smoothing=0.05
            )
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            schedule.step()
            total += float(loss.detach()) / steps
        print(f"epoch {epoch + 1}/{epochs}: loss {total:.3f}, {time.perf_counter() - began:.0f} s", flush=True)
    return net.eval()


def halved(net: ClassifierNet) -> ClassifierNet:
    """The network as it ships: weights rounded to half precision."""
    with torch.no_grad():
        for value in (*net.parameters(), *net.buffers()):
            if value.is_floating_point():
                value.copy_(value.half().float())
    return net


@torch.no_grad()
def check(net: ClassifierNet, images: Tensor, labels: Tensor) -> float:
    """Share of pictures (n, 3, 64, 64) uint8 that are named right."""
    guess = torch.cat([net(part.float() / 255).argmax(1) for part in images.split(256)])
    return float((guess == labels).float().mean())


def ship(net: ClassifierNet, accuracy: float, path: Path) -> None:
    state = {name: v.half() if v.is_floating_point() else v for name, v in net.state_dict().items()}
    save_file(state, str(path), {"classes": json.dumps(CLASSES), "accuracy": f"{accuracy:.4f}"})
    print(f"{path}: {path.stat().st_size / 1e6:.2f} MB, right on {accuracy:.1%} of renders of other shapes")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--per-class", type=int, default=400, help="renders of each class to learn from")
    parser.add_argument("--checks", type=int, default=40, help="renders of each class to check on")
    parser.add_argument("--epochs", type=int, default=6)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--gbuffers", type=Path, default=ROOT / "training" / "pocket" / "work" / "gbuffers")
    parser.add_argument("--out", type=Path, default=WEIGHTS)
    a = parser.parse_args()
    torch.set_num_threads(1)
    began = time.perf_counter()
    source = Source.open(a.gbuffers)
    seen, unseen = split_views(source)
    images, labels = render_classes(source, seen, a.per_class, a.seed)
    print(f"{len(labels)} renders of {len(CLASSES)} classes, {time.perf_counter() - began:.0f} s", flush=True)
    net = halved(fit(images, labels, a.epochs, a.seed))
    accuracy = check(net, *render_classes(source, unseen, a.checks, a.seed + 1))
    ship(net, accuracy, a.out)
    print(f"{time.perf_counter() - began:.0f} s in all")


if __name__ == "__main__":
    main()
