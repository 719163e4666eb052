"""Milliseconds, arithmetic and memory of one step in the paper's setting, stage by stage: `make bench-gpu`.

512 x 512 pixels, 4 views, DC-PBR of 512 x 512 texels as published, Stable Diffusion 2.1-base at full size with random
weights, on the cow. Speed and memory do not depend on what weights and words say, so neither is needed: the text
encoder reads random tokens. Several ways of computing the same steps take turns in one run, a block of steps each, our
own plain float32 among them. Without a GPU everything is reduced, so that the program itself can be tried; of a GPU
nothing is then said.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from benchmarks.gpu.count import ceiling, count
from benchmarks.gpu.measure import KINDS, Contender, arithmetic, enter, measure, whole_run
from benchmarks.gpu.model import FULL, SMALL
from benchmarks.gpu.report import row, text, verdicts, with_speed_up
from benchmarks.tuning import positive

from paintit.device import choose_device
from paintit.mesh.read import read_mesh

SPOT = Path(__file__).parents[2] / "assets" / "meshes" / "spot" / "spot.obj"
NAMES = tuple(kind.name for kind in KINDS)


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        "python -m benchmarks.gpu", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--device", default="auto", help="auto, cuda:N or cpu (default: %(default)s)")
    parser.add_argument("--full", action="store_true", help="the paper's setting without a GPU too: hours, 30 GB")
    parser.add_argument("--only", nargs="+", choices=NAMES, metavar="NAME",
                        help=f"of {', '.join(NAMES)} (default: all; without a GPU not the compiled one)")  # fmt: skip
    parser.add_argument("--blocks", type=positive, default=6, help="blocks of each (default: %(default)s)")
    parser.add_argument("--block-steps", type=positive, default=5, help="steps in a block (default: %(default)s)")
    parser.add_argument("--staged", type=positive, default=2, help="further ones, by stage (default: %(default)s)")
    parser.add_argument("--warm-up", type=positive, default=5, help="steps before, not measured (default: %(default)s)")
    parser.add_argument("--steps", type=positive, help="then paint this many steps whole with all but the reference")
    parser.add_argument("--profile", action="store_true", help="list the costliest operators of each on stderr")
    parser.add_argument("--json", action="store_true", help="print all figures as JSON")
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> None:
    options = parse(arguments)
    device, _ = choose_device(options.device)
    gpu = device.type == "cuda"
    setting = FULL if gpu or options.full else SMALL
    config, mesh = setting.config(), read_mesh(SPOT)
    chosen = options.only or [name for name in NAMES if gpu or name != "compiled"]
    flop = count(setting)
    product, rate = ceiling(device)
    contenders = []
    for kind in (kind for kind in KINDS if kind.name in chosen):
        print(f"{kind.name} ...", file=sys.stderr)
        contenders.append(enter(kind, setting, mesh, device, options.warm_up))
    measure(contenders, options.blocks, options.block_steps, options.staged)
    whole = {
        c.kind.name: (options.steps, whole_run(c, setting, mesh, options.steps))
        for c in contenders
        if options.steps and not c.kind.plain
    }
    rows = with_speed_up([row(c, flop, rate, whole.get(c.kind.name)) for c in contenders])
    result = {
        "setting": setting.name,
        "model": f"Stable Diffusion 2.1-base{'' if setting is FULL else ', in miniature'}, random weights",
        "views": config.views.count,
        "pixels": config.views.size,
        "texels": config.texture.size,
        "faces": len(mesh.faces),
        "gpu": torch.cuda.get_device_name(device) if gpu else None,
        "device": torch.cuda.get_device_name(device) if gpu else "the CPU: these figures say nothing of a GPU",
        "threads": torch.get_num_threads(),
        "torch": torch.__version__,
        "blocks": f"medians over {options.blocks} blocks of {options.block_steps} steps",
        "tflop": {stage: value / 1e12 for stage, value in flop.items()},
        "ceiling_of": product,
        "ceiling_tflop_per_s": rate / 1e12,
        "peak_of": "of tensors" if gpu else "process, so far",
        "whole": options.steps,
        "rows": rows,
        "verdicts": verdicts(rows, None if gpu else "no GPU"),
    }
    print(json.dumps(result, indent=1) if options.json else text(result))
    if options.profile:
        for contender in contenders:
            print(f"\n{contender.kind.name}\n{profile(contender)}", file=sys.stderr)


def profile(contender: Contender, steps: int = 3) -> str:
    """The operators of a few steps, the costliest first."""
    from torch.profiler import ProfilerActivity
    from torch.profiler import profile as recording

    gpu = contender.painter.device.type == "cuda"
    activities = [ProfilerActivity.CPU, *([ProfilerActivity.CUDA] if gpu else [])]
    stream = iter(contender.painter)
    with arithmetic(contender.kind), recording(activities=activities) as record:
        for _ in range(steps):
            next(stream)
    events: Any = record.key_averages()
    return events.table(sort_by=f"self_{'cuda' if gpu else 'cpu'}_time_total", row_limit=20)


if __name__ == "__main__":
    main()
