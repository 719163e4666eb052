"""``paintit analyze frequency|coherence``: the paper's analysis of the method, rerun (section 4, supp. A.2 and A.3)."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from paintit.cli.console import Console, Result
from paintit.cli.paint_command import defaults
from paintit.cli.parse import check_range, parse, peek
from paintit.config import POCKET, PaintConfig
from paintit.errors import UsageError
from paintit.settings import validate

ABOUT = """Rerun the paper's analysis of the method.

Examples:  paintit analyze frequency texture.png -o fitting
           paintit analyze frequency spot.obj "red brick" -o painting
           paintit analyze coherence spot.obj "red brick" -o gradients

frequency: how fast a parameterisation learns each frequency, fitting an image or painting a mesh (section 4).
coherence: how far the gradients of nearly the same views agree (supp. A.2).

'paintit analyze frequency --help' and 'paintit analyze coherence --help' list their flags."""

FREQUENCY = """How fast does a parameterisation learn each frequency? (section 4, supp. A.3)

Examples:  paintit analyze frequency texture.png --variants dcpbr pixels --steps 500 --every 10 -o fitting
           paintit analyze frequency spot.obj "red brick" --seeds 3 -o painting

With an image alone, each variant fits it by its mean absolute error; with a mesh and a prompt, each paints it. The
spectrum of the base colour (sRGB-coded, all texels) is taken every few steps and averaged in five rings of equal width
up to half a cycle per texel. In the folder: frequency.json, frequency.csv, frequency.png, and every curve by itself, so
that the same command goes on where it was broken off. The U-Net runs at the size of the texture unless
--texture.upsample says otherwise: what it cannot reach is no finding."""

COHERENCE = """How far do the gradients of nearly the same views agree? (supp. A.2)

Example:  paintit analyze coherence spot.obj "red brick" --t 0.2 0.5 0.8 --scale 1 7.5 101 -o gradients

A few cameras within two degrees of the front, the same words, noise and t: each view's score-distillation gradient on
the base colour map is a row of a matrix, whose singular values are given over the smallest. All alike: rank one. All
unrelated: ratios near 1. Controls: the noise alone, the same value in every pixel, random numbers, one gradient
repeated. In the folder: coherence.json and coherence.png."""

_IMAGES = (".png", ".jpg", ".jpeg", ".webp")


@dataclass(frozen=True)
class FrequencyArguments:
    """Flags of ``paintit analyze frequency``."""

    subject: Annotated[tyro.conf.Positional[str | None], tyro.conf.arg(metavar="IMAGE|MESH", help_behavior_hint="")] = (
        None
    )
    """Image to fit, or mesh to paint."""
    prompt: Annotated[tyro.conf.Positional[str | None], tyro.conf.arg(metavar="PROMPT", help_behavior_hint="")] = None
    """What the mesh should look like, in quotes."""
    output: Annotated[str | None, tyro.conf.arg(aliases=["-o"], metavar="FOLDER", help_behavior_hint="")] = None
    """Where everything goes."""
    variants: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME...")] = ("dcpbr", "pixels", "dcpbr-no-skip")
    """Parameterisations to compare."""
    seeds: int = 3
    """Curves of each variant, from --seed on."""
    every: Annotated[int, tyro.conf.arg(metavar="STEPS")] = 10
    """Steps between records; the first so many are recorded one by one."""
    show: Annotated[tuple[int, ...], tyro.conf.arg(metavar="STEP...", help_behavior_hint="")] = ()
    """Steps whose textures are drawn; by default 2 %, 10 %, 30 % and all of them."""
    outside: Literal["filled", "raw"] = "filled"
    """Texels between the islands: filled from the nearest inside, as in renders and files, or as the field left it."""
    overwrite: tyro.conf.FlagCreatePairsOff[bool] = False
    """Replace the curves that the folder holds."""
    preset: Literal["pocket", "paper"] = "pocket"
    """Named settings, see 'paintit paint --help'."""
    config: Annotated[str | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="")] = None
    """TOML file of settings."""
    settings: Annotated[PaintConfig, tyro.conf.arg(name="")] = field(default_factory=lambda: POCKET)
    """Every setting."""


@dataclass(frozen=True)
class CoherenceArguments:
    """Flags of ``paintit analyze coherence``."""

    mesh: Annotated[tyro.conf.Positional[str | None], tyro.conf.arg(metavar="MESH", help_behavior_hint="")] = None
    """OBJ, PLY, STL, OFF, GLB or glTF."""
    prompt: Annotated[tyro.conf.Positional[str | None], tyro.conf.arg(metavar="PROMPT", help_behavior_hint="")] = None
    """What it should look like, in quotes."""
    output: Annotated[str | None, tyro.conf.arg(aliases=["-o"], metavar="FOLDER", help_behavior_hint="")] = None
    """Where coherence.json and coherence.png go."""
    t: Annotated[tuple[float, ...], tyro.conf.arg(metavar="T...")] = (0.2, 0.5, 0.8)
    """Noise levels, fractions of the prior's schedule."""
    scale: Annotated[tuple[float, ...], tyro.conf.arg(metavar="S...")] = (1.0, 7.5, 101.0)
    """Guidance scales; 101 is what the official script calls 100."""
    reads: tuple[Literal["stack", "rgb"], ...] = ("stack", "rgb")
    """What the gradient passes through: every channel that the prior reads, or the shaded picture alone."""
    after: Annotated[tuple[int, ...], tyro.conf.arg(metavar="STEP...")] = (0,)
    """Steps painted before the gradients are taken; 0 is the random start."""
    within: Annotated[float, tyro.conf.arg(metavar="DEGREES")] = 2.0
    """Views lie this near to the front, up or down and to either side."""
    seeds: int = 3
    """Starts, views and noises, from --seed on."""
    preset: Literal["pocket", "paper"] = "pocket"
    """Named settings, see 'paintit paint --help'."""
    config: Annotated[str | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="")] = None
    """TOML file of settings."""
    settings: Annotated[PaintConfig, tyro.conf.arg(name="")] = field(default_factory=lambda: POCKET)
    """Every setting; --views is 5."""


