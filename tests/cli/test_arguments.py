"""Flags over TOML over preset; every setting has a flag; flags may stand anywhere."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from paintit.cli.globals import Globals, split_globals
from paintit.cli.paint_command import PaintArguments, parse_arguments
from paintit.cli.parse import ALIASES, flags
from paintit.config import PAPER, POCKET, FocusConfig
from paintit.settings import names


def settings(*arguments: str) -> Any:
    return parse_arguments(["mesh.obj", "red", *arguments]).settings


def test_without_flags_it_is_the_pocket_preset() -> None:
    assert settings() == POCKET
    assert settings("--preset", "paper") == PAPER
    assert settings("--preset=paper") == PAPER


def test_precedence(tmp_path: Path) -> None:
    toml = tmp_path / "c.toml"
    toml.write_text("seed = 5\n[optim]\nsteps = 7\n")
    config = settings("--preset", "paper", "--config", str(toml))
    assert (config.optim.steps, config.seed, config.views.count) == (7, 5, PAPER.views.count)
    assert config.prompt == PAPER.prompt
    config = settings("--steps", "9", "--config", str(toml), "--preset", "paper")
    assert (config.optim.steps, config.seed, config.prompt) == (9, 5, PAPER.prompt)


def test_flags_may_stand_anywhere() -> None:
    first = parse_arguments(["--steps", "3", "-o", "x.glb", "mesh.obj", "a red cow", "--overwrite"])
    last = parse_arguments(["mesh.obj", "--overwrite", "a red cow", "--optim.steps=3", "--output=x.glb"])
    assert first == last
    assert (first.mesh, first.prompt, first.output, first.settings.optim.steps) == (
        "mesh.obj", "a red cow", "x.glb", 3,
    )  # fmt: skip


@pytest.mark.parametrize(("name", "alias"), ALIASES.items())
def test_an_alias_sets_what_its_long_name_sets(name: str, alias: str) -> None:
    value = {"texture.size": "64", "light.path": "a.hdr", "views.count": "3", "views.size": "96",
             "views.focus": "1,2,3,4", "prompt.negative": "ugly", "guidance.prior": "sd15",
             "guidance.control": "depth:0.5", "guidance.lora": "style.safetensors", "guidance.reference": "a.png",
             "compute.memory": "8", "optim.steps": "3", "materials": "wood"}[name]  # fmt: skip
    assert settings(alias, value) == settings(f"--{name}", value) != POCKET


def test_every_setting_has_a_flag() -> None:
    known = flags(PaintArguments)
    for name in names():
        assert "--" + name.replace("_", "-") in known


def test_every_known_flag_is_one_that_tyro_takes(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        parse_arguments(["--help"])
    text = capsys.readouterr().out
    for flag in set(flags(PaintArguments)) - {"-v", "-q", "--verbose", "--quiet", "--version"}:
        assert flag in text or flag.startswith("--no-"), flag


def test_special_forms() -> None:
    config = settings("--focus", "0,1.5,-2,0.25", "--seed", "4", "--focus=-1,0,0,1,left hand", "--light.rotation", "90")
    assert config.views.focus == (
        FocusConfig((0.0, 1.5, -2.0), 0.25),
        FocusConfig((-1.0, 0.0, 0.0), 1.0, "left hand"),
    )
    assert config.light.rotation == 90.0
    assert settings("--preset", "paper", "--light.rotation", "random").light.rotation is None
    assert settings("--views.elevation", "-10", "20").views.elevation == (-10.0, 20.0)
    assert settings("--texture.widths", "8", "16", "--texture.skip-widths", "4", "4").texture.widths == (8, 16)


def test_controls_may_be_repeated() -> None:
    config = settings("--control", "depth", "--steps", "3", "--control=normal=a/b:0.5", "--guidance.control", "depth")
    assert config.guidance.control == ("depth", "normal=a/b:0.5", "depth"), "and validate refuses the second depth"
    assert settings("--steps", "3").guidance.control == ()


def test_another_prior_comes_with_its_own_scale(tmp_path: Path) -> None:
    def scales(*arguments: str) -> tuple[float | None, float | None, float | None]:
        config = settings(*arguments)
        return config.guidance.scale, config.guidance.scale_end, config.projection.scale

    assert scales() == scales("--prior", "pocket") == (3.0, 1.5, 2.0)
    assert scales("--preset", "paper") == (101.0, None, 7.5)
    for flag in ("--prior=klein", "--guidance.prior=klein"):
        assert scales(flag) == scales("--preset", "paper", flag) == (None, None, None)
    assert scales("--prior", "klein", "--guidance.scale", "4", "--guidance.scale-end", "2") == (4.0, 2.0, None)
    assert scales("--guidance.scale", "auto", "--projection.scale=auto") == (None, 1.5, None)
    toml = tmp_path / "some.toml"
    toml.write_text('[guidance]\nprior = "sd15"\nscale = 50\n')
    assert scales("--config", str(toml)) == (50.0, None, None)
    assert scales("--config", str(toml), "--prior", "sdxl") == (None, None, None)
    assert scales("--config", str(toml), "--prior", "sd15") == (50.0, None, None)


def test_global_flags_are_found_anywhere_before_a_double_dash() -> None:
    found, rest = split_globals(["-q", "paint", "--json", "m.obj", "--", "-v"])
    assert found == Globals(quiet=True, json=True)
    assert rest == ["paint", "m.obj", "--", "-v"]
