"""``paintit doctor``: versions, devices, folders, and one toy run from mesh to GLB."""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from paintit.cli.console import Console, Result, size_text, table
from paintit.cli.parse import parse
from paintit.errors import PaintitError

ABOUT = """Check versions, devices, folders and disk, and paint a toy from mesh to GLB.

Example:  paintit doctor

The exit code is 1 if something is broken."""

#: Free bytes under which a warning is due.
_LITTLE_SPACE = 1 << 30
_TETRAHEDRON = """v 1 1 1
v 1 -1 -1
v -1 1 -1
v -1 -1 1
f 1 2 3
f 1 4 2
f 1 3 4
f 2 4 3
"""


@dataclass(frozen=True)
class DoctorArguments:
    """``paintit doctor`` takes none of its own."""


def main(arguments: Sequence[str], console: Console) -> Result:
    parse(DoctorArguments, arguments, "paintit doctor", ABOUT)
    checks = {
        "versions": _versions,
        "device": _device,
        "cache": _cache,
        "disk": _disk,
        "models": _models,
        "toy run": _toy,
    }
    rows: list[tuple[str, str]] = []
    broken: list[str] = []
    for name, check in checks.items():
        text, fine = _tried(check)
        rows.append((name, text if fine else f"BROKEN: {text}"))
        broken += [] if fine else [name]
    rows.append(("result", f"broken: {', '.join(broken)}" if broken else "all fine"))
    data = {"checks": dict(rows[:-1]), "broken": broken}
    return Result(table(rows), data, 1 if broken else 0)


def _tried(check: Callable[[], str]) -> tuple[str, bool]:
    try:
        return check(), True
    except PaintitError as error:
        return str(error), False
    except Exception as error:
        return " ".join(f"{type(error).__name__}: {error}".split()), False


def _versions() -> str:
    from paintit.run.record import versions

    return ", ".join(f"{name} {number}" for name, number in versions().items())


def _device() -> str:
    from paintit.device import choose_device

    device, reason = choose_device("auto")
    return f"{device} ({reason}), {os.cpu_count()} CPU cores"


def _cache() -> str:
    from paintit.files import make_folder
    from paintit.render.light import cache_folder

    folder = make_folder(cache_folder())
    with tempfile.TemporaryFile(dir=folder):
        used = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    return f"{folder}, {size_text(used)}"


def _disk() -> str:
    free = shutil.disk_usage(Path.cwd()).free
    return f"{size_text(free)} free here" + (", which is little" if free < _LITTLE_SPACE else "")


def _models() -> str:
    """The hub's own cache, which diffusers and transformers share."""
    try:
        from huggingface_hub.constants import HF_HUB_CACHE
    except ImportError:
        return "diffusers is not installed; the pocket prior needs none"
    folder = Path(HF_HUB_CACHE)
    names = sorted(path.name.removeprefix("models--").replace("--", "/") for path in folder.glob("models--*"))
    return f"{folder}: {', '.join(names) or 'none downloaded'}"


def _toy() -> str:
    """Three tiny steps with the pocket prior on a mesh made here, exported as GLB and read back."""
    from paintit import api
    from paintit.config import POCKET
    from paintit.settings import merge

    network = {"texture.size": 32, "texture.widths": [8, 8], "texture.skip_widths": [4, 4]}
    config = merge(POCKET, {**network, "views.count": 2, "optim.steps": 3})
    start = time.perf_counter()
    with tempfile.TemporaryDirectory() as name:
        source = Path(name) / "tetrahedron.obj"
        source.write_text(_TETRAHEDRON, "utf-8")
        result = api.paint(source, "red plastic", config=config)
        asset = result.export(Path(name) / "tetrahedron.glb")
        faces = len(api.load_mesh(asset, "never").faces)
    return f"{len(result.history)} steps, {faces} faces read back, {time.perf_counter() - start:.1f} s"
