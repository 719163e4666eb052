"""A million triangles through the command line: inspect, unwrap, 50 steps, export. Seconds and memory of each.

    .venv/bin/python benchmarks/million.py --folder /tmp/million

The mesh is the koala with every edge cut in ``--cuts`` and a displacement of many small bumps, so that neither the
unwrap nor the visibility is easier than a real scan's; without texture coordinates, as OBJ and as GLB. The bound is
120 seconds and 4 GiB on two cores for `inspect` and `paint` together; `paint` unwraps and exports too.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import trimesh

from paintit.mesh.normals import face_normals
from paintit.mesh.read import read_mesh

KOALA = Path(__file__).parent.parent / "assets" / "meshes" / "koala.ply"
SECONDS, MIB = 120.0, 4096.0
_WATCH = """
import json, os, resource, subprocess, sys
done = subprocess.run(sys.argv[2:], stdout=subprocess.PIPE, text=True)
used = resource.getrusage(resource.RUSAGE_CHILDREN)
open(sys.argv[1], "w").write(json.dumps([done.returncode, done.stdout, used.ru_utime + used.ru_stime, used.ru_maxrss]))
"""
"""Run in a process of its own, so that the peak is the command's alone."""


def cut(vertices: np.ndarray, faces: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Each triangle in n * n, by a regular grid; vertices on common edges are shared.

    Args:
        vertices: (v, 3). faces: (f, 3). n: pieces of an edge.
    """
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]], axis=-1)
    unique, edge = np.unique(edges.reshape(-1, 2), axis=0, return_inverse=True)
    edge = edge.reshape(-1, 3)
    step = np.arange(1, n) / n
    on_edges = vertices[unique[:, 0], None] * (1 - step)[:, None] + vertices[unique[:, 1], None] * step[:, None]
    inner = [(i, j) for i in range(1, n) for j in range(1, n - i)]
    weights = np.array([(n - i - j, i, j) for i, j in inner], float).reshape(-1, 3) / n
    inside = np.einsum("wk,fkd->fwd", weights, vertices[faces])
    points = np.concatenate([vertices, on_edges.reshape(-1, 3), inside.reshape(-1, 3)])
    index = np.full((len(faces), n + 1, n + 1), -1)  # (i, j): i steps toward the second corner, j toward the third
    index[:, 0, 0], index[:, n, 0], index[:, 0, n] = faces.T
    for k, along in enumerate(([(s, 0) for s in range(1, n)], [(n - s, s) for s in range(1, n)],
                               [(0, n - s) for s in range(1, n)])):  # fmt: skip
        forward = faces[:, k] < faces[:, (k + 1) % 3]
        for s, (i, j) in enumerate(along):
            index[:, i, j] = len(vertices) + edge[:, k] * (n - 1) + np.where(forward, s, n - 2 - s)
    first = len(vertices) + len(unique) * (n - 1)
    for w, (i, j) in enumerate(inner):
        index[:, i, j] = first + np.arange(len(faces)) * len(inner) + w
    up = [(index[:, i, j], index[:, i + 1, j], index[:, i, j + 1]) for i in range(n) for j in range(n - i)]
    down = [
        (index[:, i + 1, j], index[:, i + 1, j + 1], index[:, i, j + 1]) for i in range(n) for j in range(n - i - 1)
    ]
    return points, np.stack([np.stack(corners, 1) for corners in up + down], 1).reshape(-1, 3)


def bumpy(vertices: np.ndarray, faces: np.ndarray, depth: float = 0.004) -> np.ndarray:
    """Vertices moved along their normals by waves of five lengths in random directions, ``depth`` of the extent."""
    normal, area = face_normals(vertices, faces)
    summed = np.stack(
        [np.bincount(faces.ravel(), np.repeat(normal[:, k] * area, 3), len(vertices)) for k in range(3)], 1
    )
    summed /= np.maximum(np.linalg.norm(summed, axis=1, keepdims=True), 1e-300)
    extent = float(np.ptp(vertices, axis=0).max())
    draw = np.random.default_rng(0)
    height = np.zeros(len(vertices))
    for waves in (4, 9, 20, 45, 100):
        direction = draw.normal(size=(3, 3))
        direction *= 2 * np.pi * waves / extent / np.linalg.norm(direction, axis=1, keepdims=True)
        height += np.sin(vertices @ direction.T + draw.uniform(0, 6.3, 3)).prod(1) / waves**0.5
    return vertices + summed * (depth * extent * height)[:, None]


def make(folder: Path, cuts: int) -> list[Path]:
    """The mesh as OBJ and as GLB, written once."""
    paths = [folder / f"koala{cuts}.obj", folder / f"koala{cuts}.glb"]
    if not all(path.exists() for path in paths):
        folder.mkdir(parents=True, exist_ok=True)
        koala = read_mesh(KOALA)
        vertices, faces = cut(koala.vertices, koala.faces, cuts)
        mesh = trimesh.Trimesh(bumpy(vertices, faces), faces, process=False)
        for path in paths:
            mesh.export(path)
    return paths


def measured(command: list[str], folder: Path) -> tuple[str, float, float, float]:
    """Standard output of a command, and its seconds by the clock, seconds of the processor, and peak MiB."""
    note, start = folder / "watched.json", time.perf_counter()
    subprocess.run([sys.executable, "-c", _WATCH, str(note), *command], check=True)
    seconds = time.perf_counter() - start
    code, out, cpu, peak = json.loads(note.read_text())
    if code:
        sys.exit(f"{' '.join(command)} ended with {code}")
    return out, seconds, cpu, peak / 1024


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, required=True, help="where the meshes and results go")
    parser.add_argument("--cuts", type=int, default=12, help="pieces of an edge: 12 makes 1 024 704 triangles")
    parser.add_argument("--steps", type=int, default=50)
    parser.add_argument("--formats", nargs="+", default=["obj", "glb"])
    options = parser.parse_args()
    paintit = [sys.executable, "-m", "paintit"]
    print(f"{os.cpu_count()} cores, OMP_NUM_THREADS={os.environ.get('OMP_NUM_THREADS', '-')}")
    print(f"{'':24}{'seconds':>9}{'CPU s':>9}{'peak MiB':>10}")
    good = True
    for path in make(options.folder, options.cuts):
        if path.suffix[1:] not in options.formats:
            continue
        target = options.folder / f"painted-{path.suffix[1:]}.glb"
        paint = ["paint", str(path), "a koala with thick grey fur", "--steps", str(options.steps), "-o", str(target)]
        out, *inspected = measured([*paintit, "--json", "inspect", str(path)], options.folder)
        faces = json.loads(out)["data"]["mesh"]["faces"]
        out, *painted = measured([*paintit, "--json", *paint, "--overwrite"], options.folder)
        for name, row in (("inspect", inspected), ("paint", painted)):
            print(f"{path.suffix[1:]} {name:20}{row[0]:9.1f}{row[1]:9.1f}{row[2]:10.0f}")
        total, peak = inspected[0] + painted[0], max(inspected[2], painted[2])
        within = total <= SECONDS and peak <= MIB
        good &= within
        words = "within" if within else "beyond"
        print(f"{path.suffix[1:]} together, {faces} triangles: {total:.1f} s, {peak:.0f} MiB: {words} the bound")
    sys.exit(not good)


if __name__ == "__main__":
    main()
