"""Trace the training shapes once: ``python gbuffers.py --shapes 2600`` writes ``work/gbuffers/*.npy``.

Each shape is seen from four cameras as the paint loop's and two close to its surface. Some shapes are turned about +Y,
since meshes face where they like. ``--meshes FILE ...`` adds views of mesh files by the package's own ray caster, which
is the one part that needs more than torch and numpy.
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
from pathlib import Path

import numpy as np
import torch
from shapes import BODY, Buffers, close_up_cameras, random_cameras, random_shape, trace

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
#: Archetype of a mesh file whose name begins so.
MESHES = {"chair": "furniture", "chicken": "bird", "avocado": "ball", "water_bottle": "vessel"}
#: Value of ``part`` where a ray meets nothing.
MISS = 255
#: Degrees that a shape is turned about +Y, and how often.
TURNS, TURN_ODDS = (0.0, 180.0, 90.0, -90.0), (0.62, 0.22, 0.08, 0.08)


def rows(b: Buffers, turn: float) -> dict[str, np.ndarray]:
    """Compact columns of the views in ``b``, turned by ``turn`` degrees about +Y with their cameras."""
    c, s = math.cos(math.radians(turn)), math.sin(math.radians(turn))
    rotation = torch.tensor([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    views = len(b.eye)
    columns = {
        "position": (b.position @ rotation.T).half(),
        "normal": (b.normal @ rotation.T * 127).round().to(torch.int8),
        "part": torch.where(b.mask, b.part, MISS),
        "curvature": (b.curvature * 127).round().to(torch.int8),
        "eye": b.eye @ rotation.T,
        "frame": b.frame @ rotation.T,
        "turn": torch.full((views,), math.radians(turn)),
        "archetype": torch.full((views,), ARCHETYPES.index(b.archetype), dtype=torch.uint8),
    }
    return {name: value.numpy() for name, value in columns.items()}


def make(job: tuple[int, int, int, int]) -> dict[str, np.ndarray]:
    """G-buffers of shapes ``first`` .. ``first + count``, each from its own seed."""
    first, count, views, size = job
    torch.set_num_threads(1)
    parts = []
    for index in range(first, first + count):
        rng = np.random.default_rng([2026, index])
        shape = random_shape(rng)
        turn = float(rng.choice(TURNS, p=TURN_ODDS))
        whole = trace(shape, random_cameras(views - views // 3, rng), size)
        close = trace(shape, close_up_cameras(shape, whole, views // 3, rng), size)
        parts += [rows(whole, turn), rows(close, turn)]
    return {name: np.concatenate([p[name] for p in parts]) for name in parts[0]}


def mesh_views(path: Path, views: int, size: int) -> dict[str, np.ndarray]:
    """G-buffers of a mesh file: all one part, no curvature."""
    from paintit.mesh.read import read_mesh
    from paintit.render.gbuffer import rasterize
    from paintit.render.geometry import Geometry

    archetype = next((a for prefix, a in MESHES.items() if path.stem.startswith(prefix)), "compound")
    cameras = random_cameras(views, np.random.default_rng([2026, *path.stem.encode()]))
    b = rasterize(Geometry.from_mesh(read_mesh(path)), cameras, size)
    part = torch.full(b.mask.shape, BODY, dtype=torch.uint8)
    frame = torch.stack(cameras.frame(), 1)
    flat = torch.zeros(b.mask.shape)
    return rows(Buffers(b.mask, b.position, b.normal, part, cameras.eye, frame, archetype, flat), 0.0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--shapes", type=int, default=2600)
    parser.add_argument("--views", type=int, default=6)
    parser.add_argument("--size", type=int, default=64)
    parser.add_argument("--meshes", type=Path, nargs="*", default=[])
    parser.add_argument("--mesh-views", type=int, default=60)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--out", type=Path, default=WORK / "gbuffers")
    a = parser.parse_args()
    a.out.mkdir(parents=True, exist_ok=True)
    step = min(50, a.shapes)
    jobs = [(first, min(step, a.shapes - first), a.views, a.size) for first in range(0, a.shapes, step)]
    with multiprocessing.get_context("spawn").Pool(a.processes) as pool:
        done = pool.map(make, jobs, chunksize=1)
    done += [mesh_views(path, a.mesh_views, a.size) for path in a.meshes]
    for name in done[0]:
        np.save(a.out / f"{name}.npy", np.concatenate([d[name] for d in done]))


if __name__ == "__main__":
    main()
