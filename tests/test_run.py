"""Run folders: names, record, lock, and resume to the same bytes whatever happened."""

from __future__ import annotations

import dataclasses
import getpass
import hashlib
import json
import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import torch

from paintit.config import POCKET, PaintConfig, with_prior
from paintit.errors import OutputError, PaintitError, RunError, UsageError
from paintit.export.write import write
from paintit.guidance.exact import ExactPrior
from paintit.paint.painter import Step
from paintit.run import record as records
from paintit.run.asset import load_asset
from paintit.run.folder import RunFolder, check_writable, find, locked, resolve
from paintit.run.paint import Job, Request, prepare, run
from paintit.run.record import Record
from paintit.run.request import settings_of
from paintit.settings import load_toml, merge
from tests.cli.conftest import CUBE
from tests.export.models import MODELS
from tests.export.roundtrip import differences

STEPS = 6
CONFIG = merge(
    POCKET,
    {
        "texture.size": 32, "texture.widths": [4, 4], "texture.skip_widths": [2, 2], "texture.input_channels": 2,
        "views.count": 2, "views.size": 24, "optim.steps": STEPS,
    },
)  # fmt: skip


@pytest.fixture
def mesh(tmp_path: Path) -> Path:
    path = tmp_path / "cube.obj"
    path.write_text(CUBE)
    return path


def request_for(mesh: Path, name: str, config: PaintConfig = CONFIG, kind: str = ".glb") -> Request:
    output = str(mesh.parent / name / f"painted{kind}")
    return Request(mesh, "red plastic", config, output, preview=False, command=("paintit", "paint", str(mesh)))


def job_for(mesh: Path, name: str, config: PaintConfig = CONFIG, kind: str = ".glb") -> Job:
    return prepare(request_for(mesh, name, config, kind), ExactPrior())


def resume(mesh: Path, name: str) -> Job:
    folder = mesh.parent / name / "painted.paintit"
    request = Request(None, None, load_toml(folder / "config.toml"), resume=folder, preview=False)
    return prepare(request, ExactPrior())


def textures(mesh: Path, name: str) -> dict[str, str]:
    folder = mesh.parent / name
    files = [*(folder / "painted.paintit" / "textures").glob("*.png"), folder / "painted.glb"]
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def log_of(mesh: Path, name: str) -> list[tuple[int, float]]:
    lines = (mesh.parent / name / "painted.paintit" / "log.jsonl").read_text().splitlines()
    return [(entry["index"], entry["gradient_norm"]) for entry in map(json.loads, lines)]


def test_a_whole_run_leaves_what_it_says(mesh: Path) -> None:
    done = run(prepare(dataclasses.replace(request_for(mesh, "a"), snapshot_every=4), ExactPrior()))
    folder = mesh.parent / "a"
    inside = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    assert inside == {
        "painted.glb", "painted.paintit/run.json", "painted.paintit/config.toml", "painted.paintit/log.jsonl",
        "painted.paintit/snapshots/step-00004.png", "painted.paintit/checkpoints/last.safetensors",
        "painted.paintit/checkpoints/input", "painted.paintit/textures/base_color.png",
        "painted.paintit/textures/orm.png", "painted.paintit/textures/normal.png",
    }  # fmt: skip
    assert [index for index, _ in log_of(mesh, "a")] == [*range(1, STEPS + 1)]
    assert done.record == records.read(folder / "painted.paintit" / "run.json")
    assert load_toml(folder / "painted.paintit" / "config.toml") == CONFIG


