"""Seconds per step of this tree against an older commit's, in one run: `python benchmarks/against.py COMMIT`.

Both paint the same mesh with the same settings and seed, each in a process of its own with its own sources; they take
turns, a block of steps each and the other one first in every second round, while the other waits. Prints medians over
blocks, of the clock's time and of the processor's, which other programs disturb less; their ratio; and how far the maps
of the two are apart after two steps and at the end.
"""

from __future__ import annotations

import argparse
import io
import json
import os
import statistics
import subprocess
import sys
import tarfile
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parent.parent
SPOT = ROOT / "assets" / "meshes" / "spot" / "spot.obj"


def work(options: argparse.Namespace) -> None:
    """The other side of :class:`Worker`: to "N" answer with the timings of N steps, to "maps FILE" save the maps."""
    import torch

    from paintit.config import POCKET
    from paintit.mesh.read import read_mesh
    from paintit.paint.painter import Painter

    torch.set_num_threads(options.threads)
    painter = Painter(read_mesh(options.mesh), options.prompt, POCKET, profile=True)
    steps = iter(painter)
    for line in sys.stdin:
        command, _, argument = line.strip().partition(" ")
        if command == "maps":
            np.save(argument, painter.maps().packed().numpy())
            answer: Any = "saved"
        else:
            began, count = time.process_time(), int(command)
            answer = [{**step.timings, "step": step.seconds} for step in (next(steps) for _ in range(count))]
            spent = (time.process_time() - began) / count
            answer = [{**row, "processor": spent} for row in answer]
        print(json.dumps(answer), flush=True)


class Worker:
    """A painter of the sources in ``folder``."""

    def __init__(self, folder: Path, options: argparse.Namespace) -> None:
        command = [sys.executable, __file__, "--work", "--mesh", str(options.mesh), "--prompt", options.prompt]
        self._process = subprocess.Popen(
            [*command, "--threads", str(options.threads)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
            env={**os.environ, "PYTHONPATH": str(folder / "src"), "OMP_NUM_THREADS": str(options.threads)},
        )  # fmt: skip

    def ask(self, text: str) -> Any:
        assert self._process.stdin
        assert self._process.stdout
        self._process.stdin.write(text + "\n")
        self._process.stdin.flush()
        return json.loads(self._process.stdout.readline() or sys.exit("a painter ended before its time"))

    def maps(self, folder: Path) -> np.ndarray:
        self.ask(f"maps {folder / 'maps.npy'}")
        return np.load(folder / "maps.npy")

    def close(self) -> None:
        self._process.communicate()


def sources(commit: str, folder: Path) -> Path:
    """The package's sources as they were at ``commit``, in ``folder``."""
    archive = subprocess.run(["git", "-C", str(ROOT), "archive", commit, "src"], capture_output=True, check=True).stdout
    with tarfile.open(fileobj=io.BytesIO(archive)) as tar:
        tar.extractall(folder, filter="data")
    return folder


def apart(a: np.ndarray, b: np.ndarray) -> str:
    difference = np.abs(a - b)
    return f"mean {difference.mean():.1e}, most {difference.max():.1e}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("commit", nargs="?", help="what to compare with")
    parser.add_argument("--mesh", type=Path, default=SPOT, help="mesh with texture coordinates (default: spot)")
    parser.add_argument("--prompt", default="a zebra", help="sentence (default: %(default)s)")
    parser.add_argument("--threads", type=int, default=os.cpu_count() or 1, help="CPU threads (default: all)")
    parser.add_argument("--blocks", type=int, default=8, help="blocks of each painter (default: %(default)s)")
    parser.add_argument("--steps", type=int, default=8, help="steps in a block (default: %(default)s)")
    parser.add_argument("--work", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.work:
        return work(options)
    if not options.commit:
        parser.error("name a commit")

    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        workers = {"before": Worker(sources(options.commit, folder), options), "now": Worker(ROOT, options)}
        for worker in workers.values():
            worker.ask("2")  # warm up
        early = apart(*(worker.maps(folder) for worker in workers.values()))
        blocks: dict[str, list[dict[str, float]]] = {name: [] for name in workers}
        for index in range(options.blocks):
            for name in workers if index % 2 == 0 else reversed(workers):
                steps = workers[name].ask(str(options.steps))
                blocks[name].append({key: statistics.median(step[key] for step in steps) for key in steps[0]})
        late = apart(*(worker.maps(folder) for worker in workers.values()))
        for worker in workers.values():
            worker.close()

    middle = {n: {k: statistics.median(row[k] for row in rows) for k in rows[0]} for n, rows in blocks.items()}
    print(f"{options.mesh.name}, '{options.prompt}', {options.threads} threads, "
          f"{options.blocks} blocks of {options.steps} steps each; {options.commit} against this tree")  # fmt: skip
    print(f"{'medians in ms':14}" + "".join(f"{key:>11}" for key in middle["now"]))
    for name, row in middle.items():
        print(f"{name:14}" + "".join(f"{1e3 * value:>11.1f}" for value in row.values()))
    print(f"{'ratio':14}" + "".join(f"{middle['before'][key] / value:>11.2f}" for key, value in middle["now"].items()))
    each = [a["step"] / b["step"] for a, b in zip(blocks["before"], blocks["now"], strict=True)]
    print(f"before / now: {middle['before']['step'] / middle['now']['step']:.2f} "
          f"(from {min(each):.2f} to {max(each):.2f} by round)")  # fmt: skip
    count = 2 + options.blocks * options.steps
    print(f"maps apart after 2 steps: {early}; after {count} steps: {late}")


if __name__ == "__main__":
    main()
