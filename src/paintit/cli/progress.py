"""Progress on stderr: a bar on a terminal, else a line every thirty seconds, nothing with ``-q``."""

from __future__ import annotations

import time
from types import TracebackType
from typing import TYPE_CHECKING

from paintit.cli.console import Console

if TYPE_CHECKING:
    from paintit.paint.method import Step

#: Seconds between lines where there is no terminal.
LINE_EVERY = 30.0
_SMOOTHING = 0.9


class Progress:
    """Shows one step after another.

    Args:
        console: where to.
        done: steps done before this sitting.
        total: steps in all.
    """

    def __init__(self, console: Console, done: int, total: int) -> None:
        self._console = console
        self._total = total
        self._pace: float | None = None
        self._last = self._line = time.monotonic()
        self._bar = None
        if console.interactive and not console.settings.quiet:
            from rich.console import Console as RichConsole
            from rich.progress import BarColumn, TextColumn
            from rich.progress import Progress as RichProgress

            self._bar = RichProgress(
                TextColumn("step {task.completed}/{task.total}"), BarColumn(), TextColumn("{task.fields[numbers]}"),
                console=RichConsole(file=console.err, no_color=not console.color), transient=True,
            )  # fmt: skip
            self._task = self._bar.add_task("paint", total=total, completed=done, numbers="")

    def __enter__(self) -> Progress:
        if self._bar is not None:
            self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()

    def show(self, step: Step) -> None:
        """Tell of ``step``, just done."""
        now = time.monotonic()
        taken, self._last = now - self._last, now
        self._pace = taken if self._pace is None else _SMOOTHING * self._pace + (1 - _SMOOTHING) * taken
        left = _clock((self._total - step.index) * self._pace)
        numbers = f"{step.summary}  {self._pace:.2f} s/step  {left} left"
        if self._bar is not None:
            self._bar.update(self._task, completed=step.index, numbers=numbers)
        elif now - self._line >= LINE_EVERY:
            self._line = now
            self._console.note(f"step {step.index}/{self._total}  {numbers}")


def _clock(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"
