"""``docs/reproduction.md`` from the results: every table beside the paper's, what differs said first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from paintit.variants import VARIANTS
from reproduction.score import EVEN, TRUTH

#: FID in the paper (tables 1 and S1), by the method here that is nearest to it.
PAPER_FID = {
    "dcpbr": 34.46,
    "pixels": 216.6,
    "base-color": 59.39,
    "hash-grid": 55.98,
    "points": 58.79,
    "projection": 37.89,
}
PAPER_NOTE = {"points": "Fantasia3D", "projection": "Text2Tex; TEXTure 38.40"}
#: Rows that no method makes.
NO_METHOD = {TRUTH: "*another draw of the truth*", EVEN: "*the true mean everywhere*"}
#: Supp. A.2.
PAPER_RATIOS = "2.19, 1.79, 1.78, 1.67, 1.00"
FINDINGS = Path(__file__).parent / "findings.md"
#: Figure of the results -> heading, decimals.
COLUMNS = {
    "fid_pocket": ("FID", 2), "kid_pocket": ("KID", 3), "named": ("named", 2), "delta_e": ("ΔE00", 1),
    "roughness_error": ("roughness", 2), "metallic_error": ("metalness", 2), "pattern": ("pattern", 2),
    "relighting": ("relit", 3), "saturation": ("saturation", 2), "seam": ("seam", 2), "flatness": ("baked", 2),
}  # fmt: skip
RINGS = ("lowest", "low", "middle", "high", "highest")


def digest(analysis: Mapping[str, Any]) -> dict[str, Any]:
    """What the page says of an analysis, without its curves and rows."""
    kept = ("subject", "mesh", "prompt", "seeds", "seconds", "summary", "views", "within_degrees", "rings")
    found = {name: analysis[name] for name in kept if name in analysis}
    settings = analysis["settings"]
    one = settings if "texture" in settings else next(iter(settings.values()))
    return found | {"size": one["texture"]["size"], "steps": one["optim"]["steps"]}


def page(results: Mapping[str, Any]) -> str:
    """The whole page."""
    parts = [_head(results), _comparison(results["comparison"])]
    parts += [_frequency(results[name], name) for name in ("fitting", "painting") if name in results]
    if "coherence" in results:
        parts.append(_coherence(results["coherence"]))
    parts.append(_rest())
    if FINDINGS.exists():
        parts.insert(1, FINDINGS.read_text("utf-8").strip())
    return "\n\n".join(parts) + "\n"


def _head(results: Mapping[str, Any]) -> str:
    one, made_on = results["comparison"], results["machine"]
    on = f"{made_on['processor']}, {made_on['cores']} cores, no GPU, PyTorch {made_on['torch']}"
    return f"""# The paper's tables and figures, rerun

Written by `make reproduce` on {results["date"]} from `reproduction/results.json`; change neither by hand.

## What differs from the paper, first

- **Prior.** The one in the package (`docs/pocket.md`), which paints materials at 32 x 32; the paper uses Stable
  Diffusion at 512 x 512. So no number below can be set against the paper's own by size. What can be compared is the
  order of the methods, and whether each claim holds.
- **Real set.** The paper's FID is against renders of 410 Objaverse meshes in their makers' textures. Here the truth of
  a prompt is known, since the generator of the prior's training data defines it: the real set is that material on
  the same meshes.
- **Features.** FID and KID read the package's own material classifier (64 x 64 pictures, `docs/evaluate.md`), not
  Inception; they are called `fid_pocket` and `kid_pocket` in the results.
- **Rivals.** Fantasia3D stands here as its appearance stage (an MLP on points in space), on the given mesh; TEXTure
  and Text2Tex as one projection baseline of our own (`docs/design/projection.md`), which gets material channels that
  theirs have not.
- **Size.** {one["size"]} texels a side instead of 512; {one["budget"]["seconds"]:g} seconds a paint, not 15 minutes.
- **Machine.** {on}. The comparison is {one["cells"]} paints with
  {one["budget"]["seconds"]:g} s of steps each, together {one["hours"]:g} hours by the clock, beside whatever else
  the machine did."""


def _comparison(one: Mapping[str, Any]) -> str:
    seeds, budget = one["seeds"], one["budget"]
    meshes = f"{_count(one['meshes'], 'mesh', 'es')} ({', '.join(one['meshes'])})"
    what = f"{_count(one['prompts'], 'prompt')} x {meshes} x {_seeds(seeds)}"
    spread = "± is the standard deviation of the seeds' means" if len(seeds) > 1 else "one seed, so no spread is known"
    head = ["method", "steps", *(title for title, _ in COLUMNS.values()), "FID in the paper"]
    rows = []
    for name in (TRUTH, *(v for v in VARIANTS if v in one["methods"]), EVEN):
        figures = one["methods"][name]
        cells = [_number(figures[key], digits) for key, (_, digits) in COLUMNS.items()]
        rows.append([_title(name), str(budget["steps"].get(name, "")), *cells, _paper(name)])
    return f"""## Tables 1 and S1: which parameterisation

{what}; each method for the same {budget["seconds"]:g} s of one core, at
its own best learning rate (`docs/design/parameterisations.md`); {spread}. The
steps were found by timing each method on a quiet machine; projection's are views.

{_table(head, rows)}

