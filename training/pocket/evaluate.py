"""The ruler's command line: paint the evaluation's cells, measure them, look at them, and ask the prior by itself.

    python evaluate.py classifier [--count 400]           train the retrieval ruler, its accuracy on other shapes
    python evaluate.py paint [--method guided] [--out NAME] [--part 1/2] [--set group.name=JSON ...]
    python evaluate.py measure NAME ...                   tables, totals with their spread over seeds, NAME.json
    python evaluate.py sheet NAME [-o FILE.png]           rows: prompts; columns: mesh and seed
    python evaluate.py samples [--count 64]               samples without geometry, how many are recognised
    python evaluate.py explained [PROMPT ...]             how much of a pattern is known from text and place alone
    python evaluate.py unseen FILE.json                   words that no caption held, nearest known meaning

``paint`` keeps each cell as it is done and skips those it finds, so it can be stopped, resumed, and run by several
processes (``--part 1/2`` and ``--part 2/2``). What the figures mean: ``ruler.py``, ``ruler_pattern.py``, ``scores.py``.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from pathlib import Path

import ruler_classifier
import torch
from cells import METHODS, Studio, config_of, grid, load, paint_all
from data import Source
from gbuffers import WORK
from probes import SCALE, explained, sample_retrieval, unseen_words
from ruler import PATTERNS, PROMPTS, ROOT
from ruler_classifier import Recogniser
from scores import measure, report
from sheet import contact_sheet

from paintit.device import native_bfloat16
from paintit.guidance.pocket import PocketPrior

OUT = ROOT / "outputs" / "ruler"


def folder_of(name: str) -> Path:
    """A folder as named, or the one of that name among the outputs."""
    return Path(name) if "/" in name else OUT / name


def load_prior(weights: Path | None) -> PocketPrior:
    quickest = torch.bfloat16 if native_bfloat16(torch.device("cpu")) else torch.float32
    return PocketPrior(weights, dtype=quickest)


def paint(options: argparse.Namespace) -> None:
    config = config_of(options.method, options.set)
    prior = None if options.method == "truth" else load_prior(options.weights)
    studio = Studio(options.method, config, prior, options.seconds)
    cells = grid(options.meshes, options.prompts, options.seeds, options.part)
    folder = folder_of(options.out or options.method)
    for cell, seconds in paint_all(studio, cells, folder):
        print(f"{cell.name}: {seconds:.1f} s", flush=True)


def measure_all(options: argparse.Namespace) -> None:
    for name in options.names:
        folder = folder_of(name)
        print(
            report(folder.name, measure(folder, ruler_classifier.load(options.ruler)), folder.with_suffix(".json")),
            flush=True,
        )


def draw_sheet(options: argparse.Namespace) -> None:
    folder = folder_of(options.name)
    file = options.output or folder.with_suffix(".png")
    contact_sheet(folder, [cell for cell, _ in load(folder)], options.size).save(file, optimize=True)
    print(file)


def samples(options: argparse.Namespace) -> None:
    recogniser = ruler_classifier.load(options.ruler)
    named, rate, _ = sample_retrieval(
        load_prior(options.weights), recogniser, options.count, options.seed, options.scale
    )
    for prompt, names in named.items():
        print(f"{prompt:36s}{', '.join(f'{name} {n}' for name, n in Counter(names).most_common())}")
    print(f"{options.count} samples without geometry: {rate:.3f} recognised (ruler {recogniser.accuracy:.3f})")


def unseen(options: argparse.Namespace) -> None:
    rows = unseen_words(load_prior(options.weights), options.file, options.seed, options.scale)
    for row in rows:
        mark = "right" if row["right"] else "WRONG"
        print(f"{row['word']!s:28s}{mark}  means {row['means']!s:26s} nearest {row['nearest']!s:26s} "
              f"at {row['distance']}: {row['base_linear']} {row['roughness']} {row['metallic']}")  # fmt: skip
    print(f"{sum(bool(row['right']) for row in rows)} of {len(rows)} at their known meaning")
    if options.output:
        options.output.write_text(json.dumps(rows, indent=1))


def explained_shares(options: argparse.Namespace) -> None:
    times = (0.98, 0.8, 0.5)
    print(f"{'explained variance of base colour':40s}" + "".join(f"  t = {t}" for t in times))
    for prompt, shares in explained(load_prior(options.weights), options.prompts, times, options.gbuffers).items():
        print(f"{prompt:40s}" + "".join(f"{share:9.2f}" for share in shares), flush=True)


def classifier(options: argparse.Namespace) -> None:
    source = Source.open(options.gbuffers)
    trained = ruler_classifier.train(source, options.count, options.epochs, options.seed)
    ruler_classifier.save(trained, options.ruler)
    print(confusions(trained))


def confusions(trained: Recogniser) -> str:
    """Accuracy of each class, and what it was mostly taken for instead."""
    lines = []
    for i, name in enumerate(trained.classes):
        row = trained.confusion[i]
        wrong = [(int(n), trained.classes[j]) for j, n in enumerate(row) if j != i and n]
        others = ", ".join(f"{other} {n}" for n, other in sorted(wrong, reverse=True)[:4])
        lines.append(f"{name:36s}{float(row[i] / row.sum().clamp_min(1)):.2f}  {others}")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)

    def command(name: str, run) -> argparse.ArgumentParser:
        added = commands.add_parser(name)
        added.set_defaults(run=run)
        added.add_argument("--threads", type=int, default=1)
        added.add_argument("--weights", type=Path, help="of the prior, instead of those in the package")
        added.add_argument("--ruler", type=Path, default=ruler_classifier.WEIGHTS, help="the trained classifier")
        return added

    one = command("paint", paint)
    one.add_argument("--meshes", nargs="+", default=["spot", "bob"])
    one.add_argument("--prompts", nargs="+", default=list(PROMPTS))
    one.add_argument("--seeds", nargs="+", type=int, default=[0, 1])
    one.add_argument("--set", nargs="*", default=[], help="settings to change, group.name=JSON")
    one.add_argument("--method", choices=METHODS, default="guided")
    one.add_argument("--seconds", type=float, help="paint for about so long instead of a number of steps")
    one.add_argument("--part", default="1/1", help="i/n: the i-th of n equal parts of the cells")
    one.add_argument("--out", help="name of the folder; the method's by default")
    two = command("measure", measure_all)
    two.add_argument("names", nargs="+")
    three = command("sheet", draw_sheet)
    three.add_argument("name")
    three.add_argument("--size", type=int, default=144)
    three.add_argument("-o", "--output", type=Path)
    four = command("samples", samples)
    four.add_argument("--count", type=int, default=64)
    five = command("unseen", unseen)
    five.add_argument("file", type=Path)
    five.add_argument("-o", "--output", type=Path)
    for added in (four, five):
        added.add_argument("--scale", type=float, default=SCALE)
        added.add_argument("--seed", type=int, default=0)
    more = ("tiger fur", "giraffe fur", "black and white vertical stripes", "white tiles", "cow hide", "camouflage",
            "rusty iron")  # fmt: skip
    seven = command("explained", explained_shares)
    seven.add_argument("prompts", nargs="*", default=[*PATTERNS, *more])
    six = command("classifier", classifier)
    six.add_argument("--count", type=int, default=400, help="renders of each class")
    six.add_argument("--epochs", type=int, default=5)
    six.add_argument("--seed", type=int, default=0)
    for added in (six, seven):
        added.add_argument("--gbuffers", type=Path, default=WORK / "gbuffers")
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    options.run(options)


if __name__ == "__main__":
    main()
