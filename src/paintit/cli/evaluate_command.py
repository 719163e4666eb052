"""``paintit evaluate``: scores of painted assets, as a table, as JSON, and as one page."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from paintit.cli.console import Console, Result
from paintit.cli.parse import check_range, gather, parse
from paintit.config import LimitConfig, PaintConfig
from paintit.errors import OutputError, UsageError
from paintit.settings import validate

if TYPE_CHECKING:
    from paintit.evaluate.features import Network
    from paintit.evaluate.measure import Evaluation, Painted, Reference
    from paintit.evaluate.protocol import Protocol

ABOUT = """Measure painted assets: how they look beside a reference, and what can be said without one.

A folder of assets is one set; assets named singly are one set together. Scores end in the name of the network that read
the pictures, and only scores of one network and one protocol can be compared. docs/evaluate.md says what each means.

Examples:  paintit evaluate chair.glb
           paintit evaluate ours/ theirs/ --reference photos/ -o report
           paintit evaluate painted/ --reference originals/ --truth originals/ -o report"""

_PATHS = tyro.conf.arg(metavar="PATH", help_behavior_hint="")


@dataclass(frozen=True)
class EvaluateArguments:
    """Arguments of ``paintit evaluate``."""

    paths: Annotated[tyro.conf.Positional[tuple[str, ...]], _PATHS] = ()
    """Run folders, painted GLB or glTF files, or folders of them."""
    reference: Annotated[tuple[str, ...], _PATHS] = ()
    """Painted assets, or a folder of pictures alone: what good results look like. May be repeated."""
    truth: Annotated[tuple[str, ...], _PATHS] = ()
    """Assets of the same names, or one for all, that show the right material. May be repeated."""
    features: str = "pocket"
    """Network that reads the pictures: pocket, inception, clip or clip-large."""
    weights: str = ""
    """File (inception) or folder (clip) of its weights, where they are not in the usual cache."""
    allow_download: tyro.conf.FlagCreatePairsOff[bool] = False
    """Fetch the network's weights if they are not here."""
    output: Annotated[str | None, tyro.conf.arg(aliases=["-o"], metavar="FOLDER", help_behavior_hint="")] = None
    """Folder for evaluate.json and evaluate.html."""
    size: int = 0
    """Pixels along each side of a view; 0 is 512, and what the network reads for pocket."""
    light: str = "default"
    """The light in the package, or an .hdr or .exr file."""
    relight: str = "sunset"
    """The second light, that nothing was painted under: 'sunset', or an .hdr or .exr file."""
    overwrite: tyro.conf.FlagCreatePairsOff[bool] = False
    """Replace what is there."""
    limits: LimitConfig = field(default_factory=LimitConfig)
    """What a file may ask for."""


def main(arguments: Sequence[str], console: Console) -> Result:
    arguments = gather(gather(arguments, "--reference"), "--truth")
    given = parse(EvaluateArguments, arguments, "paintit evaluate", ABOUT)
    validate(PaintConfig(limits=given.limits))
    if not given.paths:
        raise UsageError("usage.no_path", "no asset is given", "write: paintit evaluate PATH --reference FOLDER")
    check_range("--size", given.size, 0, 8192)
    files = _outputs(given)
    from paintit.evaluate.features import load_network
    from paintit.evaluate.measure import evaluate
    from paintit.evaluate.protocol import Protocol, light_of

    network = load_network(given.features, given.weights, allow_download=given.allow_download)
    size = given.size or (network.side if network.name == "pocket" else Protocol.size)
    protocol = Protocol(size=size, light=given.light, relight=given.relight)
    for light in (given.light, given.relight):
        light_of(light, protocol.exposure)
    sets = _sets(given)
    truths = _truths(given, [painted for members in sets.values() for painted in members], console)
    reference = _reference(given, protocol, network, console)
    result = evaluate(
        sets, protocol, network, reference, truths, lambda painted: console.note(f"measuring {painted.name}")
    )
    for note in result.notes:
        console.warn(note)
    data = dataclasses.asdict(result)
    if files:
        _write(files, result, sets, data)
    return Result(_table(result), data | {"files": [str(file) for file in files]})


def _outputs(given: EvaluateArguments) -> tuple[Path, ...]:
    """The JSON document and the page that shall be written; none without ``-o``.

    Raises:
        OutputError: one is there already.
    """
    if given.output is None:
        return ()
    from paintit.run.folder import check_writable

    folder = Path(given.output)
    files = folder / "evaluate.json", folder / "evaluate.html"
    for file in files:
        if file.exists() and not given.overwrite:
            raise OutputError("output.exists", f"{file} exists", "add --overwrite or choose another -o")
    check_writable(folder)
    return files


