"""Does every mesh of a folder come through? Read, unwrap, render, export, validate: one row of a table for each file.

    .venv/bin/python benchmarks/robustness.py FOLDER -o table.csv --pictures pictures

Each file is handled by a process of its own, forked from one that has everything imported, with a limit on memory and
on time. Rows are written as they come and a second run leaves out files that have one, so the run may be stopped.

Outcomes: ok; refused (a PaintitError: its code and message stand in the table); crash (any other exception, a signal,
or standing still in compiled code); hang; memory; empty (no picture shows the mesh, or the file holds other than its
faces); invalid (the Khronos validator finds an error
that the file itself had not). Only the first two are good ones.
"""

from __future__ import annotations

import argparse
import csv
import json
import math
import multiprocessing
import random
import resource
import statistics
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path

import numpy as np
import torch
from PIL import Image

from paintit.errors import PaintitError
from paintit.export.preview import BACKGROUND, EXPOSURE, preview_cameras, sheet
from paintit.export.write import write
from paintit.mesh.inspect import summarize
from paintit.mesh.mesh import Mesh
from paintit.mesh.read import FORMATS, read_mesh
from paintit.render.camera import fitted
from paintit.render.environment import load_environment
from paintit.render.gbuffer import rasterize
from paintit.render.geometry import Geometry
from paintit.render.light import Light, prefilter
from paintit.render.render import render_image
from paintit.texture.maps import TextureMaps

VALIDATOR = Path(__file__).parents[1] / "tests" / "validate_gltf.mjs"
VIEWS, SIZE = 4, 96
#: 4 x 4 squares of 16 texels: stretched or torn texture coordinates show.
CHECKS = 64


@dataclass
class Row:
    """One file.

    ``stage`` is the last one that was begun; ``seconds`` are those of the clock and ``cpu`` those of the processor;
    ``uvs`` counts layers kept and made; ``seen`` is the share of pixels that show the mesh, the most of all views.
    """

    file: str
    outcome: str = "crash"
    stage: str = "start"
    code: str = ""
    message: str = ""
    seconds: float = 0.0
    cpu: float = 0.0
    read: float = 0.0
    inspect: float = 0.0
    render: float = 0.0
    export: float = 0.0
    peak_mib: int = 0
    faces: int = 0
    layers: int = 0
    uvs: str = ""
    seen: float = 0.0
    notes: str = ""


class _NothingSeen(Exception):
    """Silent emptiness: what must not happen without an error."""


class _Invalid(Exception):
    """The validator's errors."""


