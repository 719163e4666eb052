"""``paintit paint`` from end to end: streams, the document, dry run, Ctrl-C, resume."""

from __future__ import annotations

import json
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.cli.conftest import TINY, Ran, everything, start
from tests.export.models import MODELS


def test_stdout_is_the_path_of_the_asset_alone(cube: Path, here: Path, paintit: Callable[..., Ran]) -> None:
    ran = paintit("paint", cube, "red plastic", "-o", "red.glb", *TINY)
    assert (ran.code, ran.out) == (0, "red.glb\n")
    assert "painting 3 steps on " in ran.err
    assert "finished after 3 of 3 steps in " in ran.err
    assert (here / "red.glb").read_bytes()[:4] == b"glTF"
    quiet = paintit("paint", cube, "red plastic", "-o", "red.glb", *TINY, "--overwrite", "-q")
    assert quiet == Ran(0, "red.glb\n", "")


def keys(value: Any) -> Any:
    """The shape of a document: names, and the types of what they hold."""
    if isinstance(value, dict):
        return {key: keys(inner) for key, inner in value.items()}
    return type(value).__name__


def test_the_document_keeps_its_shape(cube: Path, here: Path, paintit: Callable[..., Ran]) -> None:
    ran = paintit("paint", cube, "red plastic", "-o", "out/", *TINY, "--json", "-q")
    document = json.loads(ran.out)
    assert ran.out.count("\n") == 1
    prior = document["data"].pop("prior")
    assert prior["id"] == "pocket"
    assert keys(document) == {
        "schema": "str", "ok": "bool", "command": "str", "version": "str", "warnings": "list", "error": "NoneType",
        "data": {
            "asset": "str", "run": "str", "files": "list", "state": "str", "outcome": "str", "step": "int",
            "steps": "int", "seconds": "float", "peak_memory": "int", "seed": "int", "device": "str",
        },
    }  # fmt: skip
    assert (document["schema"], document["ok"], document["command"]) == ("paintit.cli/1", True, "paint")
    assert document["data"]["asset"] == "out/cube.glb"


def test_the_record_names_every_device(cube: Path, here: Path, paintit: Callable[..., Ran]) -> None:
    ran = paintit("paint", cube, "red plastic", "-o", "out/", *TINY, "--device", "cpu,cpu", "-q")
    assert (ran.code, ran.err) == (0, "")
    record = json.loads((here / "out" / "run.json").read_text("utf-8"))
    assert record["device"] == "cpu"
    assert record["device_reason"] == "asked for; the prior works on cpu and cpu at once"
    assert record["config"]["device"] == "cpu,cpu"


def test_materials_are_chosen_by_repeated_flags(tmp_path: Path, here: Path, paintit: Callable[..., Ran]) -> None:
    mesh = MODELS["material_settings"](tmp_path)
    ran = paintit("paint", mesh, "red", *TINY, "--dry-run", "--json", "--material", "leaf", "--exclude=sign",
                  "--material", "SIGN", "--material=car")  # fmt: skip
    plan = json.loads(ran.out)["data"]
    assert plan["painted"] == ["leaf", "car"]
    assert plan["layers"] == ["leaf", "glass", "lamp", "car", "sign"]
    assert plan["textures"].startswith("2 x ")
    ran = paintit("paint", mesh, "red", *TINY, "--dry-run", "--material", "leave")
    assert ran.code == 2
    assert ran.errors == ["error: there is no material 'leave'; the mesh has: leaf, glass, lamp, car, sign"]
    ran = paintit("paint", mesh, "red", *TINY, "--dry-run", "--material", "leaf", "--exclude", "leaf")
    assert (ran.code, len(ran.errors)) == (2, 1)
    assert "no material is left to paint" in ran.err


def test_a_dry_run_says_all_and_writes_nothing(cube: Path, here: Path, paintit: Callable[..., Ran]) -> None:
    ran = paintit("paint", cube, "red plastic", *TINY, "--dry-run", "--json")
    plan = json.loads(ran.out)["data"]
    assert ran.code == 0
    assert (plan["faces"], plan["steps"], plan["uvs"], plan["layers"]) == (12, 3, "kept from the file", ["material"])
    assert plan["prompts"] == ["", "red plastic"]
    assert plan["prior"].startswith("pocket")
    assert plan["memory"] > 1 << 28
    assert [Path(name).name for name in plan["files"]][:3] == ["cube.glb", "textures", "run.json"]
    assert everything(here) == []
    text = paintit("paint", cube, "red plastic", *TINY, "--dry-run", "-q").out
    assert "kept from the file" in text
    assert everything(here) == []


def test_a_larger_picture_needs_more_memory(cube: Path, here: Path, paintit: Callable[..., Ran]) -> None:
    def estimate(*flags: str) -> int:
        return json.loads(paintit("paint", cube, "red", *flags, "--dry-run", "--json").out)["data"]["memory"]

    assert estimate() < estimate("--texture-size", "1024") < estimate("--texture-size", "1024", "--render-size", "512")
    assert estimate("--texture.upsample", "2") < estimate("--texture.upsample", "1")


