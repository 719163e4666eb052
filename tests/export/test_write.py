"""The door to all outputs: extensions, overwriting, and file systems that refuse."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from PIL import Image
from tests.export.exporting import ASSETS, asset, known_maps

from paintit.errors import OutputError, UsageError
from paintit.export.write import check_output, write
from paintit.mesh.read import read_mesh


def test_every_kind(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("PAINTIT_CACHE", str(tmp_path / "cache"))
    mesh = asset("spot_quads.obj")
    maps = known_maps(mesh, 8)
    for name in ("a.glb", "b.gltf", "c.obj", "maps"):
        paths = write(tmp_path / name, mesh, maps, {})
        assert all(p.is_file() for p in paths)
        assert list(tmp_path.rglob(".*")) == []
    read_mesh(tmp_path / "b.gltf")
    assert (tmp_path / "maps" / "orm.png").is_file()


@pytest.mark.parametrize("name", ["a.fbx", "a.tar.gz", "a.usd"])
def test_unknown_extension(name: str, tmp_path) -> None:
    mesh = asset("spot_quads.obj")
    with pytest.raises(UsageError) as caught:
        write(tmp_path / name, mesh, known_maps(mesh, 8), {})
    assert caught.value.code == "output.unknown_extension"
    assert ".glb, .gltf, .obj" in caught.value.hint
    assert list(tmp_path.iterdir()) == []


def test_nothing_is_overwritten_unasked(tmp_path) -> None:
    mesh = asset("spot_quads.obj")
    maps = known_maps(mesh, 8)
    (tmp_path / "a.glb").write_text("precious")
    with pytest.raises(OutputError) as caught:
        write(tmp_path / "a.glb", mesh, maps, {})
    assert caught.value.code == "output.exists"
    assert "--overwrite" in caught.value.hint
    assert (tmp_path / "a.glb").read_text() == "precious"
    write(tmp_path / "a.glb", mesh, maps, {}, overwrite=True)
    read_mesh(tmp_path / "a.glb")
    write(tmp_path / "maps", mesh, maps, {})
    with pytest.raises(OutputError):
        check_output(tmp_path / "maps")
    check_output(tmp_path)  # a folder without maps in it is no obstacle


REFUSED = """
import resource, signal, sys
from pathlib import Path
from paintit.errors import OutputError
from paintit.export.write import write
from tests.export.exporting import known_maps
from paintit.mesh.read import read_mesh
mesh = read_mesh(Path(sys.argv[2]))
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[3]), int(sys.argv[3])))
try:
    write(Path(sys.argv[1]), mesh, known_maps(mesh, 64), {})
except OutputError as error:
    sys.stdout.write(f"{error.code}|{error}")
"""


@pytest.mark.parametrize(("name", "limit"), [("a.glb", 1000), ("a.gltf", 14000), ("a.obj", 10000), ("maps", 10000)])
def test_a_write_that_fails_leaves_nothing(name: str, limit: int, tmp_path) -> None:
    """A file size limit stands in for a full disk; some files of a set may fit under it before one does not."""
    done = subprocess.run(
        [sys.executable, "-c", REFUSED, str(tmp_path / name), str(ASSETS / "spot_quads.obj"), str(limit)],
        capture_output=True,
        text=True,
        cwd=Path(__file__).parents[2],
    )
    assert done.returncode == 0, done.stderr
    code, message = done.stdout.split("|")
    assert code == "output.failed"
    assert "file too large" in message
    assert "\n" not in message
    assert list(tmp_path.iterdir()) == []


def test_disk_full_has_its_own_words() -> None:
    """/dev/full answers every write with ENOSPC."""
    import errno

    from paintit.files import output_error

    with pytest.raises(OSError, match="No space left") as caught, open("/dev/full", "wb", buffering=0) as file:
        file.write(b"x")
    assert caught.value.errno == errno.ENOSPC
    assert output_error(Path("a.glb"), caught.value).code == "output.disk_full"


DENIED = """
import os, sys
from pathlib import Path
from PIL import Image
from paintit.errors import OutputError
from paintit.export.write import write
from tests.export.exporting import known_maps
from paintit.mesh.read import read_mesh
mesh = read_mesh(Path(sys.argv[2]))
maps = known_maps(mesh, 8)
Image.init()  # its plugins load on first use, which the other user may not be allowed to do
if os.geteuid() == 0:
    os.setuid(65534)  # root may write anywhere
for name in ("a.glb", "inner/a.obj", "maps"):
    try:
        write(Path(sys.argv[1]) / name, mesh, maps, {})
    except OutputError as error:
        sys.stdout.write(f"{error.code} ")
"""


@pytest.mark.skipif(os.name != "posix", reason="POSIX permissions")
@pytest.mark.parametrize("mode", [0o555, 0o000])
def test_denied_folder(mode: int) -> None:
    with tempfile.TemporaryDirectory(dir="/tmp") as outer:
        Path(outer).chmod(0o755)
        folder = Path(outer) / "locked"
        folder.mkdir()
        folder.chmod(mode)
        done = subprocess.run(
            [sys.executable, "-c", DENIED, str(folder), str(ASSETS / "spot_quads.obj")],
            capture_output=True,
            text=True,
            cwd=Path(__file__).parents[2],
        )
        assert done.returncode == 0, done.stderr
        assert done.stdout.split() == ["output.denied"] * 3
        folder.chmod(0o755)
        assert list(folder.iterdir()) == []


def test_a_file_in_the_way_of_the_folder(tmp_path) -> None:
    (tmp_path / "file").write_text("x")
    mesh = asset("spot_quads.obj")
    with pytest.raises(OutputError) as caught:
        write(tmp_path / "file" / "a.glb", mesh, known_maps(mesh, 8), {})
    assert caught.value.code == "output.not_a_folder"


def test_preview_and_turntable(tmp_path) -> None:
    from paintit.export.preview import preview, turntable, write_turntable

    mesh = asset("spot_quads.obj")
    maps = known_maps(mesh, 16)
    image = preview(mesh, maps, size=48, supersample=1)
    assert image.size == (96, 96)
    quarters = [image.crop((x, y, x + 48, y + 48)) for y in (0, 48) for x in (0, 48)]
    assert len({q.tobytes() for q in quarters}) == 4
    for quarter in quarters:
        corner, middle = quarter.getpixel((0, 0)), quarter.getpixel((24, 24))
        assert corner == (203, 203, 203)  # sRGB of linear 0.6
        assert middle != corner
    assert preview(mesh, maps, size=20, views=3, supersample=1).size == (60, 20)
    done: list[tuple[int, int]] = []
    frames = turntable(mesh, maps, size=32, frames=5, supersample=1, on_frame=lambda i, n: done.append((i, n)))
    assert done[-1] == (5, 5)
    write_turntable(tmp_path / "turn.webp", frames)
    with Image.open(tmp_path / "turn.webp") as animation:
        assert getattr(animation, "n_frames", 1) == 5
        assert animation.size == (32, 32)
    with pytest.raises(UsageError):
        preview(mesh, maps, size=0)