def main(arguments: Sequence[str], console: Console) -> Result:
    action = next((a for a in arguments if not a.startswith("-")), None)
    rest = list(arguments)
    if action in _ACTIONS:
        rest.remove(action)
        return _ACTIONS[action](rest, console)
    parse(AnalyzeArguments, arguments, "paintit analyze", ABOUT)
    raise UsageError("usage.no_action", "no analysis is named", f"choose one of {', '.join(_ACTIONS)}")


@dataclass(frozen=True)
class AnalyzeArguments:
    """Arguments of ``paintit analyze``."""

    action: Annotated[tyro.conf.Positional[Literal["frequency", "coherence"] | None],
                      tyro.conf.arg(metavar="frequency|coherence", help_behavior_hint="")] = None  # fmt: skip
    """Which analysis."""


def _frequency(arguments: Sequence[str], console: Console) -> Result:
    base = _full_size(arguments)
    given = parse(
        FrequencyArguments, arguments, "paintit analyze frequency", FREQUENCY, FrequencyArguments(settings=base)
    )
    validate(given.settings)
    if given.subject is None:
        raise UsageError("usage.no_subject", "nothing to analyze is given", "name an image, or a mesh and a prompt")
    folder = _folder(given.output)
    subject = Path(given.subject)
    image = subject.suffix.lower() in _IMAGES
    if image and given.prompt is not None:
        raise UsageError("usage.extra_argument", f"unexpected argument '{given.prompt}'",
                         "an image is fitted without a prompt")  # fmt: skip
    if not image and not (given.prompt or "").strip():
        raise UsageError("prompt.empty", "the prompt is empty", 'say what the mesh should look like: "red plastic"')
    total = given.settings.optim.steps
    check_range("--seeds", given.seeds, 1, 1000)
    check_range("--every", given.every, 1, 10_000_000)
    for step in given.show:
        check_range("--show", step, 0, total)
    if not given.variants:
        raise UsageError("usage.no_value", "--variants has no value", "name one, such as dcpbr")
    from paintit.analyze.frequency_run import Request, run
    from paintit.run.record import versions

    seeds = tuple(range(given.settings.seed, given.settings.seed + given.seeds))
    request = Request(
        subject, None if image else given.prompt, folder, given.settings, tuple(dict.fromkeys(given.variants)), seeds,
        given.every, tuple(sorted(set(given.show))), given.outside, given.overwrite,
    )  # fmt: skip
    document = run(request, console.note, versions())
    console.note(f"figure: {folder / 'frequency.png'}")
    return Result(_frequency_table(document), {"folder": str(folder), **document})


def _full_size(arguments: Sequence[str]) -> PaintConfig:
    """The settings that the flags go over; without a file of one's own the network runs at the size of the texture."""
    base = defaults(arguments)
    if peek(arguments, "--config") is not None:
        return base
    return dataclasses.replace(base, texture=dataclasses.replace(base.texture, upsample=1))


def _folder(output: str | None) -> Path:
    from paintit.run.folder import check_writable

    if output is None:
        raise UsageError("usage.no_output", "no output is given", "add -o FOLDER")
    check_writable(Path(output))
    return Path(output)