def checkers(mesh: Mesh) -> TextureMaps:
    """Two greys in squares, darker along u and v, so that orientation shows too."""
    at = np.arange(CHECKS)
    odd = (at[:, None] // 16 + at[None] // 16) % 2
    ramp = np.stack(np.broadcast_arrays(at[None] / CHECKS, at[:, None] / CHECKS, 0.5), -1)
    base = torch.from_numpy((0.25 + 0.4 * odd[..., None] + 0.25 * ramp).astype(np.float32))

    def every(values: torch.Tensor) -> torch.Tensor:
        return values.expand(len(mesh.layers), CHECKS, CHECKS, values.shape[-1]).contiguous()

    return TextureMaps(
        every(base), every(torch.tensor([0.7])), every(torch.tensor([0.0])), every(torch.tensor([0.0, 0.0, 1.0]))
    )


def examine(path: Path, light: Light, picture: Path | None, row: Row) -> None:
    """Take one file through every stage, noting in ``row`` how far it came.

    Raises:
        PaintitError: it is refused.
        _NothingSeen, _Invalid: what comes out is not what went in.
    """

    @contextmanager
    def stage(name: str) -> Iterator[None]:
        row.stage, start = name, time.perf_counter()
        yield
        if hasattr(row, name):
            setattr(row, name, round(time.perf_counter() - start, 3))

    with stage("read"):
        mesh = read_mesh(path)
    row.faces, row.layers = len(mesh.faces), len(mesh.layers)
    made = len(mesh.report.unwrapped_layers)
    row.uvs = ", ".join(f"{n} {word}" for n, word in ((row.layers - made, "kept"), (made, "made")) if n)
    row.notes = " | ".join(mesh.report.notes)
    with stage("inspect"):
        summary = summarize(mesh)
    if summary.area <= 0 or not math.isfinite(summary.extent):
        raise _NothingSeen(f"area {summary.area}, extent {summary.extent}")
    maps = checkers(mesh)
    with stage("render"):
        row.seen = _render(mesh, maps, light, picture)
    if not row.seen:
        raise _NothingSeen(f"no pixel of {VIEWS} views shows the mesh")
    with tempfile.TemporaryDirectory() as folder, stage("export"):
        target = Path(folder) / "out.glb"
        write(target, mesh, maps, {})
        row.stage = "validate"
        _validate(target, path, mesh)
    row.stage = "done"


def _render(mesh: Mesh, maps: TextureMaps, light: Light, picture: Path | None) -> float:
    """Share of pixels that show the mesh, the most of all views."""
    geometry = Geometry.from_mesh(mesh)
    cameras = fitted(preview_cameras(VIEWS), geometry.corners)
    images = render_image(geometry, cameras, maps, light, SIZE, supersample=1, background=BACKGROUND)
    if picture is not None:
        picture.parent.mkdir(parents=True, exist_ok=True)
        sheet([Image.fromarray(image) for image in images], VIEWS).save(picture)
    return round(float(rasterize(geometry, cameras, SIZE).mask.float().mean((1, 2)).max()), 4)


def _validate(target: Path, source: Path, mesh: Mesh) -> None:
    resource.setrlimit(resource.RLIMIT_AS, (resource.RLIM_INFINITY,) * 2)  # node reserves more than it uses
    document = source.suffix.lower() in (".glb", ".gltf")
    errors, triangles = _judged(target)
    old = {error.split()[0] for error in _judged(source)[0]} if document and errors else set()
    new = [error for error in errors if error.split()[0] not in old]
    if new:
        raise _Invalid("; ".join(new[:3]))
    if not document and triangles != len(mesh.faces):
        raise _NothingSeen(f"{triangles} triangles in the file of {len(mesh.faces)}")


def _judged(path: Path) -> tuple[list[str], int]:
    """The Khronos validator's errors, as code and place, and the number of triangles it counts."""
    done = subprocess.run(["node", str(VALIDATOR), str(path)], capture_output=True, text=True, check=True)
    report = json.loads(done.stdout)
    messages = report["issues"]["messages"]
    return [f"{m['code']} {m.get('pointer')}" for m in messages if m["severity"] == 0], report["info"][
        "totalTriangleCount"
    ]


def _child(path: Path, name: str, light: Light, picture: Path | None, memory: int, answer: Connection) -> None:
    """One file in a process of its own; sends a ``Row``, twice where it gets that far: before compiled code may die."""
    in_use = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (in_use + memory, resource.RLIM_INFINITY))
    row, start = Row(name), time.perf_counter()
    try:
        examine(path, light, picture, row)
        row.outcome = "ok"
    except PaintitError as error:
        row.outcome, row.code, row.message = "refused", error.code, error.message
    except MemoryError as error:
        row.outcome, row.message = "memory", str(error)
    except (_NothingSeen, _Invalid) as error:
        row.outcome, row.message = "empty" if isinstance(error, _NothingSeen) else "invalid", str(error)
    except RuntimeError as error:  # torch says so when memory is short
        row.outcome = "memory" if "alloc" in str(error) else "crash"
        row.message = "".join(traceback.format_exception(error)[-2:])
    except Exception as error:
        row.message = "".join(traceback.format_exception(error)[-2:])
    row.seconds = round(time.perf_counter() - start, 3)
    row.cpu = round(time.process_time(), 3)
    row.peak_mib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
    answer.send(row)


@dataclass
class _Running:
    process: BaseProcess
    answer: Connection
    name: str
    since: float