def test_the_record_says_how_to_repeat_the_run_and_nothing_of_the_machine(mesh: Path) -> None:
    done = run(job_for(mesh, "a"))
    record = done.record
    assert (record.state, record.step, record.steps, record.seed) == ("finished", STEPS, STEPS, 0)
    assert record.outcome == f"finished after {STEPS} of {STEPS} steps"
    assert record.input["sha256"] == hashlib.sha256(mesh.read_bytes()).hexdigest()
    assert record.input["name"] == "cube.obj"
    assert record.prompts == ("", "red plastic")
    assert record.prior["id"] == "exact"
    assert record.asset == "../painted.glb"
    assert record.command == ("paintit", "paint", "cube.obj")
    assert record.seconds > 0
    assert record.peak_memory is None or record.peak_memory > 1 << 20
    text = (done.folder.folder / "run.json").read_text()
    assert str(mesh.parent) not in text
    assert '"/' not in text
    assert f"/{getpass.getuser()}/" not in text


def test_a_field_of_the_record_is_not_renamed_by_accident() -> None:
    assert records.SCHEMA == "paintit.run/1"
    assert [field.name for field in dataclasses.fields(Record)] == [
        "schema", "state", "outcome", "step", "steps", "asset", "prompt", "prompts", "readings", "command", "started",
        "ended", "seconds", "peak_memory", "seed", "device", "device_reason", "input", "prior", "light", "versions",
        "config", "notes", "seam",
    ]  # fmt: skip


def test_two_runs_with_one_seed_are_the_same_and_another_seed_is_not(mesh: Path) -> None:
    for name, seed in (("a", 0), ("b", 0), ("c", 1)):
        run(job_for(mesh, name, dataclasses.replace(CONFIG, seed=seed)))
    first, second, other = (textures(mesh, name) for name in "abc")
    assert first == second
    assert all(first[name] != other[name] for name in first)


@pytest.mark.parametrize("stop_at", [1, 4])
def test_stopped_and_resumed_is_the_same_as_never_stopped(mesh: Path, stop_at: int) -> None:
    run(job_for(mesh, "whole"))
    job = job_for(mesh, "halved")
    stopped = run(job, stop=lambda: job.painter.step >= stop_at)
    assert (stopped.record.state, stopped.record.step, stopped.files) == ("stopped", stop_at, ())
    assert not (mesh.parent / "halved" / "painted.glb").exists()
    again = resume(mesh, "halved")
    assert again.painter.step == stop_at
    done = run(again)
    assert done.record.state == "finished"
    assert textures(mesh, "halved") == textures(mesh, "whole")
    assert log_of(mesh, "halved") == log_of(mesh, "whole")


def test_the_scale_of_the_prior_is_kept_with_the_run(mesh: Path) -> None:
    """Whatever becomes of the prior's own scale, a resumed run goes on with the one that it was begun with."""
    config = with_prior(CONFIG, "exact")
    painted = {}
    for name in ("whole", "stopped"):
        job = prepare(request_for(mesh, name, config), Guided())
        done = run(job, stop=lambda job=job, name=name: name == "stopped" and job.painter.step == 3)
        assert (done.record.config["guidance"]["scale"], done.record.config["projection"]["scale"]) == (5.0, 5.0)
        painted[name] = load_toml(mesh.parent / name / "painted.paintit" / "config.toml")
    assert painted["whole"].guidance.scale == 5.0
    folder = mesh.parent / "stopped" / "painted.paintit"
    for settings in (config, painted["stopped"]):
        job = prepare(Request(None, None, settings, resume=folder, preview=False), ExactPrior())
        assert job.painter.config == painted["whole"]
    run(job)
    assert textures(mesh, "stopped") == textures(mesh, "whole")


class Guided(ExactPrior):
    def __init__(self) -> None:
        super().__init__()
        self.spec = dataclasses.replace(self.spec, guidance_scale=5.0)


def test_a_setting_younger_than_the_run_is_resumed_as_it_was_before_it(mesh: Path) -> None:
    before = merge(CONFIG, {"texture.upsample": 1})
    assert before != CONFIG, "the preset of today differs"
    run(job_for(mesh, "whole", before))
    run(job := job_for(mesh, "halved", before), stop=lambda: job.painter.step >= 3)
    folder = mesh.parent / "halved" / "painted.paintit"
    settings = folder / "config.toml"
    settings.write_text(settings.read_text().replace("upsample = 1\n", ""))
    assert "upsample" not in settings.read_text()
    assert settings_of(folder) == before
    run(prepare(Request(None, None, settings_of(folder), resume=folder, preview=False), ExactPrior()))
    assert textures(mesh, "halved") == textures(mesh, "whole")


