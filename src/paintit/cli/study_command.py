"""``paintit study create|serve|report``: ask people how realistic results look."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from paintit.cli.console import Console, Result
from paintit.cli.parse import check_range, parse
from paintit.errors import StudyError, UsageError

if TYPE_CHECKING:
    from paintit.study.report import Report

ABOUT = """Ask people how realistic the results of several methods look, from 1 to 5.

Examples:  paintit study create STUDY dcpbr=runs/dcpbr pixels=runs/pixels
           paintit study serve STUDY -o answers.sqlite
           paintit study report answers.sqlite

'paintit study create --help' and so on show the flags of each."""

ABOUT_CREATE = """Make a study folder from one folder per method, of painted assets, runs or pictures named alike.

Assets and runs are rendered alike: same camera, same light. Pictures are taken as they are. The bare mesh is shown
beside them where an asset or --untextured gives it.

Examples:  paintit study create STUDY dcpbr=runs/dcpbr pixels=runs/pixels
           paintit study create STUDY ours=a/ theirs=b/ --untextured bare/ --prompts prompts.toml"""

ABOUT_SERVE = """Serve the questions of a study as a web page, until Ctrl-C. Every rating is on the disk at once.

Only this machine can reach the page unless --host says otherwise (0.0.0.0 is everyone who can reach the machine).

Example:   paintit study serve STUDY -o answers.sqlite --port 8000"""

ABOUT_REPORT = """Mean score per method with bootstrap intervals over raters, and the raters' agreement.

Agreement is Krippendorff's alpha for ordinal data: 1 is full agreement, 0 what chance gives.

Example:   paintit study report answers.sqlite"""

OUTPUT = tyro.conf.arg(aliases=["-o"], metavar="FILE", help_behavior_hint="")


@dataclass(frozen=True)
class StudyArguments:
    """Arguments of ``paintit study``."""

    action: Annotated[
        tyro.conf.Positional[Literal["create", "serve", "report"]], tyro.conf.arg(metavar="create|serve|report")
    ]
    """What to do."""


@dataclass(frozen=True)
class CreateArguments:
    """Arguments of ``paintit study create``."""

    study: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="STUDY")]
    """Folder to make."""
    methods: Annotated[tyro.conf.Positional[tuple[str, ...]], tyro.conf.arg(metavar="METHOD=FOLDER")]
    """What each method made; at least two."""
    items: int = 10
    """Meshes at most, in order of name."""
    title: str = "How realistic is it?"
    """Heading of the first page."""
    seed: int = 0
    """Of the order in which each rater sees the methods."""
    untextured: Annotated[str | None, tyro.conf.arg(metavar="FOLDER", help_behavior_hint="")] = None
    """Pictures of the bare meshes."""
    prompts: Annotated[str | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="")] = None
    """TOML table of mesh = "prompt", where no run tells."""
    size: int = 768
    """Pixels along each side of a rendered view."""
    views: int = 1
    """Views side by side in one picture."""
    azimuth: float = 35.0
    """Degrees of the first view; 0 looks at the front."""
    elevation: float = 15.0
    """Degrees; positive looks from above."""
    light: str = "default"
    """The light in the package, or an .hdr or .exr file."""


@dataclass(frozen=True)
class ServeArguments:
    """Arguments of ``paintit study serve``."""

    study: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="STUDY")]
    """Folder with a study.toml, or such a table."""
    output: Annotated[str | None, OUTPUT] = None
    """Where answers go, a SQLite file; by default answers.sqlite in the study's folder."""
    host: str = "127.0.0.1"
    """Address to listen on."""
    port: int = 8000
    """Port to listen on; 0 takes any free one."""


@dataclass(frozen=True)
class ReportArguments:
    """Arguments of ``paintit study report``."""

    answers: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="FILE")]
    """The SQLite file of answers."""
    seed: int = 0
    """Of the bootstrap."""


def main(arguments: Sequence[str], console: Console) -> Result:
    action, rest = (arguments[0], arguments[1:]) if arguments else ("", ())
    actions = {"create": _create, "serve": _serve, "report": _report}
    if action in actions:
        return actions[action](rest, console)
    if not arguments:
        raise UsageError("usage.no_action", "nothing is asked of the study", f"write one of {', '.join(actions)}")
    parse(StudyArguments, arguments, "paintit study", ABOUT)
    raise UsageError("usage.no_action", f"'{action}' is not the first word", f"begin with {', '.join(actions)}")


