"""The folder of a frequency analysis: every curve is kept as soon as it is done, so that a broken-off run goes on."""

from __future__ import annotations

import csv
import dataclasses
import hashlib
import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from torch import Tensor

from paintit.analyze.bands import ring_edges
from paintit.analyze.frequency import Curve
from paintit.errors import OutputError, UsageError
from paintit.export.image import quantize
from paintit.files import atomic
from paintit.settings import same_settings

#: Raised when a field of ``frequency.json`` is renamed or removed; adding one is free.
SCHEMA = "paintit.frequency/1"


class CurveFolder:
    """Curves and textures of one analysis.

    Args:
        path: the folder; made when something is written.
        subject: all that a curve depends on but for its variant and seed, as JSON can hold it.
    """

    def __init__(self, path: Path, subject: Mapping[str, Any]) -> None:
        self.path = path
        text = json.dumps(subject, sort_keys=True, ensure_ascii=False)
        self.key = hashlib.sha256(text.encode()).hexdigest()

    def curve(self, variant: str, seed: int, settings: Mapping[str, Any]) -> Curve | None:
        """The curve as it was kept; None where there is none.

        Raises:
            UsageError: there is one, but of other settings.
            OutputError: it cannot be read.
        """
        path = self._curve(variant, seed)
        try:
            data = json.loads(path.read_text("utf-8"))
            same = data["key"] == self.key and same_settings(data["settings"], settings)
            curve = Curve.from_dict(data["curve"])
        except FileNotFoundError:
            return None
        except (OSError, ValueError, KeyError, TypeError) as error:
            reason = " ".join(str(error).split())
            raise OutputError("analyze.damaged", f"cannot read {path}: {reason}", "delete that file") from None
        if not same:
            raise UsageError(
                "analyze.differs", f"{path} is of other settings", "choose another folder with -o, or add --overwrite"
            )
        return curve

    def keep(self, curve: Curve, settings: Mapping[str, Any], textures: Mapping[int, Tensor]) -> None:
        """Write a finished curve, its textures first: where the curve is, they are."""
        for step, coded in textures.items():
            with atomic(self.texture(curve.variant, curve.seed, step)) as temporary:
                Image.fromarray(quantize(coded)).save(temporary, "PNG")
        data = {"key": self.key, "settings": settings, "curve": dataclasses.asdict(curve)}
        write_json(self._curve(curve.variant, curve.seed), data)

    def textures(self, variant: str, seed: int, steps: tuple[int, ...]) -> dict[int, np.ndarray]:
        """(h, w, 3) uint8 of the kept steps."""
        found: dict[int, np.ndarray] = {}
        for step in steps:
            with Image.open(self.texture(variant, seed, step)) as image:
                found[step] = np.asarray(image.convert("RGB"))
        return found

    def texture(self, variant: str, seed: int, step: int) -> Path:
        return self.path / "textures" / f"{variant}-seed{seed}-step{step:05}.png"

    def _curve(self, variant: str, seed: int) -> Path:
        return self.path / "curves" / f"{variant}-seed{seed}.json"


def write_json(path: Path, data: Mapping[str, Any]) -> None:
    """Write ``data``, whole or not at all."""
    with atomic(path) as temporary:
        temporary.write_text(json.dumps(data, indent=1, ensure_ascii=False) + "\n", "utf-8")


def write_csv(path: Path, curves: list[Curve]) -> None:
    """One row per curve, step and ring; ``low`` and ``high`` are the ring's radii in cycles per texel."""
    edges = ring_edges()
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(["variant", "seed", "step", "ring", "low", "high", "magnitude", "power", "residual"])
    for curve in curves:
        for i, step in enumerate(curve.steps):
            for ring in range(len(edges) - 1):
                wrong = "" if curve.residual is None else f"{curve.residual[i][ring]:.6g}"
                rows.writerow([
                    curve.variant, curve.seed, step, ring + 1, f"{edges[ring]:g}", f"{edges[ring + 1]:g}",
                    f"{curve.magnitude[i][ring]:.6g}", f"{curve.power[i][ring]:.6g}", wrong,
                ])  # fmt: skip
    with atomic(path) as temporary:
        temporary.write_text(text.getvalue(), "utf-8")
