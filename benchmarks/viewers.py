"""What `paintit render` shows against what other programs show for the exported file, under one light.

    make judge                      all of it; the table on stdout, the sheet in outputs/viewers
    python -m benchmarks.viewers --only "spot, painted" "white" --judges cycles
    python -m benchmarks.viewers --sheet docs/img/viewers.jpg

Rows: four painted assets (painted first, where outputs/viewers holds none), three assets with real maps, and spheres of
one material. Figures: PSNR in dB of sRGB-coded pixels inside the silhouette, one per view. ``cycles-`` is Cycles
without the asset's shadows on and reflections in itself, against our picture without the file's occlusion textures:
what differs there is the split sum's doing. ``three-``: both without occlusion textures.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont
from tests.judges.scene import DIFFUSE, METALS, VIEWS, Pixels, Scene, overlap, psnr
from tests.judges.viewers import JudgeError, cycles, model_viewer, three

from paintit.api import paint

ROOT = Path(__file__).parent.parent
MESHES = ROOT / "assets" / "meshes"
OUT = ROOT / "outputs" / "viewers"
PAINTED = {
    "spot, painted": ("spot/spot.obj", "a brown and white dairy cow with short fur"),
    "water_bottle, painted": ("water_bottle.glb", "a brushed steel water bottle with a black rubber sleeve"),
    "flight_helmet, painted": (
        "flight_helmet.glb",
        "a 1930s leather flight helmet with brass goggles on a wooden stand",
    ),
    "fox, painted": ("fox.glb", "a red fox with a white chest, realistic fur"),
}
REAL = {f"{name}, real maps": MESHES / f"{name}.glb" for name in ("avocado", "water_bottle", "flight_helmet")}
BALLS = {ball.name: ball for ball in (*DIFFUSE, *METALS)}
#: The view on the sheet; the table has all.
SHOWN = 0
#: Difference images are multiplied by this.
GAIN = 4
TITLES = {
    "cycles": "Cycles",
    "cycles-": "Cycles, no shadows",
    "three": "three.js",
    "three-": "three.js, no occlusion",
    "model-viewer": "<model-viewer>",
}
Judge = Callable[[Scene], list[Pixels]]


def asset(name: str) -> Path:
    """The GLB of a row; painted with the default settings where it is not there."""
    if name in BALLS:
        return BALLS[name].write(OUT)
    if name in REAL:
        return REAL[name]
    file, prompt = PAINTED[name]
    path = (OUT / Path(file).name).with_suffix(".glb")
    if not path.exists():
        paint(MESHES / file, prompt).export(path)
    return path


def compare(scene: Scene, judges: dict[str, Judge]) -> dict[str, tuple[list[Pixels], list[Pixels]]]:
    """Ours and the other's pictures by judge; a judge that fails is left out and named."""
    ours = {False: scene.ours(), True: replace(scene, unoccluded=True).ours()}
    found = {}
    for name, judge in judges.items():
        unoccluded = name.endswith("-")
        try:
            found[name] = ours[unoccluded], judge(replace(scene, unoccluded=unoccluded))
        except JudgeError as error:
            print(f"{name} failed: {error}", file=sys.stderr)
    return found


def cells(figures: Sequence[float]) -> str:
    return " ".join(f"{figure:.1f}" for figure in figures)


def over_grey(image: Pixels) -> Pixels:
    alpha = image[..., 3:].astype(np.float32) / 255
    return (image[..., :3] * alpha + 200 * (1 - alpha) + 0.5).astype(np.uint8)


def difference(a: Pixels, b: Pixels) -> Pixels:
    both = np.minimum(a[..., 3:], b[..., 3:]).astype(np.float32) / 255
    return np.clip(np.abs(a[..., :3].astype(np.float32) - b[..., :3]) * GAIN * both, 0, 255).astype(np.uint8)


def strip(pairs: Sequence[tuple[list[Pixels], list[Pixels]]], view: int) -> Pixels:
    """One row: ours, then of each judge its picture and its difference from ours."""
    tiles = [over_grey(pairs[0][0][view])]
    for ours, theirs in pairs:
        tiles += [over_grey(theirs[view]), difference(ours[view], theirs[view])]
    return np.concatenate(tiles, 1)


