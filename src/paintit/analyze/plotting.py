"""What the figures share: a quiet style, colours that every eye tells apart, and matplotlib asked for in time."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from paintit.errors import PaintitError
from paintit.files import atomic

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: From low to high, dark to light: matplotlib's viridis at even places, the pale end darkened for white paper.
ORDERED = ("#440154", "#3b528b", "#21918c", "#5ec962", "#d9a600")
GREY = "#777777"
#: Dots per inch of the PNG files: 7.2 inches are 1440 pixels.
DPI = 200
_STYLE: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 8,
    "axes.titlesize": 8,
    "axes.labelsize": 8,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "legend.fontsize": 7.5,
    "legend.frameon": False,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "lines.linewidth": 1.4,
}


def require_matplotlib() -> None:
    """Fail before the work rather than after it.

    Raises:
        PaintitError: matplotlib is not installed.
    """
    try:
        importlib.import_module("matplotlib.figure")
    except ImportError as error:
        raise PaintitError(
            "analyze.extra", f"figures need the package 'matplotlib': {error}", "pip install 'paintit[analyze]'"
        ) from error


@contextmanager
def figure(path: Path, width: float, height: float) -> Iterator[Figure]:
    """Yield a figure of so many inches; it is written to ``path`` as PNG at the end.

    No window system and no global state but the style, which is put back.
    """
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with matplotlib.rc_context(_STYLE):
        made = Figure(figsize=(width, height), layout="constrained")
        FigureCanvasAgg(made)
        yield made
        with atomic(path) as temporary:
            made.savefig(temporary, format="png", dpi=DPI, metadata={"Software": None})
