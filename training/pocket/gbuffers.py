"""Trace the training shapes once: ``python gbuffers.py --shapes 2500 --views 6`` writes ``work/gbuffers/*.npy``."""

from __future__ import annotations

import argparse
import multiprocessing
from pathlib import Path

import numpy as np
import torch
from shapes import random_cameras, random_shape, trace

WORK = Path(__file__).parent / "work"
ARCHETYPES = (
    "quadruped",
    "figure",
    "bird",
    "vessel",
    "furniture",
    "plant",
    "vehicle",
    "headgear",
    "tool",
    "blob",
    "ball",
    "block",
    "ring",
    "compound",
)
#: Value of ``part`` where a ray meets nothing.
MISS = 255


def make(job: tuple[int, int, int, int]) -> dict[str, np.ndarray]:
    """G-buffers of shapes ``first`` .. ``first + count``, each from its own seed, arrays of compact types."""
    first, count, views, size = job
    torch.set_num_threads(1)
    columns: dict[str, list[np.ndarray]] = {}
    for index in range(first, first + count):
        rng = np.random.default_rng([2026, index])
        shape = random_shape(rng)
        b = trace(shape, random_cameras(shape, views, rng), size)
        part = torch.where(b.mask, b.part, MISS)
        rows = {
            "position": b.position.half(),
            "normal": (b.normal * 127).round().to(torch.int8),
            "part": part,
            "eye": b.eye,
            "frame": b.frame,
            "archetype": torch.full((views,), ARCHETYPES.index(b.archetype), dtype=torch.uint8),
        }
        for name, value in rows.items():
            columns.setdefault(name, []).append(value.numpy())
    return {name: np.concatenate(values) for name, values in columns.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--shapes", type=int, default=2500)
    parser.add_argument("--views", type=int, default=6)
    parser.add_argument("--size", type=int, default=64)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--out", type=Path, default=WORK / "gbuffers")
    a = parser.parse_args()
    a.out.mkdir(parents=True, exist_ok=True)
    step = min(50, a.shapes)
    jobs = [(first, min(step, a.shapes - first), a.views, a.size) for first in range(0, a.shapes, step)]
    with multiprocessing.get_context("spawn").Pool(a.processes) as pool:
        done = pool.map(make, jobs, chunksize=1)
    for name in done[0]:
        np.save(a.out / f"{name}.npy", np.concatenate([d[name] for d in done]))


if __name__ == "__main__":
    main()
