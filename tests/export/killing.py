"""kill -9 at every change of the file system that a piece of work makes, one process each."""

from __future__ import annotations

import hashlib
import os
import re
import signal
import sys
from collections.abc import Callable
from pathlib import Path

_CHANGES = ("os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.chmod")
_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT


def kill_everywhere(work: Callable[[int], None], step: int = 1) -> int:
    """Fork for n = 1, 1 + step, ...: the child does ``work(n)`` and is killed just before its n-th change.

    Returns:
        The first n at which the work was over before.

    Raises:
        ChildProcessError: one failed by itself.
    """
    moment = 1
    while True:
        child = os.fork()
        if child == 0:
            _work_until(moment, work)
        status = os.waitpid(child, 0)[1]
        if status == 0:
            return moment
        if not (os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGKILL):
            raise ChildProcessError(f"it failed by itself before change {moment}")
        moment += step


def _work_until(moment: int, work: Callable[[int], None]) -> None:
    left = moment

    def watch(event: str, arguments: tuple[object, ...]) -> None:
        nonlocal left
        writes = event == "open" and isinstance(arguments[2], int) and bool(arguments[2] & _WRITING)
        if writes or event in _CHANGES:
            left -= 1
            if left == 0:
                os.kill(os.getpid(), signal.SIGKILL)

    code = 1
    try:
        sys.addaudithook(watch)
        work(moment)
        code = 0
    finally:
        os._exit(code)


def whole(path: Path) -> str:
    """A digest of ``path`` and all that it names, whatever the names; "" where it is not there.

    Raises:
        FileNotFoundError: it names a file that is not there.
    """
    return _digest(path) if path.exists() else ""


def _digest(path: Path) -> str:
    data = path.read_bytes()
    if path.suffix in (".gltf", ".obj", ".mtl"):
        named = re.compile(r"[\w.\-]+\.(?:png|bin|mtl)")
        data = named.sub(lambda found: _digest(path.parent / found[0]), data.decode()).encode()
    return hashlib.sha256(data).hexdigest()
