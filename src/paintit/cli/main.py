"""The ``paintit`` command: finds the subcommand, runs it, and turns every failure into one line and an exit code.

Only the standard library is imported until a command is known, so that ``paintit --help`` is quick.
"""

from __future__ import annotations

import contextlib
import os
import sys
import traceback
import warnings
from collections.abc import Sequence
from importlib import import_module

from paintit._version import __version__
from paintit.cli.console import Console, Result
from paintit.cli.globals import Globals, split_globals
from paintit.errors import PaintitError, UsageError

#: Subcommand -> what it does. Each is ``cli/<name>_command.py`` with ``main(arguments, console) -> Result``.
COMMANDS = {
    "paint": "make textures for a mesh from a sentence",
    "inspect": "say what is in a mesh, a painted asset or a run, and what is wrong with it",
    "unwrap": "give a mesh texture coordinates and report their quality",
    "render": "make images or a turntable of a painted asset",
    "export": "write a run or an asset as GLB, glTF, OBJ or PNG maps",
    "evaluate": "score painted assets: beside a reference, and without one",
    "analyze": "rerun the paper's analysis: frequencies learned over time, agreement of gradients",
    "priors": "list the diffusion priors, show one, or download one",
    "study": "ask people how realistic results look, and report what they said",
    "objaverse": "download meshes of Objaverse by a list of ids, with their licences",
    "doctor": "check versions, devices and caches, and paint a toy",
}

HELP = """usage: paintit COMMAND ...

Give an untextured 3D mesh and a sentence, get the same file back with physically based textures.

commands:
{commands}

flags of every command:
  -h, --help      what the command does, its flags and an example
  --version       print the version
  -v, --verbose   show the whole traceback of an error
  -q, --quiet     errors only
  --json          one JSON document on stdout
  --offline       fetch nothing
  --no-color      plain text (NO_COLOR is respected too)

example:
  paintit paint chair.obj "a carved oak chair with a red velvet seat" -o chair.glb"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command line; the exit code: 0 done, 1 failed, 2 wrong usage, 130 interrupted."""
    settings, arguments = split_globals(sys.argv[1:] if argv is None else argv)
    console = Console(settings)
    try:
        code = _dispatch(arguments, settings, console)
        sys.stdout.flush()
        return code
    except BrokenPipeError:
        # The reader went away (`paintit inspect x | head`); give the interpreter something to flush at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1


def _dispatch(arguments: list[str], settings: Globals, console: Console) -> int:
    if settings.version:
        console.result("version", Result(__version__, {"version": __version__}))
        return 0
    if not arguments or arguments[0] in ("-h", "--help", "help"):
        lines = "\n".join(f"  {name:<9} {about}" for name, about in COMMANDS.items())
        console.result("help", Result(HELP.format(commands=lines), {"commands": COMMANDS}))
        return 0
    command = arguments[0]
    try:
        return _run(command, arguments[1:], console)
    except PaintitError as error:
        _trace(settings)
        console.error(command, error)
        return error.exit_code
    except KeyboardInterrupt:
        console.error(command, PaintitError("interrupted", "interrupted"))
        return 130
    except BrokenPipeError:
        raise
    except Exception as error:
        _trace(settings)
        known = out_of_memory(error)
        console.error(command, known or _internal(error))
        return 1


def _run(command: str, arguments: list[str], console: Console) -> int:
    if command not in COMMANDS:
        from paintit.settings import nearest

        near = nearest(command, COMMANDS)
        hint = f"did you mean '{near}'?" if near else f"choose one of {', '.join(COMMANDS)}"
        raise UsageError("usage.unknown_command", f"unknown command '{command}'", hint)
    module = import_module(f"paintit.cli.{command}_command")
    if "-h" in arguments or "--help" in arguments:
        return _help(module, arguments, console)
    if console.settings.offline and "--allow-download" in arguments:
        raise UsageError("usage.conflict", "--offline and --allow-download contradict each other", "leave one out")
    with warnings.catch_warnings():
        if not console.settings.verbose:
            warnings.simplefilter("ignore")
        # Whatever a library prints goes to stderr: stdout is the result's alone.
        with contextlib.redirect_stdout(console.err):
            result = module.main(arguments, console)
    console.result(command, result)
    return result.exit_code


def _help(module: object, arguments: list[str], console: Console) -> int:
    try:
        module.main(arguments, console)  # type: ignore[attr-defined]
    except SystemExit as stop:
        return int(stop.code or 0)
    return 0


def _trace(settings: Globals) -> None:
    if settings.verbose:
        traceback.print_exc()


def out_of_memory(error: BaseException) -> PaintitError | None:
    """The one-line form of memory running out, on any device; None where ``error`` is something else."""
    text = str(error)
    ours = isinstance(error, MemoryError) or type(error).__name__ == "OutOfMemoryError"
    if not ours and not any(sign in text for sign in ("out of memory", "can't allocate memory", "Cannot allocate")):
        return None
    return PaintitError(
        "memory.exhausted", "there is not enough memory",
        "use a smaller --texture-size, --render-size or --views; --dry-run shows an estimate",
    )  # fmt: skip


def _internal(error: Exception) -> PaintitError:
    reason = " ".join(f"{type(error).__name__}: {error}".split())
    return PaintitError("internal", f"internal error: {reason}", "run with -v for the traceback, and please report it")
