"""Help is quick, complete, and has an example for every command."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable

import pytest
from tests.cli.conftest import Ran

from paintit._version import __version__
from paintit.cli.main import COMMANDS

HEAVY = ("torch", "warp", "trimesh", "diffusers", "scipy")


@pytest.mark.parametrize(
    "arguments", [["--help"], ["--version"], ["paint", "--help"], ["paint", "m.obj", "p", "--stpes"]]
)
def test_nothing_heavy_is_imported_to_answer(arguments: list[str]) -> None:
    script = (
        "import sys; from paintit.cli.main import main\n"
        "try: main(sys.argv[1:])\n"
        "except SystemExit: pass\n"
        f"print([name for name in {HEAVY} if name in sys.modules], file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", script, *arguments], capture_output=True, text=True, check=True)
    assert done.stderr.splitlines()[-1] == "[]"


def test_importing_the_package_loads_nothing_heavy() -> None:
    script = f"import sys, paintit; print([name for name in {(*HEAVY, 'numpy', 'tyro')} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help_with_an_example_on_stdout(command: str, paintit: Callable[..., Ran]) -> None:
    ran = paintit(command, "--help")
    assert ran.code == 0
    assert "Example" in ran.out
    assert f"paintit {command}" in ran.out
    assert ran.err == ""


def test_help_lists_every_command(paintit: Callable[..., Ran]) -> None:
    for arguments in ([], ["-h"], ["--help"], ["help"]):
        ran = paintit(*arguments)
        assert (ran.code, ran.err) == (0, "")
        for name, about in COMMANDS.items():
            assert f"  {name:<9} {about}\n" in ran.out


def test_paint_help_shows_the_values_of_the_preset(paintit: Callable[..., Ran]) -> None:
    pocket, paper = paintit("paint", "--help"), paintit("paint", "--preset", "paper", "--help")
    assert "stable-diffusion" not in pocket.out
    assert "stable-diffusion" in paper.out


def test_version(paintit: Callable[..., Ran]) -> None:
    assert paintit("--version") == Ran(0, f"{__version__}\n", "")
    assert paintit("paint", "--version") == Ran(0, f"{__version__}\n", "")
