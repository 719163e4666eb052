"""Meshes built by hand, and a cache folder of the tests' own."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from paintit.mesh.mesh import Mesh
from paintit.render.light import Light, from_radiance, prefilter


def make_sphere(rows: int) -> Mesh:
    """A latitude-longitude sphere of radius 1, smooth normals, u once around, v from pole to pole."""
    theta = np.linspace(0, np.pi, rows + 1)
    phi = np.linspace(0, 2 * np.pi, 2 * rows + 1)
    grid = lambda t, p: np.stack([np.sin(t) * np.sin(p), np.cos(t), np.sin(t) * np.cos(p)], -1)  # noqa: E731
    vertices = grid(*np.meshgrid(theta, phi, indexing="ij")).reshape(-1, 3)
    uvs = np.stack(np.meshgrid(theta / np.pi, phi / (2 * np.pi), indexing="ij")[::-1], -1).reshape(-1, 2)
    row, column = (a.reshape(-1) for a in np.meshgrid(np.arange(rows), np.arange(2 * rows), indexing="ij"))
    a = row * (2 * rows + 1) + column
    b, c, d = a + 2 * rows + 1, a + 2 * rows + 2, a + 1
    faces = np.concatenate([np.stack([a, b, c], -1)[row > -1], np.stack([a, c, d], -1)])
    keep = ~((faces[:, 0] < 2 * rows + 1) & (faces[:, 2] < 2 * rows + 1) & (np.arange(len(faces)) >= len(a)))
    keep &= ~((row == rows - 1).repeat(1).tolist() + [False] * len(a) & np.ones(len(faces), bool))
    faces = faces[keep]
    normals = vertices[faces].astype(np.float32)
    around = np.stack([normals[..., 2], 0 * normals[..., 0], -normals[..., 0], 0 * normals[..., 0] + 1], -1)
    around[..., :3] /= np.maximum(np.linalg.norm(around[..., :3], axis=-1, keepdims=True), 1e-9)
    return Mesh(vertices, faces, uvs, faces.copy(), normals, around, np.zeros(len(faces), np.int64))