def _sets(given: EvaluateArguments) -> dict[str, list[Painted]]:
    """Each folder of assets by its name, and those named singly as ``assets``."""
    sets: dict[str, list[Painted]] = {}
    for path in map(Path, given.paths):
        found = assets_in(path)
        name = "assets" if found == [path] else path.resolve().name
        sets.setdefault(name, []).extend(_load(each, path, given.limits) for each in found)
    return sets


def assets_in(path: Path) -> list[Path]:
    """``path`` itself where it is a file or a run; else every run and every GLB or glTF under the folder.

    Raises:
        UsageError: there is none.
    """
    found = _found(path)
    if not found:
        raise UsageError("evaluate.none", f"there is no painted asset at {path}", "name runs, .glb or .gltf files")
    return found


def _found(path: Path) -> list[Path]:
    if path.is_file() or (path / "run.json").is_file():
        return [path]
    runs = [file.parent for file in path.rglob("run.json")]
    files = [file for file in path.rglob("*") if file.suffix.lower() in (".glb", ".gltf")]
    files = [file for file in files if not any(run in file.parents for run in runs)]
    beside = {file.with_suffix(".paintit") for file in files}
    return sorted([*files, *(run for run in runs if run not in beside)])


def _load(path: Path, folder: Path, limits: LimitConfig) -> Painted:
    """The asset at ``path``; its name is its path in ``folder`` without an ending."""
    from paintit.errors import RunError
    from paintit.evaluate.measure import Painted
    from paintit.run import record
    from paintit.run.asset import load_asset
    from paintit.run.folder import find

    asset = load_asset(path, limits)
    try:
        prompt = record.read(find(path) / "run.json").prompt
    except RunError:
        prompt = ""
    name = path.resolve().stem if path == folder else path.relative_to(folder).with_suffix("").as_posix()
    return Painted(name, asset.mesh, asset.maps, prompt)


def _truths(given: EvaluateArguments, assets: Sequence[Painted], console: Console) -> dict[str, Painted]:
    """The truth of each asset: that of its name, or the only one."""
    found = [_load(each, path, given.limits) for path in map(Path, given.truth) for each in assets_in(path)]
    if len(found) == 1:
        return {asset.name: found[0] for asset in assets}
    named = {truth.name: truth for truth in found}
    for name in dict.fromkeys(asset.name for asset in assets if named and asset.name not in named):
        console.warn(f"--truth has no asset of the name '{name}'")
    return named


def _reference(given: EvaluateArguments, protocol: Protocol, network: Network, console: Console) -> Reference | None:
    from paintit.evaluate.measure import PICTURES, reference_of_assets, reference_of_pictures

    if not given.reference:
        return None
    first = Path(given.reference[0])
    name = ", ".join(given.reference)
    console.note(f"reading the reference {name}")
    pictured = first.is_dir() and any(file.suffix.lower() in PICTURES for file in first.iterdir())
    if pictured and not _found(first):  # assets bring their own previews and textures
        return reference_of_pictures(first, network)
    assets = [_load(each, path, given.limits) for path in map(Path, given.reference) for each in assets_in(path)]
    return reference_of_assets(name, assets, protocol, network)


def _write(files: Sequence[Path], result: Evaluation, sets: dict[str, list[Painted]], data: dict[str, Any]) -> None:
    from paintit.evaluate.page import page
    from paintit.files import write_files

    document, html = files
    write_files({
        document: json.dumps(data, indent=1, ensure_ascii=False).encode(),
        html: page(result, [painted for members in sets.values() for painted in members]).encode(),
    })  # fmt: skip


def _table(result: Evaluation) -> str:
    """A row for each set, and below one for each asset; numbers of four digits."""
    blocks = [[(s.name, {"assets": float(s.assets), **s.scores}) for s in result.sets]]
    blocks.append([(f"{a.set}/{a.name}", a.scores) for a in result.assets])
    return "\n\n".join(_rows(block) for block in blocks)


def _rows(block: Sequence[tuple[str, dict[str, float | None]]]) -> str:
    from paintit.evaluate.page import number

    names = list(dict.fromkeys(name for _, scores in block for name in scores))
    lines = [["", *names]] + [[title, *(number(scores.get(name)) for name in names)] for title, scores in block]
    widths = [max(len(line[k]) for line in lines) for k in range(len(names) + 1)]
    return "\n".join(
        "  ".join([line[0].ljust(widths[0]), *(cell.rjust(w) for cell, w in zip(line[1:], widths[1:], strict=True))])
        for line in lines
    )
