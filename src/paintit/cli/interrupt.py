"""Ctrl-C: once to stop after the step and save, twice to stop at once."""

from __future__ import annotations

import signal
import threading
from types import FrameType, TracebackType
from typing import Any

from paintit.cli.console import Console


class StopAfterStep:
    """While entered, the first SIGINT or SIGTERM is noted and :meth:`asked` turns true; the second interrupts."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._asked = False
        self._former: dict[int, Any] = {}

    def asked(self) -> bool:
        return self._asked

    def __enter__(self) -> StopAfterStep:
        # Python delivers signals to the main thread only, and lets only it set handlers.
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                self._former[number] = signal.signal(number, self._handle)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, former in self._former.items():
            signal.signal(number, former)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        if self._asked:
            raise KeyboardInterrupt
        self._asked = True
        self._console.note("stopping after this step; once more to stop at once")