def sheet(strips: dict[str, Pixels], columns: Sequence[str], path: Path, halves: int = 1) -> None:
    """Strips below one another, each with its name, in ``halves`` side by side; the columns' names on top."""
    band, gap, font = 18, 16, ImageFont.load_default(12)
    height, width = (band + next(iter(strips.values())).shape[0]), next(iter(strips.values())).shape[1]
    rows = -(-len(strips) // halves)
    out = Image.new("RGB", (halves * (width + gap) - gap, band + rows * height), "white")
    draw = ImageDraw.Draw(out)
    for half in range(halves):
        for i, name in enumerate(columns):
            draw.text((half * (width + gap) + i * width // len(columns) + 4, 2), name, "black", font)
    for i, (name, pixels) in enumerate(strips.items()):
        x, y = i // rows * (width + gap), band + i % rows * height
        draw.text((x + 4, y + 2), name, "black", font)
        out.paste(Image.fromarray(pixels), (x, y + band))
    path.parent.mkdir(parents=True, exist_ok=True)
    out.save(path, quality=88, optimize=True)


def main() -> None:
    names = [*PAINTED, *REAL, *BALLS]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="*", choices=names, default=names, metavar="ROW", help=", ".join(names))
    parser.add_argument("--judges", nargs="*", default=["cycles", "cycles-", "three", "three-"],
                        choices=list(TITLES))  # fmt: skip
    parser.add_argument("--size", type=int, default=160, help="pixels along each side (default: %(default)s)")
    parser.add_argument("--samples", type=int, default=64, help="of Cycles, for each pixel (default: %(default)s)")
    parser.add_argument("--light", default="default", help="'default' or an .hdr file")
    parser.add_argument("--exposure", type=float, default=0.8)
    parser.add_argument("--sheet", type=Path, default=OUT / "sheet.jpg")
    given = parser.parse_args()
    by_cycles = partial(cycles, samples=given.samples)
    all_judges: dict[str, Judge] = {
        "cycles": by_cycles, "cycles-": by_cycles, "three": three, "three-": three, "model-viewer": model_viewer,
    }  # fmt: skip
    judges = {name: all_judges[name] for name in given.judges}
    shown = [name for name in judges if not name.endswith("-")] or given.judges
    # One picture for each row, so that rows can be judged apart: the sheet shows all that are there.
    rows = OUT / "-".join(["rows", str(given.size), *shown])
    rows.mkdir(parents=True, exist_ok=True)
    print(f"light {given.light} at {given.exposure}, {given.size} pixels, views {VIEWS}", file=sys.stderr)
    print(f"| asset | {' | '.join(judges)} |")
    for name in given.only:
        scene = Scene(asset(name), given.light, given.exposure, size=given.size)
        # A sphere neither shades nor mirrors itself.
        wanted = {judge: by for judge, by in judges.items() if name not in BALLS or judge in shown}
        pairs = compare(scene, wanted)
        figures = [cells(list(map(psnr, *pairs[judge]))) if judge in pairs else "" for judge in judges]
        print(f"| {name} | {' | '.join(figures)} |", flush=True)
        same = min(overlap(a, b) for pair in pairs.values() for a, b in zip(*pair, strict=True))
        print(f"{name}: silhouettes overlap by {same:.3f}", file=sys.stderr, flush=True)
        if all(judge in pairs for judge in shown):
            Image.fromarray(strip([pairs[judge] for judge in shown], SHOWN)).save(rows / f"{name}.png")
    strips = {name: np.asarray(Image.open(path)) for name in names if (path := rows / f"{name}.png").exists()}
    columns = ["paintit render", *(title for judge in shown for title in (TITLES[judge], f"difference x{GAIN}"))]
    if strips:
        sheet(strips, columns, given.sheet, halves=2 if len(strips) > 1 else 1)


if __name__ == "__main__":
    main()
