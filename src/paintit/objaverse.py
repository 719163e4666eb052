"""Meshes of Objaverse by their ids, as the paper's comparison on the subset of Text2Tex wants (section 5.2).

The ``objaverse`` package fetches; here files are checked, put in place one by one, and their licences written down.
"""

from __future__ import annotations

import dataclasses
import gzip
import hashlib
import http.client
import json
import re
import shutil
import warnings
import zlib
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from paintit.errors import DownloadError, UsageError
from paintit.files import atomic, make_folder
from paintit.settings import nearest

#: One JSON object a line, one line a mesh.
MANIFEST = "manifest.jsonl"
#: Creative Commons licences as Objaverse names them.
LICENCES = ("cc0", "by", "by-sa", "by-nd", "by-nc", "by-nc-sa", "by-nc-nd")
_UID = re.compile(r"[0-9a-f]{32}")


@dataclass(frozen=True)
class Entry:
    """One mesh in the manifest: what it is, whose, under which licence, and the bytes that arrived."""

    uid: str
    file: str
    name: str
    author: str
    author_url: str
    licence: str
    url: str
    bytes: int
    sha256: str


@dataclass(frozen=True)
class Fetched:
    """Entries in the order asked for, and uids that are not among them.

    Attributes:
        entries: all that lie in the folder now; ``new`` of them arrived this time.
        unknown: uids that Objaverse does not have.
        refused: uid -> licence, which was not among those asked for.
    """

    entries: tuple[Entry, ...]
    new: int
    unknown: tuple[str, ...]
    refused: dict[str, str]