KILLED = """
import os, signal, sys
from pathlib import Path
import torch
torch.set_num_threads({threads})
from tests.test_run import job_for, run
def on_step(step):
    if step.index == {kill_at}:
        os.kill(os.getpid(), signal.SIGKILL)
run(job_for(Path({mesh!r}), "killed"), on_step, checkpoint_every={every})
"""


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL")
@pytest.mark.parametrize(("kill_at", "every", "left"), [pytest.param(2, 1e9, 0, marks=pytest.mark.slow), (5, 0.0, 5)])
def test_killed_and_resumed_is_the_same_as_never_killed(mesh: Path, kill_at: int, every: float, left: int) -> None:
    script = KILLED.format(kill_at=kill_at, every=every, mesh=str(mesh), threads=torch.get_num_threads())
    root = Path(__file__).parents[1]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(root), os.environ.get("PYTHONPATH", "")])}
    done = subprocess.run([sys.executable, "-c", script], cwd=root, env=environment, capture_output=True, text=True)
    assert done.returncode == -signal.SIGKILL, done.stderr
    folder = mesh.parent / "killed" / "painted.paintit"
    assert records.read(folder / "run.json").state == "running"
    assert not (mesh.parent / "killed" / "painted.glb").exists()
    job = resume(mesh, "killed")
    assert job.painter.step == left
    run(job)
    run(job_for(mesh, "whole"))
    assert textures(mesh, "killed") == textures(mesh, "whole")
    assert log_of(mesh, "killed") == log_of(mesh, "whole")


def test_the_log_and_snapshots_are_cut_back_to_the_checkpoint(mesh: Path) -> None:
    """A run killed long after its last checkpoint has logged steps that will be painted again."""
    job = prepare(dataclasses.replace(request_for(mesh, "a"), snapshot_every=2), ExactPrior())
    run(job, stop=lambda: job.painter.step >= 3)
    folder = mesh.parent / "a" / "painted.paintit"
    first = log_of(mesh, "a")
    with open(folder / "log.jsonl", "a") as log:
        log.write('{"index": 4, "gradient_norm": -1}\n{"index": 5, "gra')
    (folder / "snapshots" / "step-00004.png").write_bytes(b"stale")
    run(resume(mesh, "a"))
    assert log_of(mesh, "a")[:3] == first
    assert [index for index, _ in log_of(mesh, "a")] == [*range(1, STEPS + 1)]
    assert sorted(path.name for path in (folder / "snapshots").iterdir()) == ["step-00002.png"]


def test_a_finished_run_is_exported_again(mesh: Path) -> None:
    run(job_for(mesh, "a"))
    before = textures(mesh, "a")
    (mesh.parent / "a" / "painted.glb").unlink()
    job = resume(mesh, "a")
    assert job.finished
    done = run(job)
    assert done.record.state == "finished"
    assert textures(mesh, "a") == before


def test_resume_refuses_another_mesh_prompt_or_setting(mesh: Path) -> None:
    job = job_for(mesh, "a")
    run(job, stop=lambda: True)
    folder = mesh.parent / "a" / "painted.paintit"
    same = load_toml(folder / "config.toml")
    base = Request(None, None, same, resume=folder)
    cases = {
        "optim.steps is 6 in the run, 9 here": dataclasses.replace(base, config=merge(same, {"optim.steps": 9})),
        "the run's prompt is 'red plastic', not 'gold'": dataclasses.replace(base, prompt="gold"),
    }
    for message, request in cases.items():
        with pytest.raises(RunError) as caught:
            prepare(request, ExactPrior())
        assert (caught.value.code, caught.value.message) == ("run.differs", message)
    mesh.write_text(CUBE + "# changed\n")
    with pytest.raises(RunError, match=r"not the one of this run: cube\.obj had sha256 \w{12}"):
        prepare(base, ExactPrior())
    mesh.unlink()
    changed = r"the mesh cube\.obj of this run is not where it was; write: paintit paint MESH"
    with pytest.raises(RunError, match=changed):
        prepare(base, ExactPrior())
    assert not folder.joinpath("run.lock").exists()


