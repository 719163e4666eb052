"""A disk that is really full, a file system that is really read-only: nothing lost, nothing half-written, one line.

The file systems are small ones in memory, which only root may mount. Elsewhere: ``unshare -rm .venv/bin/pytest ...``.
"""

from __future__ import annotations

import hashlib
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.cli.conftest import CUBE, TINY
from tests.export.exporting import known_maps
from tests.test_run import job_for, resume

from paintit.cli.main import main
from paintit.errors import OutputError
from paintit.export.write import write
from paintit.mesh.read import read_mesh
from paintit.run import record as records
from paintit.run.paint import run

KINDS = ["a.glb", "a.gltf", "a.obj", "maps"]


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 1 MiB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    if shutil.which("mount") is None:
        pytest.skip("there is no mount command")
    done = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "none", folder], capture_output=True, text=True)
    if done.returncode:
        pytest.skip(f"no file system can be mounted here, try under unshare -rm ({done.stderr.strip()})")
    yield folder
    subprocess.run(["umount", "-l", folder], check=True)  # a checkpoint that was loaded may still be mapped


@pytest.fixture
def painted(tmp_path: Path) -> Path:
    """A painted cube of about 60 kB."""
    (tmp_path / "cube.obj").write_text(CUBE)
    mesh = read_mesh(tmp_path / "cube.obj")
    write(tmp_path / "painted.glb", mesh, known_maps(mesh, 96), {})
    return tmp_path / "painted.glb"


def fill(disk: Path, leave: int = 0) -> None:
    """Take all of the disk but ``leave`` bytes, which are whole pages."""
    ballast = disk / "ballast"
    ballast.write_bytes(b"")
    ballast.write_bytes(bytes(shutil.disk_usage(disk).free - leave))
    assert shutil.disk_usage(disk).free == leave


def tree(folder: Path) -> dict[str, str]:
    """Every file and folder -> a digest."""
    return {
        str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() if p.is_file() else ""
        for p in sorted(folder.rglob("*"))
    }


def refused(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> str:
    """The one line that a command fails with."""
    assert main(["--quiet", *map(str, arguments)]) == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    return err


@pytest.mark.parametrize("former", [False, True])
@pytest.mark.parametrize("name", KINDS)
def test_an_export_onto_a_full_disk(
    name: str, former: bool, painted: Path, disk: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Whether it is full at once or after the first files of the set."""
    if former:
        mesh = read_mesh(painted.with_name("cube.obj"))
        write(disk / name, mesh, known_maps(mesh, 16), {})
    for leave in (0, 8192, 40960):
        fill(disk, leave)
        before = tree(disk)
        line = refused(capsys, "export", painted, "-o", disk / name, "--overwrite")
        assert "the disk is full; free some space" in line
        assert str(disk) in line
        assert tree(disk) == before
    (disk / "ballast").unlink()
    assert main(["--quiet", "export", str(painted), "-o", str(disk / name), "--overwrite"]) == 0


@pytest.mark.parametrize("name", [*KINDS, "a.png"])
def test_an_export_into_a_read_only_folder(
    name: str, painted: Path, disk: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mesh = read_mesh(painted.with_name("cube.obj"))
    write(disk / "a.gltf", mesh, known_maps(mesh, 8), {})
    before = tree(disk)
    subprocess.run(["mount", "-o", "remount,ro", disk], check=True)
    line = refused(capsys, "export", painted, "-o", disk / name, "--overwrite")
    assert "the file system is read-only; choose a folder you may write to with -o" in line
    assert tree(disk) == before


def test_a_paint_into_a_read_only_folder(painted: Path, disk: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It is refused before anything is painted."""
    subprocess.run(["mount", "-o", "remount,ro", disk], check=True)
    line = refused(capsys, "paint", painted, "red plastic", *TINY, "-o", disk / "a.glb")
    assert "the file system is read-only" in line
    assert tree(disk) == {}


@pytest.mark.parametrize("full_at", [0, 2, 6])
def test_a_disk_that_fills_up_while_painting(full_at: int, disk: Path) -> None:
    """At the first, a later or the last step: with space again the run goes on and gives what it would have given."""
    mesh = disk / "cube.obj"
    mesh.write_text(CUBE)
    run(job_for(mesh, "whole"))
    job = job_for(mesh, "full")

    def on_step(step: object) -> None:
        if job.painter.step == full_at:
            fill(disk)

    if full_at == 0:
        fill(disk)
    with pytest.raises(OutputError, match="the disk is full") as caught:
        run(job, on_step, checkpoint_every=0.0)
    assert caught.value.code == "output.disk_full"
    assert not job.folder.asset.exists()
    assert job.folder.folder.exists() == (full_at > 0)
    (disk / "ballast").unlink()
    if full_at == 0:
        run(job_for(mesh, "again"))
        assert (disk / "again" / "painted.glb").read_bytes() == (disk / "whole" / "painted.glb").read_bytes()
        return
    again = resume(mesh, "full")
    assert again.painter.step == full_at
    run(again)
    assert records.read(job.folder.record).state == "finished"
    assert (disk / "full" / "painted.glb").read_bytes() == (disk / "whole" / "painted.glb").read_bytes()
    assert list(disk.rglob(".*")) == []
