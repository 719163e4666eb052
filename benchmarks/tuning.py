"""Seconds per step of the pocket preset before and after its tuning, in one run.

The two painters take turns, a block of steps each and the other one first in every second round, so that whatever else
the machine does falls on both alike. They see the same views by the same prior: what differs is the settings listed in
``BEFORE``. Prints each painter's median over its blocks' medians, their ratio, and the shares of the stages.
"""

from __future__ import annotations

import argparse
import json
import platform
import statistics
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import torch

from paintit.config import POCKET, PaintConfig
from paintit.mesh.read import read_mesh
from paintit.paint.painter import Painter, Step
from paintit.settings import merge, names

SPOT = Path(__file__).parent.parent / "assets" / "meshes" / "spot" / "spot.obj"
STAGES = ("network", "render", "guidance", "backward", "optimiser")
#: What decides the cost of a step, as the pocket preset had it before its tuning.
BEFORE: dict[str, Any] = {
    "texture.kind": "dcpbr",
    "texture.size": 512,
    "texture.upsample": 1,
    "texture.widths": [8, 32, 64, 128, 128],
    "texture.skip_widths": [4, 16, 32, 64, 128],
    "texture.input_channels": 8,
    "texture.precision": "auto",
    "views.count": 4,
    "views.size": 64,
    "views.close_up": 0.25,
    "light.rotation": "random",
    "guidance.reads": [],
    "dtype": "auto",
}
Row = Mapping[str, float]


def differences(before: PaintConfig, after: PaintConfig) -> list[str]:
    """``name: old -> new`` of every setting in which the two differ."""

    def value(config: Any, name: str) -> Any:
        for part in name.split("."):
            config = getattr(config, part)
        return config

    pairs = ((name, value(before, name), value(after, name)) for name in names())
    return [f"{name}: {old} -> {new}" for name, old, new in pairs if old != new]


def order(rounds: int, choices: Sequence[str]) -> Iterator[str]:
    """Whose block is next: a b, b a, a b, ..."""
    for index in range(rounds):
        yield from choices if index % 2 == 0 else reversed(choices)


def medians(steps: Iterable[Step]) -> Row:
    """Median seconds of each stage and of the whole step."""
    steps = list(steps)
    stages = {stage: statistics.median(step.timings[stage] for step in steps) for stage in STAGES}
    return {**stages, "step": statistics.median(step.seconds for step in steps)}


def middle(rows: Sequence[Row]) -> Row:
    """Median of each figure over blocks."""
    return {name: statistics.median(row[name] for row in rows) for name in rows[0]}


def measure(painters: Mapping[str, Painter], rounds: int, steps: int, warm_up: int) -> dict[str, list[Row]]:
    """One row for each block of each painter."""
    streams = {name: iter(painter) for name, painter in painters.items()}
    for stream in streams.values():
        for _ in range(warm_up):
            next(stream)
    blocks: dict[str, list[Row]] = {name: [] for name in painters}
    for name in order(rounds, tuple(painters)):
        blocks[name].append(medians(next(streams[name]) for _ in range(steps)))
    return blocks


def positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{value} is less than 1")
    return value


def parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--mesh", type=Path, default=SPOT, help="mesh with texture coordinates (default: spot)")
    parser.add_argument("--prompt", default="red plastic", help="sentence (default: %(default)s)")
    parser.add_argument("--threads", type=positive, help="CPU threads (default: torch's own choice)")
    parser.add_argument("--blocks", type=positive, default=6, help="blocks of each painter (default: %(default)s)")
    parser.add_argument("--steps", type=positive, default=8, help="steps in a block (default: %(default)s)")
    parser.add_argument("--warm-up", type=positive, default=3, help="steps before, not measured (default: %(default)s)")
    parser.add_argument("--json", action="store_true", help="print figures of every block, in seconds, as JSON")
    return parser.parse_args()


def main() -> None:
    options = parse()
    if options.threads:
        torch.set_num_threads(options.threads)
    new = merge(POCKET, {"optim.steps": options.warm_up + options.blocks * options.steps})
    configs = {"before": merge(new, BEFORE), "now": new}
    mesh = read_mesh(options.mesh)
    painters = {name: Painter(mesh, options.prompt, config, profile=True) for name, config in configs.items()}
    blocks = measure(painters, options.blocks, options.steps, options.warm_up)
    result = {name: middle(rows) for name, rows in blocks.items()}
    changed = differences(configs["before"], configs["now"])
    ratios = [a["step"] / b["step"] for a, b in zip(blocks["before"], blocks["now"], strict=True)]
    ratio = result["before"]["step"] / result["now"]["step"]
    machine = {"torch": torch.__version__, "threads": torch.get_num_threads(), "device": str(painters["now"].device),
               "processor": platform.processor() or platform.machine()}  # fmt: skip
    if options.json:
        print(json.dumps({**machine, "mesh": options.mesh.name, "faces": len(mesh.faces), "changed": changed,
                          "blocks": blocks, "medians": result, "ratio": ratio, "ratios": ratios}))  # fmt: skip
        return
    print(f"{options.mesh.name}, {len(mesh.faces)} faces; {options.blocks} blocks of {options.steps} steps each; "
          + ", ".join(f"{name} {value}" for name, value in machine.items()))  # fmt: skip
    print("changed: " + ("; ".join(changed) or "nothing"))
    print(f"{'medians in ms':14}" + "".join(f"{stage:>17}" for stage in STAGES) + f"{'step':>9}")
    for name, row in result.items():
        total = sum(row[stage] for stage in STAGES)
        cells = [f"{1e3 * row[stage]:.1f} ({row[stage] / total:4.0%})" for stage in STAGES]
        print(f"{name:14}" + "".join(f"{cell:>17}" for cell in cells) + f"{1e3 * row['step']:>9.1f}")
    print(f"before / now: {ratio:.2f} (from {min(ratios):.2f} to {max(ratios):.2f} by round)")


if __name__ == "__main__":
    main()
