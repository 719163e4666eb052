"""What `paintit render` shows against what other programs show for the exported file, under one light.

    make judge                      all of it; the table on stdout, the sheet in outputs/viewers
    python -m benchmarks.viewers --only spot fox --judges cycles

Rows: spheres of one material, four painted assets (painted first, where outputs/viewers holds none), and three assets
with real maps. Figures: PSNR in dB of sRGB-coded pixels inside the silhouette, one per view. ``cycles-`` is Cycles
without the asset's shadows on and reflections in itself: what still differs there is the split sum's doing; what it
has over ``cycles`` is the shadows' and reflections'. ``three-`` is three.js without the occlusion textures of the file,
which Blender ignores and we keep but do not show.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
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
    "spot": ("spot/spot.obj", "a brown and white dairy cow with short fur"),
    "water_bottle": ("water_bottle.glb", "a brushed steel water bottle with a black rubber sleeve"),
    "flight_helmet": ("flight_helmet.glb", "a 1930s leather flight helmet with brass goggles on a wooden stand"),
    "fox": ("fox.glb", "a red fox with a white chest, realistic fur"),
}
REAL = {f"{name} (real maps)": MESHES / f"{name}.glb" for name in ("avocado", "water_bottle", "flight_helmet")}
BALLS = {ball.name: ball for ball in (*DIFFUSE, *METALS)}
#: Views on the sheet; the table has all.
SHOWN = (0, 2)
#: Difference images are multiplied by this.
GAIN = 4


def asset(name: str) -> Path:
    """The GLB of a row; painted with the default settings where it is not there."""
    if name in BALLS:
        return BALLS[name].write(OUT)
    if name in REAL:
        return REAL[name]
    path = OUT / f"{name}.glb"
    if not path.exists():
        file, prompt = PAINTED[name]
        paint(MESHES / file, prompt).export(path)
    return path


def compare(scene: Scene, judges: dict[str, Callable[[Scene], list[Pixels]]]) -> dict[str, list[Pixels]]:
    """Pictures by program; a judge that fails is left out and named."""
    found = {"ours": scene.ours()}
    for name, judge in judges.items():
        try:
            found[name] = judge(scene)
        except JudgeError as error:
            print(f"{name} failed: {error}")
    return found


def over_grey(image: Pixels) -> Pixels:
    alpha = image[..., 3:].astype(np.float32) / 255
    return (image[..., :3] * alpha + 200 * (1 - alpha) + 0.5).astype(np.uint8)


def difference(a: Pixels, b: Pixels) -> Pixels:
    both = np.minimum(a[..., 3:], b[..., 3:]).astype(np.float32) / 255
    return np.clip(np.abs(a[..., :3].astype(np.float32) - b[..., :3]) * GAIN * both, 0, 255).astype(np.uint8)


def strip(pictures: dict[str, list[Pixels]], views: Sequence[int]) -> Pixels:
    """One row for each view: ours, each judge, and after each judge its difference from ours."""
    rows = []
    for view in views:
        ours = pictures["ours"][view]
        tiles = [over_grey(ours)]
        for name, images in pictures.items():
            if name != "ours":
                tiles += [over_grey(images[view]), difference(ours, images[view])]
        rows.append(np.concatenate(tiles, 1))
    return np.concatenate(rows, 0)


def sheet(strips: dict[str, Pixels], columns: Sequence[str], path: Path) -> None:
    """Strips below one another, each with its name; the columns' names on top."""
    band, font = 18, ImageFont.load_default(12)
    width = next(iter(strips.values())).shape[1]
    out = Image.new("RGB", (width, band + sum(band + s.shape[0] for s in strips.values())), "white")
    draw = ImageDraw.Draw(out)
    for i, name in enumerate(columns):
        draw.text((i * width // len(columns) + 4, 2), name, "black", font)
    y = band
    for name, pixels in strips.items():
        draw.text((4, y + 2), name, "black", font)
        out.paste(Image.fromarray(pixels), (0, y + band))
        y += band + pixels.shape[0]
    path.parent.mkdir(parents=True, exist_ok=True)
    out.save(path, quality=88, optimize=True)


def main() -> None:
    names = [*BALLS, *PAINTED, *REAL]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="*", choices=names, default=names, metavar="ROW", help=", ".join(names))
    parser.add_argument("--judges", nargs="*", default=["cycles", "cycles-", "three", "three-"],
                        choices=["cycles", "cycles-", "three", "three-", "model-viewer"])  # fmt: skip
    parser.add_argument("--size", type=int, default=256, help="pixels along each side (default: %(default)s)")
    parser.add_argument("--samples", type=int, default=128, help="of Cycles, for each pixel (default: %(default)s)")
    parser.add_argument("--light", default="default", help="'default' or an .hdr file")
    parser.add_argument("--exposure", type=float, default=0.8)
    parser.add_argument("--sheet", type=Path, default=OUT / "sheet.jpg")
    given = parser.parse_args()
    OUT.mkdir(parents=True, exist_ok=True)
    all_judges: dict[str, Callable[[Scene], list[Pixels]]] = {
        "cycles": partial(cycles, samples=given.samples),
        "cycles-": partial(cycles, samples=given.samples, unoccluded=True),
        "three": three,
        "three-": partial(three, unoccluded=True),
        "model-viewer": model_viewer,
    }
    judges = {name: all_judges[name] for name in given.judges}
    print(f"light {given.light} at {given.exposure}, {given.size} pixels, views {VIEWS}")
    strips: dict[str, Pixels] = {}
    table = {}
    for name in given.only:
        scene = Scene(asset(name), given.light, given.exposure, size=given.size)
        pictures = compare(scene, judges)
        ours = pictures["ours"]
        table[name] = {judge: [round(psnr(a, b), 1) for a, b in zip(ours, images, strict=True)]
                       for judge, images in pictures.items() if judge != "ours"}  # fmt: skip
        cells = [f"{judge} {' '.join(f'{value:5.1f}' for value in row)}" for judge, row in table[name].items()]
        same = min(overlap(a, b) for judge in pictures for a, b in zip(ours, pictures[judge], strict=True))
        print(f"{name:26} {'   '.join(cells)}   silhouettes {same:.3f}", flush=True)
        strips[name] = strip(pictures, SHOWN[:1] if name in BALLS else SHOWN)
    columns = ["paintit render", *(title for judge in judges for title in (judge, f"difference x{GAIN}"))]
    sheet(strips, columns, given.sheet)
    given.sheet.with_suffix(".json").write_text(json.dumps(table, indent=1))


if __name__ == "__main__":
    main()
