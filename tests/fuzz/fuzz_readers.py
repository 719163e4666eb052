"""The mesh readers under a coverage-guided fuzzer (atheris; ``pip install paintit[fuzz]``).

    python -m tests.fuzz.fuzz_readers --format glb --seconds 600 --corpus corpus/glb

A finding is whatever is not a mesh and not a ``PaintitError``: another exception, a Python warning, a mesh with numbers
that are not finite or indices out of range, two readers of OBJ that do not agree, more than ``--memory`` MiB, more than
``--slow`` seconds. Each kind of finding is kept once, as a file under ``--findings``, named by what it is and where it
arose. The result is one line of JSON; ``edges`` is the number of branches of the readers that inputs have reached.
"""

from __future__ import annotations

import argparse
import json
import random
import re
import resource
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")
FORMATS = ("glb", "gltf", "obj", "ply", "stl", "off")
LARGEST = 1 << 15
"""Bytes of an input."""
RUNS = 20_000
"""Inputs after which the fuzzer is started anew: its own records grow by some 10 KiB with each."""


def check(path: Path, unwrap: bool) -> None:
    """Read and measure a file; an expected refusal is no error.

    Raises:
        Exception: whatever a reader must not raise; AssertionError where the mesh is not what ``Mesh`` promises.
    """
    import numpy as np

    from paintit.mesh.inspect import summarize
    from paintit.mesh.read import read_as_it_is, read_mesh
    from paintit.mesh.tangents import mikktspace

    if path.suffix == ".obj":
        _check_twins(path.read_bytes())
    if path.suffix in (".glb", ".gltf"):
        _or_refused(lambda: read_as_it_is(path, pose="@0.5"))
    mesh = _or_refused(lambda: read_mesh(path) if unwrap else read_as_it_is(path))
    if mesh is None:
        return
    quality = summarize(mesh, 64).uv
    tangents = mesh.tangents
    if not unwrap and quality.has_uvs:
        tangents = mikktspace(mesh.vertices, mesh.faces, mesh.uvs, mesh.face_uvs, mesh.normals)
    assert np.isfinite(tangents).all(), "tangents are not finite"
    for name in ("vertices", "normals", *(["uvs"] if unwrap else [])):
        assert np.isfinite(getattr(mesh, name)).all(), f"{name} are not finite"
    assert len(mesh.faces) > 0, "no faces"
    assert mesh.faces.min() >= 0, "a negative vertex index"
    assert mesh.faces.max() < len(mesh.vertices), "a vertex index out of range"
    assert mesh.face_uvs.max() < len(mesh.uvs), "a texture index out of range"
    assert np.abs(np.linalg.norm(mesh.normals, axis=-1) - 1).max() < 1e-3, "normals are not unit"
    assert {a for part in mesh.parts for a in part.faces} <= set(range(len(mesh.faces) + 1)), "a part out of range"


def _or_refused(read: Callable[[], T]) -> T | None:
    """What is read; None where it is refused in one line."""
    from paintit.errors import PaintitError

    try:
        return read()
    except PaintitError as error:
        if "\n" in str(error):
            raise ValueError(f"an error of several lines: {error}") from error
        return None


def _check_twins(data: bytes) -> None:
    """What the quick reader of OBJ reads, the careful one reads alike (both after the file is taken into lines)."""
    import numpy as np

    from paintit.mesh.obj_quick import read_quickly
    from paintit.mesh.obj_statements import read_statements

    data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    lines = data.decode("latin-1").split("\n")
    quick = None if b"\x00" in data else read_quickly(data, lines)
    careful = _or_refused(lambda: read_statements(lines)) if quick is not None else None
    if quick is not None:
        assert careful is not None, "only the quick reader reads it"
        for name, value in vars(quick).items():
            same = np.array_equal(value, getattr(careful, name), equal_nan=isinstance(value, np.ndarray))
            assert same, f"the readers do not agree on {name}"


def kind_of(error: BaseException) -> str:
    """What was raised and the innermost of our lines, as a file name."""
    ours = [frame for frame in traceback.extract_tb(error.__traceback__) if "paintit" in frame.filename]
    place = f"{Path(ours[-1].filename).stem}-{ours[-1].name}-{ours[-1].lineno}" if ours else "elsewhere"
    words = "-" + str(error) if isinstance(error, AssertionError) else ""
    return re.sub(r"[^\w-]+", "_", f"{type(error).__name__}{words}-{place}")[:100]


