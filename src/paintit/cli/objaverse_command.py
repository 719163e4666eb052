"""``paintit objaverse``: a subset of Objaverse by its ids, with licences."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from paintit.cli.console import Console, Result, size_text
from paintit.cli.parse import parse
from paintit.errors import UsageError

ABOUT = """Download meshes of Objaverse by a list of ids, such as the subset that Text2Tex and the paper compare on.

Each mesh becomes FOLDER/<id>.glb; FOLDER/manifest.jsonl says its name, author, licence, page, size and SHA-256. Run
again, only what is missing or changed is fetched. It needs the extra: pip install 'paintit[objaverse]'

Example:   paintit objaverse ids.txt -o objaverse/ --licence by,cc0"""


@dataclass(frozen=True)
class ObjaverseArguments:
    """Arguments of ``paintit objaverse``."""

    ids: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="IDS")]
    """Text file of ids, one a line; # begins a comment."""
    output: Annotated[str | None, tyro.conf.arg(aliases=["-o"], metavar="FOLDER", help_behavior_hint="")] = None
    """Where the meshes go."""
    licence: Annotated[str, tyro.conf.arg(metavar="NAME[,NAME]", help_behavior_hint="")] = ""
    """Only these: cc0, by, by-sa, by-nd, by-nc, by-nc-sa, by-nc-nd. By default all."""


def main(arguments: Sequence[str], console: Console) -> Result:
    given = parse(ObjaverseArguments, arguments, "paintit objaverse", ABOUT)
    if not given.output:
        raise UsageError("usage.no_output", "no folder is given", "write: paintit objaverse IDS -o FOLDER")
    if console.settings.offline:
        raise UsageError("usage.conflict", "objaverse downloads, and --offline forbids it", "leave out --offline")
    from paintit.objaverse import MANIFEST, Entry, check_licences, fetch, read_ids

    def arrived(entry: Entry, left: int) -> None:
        who = f"'{entry.name}' by {entry.author}"
        console.note(f"{entry.file}: {who}, {entry.licence}, {size_text(entry.bytes)}; {left} to come")

    folder = Path(given.output)
    found = fetch(read_ids(Path(given.ids)), folder, check_licences(given.licence), arrived)
    if found.unknown:
        console.warn(f"Objaverse has no {', '.join(found.unknown)}")
    if found.refused:
        console.warn(f"left out by licence: {', '.join(f'{uid} ({name})' for uid, name in found.refused.items())}")
    data = {
        "manifest": str(folder / MANIFEST),
        "meshes": [dataclasses.asdict(entry) for entry in found.entries],
        "new": found.new,
        "unknown": found.unknown,
        "refused": found.refused,
    }
    return Result(str(folder / MANIFEST), data, exit_code=1 if found.unknown else 0)
