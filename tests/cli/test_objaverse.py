"""``paintit objaverse`` with the real package; only the host it asks is replaced, by a server on this machine."""

from __future__ import annotations

import gzip
import hashlib
import json
import os
import subprocess
import sys
import threading
import urllib.request
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest
from tests.cli.conftest import Ran

objaverse = pytest.importorskip("objaverse", reason="needs objaverse: pip install 'paintit[objaverse]'")

UIDS = tuple(hashlib.md5(bytes([i])).hexdigest() for i in range(4))
LICENCES = dict(zip(UIDS, ("by", "cc0", "by-nc", "by"), strict=True))
ABSENT = "f" * 32
ROOT = "/datasets/allenai/objaverse/resolve/main/"


def glb(text: bytes) -> bytes:
    return b"glTF" + (2).to_bytes(4, "little") + (12 + len(text)).to_bytes(4, "little") + text


@dataclass
class Host:
    """Path -> bytes, as the package asks for them; ``cut`` names a path of which half is sent."""

    files: dict[str, bytes]
    cut: str = ""
    asked: list[str] = field(default_factory=list)


class _Handler(BaseHTTPRequestHandler):
    def __init__(self, host: Host, *arguments: Any) -> None:
        self.host = host
        super().__init__(*arguments)

    def do_GET(self) -> None:
        path = self.path.removeprefix(ROOT)
        self.host.asked.append(path)
        body = self.host.files.get(path)
        self.send_response(404 if body is None else 200)
        self.send_header("Content-Length", str(len(body or b"")))
        self.end_headers()
        self.wfile.write((body or b"")[: len(body or b"") // 2 if path == self.host.cut else None])

    def log_message(self, format: str, *args: Any) -> None:
        """Silence."""


class _Here(urllib.request.HTTPSHandler):
    """Every https request goes to the server on this machine."""

    def __init__(self, port: int) -> None:
        super().__init__()
        self.port = port

    def https_open(self, req: urllib.request.Request) -> Any:
        return urllib.request.build_opener().open(f"http://127.0.0.1:{self.port}{req.selector}")


@pytest.fixture
def host(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Host]:
    cache = tmp_path / "cache"
    monkeypatch.setattr(objaverse, "BASE_PATH", str(cache))
    monkeypatch.setattr(objaverse, "_VERSIONED_PATH", str(cache / "hf-objaverse-v1"))
    paths = {uid: f"glbs/000-00{i % 2}/{uid}.glb" for i, uid in enumerate(UIDS)}
    notes = [
        {
            uid: {
                "name": f"mesh {uid[:2]}",
                "license": LICENCES[uid],
                "user": {"username": f"user-{uid[:2]}", "displayName": "", "profileUrl": "https://example.org/u"},
                "viewerUrl": f"https://example.org/{uid}",
            }
            for i, uid in enumerate(UIDS)
            if i % 2 == part
        }
        for part in (0, 1)
    ]
    files = {
        "object-paths.json.gz": gzip.compress(json.dumps(paths).encode()),
        **{f"metadata/000-00{part}.json.gz": gzip.compress(json.dumps(notes[part]).encode()) for part in (0, 1)},
        **{path: glb(uid.encode()) for uid, path in paths.items()},
    }
    host = Host(files)
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(_Handler, host))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    urllib.request.install_opener(urllib.request.build_opener(_Here(server.server_port)))
    yield host
    urllib.request.install_opener(None)  # type: ignore[arg-type]
    server.shutdown()
    server.server_close()


@pytest.fixture
def ids(tmp_path: Path) -> Path:
    path = tmp_path / "ids.txt"
    path.write_text("# the subset\n\n" + "\n".join((UIDS[0], f"{UIDS[1]}.glb  # a chair", UIDS[2], UIDS[0])) + "\n")
    return path


def manifest(folder: Path) -> dict[str, dict[str, Any]]:
    lines = (folder / "manifest.jsonl").read_text().splitlines()
    return {entry["uid"]: entry for entry in map(json.loads, lines)}


def meshes(host: Host) -> list[str]:
    return [path.rpartition("/")[2].removesuffix(".glb") for path in host.asked if path.endswith(".glb")]


def test_meshes_arrive_with_their_licences_and_only_once(
    host: Host,
    ids: Path,
    tmp_path: Path,
    paintit: Callable[..., Ran],
) -> None:
    out = tmp_path / "out"
    ran = paintit("objaverse", ids, "-o", out, "--json")
    assert ran.code == 0, ran.err
    assert json.loads(ran.out)["data"]["new"] == 3
    entries = manifest(out)
    assert list(entries) == list(UIDS[:3])
    for uid, entry in entries.items():
        data = (out / entry["file"]).read_bytes()
        assert data == glb(uid.encode())
        assert (entry["sha256"], entry["bytes"]) == (hashlib.sha256(data).hexdigest(), len(data))
        assert (entry["licence"], entry["author"]) == (LICENCES[uid], f"user-{uid[:2]}")
        assert (entry["name"], entry["url"]) == (f"mesh {uid[:2]}", f"https://example.org/{uid}")
    assert sorted(path.name for path in out.iterdir()) == sorted(
        [*(f"{uid}.glb" for uid in UIDS[:3]), "manifest.jsonl"]
    )

    host.asked.clear()
    assert json.loads(paintit("objaverse", ids, "-o", out, "--json").out)["data"]["new"] == 0
    assert host.asked == []
    (out / f"{UIDS[1]}.glb").write_bytes(b"changed")
    assert json.loads(paintit("objaverse", ids, "-o", out, "--json").out)["data"]["new"] == 1
    assert (out / f"{UIDS[1]}.glb").read_bytes() == glb(UIDS[1].encode())


def test_a_network_that_fails_in_the_middle_is_one_line_and_the_next_run_goes_on(
    host: Host,
    ids: Path,
    tmp_path: Path,
    paintit: Callable[..., Ran],
) -> None:
    out = tmp_path / "out"
    host.cut = f"glbs/000-001/{UIDS[1]}.glb"
    ran = paintit("-q", "objaverse", ids, "-o", out)
    assert (ran.code, ran.out) == (1, "")
    hint = "connect to a network and run the command again: what has arrived is not fetched twice"
    assert ran.errors[-1].startswith("error: cannot fetch from Objaverse: retrieval incomplete: got only 22 out of 44")
    assert ran.errors[-1].endswith(hint)
    assert list(manifest(out)) == [UIDS[0]]
    assert sorted(path.suffix for path in out.iterdir()) == [".glb", ".jsonl"]
    host.cut = ""
    host.asked.clear()
    assert paintit("objaverse", ids, "-o", out).code == 0
    assert meshes(host) == [UIDS[1], UIDS[2]]
    assert list(manifest(out)) == list(UIDS[:3])


@pytest.mark.parametrize("index", ["object-paths.json.gz", "metadata/000-001.json.gz"])
def test_half_an_index_is_fetched_again(
    index: str,
    host: Host,
    ids: Path,
    tmp_path: Path,
    paintit: Callable[..., Ran],
) -> None:
    host.cut = index
    assert paintit("objaverse", ids, "-o", tmp_path / "out").code == 1
    host.cut = ""
    assert paintit("objaverse", ids, "-o", tmp_path / "out").code == 0
    assert len(manifest(tmp_path / "out")) == 3


def test_what_is_no_glb_is_not_kept(
    host: Host,
    ids: Path,
    tmp_path: Path,
    paintit: Callable[..., Ran],
) -> None:
    path = f"glbs/000-000/{UIDS[0]}.glb"
    whole, host.files[path] = host.files[path], b"<html>please log in</html>"
    ran = paintit("-q", "objaverse", ids, "-o", tmp_path / "out")
    assert ran.errors[-1] == f"error: what arrived for {UIDS[0]} is no whole GLB; run the command again"
    assert list((tmp_path / "out").iterdir()) == []
    host.files[path] = whole
    assert paintit("objaverse", ids, "-o", tmp_path / "out").code == 0


def test_licences_are_asked_for_before_anything_is_fetched(
    host: Host,
    ids: Path,
    tmp_path: Path,
    paintit: Callable[..., Ran],
) -> None:
    ran = paintit("objaverse", ids, "-o", tmp_path / "out", "--licence", "cc0,CC-BY")
    assert ran.code == 0
    assert f"left out by licence: {UIDS[2]} (by-nc)" in ran.err
    assert meshes(host) == list(UIDS[:2])
    assert json.loads(paintit("objaverse", ids, "-o", tmp_path / "out", "--licence", "by", "--json").out)["data"][
        "refused"
    ] == {UIDS[1]: "cc0", UIDS[2]: "by-nc"}


def test_an_id_that_objaverse_does_not_have_is_named_and_the_rest_arrives(
    host: Host,
    ids: Path,
    tmp_path: Path,
    paintit: Callable[..., Ran],
) -> None:
    ids.write_text(f"{ABSENT}\n{UIDS[3]}\n")
    ran = paintit("objaverse", ids, "-o", tmp_path / "out")
    assert ran.code == 1
    assert f"warning: Objaverse has no {ABSENT}" in ran.err
    assert list(manifest(tmp_path / "out")) == [UIDS[3]]


LINES = {
    "bad ids": (
        "x\n#\nabc\n" + "f" * 31,
        "ids.txt holds what is no id (line 1: 'x'; line 3: 'abc'; line 4: 'fffffffffffffffffffffffffffffff'); "
        "an id is 32 digits and letters a to f, one a line",
    ),
    "none": ("# nothing\n", "ids.txt holds no id; write one a line"),
    "absent": (None, "cannot read ids.txt: no such file or directory; give a text file"),
}


@pytest.mark.parametrize("case", LINES)
def test_a_list_that_is_wrong_is_one_line(
    case: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    paintit: Callable[..., Ran],
) -> None:
    monkeypatch.chdir(tmp_path)
    text, line = LINES[case]
    if text is not None:
        Path("ids.txt").write_text(text)
    ran = paintit("objaverse", "ids.txt", "-o", "out")
    assert (ran.code, ran.out, ran.errors) == (1, "", [f"error: {line}"])
    assert not Path("out").exists()


def test_usage(ids: Path, tmp_path: Path, paintit: Callable[..., Ran]) -> None:
    wrong = paintit("objaverse", ids, "-o", tmp_path / "out", "--licence", "by-ncc")
    assert (wrong.code, wrong.errors) == (2, ["error: the licence 'by-ncc' is not known; did you mean 'by-nc'?"])
    assert paintit("objaverse", ids).errors == ["error: no folder is given; write: paintit objaverse IDS -o FOLDER"]
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "manifest.jsonl").write_text("{}\n")
    assert (
        paintit("objaverse", ids, "-o", tmp_path / "out")
        .errors[0]
        .startswith(f"error: {tmp_path / 'out' / 'manifest.jsonl'} is no manifest: ")
    )


def test_without_a_network_it_says_so(ids: Path, tmp_path: Path) -> None:
    """The whole real path, in a process of its own: nothing listens where requests are sent."""
    nowhere = {"https_proxy": "http://127.0.0.1:9", "HTTPS_PROXY": "http://127.0.0.1:9", "HOME": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-m", "paintit", "objaverse", ids, "-o", tmp_path / "out"],
        env={**os.environ, **nowhere, "no_proxy": "", "NO_PROXY": ""}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.splitlines() == [
        "error: cannot fetch from Objaverse: [Errno 111] Connection refused; connect to a network and run the command "
        "again: what has arrived is not fetched twice"
    ]
    assert not list((tmp_path / "out").glob("*"))