@pytest.mark.parametrize("kind", ["dcpbr", "pixels", "hash-grid", "points"])
def test_a_dry_run_knows_every_kind_of_texture(kind: str, cube: Path, here: Path, paintit: Callable[..., Ran]) -> None:
    def estimate(size: str) -> int:
        flags = ["--texture.kind", kind, "--texture-size", size, "--dry-run", "--json"]
        return json.loads(paintit("paint", cube, "red", *flags).out)["data"]["memory"]

    small, large = estimate("256"), estimate("1024")
    assert 1 << 29 < small < large < 6 << 30
    assert large - small > 250 << 20


def test_the_config_of_a_run_repeats_it(cube: Path, here: Path, paintit: Callable[..., Ran]) -> None:
    assert paintit("paint", cube, "red plastic", "-o", "a.glb", *TINY, "--seed", "3").code == 0
    config = ["--config", "a.paintit/config.toml"]
    again = paintit("paint", cube, "red plastic", "-o", "b.glb", *config, "--preview", "none")
    assert again.code == 0
    assert (here / "a.glb").read_bytes() == (here / "b.glb").read_bytes()
    assert (here / "a.paintit" / "config.toml").read_text() == (here / "b.paintit" / "config.toml").read_text()


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_ctrl_c_saves_and_the_run_can_be_resumed(cube: Path, here: Path, paintit: Callable[..., Ran]) -> None:
    flags = [*TINY, "--steps", "100000"]
    process = start("paint", cube, "red plastic", "-o", "red.glb", *flags, folder=here)
    log = here / "red.paintit" / "log.jsonl"
    while process.poll() is None and not (log.exists() and log.read_text().count("\n") >= 2):
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=300)
    assert (process.returncode, out) == (130, "")
    assert "stopping after this step; once more to stop at once" in err
    assert err.endswith("go on with: paintit paint --resume red.paintit\n")
    assert "Traceback" not in err
    assert not (here / "red.glb").exists()
    assert (here / "red.paintit" / "checkpoints" / "last.safetensors").exists()
    inspected = json.loads(paintit("inspect", "red.paintit", "--json").out)["data"]["run"]
    assert inspected["state"] == "stopped"
    assert inspected["step"] == len(log.read_text().splitlines()) >= 2
    refused = paintit("paint", "--resume", "red.paintit", "--steps", "9", "-q")
    assert refused == Ran(
        1, "", "error: optim.steps is 100000 in the run, 9 here; leave --optim.steps out, or start a new run\n"
    )


def test_the_first_signal_is_noted_and_the_second_interrupts() -> None:
    from paintit.cli.console import Console
    from paintit.cli.globals import Globals
    from paintit.cli.interrupt import StopAfterStep

    before = signal.getsignal(signal.SIGINT)
    with StopAfterStep(Console(Globals(quiet=True))) as stop:
        assert not stop.asked()
        signal.raise_signal(signal.SIGINT)
        assert stop.asked()
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before


def test_stopping_at_once_exits_with_130(
    cube: Path, here: Path, paintit: Callable[..., Ran], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("paintit.cli.progress.Progress.show", interrupt)
    ran = paintit("paint", cube, "red plastic", "-o", "red.glb", *TINY, "-q")
    assert ran == Ran(130, "", "error: interrupted\n")
    run = json.loads(paintit("inspect", "red.paintit", "--json").out)["data"]["run"]
    assert (run["state"], run["outcome"]) == ("stopped", "interrupted after 1 of 3 steps")


def test_a_line_now_and_then_where_there_is_no_terminal(
    cube: Path, here: Path, paintit: Callable[..., Ran], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("paintit.cli.progress.LINE_EVERY", 0.0)
    ran = paintit("paint", cube, "red plastic", "-o", "red.glb", *TINY)
    lines = [line for line in ran.errors if line.startswith("step ")]
    assert [line.split()[1] for line in lines] == ["1/3", "2/3", "3/3"]
    assert all("gradient norm " in line and " s/step  0:0" in line and line.endswith(" left") for line in lines)


def test_a_bar_on_a_terminal() -> None:
    import io

    from paintit.cli.console import Console
    from paintit.cli.globals import Globals
    from paintit.cli.progress import Progress
    from paintit.paint.painter import Step

    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    terminal = Terminal()
    with Progress(Console(Globals(no_color=True), err=terminal), 0, 2) as progress:
        for index in (1, 2):
            progress.show(Step(index, 2, 0.5, 1.0, 12.5, 1e-3, 0.1, {}))
    assert "step 2/2" in terminal.getvalue()
    assert "gradient norm 12.5" in terminal.getvalue()
