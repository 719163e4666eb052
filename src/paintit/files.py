"""Writing without harm: a file under its final name is always complete. Disk errors become one clear line."""

from __future__ import annotations

import errno
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
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
    """Yield a temporary path beside ``path``; on success it is flushed to disk and moved into place, else removed.

    Raises:
        OutputError: the file system refuses (full, read-only, denied); nothing is left behind.
    """
    make_folder(path.parent)
    temporary: Path | None = None
    try:
        handle, name = tempfile.mkstemp(prefix=f".{path.stem}.", suffix=path.suffix, dir=path.parent)
        os.close(handle)
        temporary = Path(name)
        yield temporary
        with open(temporary, "rb+") as file:
            os.fsync(file.fileno())
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)
        os.replace(temporary, path)
    except OSError as error:
        raise output_error(path, error) from error
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)