def _frequency_table(document: dict[str, Any]) -> str:
    """Half-way steps and last energies: a line for each variant, a column for each ring."""
    edges = document["rings"]["edges"]
    rings = [f"{a:g}-{b:g}" for a, b in itertools.pairwise(edges)]
    seeds = len(document["seeds"])
    parts = [
        ("step from which on a ring has half of its last power", "half_power_step", "{:.1f}"),
        ("step from which on at most half of the target's power is wrong", "half_fitted_step", "{:.1f}"),
        ("mean magnitude at the last step", "final_magnitude", "{:.4f}"),
        ("power still wrong at the last step, over the target's", "final_residual", "{:.3f}"),
    ]
    lines = [f"{'cycles per texel':<20}" + "".join(f"{ring:>26}" for ring in rings)]
    for title, key, form in parts:
        rows = {name: found[key] for name, found in document["summary"].items() if key in found}
        if rows:
            lines += ["", f"{title}; mean of {seeds} seeds, lowest to highest"]
        for name, row in rows.items():
            lines.append(f"  {name:<18}" + "".join(f"{_spread(entry, form):>26}" for entry in row))
    return "\n".join(lines)


def _spread(entry: dict[str, float | None], form: str) -> str:
    if entry["mean"] is None:
        return "never"
    never = f" never in {entry['missing']}" if entry["missing"] else ""
    return f"{form} ({form}-{form})".format(entry["mean"], entry["low"], entry["high"]) + never


def _coherence(arguments: Sequence[str], console: Console) -> Result:
    base = _full_size(arguments)
    base = dataclasses.replace(base, views=dataclasses.replace(base.views, count=5))
    given = parse(
        CoherenceArguments, arguments, "paintit analyze coherence", COHERENCE, CoherenceArguments(settings=base)
    )
    validate(given.settings)
    if given.mesh is None:
        raise UsageError(
            "usage.no_mesh", "no mesh is given", 'write: paintit analyze coherence MESH "PROMPT" -o FOLDER'
        )
    if not (given.prompt or "").strip():
        raise UsageError("prompt.empty", "the prompt is empty", 'say what the mesh should look like: "red plastic"')
    folder = _folder(given.output)
    check_range("--views", given.settings.views.count, 2, 256)
    check_range("--seeds", given.seeds, 1, 1000)
    check_range("--within", given.within, 0, 45)
    for name, values, low, high in (
        ("--t", given.t, 0.001, 1), ("--scale", given.scale, -1e6, 1e6), ("--after", given.after, 0, 10_000_000)
    ):  # fmt: skip
        if not values:
            raise UsageError("usage.no_value", f"{name} has no value", f"{name} takes one or more numbers")
        for value in values:
            check_range(name, value, low, high)
    check_range("--after", max(given.after), 0, given.settings.optim.steps)
    from paintit.analyze.coherence_run import Request, run
    from paintit.run.record import versions

    first = given.settings.seed
    request = Request(
        Path(given.mesh), given.prompt or "", folder, given.settings, given.settings.views.count, given.within,
        tuple(dict.fromkeys(given.t)), tuple(dict.fromkeys(given.scale)), tuple(dict.fromkeys(given.reads)),
        tuple(sorted(set(given.after))), tuple(range(first, first + given.seeds)),
    )  # fmt: skip
    document = run(request, console.note, versions())
    console.note(f"figure: {folder / 'coherence.png'}")
    return Result(_coherence_table(document), {"folder": str(folder), **document})


def _coherence_table(document: dict[str, Any]) -> str:
    """A line for each kind of gradient: its ratios, spread over seeds, and the mean cosine of two of its rows."""
    paper, views = document["paper_ratios"], document["views"]
    lines = [f"{'gradient':<10}{'steps':>6}{'reads':>7}{'t':>6}{'scale':>7}  {'rank':>4}{'eff.':>6}{'cosine':>8}  "
             "singular values over the smallest (first: lowest to highest of the seeds)"]  # fmt: skip
    for entry in document["summary"]:
        t, scale = ("-" if value is None else f"{value:g}" for value in (entry["t"], entry["scale"]))
        ratios = " ".join(f"{ratio:.4g}" for ratio in entry["ratios"]) or "-"
        spread = f" ({entry['low'][0]:.4g} to {entry['high'][0]:.4g})" if entry["ratios"] else ""
        lines.append(
            f"{entry['kind']:<10}{entry['after']:>6}{entry['reads']:>7}{t:>6}{scale:>7}  {entry['rank']:>4}"
            f"{entry['effective_rank']:>6.2f}{entry['cosine']:>8.3f}  {ratios}{spread}"
        )
    if views == len(paper):
        lines.append(f"{'paper':<10}{'':>6}{'rgb':>7}{'?':>6}{'?':>7}  {views:>4}{'':>6}{'':>8}  "
                     + " ".join(f"{ratio:.4g}" for ratio in paper))  # fmt: skip
    return "\n".join(lines)


_ACTIONS = {"frequency": _frequency, "coherence": _coherence}
