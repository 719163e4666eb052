"""The retrieval ruler: a small network that names the material in a stack, trained on renders of the generator itself.

It is trained on one set of shapes and checked on others, in the stack's own 8 channels at 32x32, so that it can read
paints (eight views, log-probabilities averaged) and samples of the prior alike. Its classes are the prompts of the
evaluation and as many look-alikes, so that a guess is rarely right.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from classes import RETRIEVAL, material_of
from data import Source, make_lights, render_materials
from gbuffers import WORK
from materials import noise_volume
from torch import Tensor, nn

WEIGHTS = WORK / "ruler.pt"
CLASSES = tuple(RETRIEVAL)
#: Share of the views, the last ones, whose shapes are kept for the check.
HELD_OUT = 0.15
#: Smallest share of a view that the object covers.
COVER = 0.04
BATCH = 64


class Net(nn.Module):
    """Stacks (n, 8, 32, 32) in [0, 1] -> logits (n, classes)."""

    def __init__(self, classes: int) -> None:
        super().__init__()

        def block(given: int, out: int, stride: int) -> nn.Sequential:
            convolution = nn.Conv2d(given, out, 3, stride=stride, padding=1, bias=False)
            return nn.Sequential(convolution, nn.BatchNorm2d(out), nn.ReLU())

        self.trunk = nn.Sequential(
            block(32, 64, 1),
            block(64, 64, 1),
            block(64, 96, 2),
            block(96, 96, 1),
            block(96, 160, 2),
            block(160, 160, 1),
        )
        self.head = nn.Sequential(nn.Dropout(0.1), nn.Linear(320, classes))

    def forward(self, stack: Tensor) -> Tensor:
        h = self.trunk(F.pixel_unshuffle(stack * 2 - 1, 2))
        return self.head(torch.cat([h.mean((2, 3)), h.amax((2, 3))], 1))


def class_of(prompt: str) -> str:
    """The class that has ``prompt`` among its wordings."""
    for name, wordings in RETRIEVAL.items():
        if prompt == name or prompt in wordings:
            return name
    raise KeyError(f"no class of the retrieval ruler is worded '{prompt}'")


def split_views(source: Source) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the views to learn from and of those to check on. Views of one shape lie together, so shapes differ."""
    covered = np.concatenate(
        [source.mask(part).flatten(1).float().mean(1).numpy() for part in np.array_split(np.arange(len(source)), 64)]
    )
    first = int(len(source) * (1 - HELD_OUT))
    good = np.flatnonzero(covered > COVER)
    return good[good < first], good[good >= first + 6]