def run(paths: list[tuple[str, Path]], options: argparse.Namespace, table: csv.DictWriter[str]) -> Iterator[Row]:
    """Handle the files, ``options.workers`` at once; yields each row once it is written."""
    light = prefilter(load_environment("default", EXPOSURE))
    _warm_up(light)
    context = multiprocessing.get_context("fork")
    todo, running = list(reversed(paths)), []
    while todo or running:
        while todo and len(running) < options.workers:
            name, path = todo.pop()
            ours, theirs = context.Pipe(False)
            picture = options.pictures / f"{name}.png" if options.pictures else None
            arguments = (path, name, light, picture, options.memory * 2**20, theirs)
            process = context.Process(target=_child, args=arguments)
            process.start()
            theirs.close()
            running.append(_Running(process, ours, name, time.perf_counter()))
        wait([r.answer for r in running], timeout=0.5)
        for r in list(running):
            row = _outcome(r, options.seconds)
            if row is not None:
                running.remove(r)
                table.writerow(asdict(row))
                yield row


def _outcome(r: _Running, limit: float) -> Row | None:
    """The row of a process that has answered, died, or had its time; None while it works."""
    elapsed = time.perf_counter() - r.since
    if r.answer.poll():
        try:
            row = r.answer.recv()
        except EOFError:
            r.process.join()
            row = Row(r.name, "crash", message=f"exit code {r.process.exitcode}", seconds=round(elapsed, 3))
    elif elapsed > limit:
        r.process.kill()
        row = Row(r.name, "hang", message=f"killed after {elapsed:.0f} s", seconds=round(elapsed, 3))
    else:
        return None
    r.process.join()
    r.answer.close()
    return row


def _warm_up(light: Light) -> None:
    """Load what is loaded on first use, so that no child has to."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "triangle.obj"
        # With texture coordinates: an unwrap would start threads, which a forked process does not have.
        path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n")
        examine(path, light, None, Row("warm-up"))


def report(rows: list[Row]) -> str:
    """The table of outcomes, times and memory, and every refusal."""
    lines = [f"{len(rows)} files"]
    lines += [f"{count:6}  {outcome}" for outcome, count in Counter(r.outcome for r in rows).most_common()]
    for name in ("seconds", "cpu", "read", "inspect", "render", "export", "peak_mib", "faces"):
        values = sorted(float(getattr(r, name)) for r in rows)
        at = [statistics.median(values), values[int(0.95 * (len(values) - 1))], values[-1]]
        lines.append(f"{name:>10}  median {at[0]:.6g}, 95 % {at[1]:.6g}, most {at[2]:.6g}")
    lines += [f"{r.outcome}: {r.file} ({r.stage}): {r.code} {r.message}" for r in rows if r.outcome != "ok"]
    return "\n".join(lines)


def read_table(path: Path) -> list[Row]:
    """Rows of an earlier run."""
    kinds = {f.name: {"int": int, "float": float}.get(str(f.type), str) for f in fields(Row)}
    with path.open(newline="") as file:
        return [Row(**{key: kinds[key](value) for key, value in row.items()}) for row in csv.DictReader(file)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True, help="table (CSV); rows are added to it")
    parser.add_argument("--pictures", type=Path, help="folder for a small picture of each mesh")
    parser.add_argument("--formats", nargs="+", default=list(FORMATS), choices=FORMATS)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=60.0, help="limit for one file")
    parser.add_argument("--memory", type=int, default=4096, help="MiB that one file may take")
    parser.add_argument("--again", nargs="*", default=[], help="outcomes to be tried once more")
    options = parser.parse_args()
    torch.set_num_threads(1)

    done = [r for r in read_table(options.output) if r.outcome not in options.again] if options.output.exists() else []
    known = {r.file for r in done}
    found = sorted(p for p in options.folder.rglob("*") if p.suffix.lower().lstrip(".") in options.formats)
    todo = [(str(p.relative_to(options.folder)), p) for p in found if p.is_file()]
    todo = [(name, path) for name, path in todo if name not in known]
    random.Random(0).shuffle(todo)  # so that a run cut short is a sample of all
    with options.output.open("w", newline="") as file:
        table = csv.DictWriter(file, [f.name for f in fields(Row)])
        table.writeheader()
        table.writerows(asdict(row) for row in done)
        for i, row in enumerate(run(todo, options, table)):
            file.flush()
            done.append(row)
            if row.outcome != "ok" or i % 50 == 0:
                print(f"{i + 1}/{len(todo)} {row.outcome}: {row.file} {row.code} {row.message}", file=sys.stderr)
    print(report(done))


if __name__ == "__main__":
    main()
