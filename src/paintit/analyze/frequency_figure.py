"""The figure of a frequency analysis, after the paper's figures 4, S5 and S6."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from paintit.analyze.bands import RINGS, ring_edges
from paintit.analyze.frequency import Curve
from paintit.analyze.plotting import GREY, ORDERED, figure

#: Inches of the figure, of one row, and of what stands above and below the rows.
WIDTH, ROW, REST = 7.2, 1.75, 0.75


def draw(
    path: Path,
    curves: Mapping[str, Sequence[Curve]],
    titles: Mapping[str, str],
    textures: Mapping[str, Mapping[int, np.ndarray]],
    target: np.ndarray | None = None,
) -> None:
    """One row for each parameterisation: energies, the same over their last value, and textures at chosen steps.

    Args:
        curves: variant -> its curves, one per seed.
        textures: variant -> step -> (h, w, 3) uint8 of the first seed.
        target: (h, w, 3) uint8, where an image was fitted: the last texture of the first row's right.
    """
    shown = max(len(row) for row in textures.values())
    with figure(path, WIDTH, ROW * len(curves) + REST) as made:
        columns = [1.55, 1.55] + [1.0] * (shown + (target is not None))
        axes = made.subplots(len(curves), len(columns), squeeze=False, width_ratios=columns)
        seen = [value for row in curves.values() for curve in row for ring in curve.magnitude for value in ring]
        for place, (row, (variant, found)) in enumerate(zip(axes, curves.items(), strict=True)):
            last = place == len(curves) - 1
            _energies(row[0], found, max(min(seen), max(seen) * 1e-5), max(seen))
            _shares(row[1], found)
            row[0].set_title(titles[variant], loc="left", fontweight="bold")
            for axis in row[:2]:
                axis.set_xlabel("step" if last else "")
                axis.tick_params(labelbottom=last)
            _pictures(row[2:], textures[variant], target)
        _legend(made, len(next(iter(curves.values()))))


def _energies(axis: Any, curves: Sequence[Curve], low: float, high: float) -> None:
    """Mean magnitude; a dot where the power has risen to half of its last value."""
    for ring in range(RINGS):
        _line(axis, curves, [[row[ring] for row in curve.magnitude] for curve in curves], ORDERED[ring])
    axis.set_yscale("log")
    axis.set_ylim(low / 1.5, high * 1.5)
    axis.set_ylabel("mean magnitude")
    _steps(axis, curves)
    for ring in range(RINGS):
        half = [step for curve in curves if (step := curve.half_power()[ring]) is not None]
        height = statistics.fmean(curve.magnitude[-1][ring] for curve in curves) / math.sqrt(2)
        if half:
            _dot(axis, statistics.fmean(half), height, ORDERED[ring])


def _shares(axis: Any, curves: Sequence[Curve]) -> None:
    """A fit: what is still wrong, over the target's power. A paint: the power over its last value. Dots at half."""
    for ring in range(RINGS):
        rows = [
            [row[ring] for row in curve.residual]
            if curve.residual is not None
            else [row[ring] / max(curve.power[-1][ring], 1e-30) for row in curve.power]
            for curve in curves
        ]
        _line(axis, curves, rows, ORDERED[ring])
        half = [(curve.half_fitted() or curve.half_power())[ring] for curve in curves]
        known = [step for step in half if step is not None]
        if len(known) == len(half):
            _dot(axis, statistics.fmean(known), 0.5, ORDERED[ring])
    axis.axhline(0.5, color=GREY, lw=0.6, ls=":", zorder=0)
    axis.set_ylim(0, 1.5)
    axis.set_yticks([0, 0.5, 1, 1.5])
    axis.set_ylabel("power / last power" if curves[0].residual is None else "wrong power / target's")
    _steps(axis, curves)


def _dot(axis: Any, x: float, y: float, color: str) -> None:
    axis.plot(x, y, "o", color=color, ms=4, mec="white", mew=0.6, zorder=3, clip_on=False)


def _steps(axis: Any, curves: Sequence[Curve]) -> None:
    """Steps on an axis that is linear up to 1 and logarithmic from there: fast and slow rises are both seen."""
    last = curves[0].steps[-1]
    axis.set_xscale("symlog", linthresh=1, linscale=0.4)
    axis.set_xlim(0, last)
    ticks = [0, *(10**k for k in range(6) if 10**k <= last)]
    axis.set_xticks(ticks, [str(tick) for tick in ticks])
    axis.minorticks_off()


def _line(axis: Any, curves: Sequence[Curve], rows: Sequence[Sequence[float]], color: str) -> None:
    """Mean over seeds, and a band from the lowest to the highest."""
    steps, values = curves[0].steps, np.array(rows)
    if len(rows) > 1:
        axis.fill_between(steps, values.min(0), values.max(0), color=color, alpha=0.2, lw=0)
    axis.plot(steps, values.mean(0), color=color)


def _pictures(axes: Sequence[Any], textures: Mapping[int, np.ndarray], target: np.ndarray | None) -> None:
    pictures = [(f"step {step}", image) for step, image in textures.items()]
    if target is not None:
        pictures.append(("target", target))
    for axis in axes:
        axis.set_axis_off()
    for axis, (title, image) in zip(axes, pictures, strict=False):
        axis.imshow(image, interpolation="nearest")
        axis.set_title(title)


def _legend(made: Any, seeds: int) -> None:
    from matplotlib.lines import Line2D

    edges = ring_edges()
    handles = [Line2D([], [], color=color) for color in ORDERED]
    labels = [f"{edges[i]:g}–{edges[i + 1]:g}" for i in range(RINGS)]
    band = f"; band: lowest to highest of {seeds} seeds" if seeds > 1 else ""
    made.legend(
        handles, labels, loc="outside upper center", ncols=RINGS, handlelength=1.4, columnspacing=1.4,
        title=f"spatial frequency in cycles per texel{band}", title_fontsize=7.5,
    )  # fmt: skip