def fuzz(options: argparse.Namespace) -> None:
    """Run until the time is over, or until libFuzzer ends the process at an input that takes too long."""
    import atheris

    with atheris.instrument_imports(include=["paintit.mesh"]):
        import paintit.mesh.inspect
        import paintit.mesh.read  # noqa: F401
    from tests.fuzz.mutators import mutate_document, mutate_text

    warnings.simplefilter("error")
    folder = tempfile.TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None)
    path = Path(folder.name) / f"input.{options.format}"

    def one(data: bytes) -> None:
        path.write_bytes(data)
        start, kind = time.process_time(), None
        _limit_memory(options.memory)
        try:
            check(path, options.unwrap)
        except Exception as error:
            kind = kind_of(error)
        _limit_memory(None)
        if time.process_time() - start > options.slow:
            kind = "slow"
        if kind:
            keep(kind, data)

    def keep(kind: str, data: bytes) -> None:
        target = options.findings / f"{kind}.{options.format}"
        if not target.exists() or target.stat().st_size > len(data):
            target.write_bytes(data)

    def mutate(data: bytes, largest: int, seed: int) -> bytes:
        draw = random.Random(seed)
        if draw.random() < 0.25:
            return atheris.Mutate(data, largest)
        if options.format in ("glb", "gltf"):
            return mutate_document(options.format, data, largest, draw, atheris.Mutate)
        return mutate_text(data, largest, draw, atheris.Mutate)

    # Slow inputs are told by processor time above; libFuzzer's own clock only ends what would not end.
    flags = [f"-max_total_time={options.seconds}", "-timeout=300", "-report_slow_units=1000000"]
    flags += [f"-rss_limit_mb={4 * options.memory}", f"-artifact_prefix={options.findings}/", f"-max_len={LARGEST}"]
    flags += ["-print_final_stats=1", f"-runs={RUNS}", str(options.corpus)]
    atheris.Setup([sys.argv[0], *flags], one, custom_mutator=mutate)
    atheris.Fuzz()


def _limit_memory(more: int | None) -> None:
    """Allow ``more`` MiB of address space beyond what is in use now; any with None."""
    limit = resource.RLIM_INFINITY
    if more is not None:
        limit = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize() + more * 2**20
    resource.setrlimit(resource.RLIMIT_AS, (limit, resource.RLIM_INFINITY))


def supervise(options: argparse.Namespace, arguments: list[str]) -> None:
    """Start the fuzzer again whenever an input ends it; counts executions and seconds."""
    from tests.fuzz.seeds import seeds

    for folder in (options.corpus, options.findings):
        folder.mkdir(parents=True, exist_ok=True)
    for i, data in enumerate(seeds(options.format)):
        (options.corpus / f"seed{i}").write_bytes(data)
    start, executions, starts, edges = time.monotonic(), 0, 0, 0
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    while (left := options.seconds - (time.monotonic() - start)) > 1:
        command = [sys.executable, "-m", "tests.fuzz.fuzz_readers", *arguments, "--child", "--seconds", str(int(left))]
        with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, errors="replace") as process:
            assert process.stderr is not None
            last, tail = 0, []
            for line in process.stderr:
                if match := re.match(r"(?:#|stat::number_of_executed_units:\s*)(\d+)", line):
                    last = int(match[1])
                if match := re.search(r"\bcov: (\d+)", line):
                    edges = max(edges, int(match[1]))
                tail = [*tail[-30:], line]
        executions, starts = executions + last, starts + 1
        if process.returncode and not last:
            sys.exit("the fuzzer does not start:\n" + "".join(tail))
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    found = sorted(p.name for p in options.findings.iterdir())
    summary = {
        "format": options.format,
        "seconds": round(time.monotonic() - start),
        "cpu_seconds": round(used.ru_utime + used.ru_stime - before.ru_utime - before.ru_stime),
        "executions": executions,
        "starts": starts,
        "edges": edges,
        "corpus": sum(1 for _ in options.corpus.iterdir()),
        "findings": found,
    }
    print(json.dumps(summary))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--format", choices=FORMATS, required=True)
    parser.add_argument("--seconds", type=int, default=600)
    parser.add_argument("--corpus", type=Path, required=True, help="folder; seeds are put in, what is found is added")
    parser.add_argument("--findings", type=Path, default=Path("fuzz-findings"), help="folder")
    parser.add_argument("--unwrap", action="store_true", help="unwrap what needs it too: slower, reaches compiled code")
    parser.add_argument("--memory", type=int, default=1024, help="MiB beyond what the fuzzer itself takes")
    parser.add_argument("--slow", type=float, default=10.0, help="processor seconds for one input")
    parser.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        fuzz(options)
    else:
        supervise(options, sys.argv[1:])


if __name__ == "__main__":
    main()
