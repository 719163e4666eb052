"""Shared by the exporter's tests: assets, maps with known values, small glTF files, the validator, Blender."""

from __future__ import annotations

import functools
import importlib.util
import io
import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from paintit.export.gltf_assembly import Assembly
from paintit.export.image import png_bytes
from paintit.mesh.gltf_document import GltfDocument
from paintit.mesh.gltf_parse import read_document
from paintit.mesh.mesh import Mesh
from paintit.mesh.read import read_mesh
from paintit.texture.maps import TextureMaps

TESTS = Path(__file__).parents[1]
ASSETS = TESTS.parent / "assets" / "meshes"


@functools.cache
def asset(name: str, unwrap: str = "auto") -> Mesh:
    return read_mesh(ASSETS / name, unwrap)  # pyright: ignore[reportArgumentType]


def known_maps(mesh: Mesh, size: int = 32) -> TextureMaps:
    """Random texels, every value exactly representable in 8 bits after the files' coding."""
    draw = np.random.default_rng(7).integers
    shape = (len(mesh.layers), size, size)
    coded = torch.from_numpy(draw(0, 256, (*shape, 3)).astype(np.float32)) / 255
    rm = torch.from_numpy(draw(0, 256, (*shape, 2)).astype(np.float32)) / 255
    linear = torch.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4)
    tilt = torch.from_numpy(draw(-12, 13, (*shape, 2)).astype(np.float32)) / 127.5
    normal = torch.cat([tilt, (1 - tilt.square().sum(-1, keepdim=True)).sqrt()], -1)
    return TextureMaps(linear, rm[..., :1], rm[..., 1:], normal)


def validator_report(path: Path) -> dict[str, Any]:
    """The Khronos validator's report; skips where node or the package is absent (`npm ci` in tests/)."""
    if shutil.which("node") is None or not (TESTS / "node_modules" / "gltf-validator").is_dir():
        pytest.skip("the Khronos validator is not installed: run `npm ci` in tests/")
    done = subprocess.run(
        ["node", str(TESTS / "validate_gltf.mjs"), str(path)], capture_output=True, text=True, check=True
    )
    return json.loads(done.stdout)


def errors_of(path: Path) -> list[str]:
    """Codes of the validator's errors."""
    return [m["code"] for m in validator_report(path)["issues"]["messages"] if m["severity"] == 0]


def blender_report(path: Path) -> dict[str, Any]:
    """What Blender sees in a file, asked in a process of its own; skips where bpy is absent."""

    if importlib.util.find_spec("bpy") is None:
        pytest.skip("Blender (bpy) is not installed")
    done = subprocess.run(
        [sys.executable, str(Path(__file__).with_name("blender_report.py")), str(path)],
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout.splitlines()[-1])


def load(path: Path) -> GltfDocument:
    return read_document(path, path.read_bytes())


def image_of(document: GltfDocument, info: dict[str, Any]) -> np.ndarray:
    """(h, w, c) uint8 of the image behind a texture info."""
    source = document.json["textures"][info["index"]]["source"]
    return np.asarray(Image.open(io.BytesIO(document.image(source))))


def grid_document(materials: list[dict[str, Any]], **more: Any) -> Assembly:
    """A GLB under construction: a curved 2 x 2 grid of quads with normals and two UV sets, one node, unshared."""
    x, y = np.meshgrid(np.linspace(-1, 1, 3), np.linspace(-1, 1, 3))
    position = np.stack([x, y, 0.3 * np.cos(x + 2 * y)], -1).reshape(-1, 3).astype(np.float32)
    normal = np.stack([0.3 * np.sin(x + 2 * y), 0.6 * np.sin(x + 2 * y), np.ones_like(x)], -1).reshape(-1, 3)
    normal = (normal / np.linalg.norm(normal, axis=1, keepdims=True)).astype(np.float32)
    uv = (np.stack([x, -y], -1).reshape(-1, 2) * 0.45 + 0.5).astype(np.float32)
    quads = np.array([[i, i + 1, i + 4, i, i + 4, i + 3] for i in (0, 1, 3, 4)]).reshape(-1, 3)
    assembly = Assembly(
        {
            "asset": {"version": "2.0", "generator": "the test"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0, "name": "grid"}],
            "materials": materials,
            **more,
        }
    )
    assembly.append(
        "meshes",
        {
            "name": "grid",
            "primitives": [
                {
                    "attributes": {
                        "POSITION": assembly.add_attribute(position, bounds=True),
                        "NORMAL": assembly.add_attribute(normal),
                        "TEXCOORD_0": assembly.add_attribute(uv),
                        "TEXCOORD_1": assembly.add_attribute(np.ascontiguousarray(uv[:, ::-1])),
                        "COLOR_0": assembly.add_attribute(np.arange(36, dtype=np.uint8).reshape(9, 4), normalized=True),
                    },
                    "indices": assembly.add_indices(quads),
                    "material": 0,
                    "targets": [
                        {
                            "POSITION": assembly.add_attribute(
                                np.full((9, 3), 0.25, np.float32) * position[:, :1], bounds=True
                            )
                        }
                    ],
                }
            ],
        },
    )
    return assembly


def add_image(assembly: Assembly, pixels: np.ndarray) -> int:
    """Texture index of a new PNG."""
    if "samplers" not in assembly.json:
        assembly.append("samplers", {"wrapS": 33071})
    return assembly.add_texture(f"image{len(assembly.pngs)}", png_bytes(pixels), 0)


def save(assembly: Assembly, path: Path) -> Path:
    path.write_bytes(assembly.glb())
    return path
