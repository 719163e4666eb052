"""Seconds per step, split by stage, at three mesh sizes, all in one run: `make bench`.

Prints medians and the ratio to the smallest mesh. The three painters take turns, one step each, so that whatever else
the machine does falls on all of them alike.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import platform
import statistics
from pathlib import Path

import numpy as np
import torch

from paintit.config import preset
from paintit.mesh.mesh import Mesh, Part
from paintit.mesh.read import read_mesh
from paintit.paint.painter import Painter

ASSETS = Path(__file__).parent.parent / "assets" / "meshes"
STAGES = ("network", "render", "guidance", "backward", "optimiser")


def subdivide(mesh: Mesh) -> Mesh:
    """Each triangle split into four at its edges' midpoints; positions, UVs, normals and tangents are interpolated."""

    def split(indices: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        edges = np.sort(indices[:, [[0, 1], [1, 2], [2, 0]]], axis=-1)
        unique, inverse = np.unique(edges.reshape(-1, 2), axis=0, return_inverse=True)
        mid = inverse.reshape(-1, 3) + len(values)
        a, b, c = indices.T
        ab, bc, ca = mid.T
        faces = np.stack([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca], -1).reshape(-1, 3)
        return faces, np.concatenate([values, values[unique].mean(1)])

    def corners(values: np.ndarray, unit: int) -> np.ndarray:
        a, b, c = values[:, 0], values[:, 1], values[:, 2]
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        out = np.stack([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca], 1).reshape(-1, 3, values.shape[-1])
        length = np.linalg.norm(out[..., :unit], axis=-1, keepdims=True)
        out[..., :unit] /= np.maximum(length, 1e-12)
        return out

    faces, vertices = split(mesh.faces, mesh.vertices)
    face_uvs, uvs = split(mesh.face_uvs, mesh.uvs)
    tangents = corners(mesh.tangents, 3)
    tangents[..., 3] = np.where(tangents[..., 3] < 0, -1, 1)
    parts = tuple(Part(p.name, (4 * p.faces[0], 4 * p.faces[1]), p.layer) for p in mesh.parts)
    return dataclasses.replace(
        mesh, vertices=vertices, faces=faces, uvs=uvs, face_uvs=face_uvs, normals=corners(mesh.normals, 3),
        tangents=tangents, face_layer=np.repeat(mesh.face_layer, 4), parts=parts, source=None,
    )  # fmt: skip


def repeated(mesh: Mesh, times: int) -> Mesh:
    for _ in range(times):
        mesh = subdivide(mesh)
    return mesh


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--preset", default="pocket")
    parser.add_argument("--prior", help="another prior than the preset's")
    parser.add_argument("--steps", type=int, default=15, help="measured steps per mesh")
    parser.add_argument("--warm-up", type=int, default=3)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()

    config = preset(options.preset)
    if options.prior:
        config = dataclasses.replace(config, guidance=dataclasses.replace(config.guidance, prior=options.prior))
    spot, bob = (read_mesh(ASSETS / name / f"{name}.obj") for name in ("spot", "bob"))
    meshes = {"spot": spot, "spot, subdivided twice": repeated(spot, 2), "bob, subdivided 3 times": repeated(bob, 3)}
    painters = {name: Painter(mesh, "red plastic", config, profile=True) for name, mesh in meshes.items()}
    streams = {name: iter(painter) for name, painter in painters.items()}
    records = {name: [] for name in painters}
    for index in range(options.warm_up + options.steps):
        for name, steps in streams.items():
            step = next(steps)
            if index >= options.warm_up:
                records[name].append(step)

    rows = []
    for name, steps in records.items():
        row = {stage: statistics.median(s.timings[stage] for s in steps) for stage in STAGES}
        seconds = [s.seconds for s in steps]
        rows.append({"mesh": name, "faces": len(meshes[name].faces), **row, "step": statistics.median(seconds),
                     "min": min(seconds), "max": max(seconds)})  # fmt: skip
    base = rows[0]["step"]
    if options.json:
        print(json.dumps({"torch": torch.__version__, "threads": torch.get_num_threads(), "rows": rows}, indent=1))
        return
    print(f"preset {options.preset}, {options.steps} steps each, medians in ms; torch {torch.__version__}, "
          f"{torch.get_num_threads()} threads, {platform.processor() or platform.machine()}")  # fmt: skip
    print(f"{'mesh':26}{'faces':>9}" + "".join(f"{s:>11}" for s in (*STAGES, "step", "min", "max", "ratio")))
    for row in rows:
        figures = [f"{1e3 * row[s]:.1f}" for s in (*STAGES, "step", "min", "max")] + [f"{row['step'] / base:.2f}"]
        print(f"{row['mesh']:26}{row['faces']:>9}" + "".join(f"{f:>11}" for f in figures))


if __name__ == "__main__":
    main()
