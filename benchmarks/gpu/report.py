"""What was measured, as plain data, and in words; nothing is guessed: what was not measured is None and says so."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks.gpu.measure import STAGES, Contender
from benchmarks.tuning import middle

GB = 1_000_000_000
#: What is wanted of the paper's setting on a GPU of the class of an H100, each: words, row, figure, bound, unit.
BOUNDS = (
    ("milliseconds per step", "default", "step_ms", 50.0, "ms"),
    ("times as fast as the reference", "default", "speed_up", 8.0, "x"),
    ("peak memory", "default", "peak_gb", 16.0, "GB"),
    ("peak memory with --memory 8", "memory 8", "peak_gb", 8.0, "GB"),
    ("1000 steps", "default", "thousand_s", 60.0, "s"),
)
#: Figures of which more is better.
AT_LEAST = ("speed_up",)


def row(
    contender: Contender, flop: Mapping[str, float], ceiling: float, whole: tuple[int, float] | None
) -> dict[str, Any]:
    """One way of computing in figures.

    Args:
        flop: of the stages that have some, from :func:`count.count`. What is computed twice to save memory counts once.
        ceiling: FLOP/s.
        whole: steps and seconds of a whole paint, where one was painted.
    """
    figures = middle(contender.rows)
    step, total = figures["step"], sum(figures[stage] for stage in STAGES)
    stages = {
        stage: {
            "ms": 1e3 * figures[stage],
            "share": figures[stage] / total,
            "of_ceiling": flop[stage] / figures[stage] / ceiling if stage in flop else None,
        }
        for stage in STAGES
    }
    rate = sum(flop.values()) / step
    steps, seconds = whole or (None, None)
    return {
        "name": contender.kind.name,
        "done": contender.economy.words or "nothing",
        "dtype": str(contender.prior.denoiser.dtype).removeprefix("torch."),
        "step_ms": 1e3 * step,
        "stages": stages,
        "tflop_per_s": rate / 1e12,
        "of_ceiling": rate / ceiling,
        "peak_gb": None if contender.peak is None else contender.peak / GB,
        "reserved_gb": None if contender.reserved is None else contender.reserved / GB,
        "load_s": contender.load_seconds,
        "first_step_s": contender.first_seconds,
        "start_up_s": contender.first_seconds - step,
        "projected_1000_s": contender.first_seconds + 999 * step,
        "steps": steps,
        "steps_s": seconds,
        "thousand_s": seconds if steps == 1000 else None,
    }


def with_speed_up(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """``rows`` with ``speed_up``: how many times as fast as the reference each is; None where there is none."""
    base = next((row["step_ms"] for row in rows if row["name"] == "reference"), None)
    return [{**row, "speed_up": base and base / row["step_ms"]} for row in rows]


def verdicts(rows: Sequence[Mapping[str, Any]], why_not: str | None) -> list[dict[str, Any]]:
    """Each bound, what was measured, and whether it is met; None and a reason where it was not measured.

    Args:
        why_not: why nothing that was measured says anything of the bounds; None where it does.
    """
    named = {row["name"]: row for row in rows}
    found = []
    for words, name, figure, bound, unit in BOUNDS:
        value = named[name][figure] if name in named and not why_not else None
        met = None if value is None else value >= bound if figure in AT_LEAST else value <= bound
        reason = why_not or ("" if value is not None else "--steps 1000 measures it" if unit == "s" else "left out")
        found.append({"what": words, "bound": bound, "at_least": figure in AT_LEAST, "unit": unit, "value": value,
                      "met": met, "why_not": reason})  # fmt: skip
    return found


def text(result: Mapping[str, Any]) -> str:
    """The whole result as a table, and the verdicts."""
    flop, rows = result["tflop"], result["rows"]
    lines = [
        f"{result['setting']}: {result['model']}; {result['views']} views of {result['pixels']} pixels, "
        f"{result['texels']} texels, {result['faces']} faces",
        f"on {result['device']}, {result['threads']} threads, torch {result['torch']}; {result['blocks']}",
        f"one step: {sum(flop.values()):.4g} TFLOP: "
        + ", ".join(f"{name} {value:.3g}" for name, value in flop.items()),
        f"ceiling: {result['ceiling_tflop_per_s']:.4g} TFLOP/s ({result['ceiling_of']} matrix product)",
        "",
        "of stages: ms, share, and of the ceiling; waiting after each stage adds to their sum",
        _line("", [row["name"] for row in rows]),
        _line("precision", [row["dtype"] for row in rows]),
    ]
    for stage in STAGES:
        lines.append(_line(stage, [_stage(row["stages"][stage]) for row in rows]))
    for label, figure, form in (
        ("ms per step", "step_ms", "{:.1f}"),
        ("times as fast as the reference", "speed_up", "{:.2f}"),
        ("TFLOP/s", "tflop_per_s", "{:.3g}"),
        ("of the ceiling", "of_ceiling", "{:.1%}"),
        (f"peak, GB ({result['peak_of']})", "peak_gb", "{:.2f}"),
        ("with what is kept for reuse, GB", "reserved_gb", "{:.2f}"),
        ("weights drawn, s", "load_s", "{:.1f}"),
        ("first step, s", "first_step_s", "{:.1f}"),
        ("of it start-up and compilation, s", "start_up_s", "{:.1f}"),
        ("1000 steps, projected, s", "projected_1000_s", "{:.1f}"),
        (f"{result['whole'] or 1000} steps, measured, s", "steps_s", "{:.1f}"),
    ):
        lines.append(_line(label, ["-" if row[figure] is None else form.format(row[figure]) for row in rows]))
    lines += [
        "",
        *(f"{row['name']}: {row['done']}" for row in rows),
        "the first one's first step pays what all share",
        "",
    ]
    return "\n".join([*lines, *map(_verdict, result["verdicts"])])


def _line(label: str, cells: Sequence[str]) -> str:
    return f"{label:36}" + "".join(f"{cell:>22}" for cell in cells)


def _stage(stage: Mapping[str, Any]) -> str:
    fraction = "" if stage["of_ceiling"] is None else f"{stage['of_ceiling']:.0%}"
    return f"{stage['ms']:.1f} {stage['share']:4.0%} {fraction:>5}"


def _verdict(verdict: Mapping[str, Any]) -> str:
    sign = "at least" if verdict["at_least"] else "at most"
    wanted = f"{verdict['what']}, {sign} {verdict['bound']:g} {verdict['unit']}"
    if verdict["met"] is None:
        return f"{wanted}: not measured: {verdict['why_not']}"
    return f"{wanted}: {verdict['value']:.3g} {verdict['unit']}: {'met' if verdict['met'] else 'NOT met'}"
