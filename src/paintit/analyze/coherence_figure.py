"""The figure of a coherence analysis: singular values over the smallest, against the controls and the paper's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from paintit.analyze.coherence import PAPER_RATIOS
from paintit.analyze.plotting import GREY, ORDERED, figure

#: Inches of the figure, of one row, and of what stands above and below the rows.
WIDTH, ROW, REST = 7.2, 1.9, 0.85
_READS = {"stack": "all channels", "rgb": "shaded RGB only"}
#: How far apart the lines of two scales stand, in singular values.
_BESIDE = 0.12
#: Controls that have a line, and its dashes. The repeated gradient has none: its rank is 1.
_CONTROLS = {"even": ("same value in every pixel", (0, (5, 2))), "noise": ("noise alone", (0, (1, 1.2))),
             "random": ("random", "-")}  # fmt: skip


def draw(path: Path, table: Sequence[Mapping[str, Any]], views: int, seeds: int) -> None:
    """A row for each state and set of channels, a column for each t, a line for each guidance scale.

    Args:
        table: from ``coherence_run.summary``.
    """
    guided = [entry for entry in table if entry["kind"] == "guidance"]
    states = list(dict.fromkeys((entry["after"], entry["reads"]) for entry in guided))
    levels = list(dict.fromkeys(entry["t"] for entry in guided))
    scales = list(dict.fromkeys(entry["scale"] for entry in guided))
    colors = {scale: ORDERED[i * (len(ORDERED) - 1) // max(len(scales) - 1, 1)] for i, scale in enumerate(scales)}
    with figure(path, WIDTH, ROW * len(states) + REST) as made:
        axes = made.subplots(len(states), len(levels), squeeze=False, sharex=True, sharey=True)
        for axis, t in zip(axes[0], levels, strict=True):
            axis.set_title(f"t = {t:g}")
        for row, (after, reads) in zip(axes, states, strict=True):
            here = [entry for entry in table if (entry["after"], entry["reads"]) == (after, reads)]
            for axis, t in zip(row, levels, strict=True):
                _panel(axis, [entry for entry in here if entry["t"] in (t, None)], colors, views)
            start = "random start" if after == 0 else f"after {after} steps"
            row[0].set_ylabel(f"{_READS[reads]}, {start}\nsingular value / smallest")
        for axis in axes[-1]:
            axis.set_xlabel("singular value")
        _legend(made, colors, views, seeds)


def _panel(axis: Any, entries: Sequence[Mapping[str, Any]], colors: Mapping[float, str], views: int) -> None:
    """Lines side by side where they would hide one another; bars from the lowest to the highest seed; mean cosines."""
    places = np.arange(1, views + 1)
    for entry in (entry for entry in entries if entry["ratios"]):
        ratios = np.array(entry["ratios"])
        if entry["kind"] != "guidance":
            axis.plot(places, ratios, color=GREY, lw=1, ls=_CONTROLS[entry["kind"]][1], zorder=1)
            continue
        order = list(colors).index(entry["scale"])
        bars = ratios - entry["low"], entry["high"] - ratios
        axis.errorbar(places + _BESIDE * (order - (len(colors) - 1) / 2), ratios, bars, fmt="o-", ms=3, lw=1.2,
                      elinewidth=0.8, color=colors[entry["scale"]])  # fmt: skip
        axis.text(0.98, 0.97 - 0.1 * order, f"cosine {entry['cosine']:.2f}", color=colors[entry["scale"]],
                  transform=axis.transAxes, ha="right", va="top", fontsize=7)  # fmt: skip
    if views == len(PAPER_RATIOS):
        axis.plot(places, PAPER_RATIOS, "s", color="black", ms=3.5, mfc="none", mew=0.8)
    axis.set_yscale("log")
    axis.set_yticks([1, 2, 5, 10, 20, 50], ["1", "2", "5", "10", "20", "50"])
    axis.minorticks_off()
    axis.set_xticks(places)


def _legend(made: Any, colors: Mapping[float, str], views: int, seeds: int) -> None:
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], color=color, marker="o", ms=3) for color in colors.values()]
    labels = [f"guidance scale {scale:g}" for scale in colors]
    for label, dashes in _CONTROLS.values():
        handles.append(Line2D([], [], color=GREY, lw=1, ls=dashes))
        labels.append(label)
    if views == len(PAPER_RATIOS):
        handles.append(Line2D([], [], color="black", marker="s", ms=3.5, mfc="none", mew=0.8, ls=""))
        labels.append("paper, Stable Diffusion")
    band = f"lines: mean of {seeds} seeds; bars: lowest to highest" if seeds > 1 else None
    made.legend(handles, labels, loc="outside upper center", ncols=4, title=band, title_fontsize=7.5)
