"""``paintit paint``: make textures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from paintit.cli.console import Console, Result, size_text, table
from paintit.cli.parse import check_range, gather, parse, peek
from paintit.config import POCKET, PRESETS, PaintConfig, preset, with_prior
from paintit.errors import UsageError
from paintit.settings import load_toml, validate

if TYPE_CHECKING:
    from paintit.run.paint import Done, Job, Request

ABOUT = """Make textures for a mesh from a sentence.

Example:  paintit paint chair.obj "a carved oak chair with a red velvet seat" -o chair.glb

A preset gives every setting; --config FILE replaces some; flags replace those. Everyday flags: -o --preset --config
--resume --method --prior --control --lora --reference --negative --steps --views --seed --texture-size --render-size
--light --focus --no-focus --pose --material --exclude --unwrap --device --dtype --memory --snapshot-every --preview
--turntable --dry-run --overwrite. For every command: --json -v -q --offline --no-color."""


@dataclass(frozen=True)
class PaintArguments:
    """Flags of ``paintit paint``."""

    mesh: Annotated[tyro.conf.Positional[str | None], tyro.conf.arg(metavar="MESH", help_behavior_hint="")] = None
    """OBJ, PLY, STL, OFF, GLB or glTF."""
    prompt: Annotated[tyro.conf.Positional[str | None], tyro.conf.arg(metavar="PROMPT", help_behavior_hint="")] = None
    """What it should look like, in quotes."""
    output: Annotated[str | None, tyro.conf.arg(aliases=["-o"], metavar="PATH", help_behavior_hint="")] = None
    """File (.glb, .gltf, .obj) or folder; by default outputs/MESH/TIME/."""
    preset: Literal["pocket", "paper"] = "pocket"
    """Named settings: pocket (any machine, no download) or paper (Stable Diffusion, needs a GPU)."""
    config: Annotated[str | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="")] = None
    """TOML file of settings, such as the config.toml of an earlier run."""
    resume: Annotated[str | None, tyro.conf.arg(metavar="RUN", help_behavior_hint="")] = None
    """Go on with a run that was stopped or killed; gives the same bytes as one that was not."""
    snapshot_every: Annotated[int, tyro.conf.arg(metavar="STEPS")] = 0
    """Save a small preview every so many steps; 0 for none."""
    preview: Literal["png", "none"] = "png"
    """Picture from four sides beside the asset."""
    turntable: tyro.conf.FlagCreatePairsOff[bool] = False
    """Also write turntable.webp."""
    dry_run: tyro.conf.FlagCreatePairsOff[bool] = False
    """Check everything, print the plan and the memory estimate, write nothing."""
    overwrite: tyro.conf.FlagCreatePairsOff[bool] = False
    """Replace an earlier result of that name."""
    allow_download: tyro.conf.FlagCreatePairsOff[bool] = False
    """Fetch the prior from its hub where it is not on this machine yet."""
    settings: Annotated[PaintConfig, tyro.conf.arg(name="")] = field(default_factory=lambda: POCKET)
    """Every setting."""


def defaults(arguments: Sequence[str]) -> PaintConfig:
    """What the flags go over: the preset, the TOML file over it, or the settings of the run that is resumed; and the
    scales of the prior that a flag names."""
    resume, file, name = (peek(arguments, flag) for flag in ("--resume", "--config", "--preset"))
    if resume is not None:
        from paintit.run.folder import find
        from paintit.run.request import settings_of

        if file is not None or name is not None:
            raise UsageError("usage.resume", "--resume keeps the settings of its run",
                             "leave out --preset and --config")  # fmt: skip
        return settings_of(find(Path(resume)))
    base = preset(name) if name is not None and name in PRESETS else None
    config = load_toml(Path(file), base) if file is not None else base or POCKET
    prior = peek(arguments, "--prior") or peek(arguments, "--guidance.prior")
    return config if prior is None else with_prior(config, prior)


def parse_arguments(arguments: Sequence[str]) -> PaintArguments:
    """Flags over TOML over preset.

    Raises:
        UsageError: a flag, a value or a file that cannot be used.
    """
    wants_help = "-h" in arguments or "--help" in arguments
    base = POCKET if wants_help and peek(arguments, "--resume") else defaults(arguments)
    joined = gather(arguments, "--focus", ["--views.focus"])
    joined = gather(joined, "--material", ["--materials"])
    joined = gather(joined, "--exclude")
    joined = gather(joined, "--control", ["--guidance.control"])
    joined = gather(joined, "--lora", ["--guidance.lora"])
    return parse(PaintArguments, joined, "paintit paint", ABOUT, PaintArguments(settings=base))


def main(arguments: Sequence[str], console: Console) -> Result:
    given = parse_arguments(arguments)
    check_range("--snapshot-every", given.snapshot_every, 0, 10_000_000)
    validate(given.settings)
    if given.resume is None and given.mesh is None:
        raise UsageError("usage.no_mesh", "no mesh is given", 'write: paintit paint MESH "PROMPT"')
    if given.resume is None and not (given.prompt or "").strip():
        raise UsageError("prompt.empty", "the prompt is empty", 'say what the mesh should look like: "red plastic"')
    from paintit.run.paint import Request

    return _paint(
        Request(
            mesh=Path(given.mesh) if given.mesh is not None else None,
            prompt=given.prompt,
            config=given.settings,
            output=given.output,
            resume=Path(given.resume) if given.resume is not None else None,
            overwrite=given.overwrite,
            snapshot_every=given.snapshot_every,
            preview=given.preview == "png",
            turntable=given.turntable,
            allow_download=given.allow_download,
            command=("paintit", "paint", *arguments),
        ),
        given.dry_run,
        console,
    )


def _paint(request: Request, dry_run: bool, console: Console) -> Result:
    from paintit.cli.interrupt import StopAfterStep
    from paintit.cli.progress import Progress
    from paintit.run.paint import prepare, run

    if dry_run:
        return _plan(request)
    job = prepare(request)
    for note in job.painter.notes:
        console.note(note)
    for word, meaning in job.painter.readings.items():
        console.note(f"the prior does not know '{word}' and reads it as '{meaning}'")
    console.note(_opening(job))
    with StopAfterStep(console) as stop, Progress(console, job.painter.step, job.painter.total) as progress:
        done = run(job, progress.show, stop.asked)
    if done.record.state == "stopped":
        return _stopped(done, console)
    console.note(_closing(done))
    if hint := _gpu_hint(job):
        console.note(hint)
    return Result(str(done.folder.asset), _data(done))


def _plan(request: Request) -> Result:
    from paintit.run.plan import plan

    planned = plan(request)
    rows = [(name.replace("_", " "), _value_text(name, value)) for name, value in planned.items()]
    return Result(table(rows), planned)


def _value_text(name: str, value: object) -> str:
    if name == "memory" and isinstance(value, int):
        return f"about {size_text(value)}"
    return "\n".join(map(str, value)) if isinstance(value, list) else str(value)


def _opening(job: Job) -> str:
    if job.finished:
        return f"the run {job.folder.folder} had finished; exporting it again"
    painter = job.painter
    went = f", going on after step {painter.step}" if painter.step else ""
    return f"painting {painter.total} steps on {painter.device} ({painter.device_reason}){went}"


def _stopped(done: Done, console: Console) -> Result:
    command = f"paintit paint --resume {_quoted(done.folder.folder)}"
    console.note(f"{done.record.outcome}; go on with: {command}")
    return Result("", _data(done) | {"resume": command}, 130)


def _quoted(path: Path) -> str:
    import shlex

    return shlex.quote(str(path))


def _closing(done: Done) -> str:
    record = done.record
    return f"{record.outcome} in {record.seconds:.1f} s, peak memory {size_text(record.peak_memory)}"


def _gpu_hint(job: Job) -> str:
    """On a machine with a GPU, how to use the larger model; the default stays the same everywhere."""
    import torch

    has_gpu = torch.cuda.is_available() or torch.backends.mps.is_available()
    if not has_gpu or job.painter.prior.spec.family != "pocket":
        return ""
    return "this machine has a GPU: --preset paper paints with Stable Diffusion (or name a model with --prior)"


def _data(done: Done) -> dict[str, object]:
    record = done.record
    return {
        "asset": str(done.folder.asset) if done.files else None,
        "run": str(done.folder.folder),
        "files": [str(path) for path in done.files],
        "state": record.state,
        "outcome": record.outcome,
        "step": record.step,
        "steps": record.steps,
        "seconds": record.seconds,
        "peak_memory": record.peak_memory,
        "seed": record.seed,
        "device": record.device,
        "prior": record.prior,
    }
