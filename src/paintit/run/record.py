"""``run.json``: what was asked, with what, and how it ended. One definition for writer, reader and every later tool."""

from __future__ import annotations

import dataclasses
import json
import platform
import re
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any, Literal

from paintit._version import __version__
from paintit.errors import RunError
from paintit.files import atomic

#: Raised when a field is renamed or removed; adding one is free.
SCHEMA = "paintit.run/1"
_PACKAGES = ("torch", "numpy", "warp-lang", "uvunwrap", "diffusers", "transformers", "peft")


@dataclass(frozen=True)
class Record:
    """One run. Holds no absolute path and no user name: it is made to be passed on."""

    schema: str = SCHEMA
    state: Literal["running", "finished", "stopped", "failed"] = "running"
    outcome: str = "running"
    """How it ended, in words."""
    step: int = 0
    """Steps done."""
    steps: int = 0
    """Steps asked for."""
    asset: str = ""
    """The painted mesh, relative to the run folder."""
    prompt: str = ""
    prompts: tuple[str, ...] = ()
    """Exactly the texts that were sent to the prior."""
    readings: dict[str, str] = field(default_factory=dict)
    """Words of the prompt that the prior does not know -> what it took them to mean."""
    command: tuple[str, ...] = ()
    started: str = ""
    """UTC, ISO 8601."""
    ended: str = ""
    seconds: float = 0.0
    """Painting time, all sittings together."""
    peak_memory: int | None = None
    """Bytes, of the process; of the GPU where one was used."""
    seed: int = 0
    device: str = ""
    device_reason: str = ""
    input: dict[str, Any] = field(default_factory=dict)
    """Name, SHA-256 and size of the mesh file's content."""
    prior: dict[str, Any] = field(default_factory=dict)
    """The prior's spec."""
    light: dict[str, Any] = field(default_factory=dict)
    """Name, SHA-256 and exposure factor of the environment."""
    versions: dict[str, str] = field(default_factory=dict)
    config: dict[str, Any] = field(default_factory=dict)
    """Every setting as used."""
    notes: tuple[str, ...] = ()
    """What was found and repaired while reading the mesh."""
    seam: dict[str, Any] | None = None
    """How visible UV seams are in the exported base colour, see ``paintit.export.seams.SeamFigure``; None before the
    end, and where there is no seam."""


def write(path: Path, record: Record) -> None:
    """Write ``record``, whole or not at all."""
    with atomic(path) as temporary:
        temporary.write_text(json.dumps(dataclasses.asdict(record), indent=2, ensure_ascii=False) + "\n", "utf-8")


def read(path: Path) -> Record:
    """The record in ``path``; fields of later versions are ignored.

    Raises:
        RunError: it is missing, damaged, or of another schema.
    """
    try:
        data = json.loads(path.read_text("utf-8"))
        known = {f.name for f in dataclasses.fields(Record)}
        values: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in data.items() if k in known}
        record = Record(**values)
    except FileNotFoundError:
        raise RunError("run.missing", f"there is no {path}", "give the folder that paint made") from None
    except (OSError, ValueError, TypeError, AttributeError) as error:
        reason = " ".join(str(error).split())
        raise RunError("run.damaged", f"{path} cannot be read: {reason}", "start a new run") from None
    if record.schema != SCHEMA:
        raise RunError("run.schema", f"{path} has schema '{record.schema}', this version reads '{SCHEMA}'",
                       "use the version of paintit that made it")  # fmt: skip
    return record


def now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def versions() -> dict[str, str]:
    """Versions of this package, Python and what the numbers depend on."""
    found = {"paintit": __version__, "python": platform.python_version(), "system": platform.system()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def without_folders(value: Any) -> Any:
    """``value`` with every absolute path cut to its last name, inside lists and dicts and behind ``key=`` too."""
    match value:
        case str():
            flag, equals, text = value.rpartition("=") if re.match(r"-|\w+=", value) else ("", "", value)
            if PureWindowsPath(text).is_absolute():
                return flag + equals + PureWindowsPath(text).name
            if text.startswith(("/", "~")) and len(PurePosixPath(text).parts) > 1:
                return flag + equals + PurePosixPath(text).name
            return value
        case dict():
            return {key: without_folders(v) for key, v in value.items()}
        case list():
            return [without_folders(v) for v in value]
        case tuple():
            return tuple(without_folders(v) for v in value)
        case _:
            return value
