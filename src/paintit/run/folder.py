"""The names inside a run folder, where it lies, and the lock that keeps two processes out of it."""

from __future__ import annotations

import contextlib
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from paintit.errors import OutputError, RunError, UsageError
from paintit.files import make_folder, output_error

#: Formats of the painted asset, by extension.
ASSETS = (".glb", ".gltf", ".obj")


@dataclass(frozen=True)
class RunFolder:
    """Every path of one run.

    Attributes:
        folder: holds everything but, with ``-o chair.glb``, the asset.
        asset: the painted mesh.
    """

    folder: Path
    asset: Path

    @property
    def record(self) -> Path:
        return self.folder / "run.json"

    @property
    def config(self) -> Path:
        return self.folder / "config.toml"

    @property
    def log(self) -> Path:
        return self.folder / "log.jsonl"

    @property
    def textures(self) -> Path:
        return self.folder / "textures"

    @property
    def preview(self) -> Path:
        return self.folder / "preview.png"

    @property
    def turntable(self) -> Path:
        return self.folder / "turntable.webp"

    @property
    def snapshots(self) -> Path:
        return self.folder / "snapshots"

    @property
    def checkpoint(self) -> Path:
        return self.folder / "checkpoints" / "last.safetensors"

    @property
    def input(self) -> Path:
        """Where the mesh is, relative to the folder: for ``--resume``, and kept out of ``run.json``."""
        return self.folder / "checkpoints" / "input"

    @property
    def lock(self) -> Path:
        return self.folder / "run.lock"

    def snapshot(self, step: int) -> Path:
        return self.snapshots / f"step-{step:05d}.png"

    def existing(self) -> list[Path]:
        """What this run would write over."""
        names = (self.asset, self.record, self.config, self.log, self.textures, self.preview, self.turntable,
                 self.snapshots, self.checkpoint.parent)  # fmt: skip
        return [path for path in names if path.exists()]

    def clear(self) -> None:
        """Remove what an earlier run left, and nothing else. Its asset stays until the new one takes its place.

        Raises:
            OutputError: the file system refuses.
        """
        for path in self.existing():
            if path == self.asset:
                continue
            try:
                shutil.rmtree(path) if path.is_dir() else path.unlink()
            except OSError as error:
                raise output_error(path, error) from error


def resolve(output: str | None, mesh: Path, root: Path = Path("outputs"), now: str | None = None) -> RunFolder:
    """The run folder that ``-o`` means: a file (``chair.glb``), a folder, or nothing: ``outputs/<mesh>/<time>/``.

    Raises:
        UsageError: the extension is not one that can be written.
    """
    if not output:
        stamp = now or time.strftime("%Y-%m-%dT%H-%M-%S")
        folder = root / mesh.stem / stamp
        for extra in range(2, 1000):
            if not folder.exists():
                break
            folder = root / mesh.stem / f"{stamp}-{extra}"
        return RunFolder(folder, folder / f"{mesh.stem}.glb")
    path = Path(output)
    if path.suffix.lower() in ASSETS and not path.is_dir():
        return RunFolder(path.with_suffix(".paintit"), path)
    if path.suffix and not path.is_dir() and not output.endswith(("/", os.sep)):
        raise UsageError(
            "output.format", f"cannot write '{path.suffix}' ({path.name})",
            f"end the name with {', '.join(ASSETS)}, or with / for a folder",
        )  # fmt: skip
    return RunFolder(path, path / f"{mesh.stem}.glb")


def check_writable(folder: Path) -> None:
    """Make sure files can be written into ``folder``, made if need be; nothing is left behind.

    Raises:
        OutputError: they cannot.
    """
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        make_folder(folder)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise output_error(folder, error) from error
    finally:
        for path in missing:
            with contextlib.suppress(OSError):
                path.rmdir()


def check_free(folder: RunFolder, mesh: Path, overwrite: bool) -> None:
    """Refuse to write over the input, over what no run of ours made, or over an earlier result unless told to.

    Raises:
        OutputError: something is there; it is named.
    """
    if folder.asset.exists() and mesh.exists() and folder.asset.samefile(mesh):
        raise OutputError("output.is_input", f"{folder.asset} is the mesh itself", "choose another name with -o")
    existing = folder.existing()
    if existing and not overwrite:
        raise OutputError("output.exists", f"{existing[0]} exists already", "add --overwrite or choose another -o")
    foreign = [path for path in existing if path != folder.asset and not folder.record.exists()]
    if foreign:
        message = f"{foreign[0]} is there and no run of paintit made it"
        raise OutputError("output.not_a_run", message, "choose another -o")


def find(path: Path) -> Path:
    """The run folder that ``path`` means: itself, or ``chair.paintit`` for the asset ``chair.glb``.

    Raises:
        RunError: there is no run.
    """
    for folder in (path, path.parent / f"{path.stem}.paintit"):
        if (folder / "run.json").is_file():
            return folder
    raise RunError("run.missing", f"{path} is not a run folder: it has no run.json", "give the folder that paint made")


@contextlib.contextmanager
def locked(folder: RunFolder) -> Iterator[None]:
    """Hold the run folder alone. The lock dies with its process, so a killed run never blocks the next.

    Raises:
        OutputError: the file system refuses; a folder with nothing in it is not left behind.
        RunError: a living process holds it; its number is named.
    """
    make_folder(folder.folder)
    try:
        handle = _take(folder.lock)
    except OSError as error:
        raise output_error(folder.lock, error) from error
    if handle is None:
        owner = folder.lock.read_text("utf-8", "replace").strip() or "unknown"
        raise RunError(
            "run.locked", f"{folder.folder} is being painted by process {owner}", "wait for it, or choose another -o"
        )
    try:
        try:
            os.ftruncate(handle, 0)
            os.write(handle, f"{os.getpid()}\n".encode())
        except OSError as error:
            raise output_error(folder.lock, error) from error
        yield
    finally:
        if sys.platform == "win32":  # an open file cannot be removed there
            os.close(handle)
            folder.lock.unlink(missing_ok=True)
        else:
            folder.lock.unlink(missing_ok=True)
            os.close(handle)
        with contextlib.suppress(OSError):  # stays unless it is empty
            folder.folder.rmdir()


def _take(path: Path) -> int | None:
    """A locked file descriptor, or None where another process has it."""
    while True:
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        if not _lock(handle):
            os.close(handle)
            return None
        # The former owner may have removed the name between our open and our lock.
        with contextlib.suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(handle), os.stat(path)):
                return handle
        os.close(handle)


def _lock(handle: int) -> bool:
    """Take the system's advisory lock without waiting; file systems that have none are taken as free."""
    try:
        if sys.platform == "win32":
            import msvcrt

            # Far beyond the text, so that others can still read who holds it.
            os.lseek(handle, 1 << 20, os.SEEK_SET)
            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
            os.lseek(handle, 0, os.SEEK_SET)
        else:
            import fcntl

            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError):
        return False
    except OSError:
        return True
    return True
