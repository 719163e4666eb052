"""``paintit priors list|show``: the diffusion models that can guide a paint."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from paintit.cli.console import Console, Result, table
from paintit.cli.parse import parse
from paintit.errors import UsageError

if TYPE_CHECKING:
    from paintit.guidance.load import PriorInfo

ABOUT = """List the diffusion priors that have a short name, or show one.

Examples:  paintit priors list
           paintit priors show sd15

Any folder that diffusers saved and any hub id OWNER/NAME also work as --prior. Nothing is downloaded unasked."""


@dataclass(frozen=True)
class PriorsArguments:
    """Arguments of ``paintit priors``."""

    action: Annotated[tyro.conf.Positional[Literal["list", "show"]], tyro.conf.arg(metavar="list|show")] = "list"
    """What to do."""
    name: Annotated[tyro.conf.Positional[str | None], tyro.conf.arg(metavar="NAME", help_behavior_hint="")] = None
    """Short name, for show."""


def main(arguments: Sequence[str], console: Console) -> Result:
    given = parse(PriorsArguments, arguments, "paintit priors", ABOUT)
    from paintit.guidance.load import KNOWN, prior_info

    if given.action == "list":
        if given.name is not None:
            raise UsageError("usage.extra_argument", f"unexpected argument '{given.name}'", "write: priors show NAME")
        text = table([(name, f"{info.note}; {info.licence}; {_download(info)}") for name, info in KNOWN.items()])
        return Result(text, {"priors": [_entry(info) for info in KNOWN.values()]})
    if given.name is None:
        raise UsageError("usage.no_name", "no prior is named", f"known: {', '.join(KNOWN)}")
    entry = _entry(prior_info(given.name))
    rows = [(key, str(value)) for key, value in entry.items() if key != "size_mb"]
    return Result(table([*rows, ("download", _download(prior_info(given.name)))]), entry)


def _download(info: PriorInfo) -> str:
    return f"{info.size_mb / 1000:.1f} GB to download" if info.size_mb else "nothing to download"


def _entry(info: PriorInfo) -> dict[str, Any]:
    return dataclasses.asdict(info)