FID, KID: distance of 20 views of every mesh from those of the true materials. named: share of the meshes whose views
the classifier calls by their prompt. ΔE00: CIEDE2000 of the mean base colour. roughness, metalness: absolute error of
the means. pattern: the pattern score of `docs/pocket.md`, 1 is right, patterned prompts only. relit: mean absolute
error under an unseen light, plain prompts only. saturation: chroma over the true one, 1 is right. seam:
`docs/design/seams.md`, 1 cannot be seen. baked: correlation of base colour and irradiance, unsigned; 0 is right.

![Each prompt on one mesh, by every method](img/reproduction-methods.jpg)"""


def _title(name: str) -> str:
    return NO_METHOD.get(name) or VARIANTS[name].title


def _paper(name: str) -> str:
    if name not in PAPER_FID:
        return ""
    return f"{PAPER_FID[name]:.2f}" + (f" ({PAPER_NOTE[name]})" if name in PAPER_NOTE else "")


def _frequency(one: Mapping[str, Any], name: str) -> str:
    fitting = name == "fitting"
    title = "Figures 4a, 4b and S5: fitting a texture" if fitting else "Figures 4c, 4d and S6: painting by guidance"
    task = (
        f"Fitting `{one['subject'].get('image')}`"
        if fitting
        else f'Painting {one["subject"].get("mesh")}, "{one["subject"].get("prompt")}"'
    )
    key = "half_fitted_step" if fitting else "half_power_step"
    asked = "has fitted half of the target's power" if fitting else "reaches half of its final power, to stay above it"
    rows = [[VARIANTS[v].title, *(_range(ring) for ring in found[key])] for v, found in one["summary"].items()]
    last = "final_residual" if fitting else "final_magnitude"
    ends = [
        [VARIANTS[v].title, *(_number(ring, 4, "low") for ring in found[last])] for v, found in one["summary"].items()
    ]
    what = (
        "Share of the target's power that is still wrong at the end"
        if fitting
        else "Mean magnitude of each ring at the end"
    )
    return f"""## {title}

{task}: {one["steps"]} steps, {one["size"]} texels, {_seeds(one["seeds"])}, {one["seconds"]:.0f} s.
The step at which each ring of frequencies {asked} (mean, lowest and highest over seeds):

{_table(["method", *RINGS], rows)}

{what}:

{_table(["method", *RINGS], ends)}

![Energy of five rings of frequencies](img/reproduction-{name}.png)"""


def _coherence(one: Mapping[str, Any]) -> str:
    rows = []
    for entry in one["summary"]:
        ratios = ", ".join(f"{x:.2f}" for x in entry["ratios"]) or f"none: rank {entry['rank']}"
        level = "" if entry["t"] is None else f"{entry['t']:g}"
        scale = "" if entry["scale"] is None else f"{entry['scale']:g}"
        rows.append([entry["kind"], str(entry["after"]), entry["reads"], level, scale, ratios,
                     f"{entry['effective_rank']:.2f}", f"{entry['cosine']:.2f}"])  # fmt: skip
    rows.append(["*the paper*", "", "rgb", "", "", PAPER_RATIOS, "", ""])
    return f"""## Supp. A.2: do the gradients of nearly the same views agree?

{one["views"]} views within ±{one["within_degrees"]:g} degrees of the front of {one["mesh"]}, "{one["prompt"]}"; same
noise, same t; the gradient on the base colour ({one["size"]} texels). Singular values over the smallest, means over
{_seeds(one["seeds"])}. "after" counts the steps painted before; "rgb" lets only the shaded picture carry the gradient,
as in the paper. Controls: `random` unrelated numbers, `noise` the injected noise alone, `even` one number in every
pixel, `repeated` the first view's gradient every time.

{_table(["gradient", "after", "reads", "t", "scale", "ratios", "effective rank", "cosine"], rows)}

![Singular values of the gradients of five near views](img/reproduction-coherence.png)"""


def _rest() -> str:
    return """## What cannot be rerun here

- Table 1's FID by Inception on Objaverse, and all figures by Stable Diffusion: the weights and meshes are downloads.
  `paintit objaverse`, `paintit evaluate --features inception` and `paintit paint --preset paper` are the same
  steps where there is a network and a GPU.
- Table 1's user score (4.37 of 5): it takes people. `paintit study` asks them (`docs/study.md`).
- Time (supp. A.5: 15 minutes on an RTX A6000): no GPU here."""


def _seeds(seeds: Sequence[int]) -> str:
    return _count(seeds, "seed")


def _count(things: Sequence[object], name: str, ending: str = "s") -> str:
    return f"{len(things)} {name}{ending * (len(things) > 1)}"


def _number(value: Mapping[str, float | None], digits: int, low: str = "") -> str:
    mean = value["mean"]
    if mean is None or mean != mean:
        return ""
    sd = value.get("sd")
    return f"{mean:.{digits}f}" + (f" ± {sd:.{digits}f}" if sd and not low else "")


def _range(value: Mapping[str, float | None]) -> str:
    mean, low, high = value["mean"], value["low"], value["high"]
    if mean is None or low is None or high is None:
        return "never"
    return f"{mean:.0f}" if high - low < 1 else f"{mean:.0f} ({low:.0f} to {high:.0f})"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    line = lambda cells: "| " + " | ".join(cells) + " |"  # noqa: E731
    return "\n".join([line(head), line(["---"] * len(head)), *(line(row) for row in rows)])