def _create(arguments: Sequence[str], console: Console) -> Result:
    given = parse(CreateArguments, arguments, "paintit study create", ABOUT_CREATE)
    check_range("--items", given.items, 1, 1000)
    check_range("--seed", given.seed, 0, 2**63 - 1)
    check_range("--size", given.size, 8, 4096)
    check_range("--views", given.views, 1, 8)
    check_range("--azimuth", given.azimuth, -720, 720)
    check_range("--elevation", given.elevation, -89.9, 89.9)
    methods = _methods(given.methods)
    from paintit.study.create import Look, create, read_prompts

    created = create(
        Path(given.study), methods, title=given.title, seed=given.seed, count=given.items,
        untextured=Path(given.untextured) if given.untextured else None,
        prompts=read_prompts(Path(given.prompts)) if given.prompts else {},
        look=Look(given.size, given.views, given.azimuth, given.elevation, given.light),
        on_picture=lambda name: console.note(f"picture of {name}"),
    )  # fmt: skip
    if created.lacking:
        console.warn(f"left out, since not every method has them: {', '.join(created.lacking)}")
    if created.spare:
        console.warn(f"left out, beyond --items {given.items}: {', '.join(created.spare)}")
    names = [question.name for question in created.study.questions]
    return Result(given.study, {"study": given.study, "methods": list(methods), "questions": names})


def _methods(texts: Sequence[str]) -> dict[str, Path]:
    """``NAME=FOLDER`` as name -> folder.

    Raises:
        UsageError: it is anything else, or a name comes twice.
    """
    methods: dict[str, Path] = {}
    for text in texts:
        name, equals, folder = text.partition("=")
        if not (name and equals and folder):
            raise UsageError("usage.method", f"a method is '{text}'", "write METHOD=FOLDER")
        if name in methods:
            raise UsageError("usage.method", f"the method '{name}' comes twice", "give each a name of its own")
        methods[name] = Path(folder)
    return methods


def _serve(arguments: Sequence[str], console: Console) -> Result:
    given = parse(ServeArguments, arguments, "paintit study serve", ABOUT_SERVE)
    check_range("--port", given.port, 0, 65535)
    from paintit.study.answers import Answers
    from paintit.study.questions import read_study

    try:
        from paintit.study.server import serve
    except ModuleNotFoundError as error:
        hint = "install it: pip install 'paintit[study]'"
        raise StudyError("study.extra", f"the page needs {error.name}, which is not installed", hint) from None
    path = Path(given.study)
    study = read_study(path)
    target = Path(given.output) if given.output else (path if path.is_dir() else path.parent) / "answers.sqlite"
    answers = Answers(target, study)
    try:
        serve(answers, given.host, given.port, lambda url: console.note(f"asking at {url} (Ctrl-C ends)"))
    except KeyboardInterrupt:
        console.note("ended")
    finally:
        count, raters = answers.counts()
        answers.close()
    data = {"answers": str(target), "count": count, "raters": raters}
    return Result(str(target), data)


def _report(arguments: Sequence[str], console: Console) -> Result:
    given = parse(ReportArguments, arguments, "paintit study report", ABOUT_REPORT)
    check_range("--seed", given.seed, 0, 2**63 - 1)
    from paintit.study.answers import read_answers
    from paintit.study.report import report

    found = report(read_answers(Path(given.answers)), given.seed)
    return Result(_text(found), dataclasses.asdict(found))


def _text(found: Report) -> str:
    width = max([6, *(len(opinion.method) for opinion in found.opinions)])
    lines = [f"{'method':<{width}}   mean   95 % interval   answers     1    2    3    4    5"]
    for opinion in found.opinions:
        interval = "-" if opinion.low is None else f"{opinion.low:.2f} to {opinion.high:.2f}"
        counts = "".join(f"{count:5d}" for count in opinion.counts)
        lines.append(f"{opinion.method:<{width}}   {opinion.mean:.2f}   {interval:<13}   {opinion.answers:7d} {counts}")
    agreement = "not defined" if found.agreement is None else f"{found.agreement:.3f}"
    lines += [
        "",
        f"{found.answers} answers by {found.raters} raters to {found.questions} questions; {found.complete} raters "
        f"answered all, {found.silent} began and answered none",
        f"agreement (Krippendorff's alpha, ordinal): {agreement}",
        f"intervals: percentile bootstrap over raters, {found.resamples} resamples, seed {found.seed}",
    ]
    if found.unfinished:
        rounds = ", ".join(f"rater {u.rater} ({u.answers} of {u.asked})" for u in found.unfinished)
        lines.append(f"incomplete rounds: {rounds}")
    return "\n".join(lines)
