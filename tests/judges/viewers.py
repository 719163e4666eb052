"""The judges: Cycles through Blender's own importer, and three.js and <model-viewer> in a headless Chromium."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import threading
from dataclasses import dataclass, field
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from tests.judges.scene import Pixels, Scene

HERE = Path(__file__).parent
MODULES = HERE.parent / "node_modules"
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
#: Seconds that a judge may take.
PATIENCE = 1800


class JudgeError(RuntimeError):
    """A judge failed, or left no pictures."""


def threads() -> int:
    """How many a judge may use: as many as everything else here."""
    return int(os.environ.get("OMP_NUM_THREADS", os.cpu_count() or 1))


def cycles(scene: Scene, samples: int = 128) -> list[Pixels]:
    """Path traced by Blender. Unoccluded: the asset is hidden from every ray but the camera's."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        more = {"samples": samples, "threads": threads()}
        (out / "job.json").write_text(json.dumps({**scene.job(out), **more}))
        command = [sys.executable, str(HERE / "blender_render.py"), str(out / "job.json")]
        done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)
        return _pictures(out, len(scene.views), (done.stdout + done.stderr)[-2000:])


def browser() -> str | None:
    """The path of a Chromium, or None."""
    return next((path for path in map(shutil.which, BROWSERS) if path), None)


def three(scene: Scene) -> list[Pixels]:
    """Rasterised by three.js: PMREM light, no tone mapping, sRGB out."""
    return _in_browser(scene, "three.html")


def model_viewer(scene: Scene) -> list[Pixels]:
    """As <model-viewer> shows it, tone mapping off. It knows neither ``rotation`` nor ``unoccluded``."""
    return _in_browser(scene, "model_viewer.html")


def _in_browser(scene: Scene, page: str) -> list[Pixels]:
    path = browser()
    if path is None:
        raise JudgeError(f"there is no browser: install one of {', '.join(BROWSERS)}")
    with tempfile.TemporaryDirectory() as folder:
        stage = _Stage(Path(folder), scene.job(Path(folder)))
        server = ThreadingHTTPServer(("127.0.0.1", 0), partial(_Handler, stage))
        threading.Thread(target=server.serve_forever, daemon=True).start()
        flags = ["--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
        flags += ["--ignore-gpu-blocklist", "--hide-scrollbars", f"--window-size={scene.size},{scene.size}"]
        flags += [f"--user-data-dir={folder}/profile", "--force-color-profile=srgb", "--disable-background-networking"]
        url = f"http://127.0.0.1:{server.server_port}/{page}"
        process = subprocess.Popen([path, *flags, url], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            stage.finished.wait(PATIENCE)
        finally:
            process.terminate()
            process.wait()
            server.shutdown()
            server.server_close()
        return _pictures(stage.out, len(scene.views), stage.failure or "the browser never finished")


@dataclass
class _Stage:
    """What the page is given, and how it ended."""

    out: Path
    job: dict[str, Any]
    finished: threading.Event = field(default_factory=threading.Event)
    failure: str = ""

    def file(self, url: str) -> Path | None:
        match url.split("?")[0].split("/")[1:]:
            case ["asset.glb"]:
                return Path(self.job["glb"])
            case ["light" | "light.hdr"]:
                return Path(self.job["light"])
            case ["modules", *rest] if ".." not in rest:
                return MODULES.joinpath(*rest)
            case [page] if page.endswith(".html") and "/" not in page:
                return HERE / page
        return None


TYPES = {".html": "text/html", ".js": "text/javascript", ".glb": "model/gltf-binary"}


class _Handler(BaseHTTPRequestHandler):
    def __init__(self, stage: _Stage, *arguments: Any) -> None:
        self.stage = stage
        super().__init__(*arguments)

    def do_GET(self) -> None:
        path = self.stage.file(self.path)
        if self.path == "/job.json":
            self._answer(200, json.dumps(self.stage.job).encode(), "application/json")
        elif path is None or not path.is_file():
            self._answer(404, b"", "text/plain")
        else:
            self._answer(200, path.read_bytes(), TYPES.get(path.suffix, "application/octet-stream"))

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
        self._answer(200, b"", "text/plain")
        match self.path.split("/")[1:]:
            case ["out", name]:
                (self.stage.out / Path(name).name).write_bytes(body)
            case ["failed"]:
                self.stage.failure = body.decode(errors="replace")
                self.stage.finished.set()
            case ["done"]:
                self.stage.finished.set()

    def _answer(self, status: int, body: bytes, kind: str) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        with contextlib.suppress(BrokenPipeError):
            self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        """Silence."""


def _pictures(out: Path, count: int, failure: str) -> list[Pixels]:
    paths = [out / f"{i}.png" for i in range(count)]
    if not all(path.is_file() for path in paths):
        raise JudgeError(failure)
    return [np.asarray(Image.open(path).convert("RGBA")) for path in paths]
