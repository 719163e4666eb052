"""kill -9 while exporting, at every change of the file system: what the asset and its files are afterwards."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from tests.cli.conftest import CUBE
from tests.export.exporting import known_maps
from tests.export.killing import whole

from paintit.cli.main import main
from paintit.export.write import write
from paintit.mesh.read import read_mesh

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no kill -9")

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"

EXPORT = """
import shutil, sys
from pathlib import Path
import torch
torch.set_num_threads(1)
import paintit.export.write, paintit.run.asset
from paintit.cli.main import main
from tests.export.killing import kill_everywhere
folder, name = Path(sys.argv[1]), sys.argv[2]
def work(moment):
    if main(["--quiet", "export", str(folder / "new.glb"), "-o", str(folder / str(moment) / name), "--overwrite"]):
        raise SystemExit(1)
for moment in range(1, 120):
    shutil.copytree(folder / "old", folder / str(moment))
sys.stdout.write(str(kill_everywhere(work)))
"""

PAINT = """
import shutil, sys
from pathlib import Path
import torch
torch.set_num_threads(1)
from paintit.run.paint import run
from tests.export.killing import kill_everywhere
from tests.test_run import resume
folder = Path(sys.argv[1])
for moment in range(1, 120):
    shutil.copytree(folder / "old", folder / str(moment))
sys.stdout.write(str(kill_everywhere(lambda moment: run(resume(folder / "cube.obj", str(moment))), 5)))
"""


def killed(script: str, *arguments: str | Path) -> int:
    """The first moment at which it was not killed."""
    command = [sys.executable, "-c", script, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=Path(__file__).parents[2])
    assert done.returncode == 0, done.stderr[-2000:]
    return int(done.stdout.split()[-1])


def tree(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.fixture
def painted(tmp_path: Path) -> Path:
    """A folder with ``new.glb``, a painted cube, and ``old``, an empty folder."""
    (tmp_path / "cube.obj").write_text(CUBE)
    mesh = read_mesh(tmp_path / "cube.obj")
    write(tmp_path / "new.glb", mesh, known_maps(mesh, 8), {})
    (tmp_path / "old").mkdir()
    return tmp_path


QUICK = [("a.glb", True), ("a.gltf", True)]
SLOW = [("a.obj", True), ("a.glb", False), ("a.gltf", False), ("a.obj", False)]


@pytest.mark.parametrize(("name", "former"), [*QUICK, *(pytest.param(*each, marks=pytest.mark.slow) for each in SLOW)])
def test_an_asset_is_the_former_one_or_the_new_one(name: str, former: bool, painted: Path) -> None:
    """With everything it names. And the next export sweeps out what is left of the killed one."""
    if former:
        (painted / "old.obj").write_text(TRIANGLE)
        mesh = read_mesh(painted / "old.obj")
        write(painted / "old" / name, mesh, known_maps(mesh, 16), {})
    end = killed(EXPORT, painted, name)
    assert end > (5 if name == "a.glb" else 20)
    states = [whole(painted / str(moment) / name) for moment in range(1, end + 1)]
    old, new = whole(painted / "old" / name), states[-1]
    assert old != new
    assert states == sorted(states, key=[old, new].index)  # first the former one, from some moment on the new one
    assert states[0] == old
    complete = tree(painted / str(end))
    assert not any(file.startswith(".") for file in complete)
    for moment in range(1, end, 5):
        folder = painted / str(moment)
        assert main(["--quiet", "export", str(painted / "new.glb"), "-o", str(folder / name), "--overwrite"]) == 0
        assert tree(folder) == complete
        assert list(folder.glob(".*")) == []


@pytest.mark.slow
def test_each_map_of_a_folder_is_whole(painted: Path) -> None:
    mesh = read_mesh(painted / "cube.obj")
    write(painted / "old" / "maps", mesh, known_maps(mesh, 16), {})
    end = killed(EXPORT, painted, "maps")
    old, new = tree(painted / "old" / "maps"), tree(painted / str(end) / "maps")
    assert len(new) == 3
    for moment in range(1, end):
        for file, data in tree(painted / str(moment) / "maps").items():
            assert ".paintit-" in file or data in (old[file], new[file])


@pytest.mark.slow
@pytest.mark.parametrize("kind", [".glb", ".gltf"])
def test_a_paint_is_killed_while_it_exports(kind: str, tmp_path: Path) -> None:
    """Its asset is the former one or the new one, and resuming the run gives what an undisturbed one gives."""
    from tests.test_run import job_for, resume

    from paintit.run.paint import run

    mesh = tmp_path / "cube.obj"
    mesh.write_text(CUBE)
    job = job_for(mesh, "old", kind=kind)
    run(job)
    expected = tree(tmp_path / "old")
    for file in (tmp_path / "old" / "painted.paintit" / "textures").iterdir():
        file.unlink()
    cube = read_mesh(mesh)
    write(job.folder.asset, cube, known_maps(cube, 16), {}, overwrite=True)
    end = killed(PAINT, tmp_path)
    assert end > 20
    old, new = whole(job.folder.asset), whole(tmp_path / str(end) / job.folder.asset.name)
    for moment in range(1, end, 5):
        folder = tmp_path / str(moment)
        assert whole(folder / job.folder.asset.name) in (old, new)
        run(resume(mesh, str(moment)))
        found = tree(folder)
        assert found.keys() == expected.keys()
        assert all(found[name] == expected[name] for name in expected if not name.endswith("run.json"))