def render_classes(source: Source, views: np.ndarray, per_class: int, seed: int) -> tuple[Tensor, Tensor]:
    """Stacks (n, 8, 32, 32) uint8 and labels (n,) of ``per_class`` fresh draws of each class on random ``views``."""
    rng = np.random.default_rng([seed, 77])
    lights, volume = make_lights(), noise_volume()
    labels = rng.permutation(np.repeat(np.arange(len(CLASSES)), per_class))
    stacks = []
    for some in np.array_split(labels, -(-len(labels) // 40)):
        index = np.sort(rng.choice(views, len(some)))
        materials = [material_of(str(rng.choice(RETRIEVAL[CLASSES[k]])), rng) for k in some]
        stack = render_materials(source, index, materials, rng, lights, volume)[0]
        stacks.append((stack.clamp(0, 1) * 255).round().to(torch.uint8))
    return torch.cat(stacks), torch.from_numpy(labels).long()


def augment(stack: Tensor, generator: torch.Generator) -> Tensor:
    """Mirrored, a little blurred, a little noisy: a paint is never as clean as a render, and that is not its class."""
    n = len(stack)
    draw = lambda: torch.rand(n, 1, 1, 1, generator=generator)  # noqa: E731
    stack = torch.where(draw() < 0.5, stack.flip(-1), stack)
    soft = F.avg_pool2d(F.pad(stack, (1, 1, 1, 1), mode="replicate"), 3, stride=1)
    stack = stack + (soft - stack) * (draw() * 1.4 - 0.6).clamp_min(0)
    noise = torch.randn(stack.shape, generator=generator)
    return stack + noise * (draw() * 0.1 - 0.05).clamp_min(0)


@dataclass(frozen=True)
class Recogniser:
    """A trained network, its classes, and how often it was right on renders of shapes it had not seen."""

    net: Net
    classes: tuple[str, ...]
    accuracy: float
    confusion: Tensor
    """(classes, classes) counts: rows are the truth."""

    @torch.no_grad()
    def log_probabilities(self, stacks: Tensor) -> Tensor:
        """(n, classes) of stacks (n, 8, 32, 32) in [0, 1]."""
        return torch.cat([self.net(part).log_softmax(1) for part in stacks.float().split(256)])

    def recognise(self, stacks: Tensor) -> str:
        """The class of one object from its views (v, 8, 32, 32): mean log-probability, largest."""
        return self.classes[int(self.log_probabilities(stacks).mean(0).argmax())]


def train(
    source: Source, per_class: int = 400, epochs: int = 5, seed: int = 0, report: Callable[[str], None] = print
) -> Recogniser:
    """Render, learn, check on held-out shapes with a fifth as many renders (at least four a class)."""
    began = time.perf_counter()
    seen, unseen = split_views(source)
    stacks, labels = render_classes(source, seen, per_class, seed)
    report(f"{len(labels)} renders of {len(CLASSES)} classes in {time.perf_counter() - began:.0f} s")
    net = fit(stacks, labels, epochs, seed, report)
    test, truth = render_classes(source, unseen, max(4, per_class // 5), seed + 1)
    with torch.no_grad():
        guess = torch.cat([net(part.float() / 255).argmax(1) for part in test.split(256)])
    confusion = torch.zeros(len(CLASSES), len(CLASSES), dtype=torch.long)
    confusion.index_put_((truth, guess), torch.ones_like(truth), accumulate=True)
    accuracy = float((guess == truth).float().mean())
    report(f"top-1 on {len(truth)} renders of other shapes: {accuracy:.3f}, {time.perf_counter() - began:.0f} s in all")
    return Recogniser(net, CLASSES, accuracy, confusion)


def fit(
    stacks: Tensor, labels: Tensor, epochs: int, seed: int, report: Callable[[str], None], batch: int = BATCH
) -> Net:
    """A network trained on stacks (n, 8, 32, 32) uint8, ready to be asked; ``seed`` decides all that is drawn."""
    generator = torch.Generator().manual_seed(seed)
    steps = max(1, len(labels) // batch)
    with torch.random.fork_rng(devices=[]):  # initial weights and dropout draw from the global generator
        torch.manual_seed(seed)
        net = Net(len(CLASSES))
        optimizer = torch.optim.AdamW(net.parameters(), lr=3e-3, weight_decay=0.02)
        schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, 6e-3, total_steps=epochs * steps, pct_start=0.2)
        for epoch in range(epochs):
            total = 0.0
            for index in torch.randperm(len(labels), generator=generator).split(batch)[:steps]:
                logits = net(augment(stacks[index].float() / 255, generator))
                loss = F.cross_entropy(logits, labels[index], label_smoothing=0.05)
                optimizer.zero_grad()
                loss.backward()
                optimizer.step()
                schedule.step()
                total += float(loss.detach()) / steps
            report(f"epoch {epoch + 1}/{epochs}: loss {total:.3f}")
    return net.eval()


def save(recogniser: Recogniser, path: Path = WEIGHTS) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    torch.save(
        {
            "net": recogniser.net.state_dict(),
            "classes": list(recogniser.classes),
            "accuracy": recogniser.accuracy,
            "confusion": recogniser.confusion,
        },
        path,
    )


def load(path: Path = WEIGHTS) -> Recogniser:
    """The trained ruler.

    Raises:
        FileNotFoundError: it was never trained.
        ValueError: it was trained for other classes.
    """
    if not path.exists():
        raise FileNotFoundError(f"there is no {path}: run 'evaluate.py classifier' first")
    stored = torch.load(path, weights_only=True)
    if tuple(stored["classes"]) != CLASSES:
        raise ValueError(f"{path} was trained for other classes: run 'evaluate.py classifier' again")
    net = Net(len(CLASSES))
    net.load_state_dict(stored["net"])
    return Recogniser(net.eval(), CLASSES, stored["accuracy"], stored["confusion"])
