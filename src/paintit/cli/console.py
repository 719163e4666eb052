"""Two streams: the result on stdout, all else on stderr. With ``--json`` the result is one document."""

from __future__ import annotations

import json
import os
import sys
from dataclasses import asdict, dataclass, field
from typing import Any, TextIO

from paintit._version import __version__
from paintit.cli.globals import Globals
from paintit.errors import PaintitError

#: Raised when a field of the document is renamed or removed; adding one is free.
SCHEMA = "paintit.cli/1"


@dataclass(frozen=True)
class Failure:
    """The ``error`` of the document."""

    code: str
    message: str
    hint: str = ""


@dataclass(frozen=True, kw_only=True)
class Document:
    """What ``--json`` prints, whatever the command."""

    schema: str = SCHEMA
    ok: bool
    command: str
    version: str = __version__
    data: dict[str, Any] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    error: Failure | None = None

    def text(self) -> str:
        return json.dumps(asdict(self), ensure_ascii=False, default=str)


@dataclass(frozen=True)
class Result:
    """What a command hands back: lines for people, data for programs, an exit code."""

    text: str
    data: dict[str, Any]
    exit_code: int = 0


class Console:
    """How one command speaks.

    Args:
        settings: the global flags.
        out, err: the streams; by default those of the process.
    """

    def __init__(self, settings: Globals, out: TextIO | None = None, err: TextIO | None = None) -> None:
        self.settings = settings
        self.out = out or sys.stdout
        self.err = err or sys.stderr
        self.warnings: list[str] = []

    @property
    def interactive(self) -> bool:
        return self.err.isatty() and not self.settings.quiet

    @property
    def color(self) -> bool:
        return not self.settings.no_color and not os.environ.get("NO_COLOR")

    def note(self, text: str) -> None:
        """A line about what goes on."""
        if not self.settings.quiet:
            print(text, file=self.err, flush=True)

    def warn(self, text: str) -> None:
        """Something the user should know; also in the document."""
        self.warnings.append(text)
        self.note(f"warning: {text}")

    def result(self, command: str, result: Result) -> None:
        if self.settings.json:
            ok = result.exit_code == 0
            document = Document(ok=ok, command=command, data=result.data, warnings=tuple(self.warnings))
            print(document.text(), file=self.out, flush=True)
        elif result.text:
            print(result.text, file=self.out, flush=True)

    def error(self, command: str, error: PaintitError) -> None:
        """One line on stderr, and with ``--json`` the document."""
        if self.settings.json:
            failure = Failure(error.code, one_line(error.message), one_line(error.hint))
            document = Document(ok=False, command=command, warnings=tuple(self.warnings), error=failure)
            print(document.text(), file=self.out, flush=True)
        print(f"error: {one_line(str(error))}", file=self.err, flush=True)


def one_line(text: str) -> str:
    return " ".join(text.split())


def table(rows: list[tuple[str, str]]) -> str:
    """Two aligned columns of plain text; a value of several lines stays in its column."""
    width = max((len(name) for name, _ in rows), default=0)
    gap = "\n" + " " * (width + 2)
    return "\n".join(f"{name:<{width}}  {value.replace(chr(10), gap)}".rstrip() for name, value in rows)


def size_text(count: int | None) -> str:
    """Bytes as people read them: ``1.2 GiB``."""
    if count is None:
        return "unknown"
    value = float(count)
    for unit in ("B", "KiB", "MiB", "GiB"):
        if value < 1024 or unit == "GiB":
            break
        value /= 1024
    return f"{value:.0f} {unit}" if unit == "B" else f"{value:.1f} {unit}"