def test_a_run_that_diverges_says_so_and_keeps_its_checkpoint(mesh: Path) -> None:
    job = job_for(mesh, "a")

    def spoil(step: Step) -> None:
        if step.index == 3:
            with torch.no_grad():
                next(iter(job.painter.field.parameters())).fill_(math.nan)

    with pytest.raises(PaintitError) as caught:
        run(job, spoil, checkpoint_every=0.0)
    assert caught.value.code == "paint.diverged"
    record = records.read(job.folder.record)
    assert (record.state, record.step) == ("failed", 3)
    assert record.outcome.startswith("failed at step 4 of 6: ")
    assert resume(mesh, "a").painter.step == 3


def test_nothing_is_written_before_every_check_has_passed(mesh: Path) -> None:
    before = sorted(mesh.parent.rglob("*"))
    with pytest.raises(PaintitError, match="no environment map"):
        job_for(mesh, "deep/er", merge(CONFIG, {"light.path": "no.hdr"}))
    assert sorted(mesh.parent.rglob("*")) == before


@pytest.mark.parametrize(
    ("output", "folder", "asset"),
    [
        ("chair.glb", "chair.paintit", "chair.glb"),
        ("a/chair.GLTF", "a/chair.paintit", "a/chair.GLTF"),
        ("chair.obj", "chair.paintit", "chair.obj"),
        ("out", "out", "out/cube.glb"),
        ("out.v2/", "out.v2", "out.v2/cube.glb"),
        (None, "outputs/cube/now", "outputs/cube/now/cube.glb"),
    ],
)
def test_where_a_run_goes(output: str | None, folder: str, asset: str) -> None:
    assert resolve(output, Path("meshes/cube.obj"), now="now") == RunFolder(Path(folder), Path(asset))


def test_two_runs_in_one_second_get_two_folders(tmp_path: Path) -> None:
    first = resolve(None, Path("cube.obj"), tmp_path, "now")
    first.folder.mkdir(parents=True)
    assert resolve(None, Path("cube.obj"), tmp_path, "now").folder == tmp_path / "cube" / "now-2"


def test_an_unknown_extension_is_refused() -> None:
    with pytest.raises(UsageError, match=r"cannot write '\.fbx'"):
        resolve("x.fbx", Path("cube.obj"))


def test_a_run_is_found_by_its_folder_or_its_asset(mesh: Path) -> None:
    done = run(job_for(mesh, "a"), stop=lambda: True)
    assert find(done.folder.folder) == find(done.folder.asset) == done.folder.folder
    with pytest.raises(RunError, match="is not a run folder"):
        find(mesh)


def test_the_lock_keeps_a_second_process_out_and_dies_with_its_own(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path / "run", tmp_path / "run" / "x.glb")
    script = (
        "import time; from pathlib import Path; from paintit.run.folder import RunFolder, locked\n"
        f"folder = RunFolder(Path({str(folder.folder)!r}), Path('x'))\n"
        "with locked(folder): print('held', flush=True); time.sleep(60)"
    )
    holder = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True)
    try:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        with pytest.raises(RunError) as caught, locked(folder):
            pass
        assert caught.value.message == f"{folder.folder} is being painted by process {holder.pid}"
    finally:
        holder.kill()
        holder.communicate()
    assert folder.lock.exists()
    with locked(folder):
        assert folder.lock.read_text() == f"{os.getpid()}\n"
    assert not folder.lock.exists()


def test_checking_that_a_folder_can_be_written_leaves_nothing(tmp_path: Path) -> None:
    check_writable(tmp_path / "a" / "b")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "file").touch()
    with pytest.raises(OutputError):
        check_writable(tmp_path / "file" / "b")


