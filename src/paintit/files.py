"""Writing without harm: a file under its final name is always complete. Disk errors become one clear line."""

from __future__ import annotations

import errno
import glob
import os
import secrets
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from paintit.errors import OutputError

_REMEDIES = {
    errno.ENOSPC: ("output.disk_full", "the disk is full", "free some space or choose another place with -o"),
    errno.EDQUOT: ("output.disk_full", "the disk quota is used up", "free some space or choose another place with -o"),
    errno.EACCES: ("output.denied", "permission denied", "choose a folder you may write to with -o"),
    errno.EPERM: ("output.denied", "permission denied", "choose a folder you may write to with -o"),
    errno.EROFS: ("output.denied", "the file system is read-only", "choose a folder you may write to with -o"),
    errno.ENOTDIR: ("output.not_a_folder", "a part of the path is a file", "choose another place with -o"),
    errno.EISDIR: ("output.is_a_folder", "there is a folder of that name", "choose another name with -o"),
    errno.ENAMETOOLONG: ("output.name_too_long", "the name is too long", "choose a shorter name with -o"),
}

_WORKSHOP = ".paintit-"
"""What the names of the folders begin with in which files are written before they are moved into place."""


def output_error(path: Path, error: OSError) -> OutputError:
    """The one-line form of an ``OSError`` met while writing ``path``."""
    code, reason, hint = _REMEDIES.get(
        error.errno or 0, ("output.failed", (error.strerror or str(error)).lower(), "choose another place with -o")
    )
    return OutputError(code, f"cannot write {path}: {reason}", hint)


def make_folder(path: Path) -> Path:
    """``path`` as an existing folder.

    Raises:
        OutputError: it cannot be made.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise OutputError(
            "output.not_a_folder", f"cannot write into {path}: it is a file", "choose another place with -o"
        ) from None
    except OSError as error:
        raise output_error(path, error) from error
    return path


@contextmanager
def atomic(path: Path) -> Iterator[Path]:
    """Yield a temporary path on the disk of ``path``; on success it is flushed and moved into place, else removed.

    Raises:
        OutputError: the file system refuses (full, read-only, denied); nothing is left behind.
    """
    try:
        with _workshop(path) as folder:
            yield (temporary := folder / path.name)
            _settle(temporary)
            os.replace(temporary, path)
    except OSError as error:
        raise output_error(path, error) from error


def write_files(files: Mapping[Path, bytes]) -> None:
    """Write ``files``, each whole: all are on the disk before the first takes its name, in the order given.

    Raises:
        OutputError: the file system refuses; nothing of this call is left.
    """
    with _staged(files) as staged:
        _move(staged)


def write_set(path: Path, stem: str, build: Callable[[str], dict[Path, bytes]]) -> list[Path]:
    """Write ``path`` and the files beside it that it names. Whenever the process is killed, ``path`` and what it names
    are of one version, the former or the new one, or ``path`` is not there yet.

    No file can be replaced together with those that it names. Where some of these would change under the former
    ``path``, it first comes to name a bridge: the new set under names of its own, until the lasting names hold it.

    Args:
        path: moved into place last.
        stem: what the names of the files beside ``path`` begin with.
        build: stem -> every file of the set and its bytes, ``path`` last. Files whose names do not begin with the stem
            are the same for all stems.

    Returns:
        The paths written, ``path`` last.

    Raises:
        OutputError: the file system refuses; nothing of this call is left.
    """
    files = build(stem)
    bridge_stem = f".{path.name}.bridge-"
    with _staged(files) as staged:
        if path.exists() and any(_changes(file, data) for file, data in files.items() if file != path):
            bridge = build(bridge_stem + secrets.token_hex(4))
            write_files({file: data for file, data in bridge.items() if file == path or file not in files})
        _move(staged)
    for file in path.parent.glob(glob.escape(bridge_stem) + "*"):
        with suppress(OSError):
            file.unlink()
    return list(files)


@contextmanager
def _staged(files: Mapping[Path, bytes]) -> Iterator[dict[Path, Path]]:
    """Path -> where its bytes wait, on the disk already; what has not been moved at the end is removed."""
    path = next(iter(files))
    try:
        with _workshop(path) as folder:
            staged: dict[Path, Path] = {}
            for number, (path, data) in enumerate(files.items()):
                make_folder(path.parent)
                staged[path] = folder / str(number)
                staged[path].write_bytes(data)
                _settle(staged[path])
            yield staged
    except OSError as error:
        raise output_error(path, error) from error


def _move(staged: Mapping[Path, Path]) -> None:
    """Each file takes its place, in this order; where one cannot, those that are new go again."""
    created: list[Path] = []
    for path, temporary in staged.items():
        try:
            fresh = not path.exists()
            os.replace(temporary, path)
        except OSError as error:
            for made in created:
                made.unlink(missing_ok=True)
            raise output_error(path, error) from error
        created += [path] * fresh


@contextmanager
def _workshop(path: Path) -> Iterator[Path]:
    """A hidden folder beside ``path``, gone at the end. What killed processes left of theirs is swept out first."""
    beside = make_folder(path.parent)
    for leftover in beside.glob(f"{_WORKSHOP}*"):
        with suppress(OSError), _lock(leftover):  # refused while somebody is at work in it
            shutil.rmtree(leftover)
    with tempfile.TemporaryDirectory(prefix=_WORKSHOP, dir=beside) as name, ExitStack() as stack:
        with suppress(OSError):  # there are file systems without locks
            stack.enter_context(_lock(Path(name)))
        yield Path(name)


@contextmanager
def _lock(folder: Path) -> Iterator[None]:
    """Hold the system's advisory lock on a folder; it dies with its process.

    Raises:
        OSError: another process holds it, or the system has no such locks.
    """
    if sys.platform == "win32":
        raise OSError(errno.ENOTSUP, "folders cannot be locked")
    import fcntl

    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    finally:
        os.close(handle)


def _settle(temporary: Path) -> None:
    """Onto the disk, with the rights that a new file has."""
    with open(temporary, "rb+") as file:
        os.fsync(file.fileno())
    umask = os.umask(0)
    os.umask(umask)
    temporary.chmod(0o666 & ~umask)


def _changes(path: Path, data: bytes) -> bool:
    return path.exists() and path.read_bytes() != data
