"""Flags about the mesh: limits on every command that reads one, the pose, and the head that is looked at."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.cli.conftest import TINY, Ran, everything

from paintit.cli.paint_command import parse_arguments
from paintit.config import POCKET, ViewConfig
from paintit.run.request import settings_of

COMMANDS = {
    "paint": ["red", "-o", "out.glb"],
    "inspect": [],
    "unwrap": ["-o", "out.glb"],
    "render": ["-o", "out.png"],
    "export": ["-o", "out.obj"],
}


@pytest.fixture
def fox(assets: Path) -> Path:
    return assets / "meshes" / "fox.glb"


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_that_reads_a_mesh_keeps_to_the_limits(
    command: str, fox: Path, here: Path, paintit: Callable[..., Ran]
) -> None:
    before = everything(here)
    ran = paintit(command, fox, *COMMANDS[command], "--limits.faces", "100")
    assert (ran.code, ran.out, len(ran.errors)) == (1, "", 1)
    assert ran.errors[0].startswith(f"error: cannot read {fox}: triangles' worth of elements in accessor 0: 576")
    assert ran.errors[0].endswith("more than the limit of 100; if you trust it, add --limits.faces 576")
    ran = paintit(command, fox, *COMMANDS[command], "--limits.faces", "0")
    assert (ran.code, ran.errors) == (2, ["error: limits.faces is 0; it must be from 1 to 1000000000"])
    assert everything(here) == before


def test_a_raised_limit_lets_the_file_pass(fox: Path, paintit: Callable[..., Ran]) -> None:
    assert paintit("inspect", fox, "--limits.faces=576", "--limits.file-mib", "1").code == 0


def test_pose_and_focus_are_settings() -> None:
    given = parse_arguments(["m.glb", "red", "--pose", "Walk@0.5", "--no-focus", "--limits.nodes", "7"]).settings
    assert (given.pose, given.views.auto_focus, given.limits.nodes) == ("Walk@0.5", False, 7)
    assert (
        given
        == parse_arguments(["m.glb", "red", "--pose=Walk@0.5", "--views.no-auto-focus", "--limits.nodes=7"]).settings
    )
    assert POCKET.views.auto_focus
    assert (POCKET.pose, POCKET.limits.faces) == ("rest", 20_000_000)


def test_no_focus_is_in_the_help_and_is_the_nearest_flag(fox: Path, paintit: Callable[..., Ran]) -> None:
    assert "--no-focus" in paintit("paint", "--help").out
    assert paintit("paint", fox, "red", "--no-focuss").errors == [
        "error: unknown flag --no-focuss; did you mean --no-focus?"
    ]


def test_an_unknown_animation_is_one_line(fox: Path, here: Path, paintit: Callable[..., Ran]) -> None:
    ran = paintit("paint", fox, "red", "--pose", "Jump@1", "-o", "out.glb")
    assert ran.code == 1
    assert ran.errors == [
        f"error: cannot read {fox}: there is no animation 'Jump'; choose rest or one of Survey, Walk, Run"
    ]
    assert everything(here) == []


def test_the_head_is_looked_at_and_recorded(fox: Path, here: Path, paintit: Callable[..., Ran]) -> None:
    assert paintit("paint", fox, "a red fox", "-o", "out.glb", "--pose", "Run@0.4", *TINY).code == 0
    record = json.loads((here / "out.paintit" / "run.json").read_text())
    assert "focus on the head (joint 'b_Head_05'); --no-focus turns it off" in record["notes"]
    assert "posed as in animation 'Run' at 0.4 s" in record["notes"]
    assert "a face of a red fox" in record["prompts"]
    assert settings_of(here / "out.paintit").pose == "Run@0.4"
    ran = paintit("paint", fox, "a red fox", "--dry-run", "--no-focus", "--json")
    assert "face" not in json.dumps(json.loads(ran.out)["data"]["prompts"])


def test_a_run_from_before_the_setting_goes_on_without_it(tmp_path: Path) -> None:
    (tmp_path / "config.toml").write_text("seed = 3\n")
    assert settings_of(tmp_path).views == ViewConfig(auto_focus=False)
