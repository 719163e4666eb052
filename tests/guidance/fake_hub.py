"""A hub on this machine: the few answers of the real one that ``huggingface_hub`` asks for, over real HTTP."""

from __future__ import annotations

import hashlib
import json
import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

if TYPE_CHECKING:
    import pytest

COMMIT = "0123456789abcdef0123456789abcdef01234567"


@dataclass
class FakeHub:
    """What it serves and what it was asked.

    Attributes:
        folders: repository -> the folder with its files.
        refusals: repository -> (status, X-Error-Code), for everything in it.
        gone: commits that it does not have; it has all others, with the same files.
        closed: repositories whose names are told and whose files are not, as the real hub does with gated ones.
    """

    folders: dict[str, Path] = field(default_factory=dict)
    refusals: dict[str, tuple[int, str]] = field(default_factory=dict)
    closed: set[str] = field(default_factory=set)
    gone: set[str] = field(default_factory=set)
    licence: str = "test-licence"
    requests: list[str] = field(default_factory=list)
    tokens: set[str] = field(default_factory=set)
    url: str = ""

    @property
    def fetched(self) -> list[str]:
        """Files that were asked for."""
        found = (re.fullmatch(r"GET /.*/resolve/[0-9a-f]{40}/(.*)", path) for path in self.requests)
        return sorted(path[1] for path in found if path)


@contextmanager
def serve() -> Iterator[FakeHub]:
    hub = FakeHub()
    server = ThreadingHTTPServer(("127.0.0.1", 0), _handler(hub))
    server.daemon_threads = True
    hub.url = f"http://127.0.0.1:{server.server_address[1]}"
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02})
    thread.start()
    try:
        yield hub
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


@contextmanager
def local_hub(cache: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[FakeHub]:
    """As :func:`serve`, and ``huggingface_hub`` in this process asks it, without a token, and caches in ``cache``."""
    from huggingface_hub import constants

    with serve() as hub:
        template = constants.HUGGINGFACE_CO_URL_TEMPLATE.replace(constants.ENDPOINT, hub.url)
        monkeypatch.setattr(constants, "HUGGINGFACE_CO_URL_TEMPLATE", template)
        monkeypatch.setattr(constants, "ENDPOINT", hub.url)
        monkeypatch.setattr(constants, "HF_HUB_CACHE", str(cache))
        monkeypatch.setattr(constants, "HF_TOKEN_PATH", str(cache / "no-token"))
        monkeypatch.delenv("HF_TOKEN", raising=False)
        yield hub


def _handler(hub: FakeHub) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        def do_HEAD(self) -> None:
            self.do_GET()

        def do_GET(self) -> None:
            path = urlsplit(self.path).path
            hub.requests.append(f"{self.command} {path}")
            if token := self.headers.get("Authorization"):
                hub.tokens.add(token)
            words = path.removeprefix("/api/models").strip("/").split("/")
            source, rest = "/".join(words[:2]), words[2:]
            named = rest[1] if len(rest) > 1 else "main"
            self.commit = named if re.fullmatch("[0-9a-f]{40}", named) else COMMIT
            if source in hub.refusals:
                self._refuse(*hub.refusals[source])
            elif source not in hub.folders:
                self._refuse(404, "RepoNotFound")
            elif not path.startswith("/api/"):
                self._file(source, "/".join(rest[2:]))
            elif rest[:1] == ["tree"]:
                self._json([{"type": "file", "path": n, "size": s, "oid": n} for n, s in _files(hub.folders[source])])
            elif rest[:1] == ["revision"] and (named not in ("main", self.commit) or named in hub.gone):
                self._refuse(404, "RevisionNotFound")
            else:
                names = [{"rfilename": name, "size": size} for name, size in _files(hub.folders[source])]
                self._json({"id": source, "sha": self.commit, "siblings": names, "cardData": {"license": hub.licence}})

        def _file(self, source: str, name: str) -> None:
            file = hub.folders[source] / name
            if source in hub.closed:
                self._refuse(403, "GatedRepo")
            elif not file.is_file():
                self._refuse(404, "EntryNotFound")
            else:
                self._send(file.read_bytes(), {"ETag": f'"{hashlib.sha1(file.read_bytes()).hexdigest()}"'})

        def _json(self, data: object) -> None:
            self._send(json.dumps(data).encode(), {"Content-Type": "application/json"})

        def _refuse(self, status: int, code: str) -> None:
            self._send(b"{}", {"X-Error-Code": code} if code else {}, status)

        def _send(self, body: bytes, headers: dict[str, str], status: int = 200) -> None:
            self.send_response(status)
            for name, value in {**headers, "X-Repo-Commit": self.commit, "Content-Length": str(len(body))}.items():
                self.send_header(name, value)
            self.end_headers()
            if self.command != "HEAD":
                self.wfile.write(body)

        def log_message(self, format: str, *args: object) -> None:
            pass

    return Handler


def _files(folder: Path) -> list[tuple[str, int]]:
    paths = sorted(path for path in folder.rglob("*") if path.is_file())
    return [(path.relative_to(folder).as_posix(), path.stat().st_size) for path in paths]