def read_ids(path: Path) -> tuple[str, ...]:
    """The uids in a text file, one a line, each once; ``#`` begins a comment.

    Raises:
        DownloadError: it cannot be read, holds none, or a line is no uid.
    """
    try:
        lines = path.read_text("utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror or str(error) if isinstance(error, OSError) else "it is not text"
        raise DownloadError("objaverse.ids", f"cannot read {path}: {reason.lower()}", "give a text file") from None
    words = [(number, line.partition("#")[0].strip()) for number, line in enumerate(lines, 1)]
    words = [(number, word.removesuffix(".glb")) for number, word in words if word]
    if wrong := [f"line {number}: '{word}'" for number, word in words if not _UID.fullmatch(word)]:
        more = f" and {len(wrong) - 3} more" if len(wrong) > 3 else ""
        hint = "an id is 32 digits and letters a to f, one a line"
        raise DownloadError("objaverse.ids", f"{path} holds what is no id ({'; '.join(wrong[:3])}{more})", hint)
    if not words:
        raise DownloadError("objaverse.ids", f"{path} holds no id", "write one a line")
    return tuple(dict.fromkeys(word for _, word in words))


def check_licences(text: str) -> frozenset[str]:
    """``by,cc0`` as a set.

    Raises:
        UsageError: a licence is unknown; the nearest is named.
    """
    names = [name.strip().lower().removeprefix("cc-") for name in text.split(",") if name.strip()]
    for name in names:
        if name not in LICENCES:
            near = nearest(name, LICENCES)
            hint = f"did you mean '{near}'?" if near else f"choose of {', '.join(LICENCES)}"
            raise UsageError("objaverse.licence", f"the licence '{name}' is not known", hint)
    return frozenset(names)


def fetch(
    uids: Sequence[str],
    folder: Path,
    licences: Collection[str] = (),
    on_arrival: Callable[[Entry, int], None] | None = None,
) -> Fetched:
    """Fetch what is not in ``folder`` yet. The manifest grows with each mesh, so that nothing is fetched twice.

    Args:
        licences: only these; empty takes all.
        on_arrival: called with each entry that arrives and how many are still to come.

    Raises:
        DownloadError: the package is absent, the network is, or a file is damaged. What arrived before stays.
        OutputError: the folder cannot be written.
    """
    manifest = make_folder(folder) / MANIFEST
    held = {uid: entry for uid, entry in read_manifest(manifest).items() if uid not in uids or _intact(folder, entry)}
    missing = [uid for uid in uids if uid not in held]
    notes, unknown = _annotations(missing) if missing else ({}, ())
    refused = {uid: _licence(note) for uid, note in notes.items() if licences and _licence(note) not in licences}
    refused |= {
        uid: held[uid].licence for uid in uids if uid in held and licences and held[uid].licence not in licences
    }
    wanted = [uid for uid in missing if uid in notes and uid not in refused]
    for number, uid in enumerate(wanted, 1):
        held[uid] = _arrive(uid, notes[uid], folder)
        _write_manifest(manifest, held)
        if on_arrival:
            on_arrival(held[uid], len(wanted) - number)
    return Fetched(tuple(held[u] for u in uids if u in held and u not in refused), len(wanted), unknown, refused)


def read_manifest(path: Path) -> dict[str, Entry]:
    """uid -> entry; empty where there is no manifest.

    Raises:
        DownloadError: it is not one.
    """
    try:
        lines = path.read_text("utf-8").splitlines() if path.exists() else []
        entries = [Entry(**json.loads(line)) for line in lines]
    except (ValueError, TypeError) as error:
        hint = "move it away; meshes that are known to be whole are not fetched again"
        raise DownloadError("objaverse.manifest", f"{path} is no manifest: {error}", hint) from None
    return {entry.uid: entry for entry in entries}


def _write_manifest(path: Path, entries: dict[str, Entry]) -> None:
    with atomic(path) as temporary:
        lines = (json.dumps(dataclasses.asdict(entry), ensure_ascii=False) for entry in entries.values())
        temporary.write_text("".join(f"{line}\n" for line in lines), "utf-8")


def _annotations(uids: Sequence[str]) -> tuple[dict[str, dict[str, Any]], tuple[str, ...]]:
    """What Objaverse says of ``uids``, and those it does not know."""
    objaverse = _package()

    def ask() -> dict[str, dict[str, Any]]:
        known = set(objaverse.load_uids())
        return objaverse.load_annotations([uid for uid in uids if uid in known])

    with _network():
        try:
            notes = ask()
        except (EOFError, zlib.error, gzip.BadGzipFile, json.JSONDecodeError):
            _drop_damaged(Path(objaverse.BASE_PATH))
            notes = ask()
    return notes, tuple(uid for uid in uids if uid not in notes)


def _arrive(uid: str, note: dict[str, Any], folder: Path) -> Entry:
    """Fetch one mesh and put it into ``folder``, whole."""
    with _network():
        source = Path(_package().load_objects([uid])[uid])
    target = folder / f"{uid}.glb"
    with open(source, "rb") as file:
        head = file.read(12)
    if head[:4] != b"glTF" or int.from_bytes(head[8:12], "little") != source.stat().st_size:
        source.unlink()  # the package would take it for the mesh for ever
        raise DownloadError("objaverse.damaged", f"what arrived for {uid} is no whole GLB", "run the command again")
    with atomic(target) as temporary:
        shutil.copyfile(source, temporary)
    user = note.get("user") or {}
    return Entry(
        uid, target.name, str(note.get("name") or ""), str(user.get("displayName") or user.get("username") or ""),
        str(user.get("profileUrl") or ""), _licence(note), str(note.get("viewerUrl") or note.get("uri") or ""),
        target.stat().st_size, _sha256(target),
    )  # fmt: skip


def _licence(note: dict[str, Any]) -> str:
    return str(note.get("license") or "unknown")


def _intact(folder: Path, entry: Entry) -> bool:
    path = folder / entry.file
    return path.is_file() and path.stat().st_size == entry.bytes and _sha256(path) == entry.sha256


def _sha256(path: Path) -> str:
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _package() -> Any:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            import objaverse
    except ImportError:
        hint = "install it: pip install 'paintit[objaverse]'"
        raise DownloadError("objaverse.absent", "the package objaverse is not installed", hint) from None
    return objaverse


@contextmanager
def _network() -> Iterator[None]:
    """Every way in which a download ends early, as one line."""
    try:
        yield
    except (OSError, EOFError, ValueError, http.client.HTTPException) as error:
        reason = getattr(error, "reason", None) or error
        hint = "connect to a network and run the command again: what has arrived is not fetched twice"
        raise DownloadError("objaverse.network", f"cannot fetch from Objaverse: {reason}", hint) from None


def _drop_damaged(cache: Path) -> None:
    """Remove index files of which an interrupted download left a part; the package would read them for ever."""
    for path in cache.rglob("*.json.gz"):
        try:
            with gzip.open(path) as file:
                json.load(file)
        except (OSError, EOFError, zlib.error, ValueError):
            path.unlink()
