"""``paintit priors list|show|pull``: the diffusion models that can guide a paint."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from paintit.cli.console import Console, Result, table
from paintit.cli.parse import parse
from paintit.errors import PriorError, UsageError

if TYPE_CHECKING:
    from paintit.guidance.hub import Download
    from paintit.guidance.known import PriorInfo

ABOUT = """List the diffusion priors that have a short name, show one, or download one.

Examples:  paintit priors list
           paintit priors show sd15
           paintit priors pull sd15 --dry-run

pull also takes any hub id OWNER/NAME; --prior takes those, and any folder that diffusers saved. HF_HOME, HF_TOKEN,
HF_ENDPOINT and HF_HUB_OFFLINE are respected. Nothing is downloaded unasked."""


@dataclass(frozen=True)
class PriorsArguments:
    """Arguments of ``paintit priors``."""

    action: Annotated[
        tyro.conf.Positional[Literal["list", "show", "pull"]], tyro.conf.arg(metavar="list|show|pull")
    ] = "list"
    """What to do."""
    name: Annotated[tyro.conf.Positional[str | None], tyro.conf.arg(metavar="NAME", help_behavior_hint="")] = None
    """Short name, for show and pull; or a hub id, for pull."""
    revision: Annotated[str, tyro.conf.arg(metavar="COMMIT", help_behavior_hint="")] = ""
    """For pull: a commit, tag or branch."""
    dry_run: tyro.conf.FlagCreatePairsOff[bool] = False
    """For pull: say which files would be downloaded, and how many megabytes; download nothing."""


def main(arguments: Sequence[str], console: Console) -> Result:
    given = parse(PriorsArguments, arguments, "paintit priors", ABOUT)
    if given.action != "pull" and (given.dry_run or given.revision):
        flag = "--dry-run" if given.dry_run else "--revision"
        raise UsageError("usage.extra_argument", f"{flag} is for pull", "write: priors pull NAME")
    if given.action == "list":
        if given.name is not None:
            raise UsageError("usage.extra_argument", f"unexpected argument '{given.name}'", "write: priors show NAME")
        return _list()
    if given.name is None:
        from paintit.guidance.known import known_priors

        raise UsageError("usage.no_name", "no prior is named", f"known: {', '.join(known_priors())}")
    return _show(given.name) if given.action == "show" else _pull(given.name, given.revision, given.dry_run, console)


def _list() -> Result:
    from paintit.guidance.known import known_priors

    entries = [_entry(info) for info in known_priors().values()]
    lines = [(e["name"], f"{e['note']}; {e['licence']}; {_where(e)}") for e in entries]
    return Result(table(lines), {"priors": entries})


def _show(name: str) -> Result:
    from paintit.guidance.known import prior_info

    info = prior_info(name)
    entry = _entry(info)
    rows = [
        ("name", name),
        ("about", info.note),
        ("licence", info.licence + ("; accept it on the page of the source first" if info.gated else "")),
        ("family", info.family),
        ("sources", "\n".join(info.sources) or "ships with paintit"),
        ("revision", info.revision or ("the newest; none is pinned" if info.sources else "that of the package")),
        ("resolution", f"{info.resolution} x {info.resolution} pixels"),
        ("guidance", f"{info.guidance:g} by default"),
        (
            "memory",
            f"about {_gigabytes(info.memory_mb)} for its weights in 16 bits" if info.memory_mb else "negligible",
        ),
        ("download", _where(entry)),
    ]
    if info.control:
        rows.append(("control", "\n".join(f"{kind}: {net}" for kind, net in info.control.items())))
    if info.withdrawn:
        rows.insert(5, ("withdrawn", "\n".join(info.withdrawn)))
    return Result(table(rows), entry)


def _pull(name: str, revision: str, dry_run: bool, console: Console) -> Result:
    from paintit.guidance import remote
    from paintit.guidance.known import known_prior
    from paintit.guidance.load import plan_download

    known = known_prior(name)
    if console.settings.offline:
        if not (dry_run and known):
            raise UsageError("usage.conflict", "pull downloads, and --offline forbids it", "leave out --offline")
        return _estimate(known)
    if not console.interactive:
        remote.hide_bars()
    try:
        plan = plan_download(name, revision)
    except PriorError as error:
        if not (dry_run and known and error.code in ("prior.offline", "prior.download")):
            raise
        console.warn(f"{error.message}; these figures are those of the table")
        return _estimate(known)
    console.note(f"licence: {plan.licence}")
    data = _data(plan)
    if dry_run:
        rows = [(path, _size(plan.missing[path]) if path in plan.missing else "here") for path in plan.sizes]
        return Result(table([*rows, ("download", plan.summary)]), data)
    console.note(f"downloading {plan.summary}")
    folder = remote.fetch(plan.source, plan.asked, tuple(plan.sizes))
    return Result(str(folder), data | {"folder": str(folder)})


def _estimate(known: PriorInfo) -> Result:
    """What a download would take, without asking the hub."""
    data = {"source": known.sources[0] if known.sources else "", "licence": known.licence, "megabytes": known.size_mb}
    text = f"about {known.size_mb} MB of {known.sources[0]}" if known.sources else "nothing to download"
    return Result(text, data | {"revision": known.revision, "files": {}, "exact": False})


def _data(plan: Download) -> dict[str, Any]:
    return {
        "source": plan.source,
        "revision": plan.revision,
        "licence": plan.licence,
        "files": dict(plan.missing),
        "megabytes": plan.megabytes,
        "exact": True,
    }


def _size(count: int) -> str:
    return f"{count / 1e6:.1f} MB" if count >= 1e5 else f"{count / 1e3:.1f} kB"


def _entry(info: PriorInfo) -> dict[str, Any]:
    from paintit.guidance.load import on_this_machine

    return dataclasses.asdict(info) | {"here": on_this_machine(info)}


def _where(entry: dict[str, Any]) -> str:
    if not entry["sources"]:
        return "nothing to download"
    if entry["here"]:
        return "on this machine"
    return f"about {_gigabytes(entry['size_mb'])} to download"


def _gigabytes(megabytes: int) -> str:
    return f"{megabytes / 1000:.1f} GB"
