"""Cells of an evaluation: one mesh, one prompt, one seed; how each method paints it, and how it is kept on disk."""

from __future__ import annotations

import dataclasses
import json
import os
import re
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from meanings import meaning
from ruler import constant_maps, subject, true_maps
from torch import Tensor

from paintit.color import decode_srgb
from paintit.config import PaintConfig, preset, to_dict
from paintit.export.finish import finish
from paintit.guidance.pocket import PocketPrior
from paintit.paint.painter import Painter
from paintit.settings import same_settings
from paintit.texture.maps import TextureMaps
from paintit.variants import apply

#: ``guided`` the product; ``pixels`` texels without a network, with total variation; ``mean-start`` even maps of the
#: caption's mean material as the text encoder tells it, no guidance; ``rgb-only`` guidance of the shaded picture alone;
#: ``truth`` the generator's own material, the most that any method can reach.
Method = Literal["guided", "pixels", "mean-start", "rgb-only", "truth"]
METHODS: tuple[Method, ...] = ("guided", "pixels", "mean-start", "rgb-only", "truth")
#: Steps that are timed to find how many fill a given number of seconds.
TIMED_STEPS = 4


@dataclass(frozen=True)
class Cell:
    mesh: str
    prompt: str
    seed: int

    @property
    def name(self) -> str:
        """File name without extension."""
        return f"{self.mesh}-{re.sub(r'[^a-z0-9]+', '-', self.prompt.lower()).strip('-')}-{self.seed}"


def grid(meshes: Sequence[str], prompts: Sequence[str], seeds: Sequence[int], part: str = "1/1") -> list[Cell]:
    """All cells, or every n-th from the i-th where ``part`` is "i/n"."""
    cells = [Cell(mesh, prompt, seed) for seed in seeds for prompt in prompts for mesh in meshes]
    first, step = map(int, part.split("/"))
    if not 1 <= first <= step:
        raise ValueError(f"part '{part}' is not i/n with 1 <= i <= n")
    return cells[first - 1 :: step]


def changed(config: PaintConfig, assignments: Sequence[str]) -> PaintConfig:
    """``config`` with each ``group.name=JSON`` replaced."""
    for assignment in assignments:
        path, value = assignment.split("=", 1)
        parsed = json.loads(value)
        parsed = tuple(parsed) if isinstance(parsed, list) else parsed
        *groups, name = path.split(".")
        if groups:
            group = getattr(config, groups[0])
            config = dataclasses.replace(config, **{groups[0]: dataclasses.replace(group, **{name: parsed})})
        else:
            config = dataclasses.replace(config, **{name: parsed})
    return config


def config_of(method: Method, assignments: Sequence[str]) -> PaintConfig:
    """The settings of a method: the ``pocket`` preset, what the method changes, then ``assignments``."""
    config = apply(preset("pocket"), "pixels" if method == "pixels" else "dcpbr")
    own = ['guidance.reads=["shaded"]'] if method == "rgb-only" else []
    return changed(config, [*own, *assignments])


@dataclass
class Studio:
    """Paints cells by one method."""

    method: Method
    config: PaintConfig
    prior: PocketPrior | None
    """None for ``truth``, which needs none."""
    seconds: float | None = None
    """Paint for about so long instead of the settings' number of steps."""

    def paint(self, cell: Cell) -> tuple[TextureMaps, float, int]:
        """Finished maps as a user gets them, seconds of painting, and steps."""
        on = subject(cell.mesh, self.config.texture.size)
        if self.method == "truth":
            rng = np.random.default_rng([cell.seed, 4242])
            return true_maps(on, meaning(cell.prompt, rng), rng), 0.0, 0
        prior = self.prior
        if prior is None:
            raise ValueError(f"method '{self.method}' needs a prior")
        if self.method == "mean-start":
            value = prior.mean_material(cell.prompt)
            return constant_maps(torch.cat([decode_srgb(value[:3]), value[3:]]), on.seen), 0.0, 0
        config = dataclasses.replace(self.config, seed=cell.seed)
        if self.seconds is not None:
            trial = list(Painter(on.mesh, cell.prompt, changed(config, [f"optim.steps={TIMED_STEPS}"]), prior))
            each = float(np.median([step.seconds for step in trial]))
            config = changed(config, [f"optim.steps={max(1, round(self.seconds / each))}"])
        painter = Painter(on.mesh, cell.prompt, config, prior)
        spent = sum(step.seconds for step in painter)
        return finish(on.mesh, painter.maps(), painter.support), spent, config.optim.steps

    def record(self) -> dict[str, Any]:
        """What has to be the same in all cells of one folder."""
        weights = self.prior.spec.revision if self.prior else ""
        return {"method": self.method, "seconds": self.seconds, "weights": weights, "config": to_dict(self.config)}


def claim(folder: Path, record: dict[str, Any]) -> None:
    """Write ``settings.json``, or see that it says the same.

    Raises:
        ValueError: the folder holds cells of other settings or weights.
    """
    file = folder / "settings.json"
    folder.mkdir(parents=True, exist_ok=True)
    if not file.exists():
        _write(file, json.dumps(record, indent=1).encode())
    known, given = json.loads(file.read_text()), json.loads(json.dumps(record))
    if not same_settings(known.pop("config", {}), given.pop("config", {})) or known != given:
        raise ValueError(f"'{folder}' holds cells of other settings or weights: choose another --out")


def paint_all(studio: Studio, cells: Sequence[Cell], folder: Path) -> Iterator[tuple[Cell, float]]:
    """Paint the cells that ``folder`` lacks; yields each with its seconds."""
    claim(folder, studio.record())
    for cell in cells:
        if (folder / f"{cell.name}.json").exists():
            continue
        began = time.perf_counter()
        maps, seconds, steps = studio.paint(cell)
        save(folder, cell, maps, seconds, steps)
        yield cell, time.perf_counter() - began


def save(folder: Path, cell: Cell, maps: TextureMaps, seconds: float, steps: int) -> None:
    """``<cell>.npz`` with the maps in half precision, then ``<cell>.json``, whose presence says that both are whole."""
    temporary = folder / f".{cell.name}.{os.getpid()}.npz"
    np.savez_compressed(temporary, packed=maps.packed().half().numpy())
    temporary.replace(folder / f"{cell.name}.npz")
    row = {**dataclasses.asdict(cell), "seconds": round(seconds, 2), "steps": steps}
    _write(folder / f"{cell.name}.json", json.dumps(row).encode())


def load(folder: Path) -> list[tuple[Cell, float]]:
    """The cells in a folder with the seconds that each took, by seed, then mesh, then prompt as painted."""
    rows = [json.loads(f.read_text()) for f in folder.glob("*.json") if f.with_suffix(".npz").exists()]
    found = [(Cell(r["mesh"], r["prompt"], r["seed"]), float(r["seconds"])) for r in rows]
    return sorted(found, key=lambda x: (x[0].seed, x[0].mesh, x[0].prompt))


def load_maps(folder: Path, cell: Cell) -> TextureMaps:
    with np.load(folder / f"{cell.name}.npz") as file:
        packed: Tensor = torch.from_numpy(file["packed"]).float()
    return TextureMaps.unpacked(packed)


def _write(file: Path, data: bytes) -> None:
    temporary = file.with_name(f".{file.name}.{os.getpid()}")
    temporary.write_bytes(data)
    temporary.replace(file)