def test_a_damaged_record_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "run.json"
    for text, code in (("{", "run.damaged"), ("[]", "run.damaged"), ('{"schema": "paintit.run/9"}', "run.schema")):
        path.write_text(text)
        with pytest.raises(RunError) as caught:
            records.read(path)
        assert caught.value.code == code
        assert "\n" not in str(caught.value)


def test_absolute_paths_are_cut_to_their_names() -> None:
    values = ("paint", "/home/me/x.obj", "--light=/a/b.hdr", "a red/blue cow", "C:\\Users\\me\\x.obj", "rel/x.obj", "/")
    assert records.without_folders(values) == (
        "paint", "x.obj", "--light=b.hdr", "a red/blue cow", "x.obj", "rel/x.obj", "/",
    )  # fmt: skip
    assert records.without_folders({"a": ["/x/y", 1, None]}) == {"a": ["y", 1, None]}
    assert records.without_folders(["depth=/a/net:0.8", "--control=depth=/a/net", "depth=me/net", "x = /a/b"]) == [
        "depth=net:0.8", "--control=depth=net", "depth=me/net", "x = /a/b",
    ]  # fmt: skip


def test_times_are_utc() -> None:
    assert records.now().endswith("+00:00")
    assert records.now()[:4] == time.strftime("%Y", time.gmtime())


def test_overwriting_keeps_the_old_asset_until_the_new_one_is_whole(mesh: Path) -> None:
    run(job_for(mesh, "twice"))
    asset = mesh.parent / "twice" / "painted.glb"
    old = asset.read_bytes()
    request = dataclasses.replace(request_for(mesh, "twice", merge(CONFIG, {"seed": 5})), overwrite=True)
    seen: list[bool] = []
    run(prepare(request, ExactPrior()), on_step=lambda _: seen.append(asset.read_bytes() == old))
    assert seen == [True] * STEPS
    assert asset.read_bytes() != old


def test_the_choice_of_materials_is_known_to_the_record_and_to_resume(tmp_path: Path) -> None:
    source = MODELS["material_settings"](tmp_path)
    config = merge(CONFIG, {"materials": ["leaf", "car", "sign"], "exclude": ["sign"]})
    whole = run(job_for(source, "whole", config))
    assert whole.record.input["painted"] == ["leaf", "car"]
    assert whole.record.config["exclude"] == ["sign"]
    half = job_for(source, "half", config)
    run(half, stop=lambda: half.painter.step >= 3)
    assert resume(source, "half").painter.field().layers == 2
    run(resume(source, "half"))
    assert textures(source, "half") == textures(source, "whole")
    assert set(textures(source, "whole")) == {
        "painted.glb", *(f"{key}_{name}.png" for key in ("base_color", "orm", "normal") for name in ("leaf", "car")),
    }  # fmt: skip
    other = Request(None, None, merge(config, {"exclude": []}), resume=tmp_path / "half" / "painted.paintit")
    with pytest.raises(RunError, match="exclude is"):
        prepare(other, ExactPrior())
    assert differences(source, whole.folder.asset, ["leaf", "car"]) == []
    asset = load_asset(whole.folder.folder)
    assert [layer.painted for layer in asset.mesh.layers] == [True, False, False, True, False]
    write(tmp_path / "again.gltf", asset.mesh, asset.maps, {})
    assert differences(source, tmp_path / "again.gltf", ["leaf", "car"]) == []


def test_files_beside_the_asset_are_checked_before_anything_is_painted(mesh: Path) -> None:
    (mesh.parent / "new.mtl").write_text("precious")
    request = dataclasses.replace(request_for(mesh, "a"), output=str(mesh.parent / "new.obj"))
    with pytest.raises(OutputError, match=r"new\.mtl already exists"):
        prepare(request, ExactPrior())
    assert not (mesh.parent / "new.paintit").exists()
