"""Paint the nine bundled meshes with default settings, judge every GLB, and compose the contact sheet.

    python docs/pictures/showcase.py [--only NAME ...] [--sheet-only] [--sheet FILE.png]

For each: `paintit paint` with its prompt, the Khronos validator, Blender (which images feed which inputs, and a Cycles
render). Needs the `dev` and `judges` extras and `npm ci --prefix tests`. Results go to outputs/showcase/, the sheet to
docs/img/showcase.png.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

ROOT = Path(__file__).parents[2]
MESHES = ROOT / "assets" / "meshes"
OUT = ROOT / "outputs" / "showcase"
SHEET = ROOT / "docs" / "img" / "showcase.png"
#: Name -> mesh file, prompt, azimuth of the picture in degrees.
PAINTS = {
    "spot": ("spot/spot.obj", "a brown and white dairy cow with short fur", 215),
    "bob": ("bob/bob.obj", "an inflatable rubber duck swim ring, glossy vinyl", 330),
    "koala": ("koala.ply", "a koala with thick grey fur", 35),
    "wingnut": ("wingnut.stl", "a rusty steel wing nut", 35),
    "teapot": ("teapot/teapot.obj", "a blue and white porcelain teapot", 35),
    "human": ("human.obj", "a firefighter in uniform", 20),
    "fox": ("fox.glb", "a red fox with a white chest, realistic fur", 45),
    "flight_helmet": (
        "flight_helmet.glb", "a 1930s leather flight helmet with brass goggles on a wooden stand", 35,
    ),
    "spot_quads": ("spot_quads.obj", "a carved wooden toy cow", 215),
}  # fmt: skip


def run(*command: str | Path) -> str:
    """Standard output of a command; its error output passes through.

    Raises:
        CalledProcessError: it failed.
    """
    return subprocess.run([str(c) for c in command], check=True, stdout=subprocess.PIPE, text=True, cwd=ROOT).stdout


def paint(name: str, extra: list[str]) -> dict[str, object]:
    """Paint, validate and open one mesh; what was found."""
    file, prompt, azimuth = PAINTS[name]
    glb, png = OUT / f"{name}.glb", OUT / f"{name}.png"
    start = time.perf_counter()
    run(sys.executable, "-m", "paintit", "paint", MESHES / file, prompt, "-o", glb, "--overwrite", *extra)
    seconds = time.perf_counter() - start
    issues = json.loads(run("node", "tests/validate_gltf.mjs", glb))["issues"]
    blender = run(sys.executable, "docs/pictures/blender_render.py", glb, png, "--azimuth", str(azimuth))
    materials = json.loads(next(line for line in blender.splitlines() if line.startswith("{")))
    record = json.loads((OUT / f"{name}.paintit" / "run.json").read_text())
    return {"prompt": prompt, "wall_seconds": round(seconds, 1), "paint_seconds": round(record["seconds"], 1),
            "errors": issues["numErrors"], "warnings": issues["numWarnings"], "materials": materials}  # fmt: skip


def compose(names: list[str], size: int = 384, columns: int = 3) -> Image.Image:
    """The Blender renders in a grid, each with its prompt below."""
    band = 30
    rows = -(-len(names) // columns)
    sheet = Image.new("RGB", (columns * size, rows * (size + band)), "white")
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(13)
    for i, name in enumerate(names):
        x, y = i % columns * size, i // columns * (size + band)
        sheet.paste(Image.open(OUT / f"{name}.png").convert("RGB").resize((size, size)), (x, y))
        words, lines = PAINTS[name][1].split(), [""]
        for word in words:
            if draw.textlength(f"{lines[-1]} {word}", font) > size - 12:
                lines.append("")
            lines[-1] = f"{lines[-1]} {word}".strip()
        draw.multiline_text((x + 6, y + size + 1), "\n".join(lines[:2]), "black", font, spacing=1)
    return sheet


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", choices=list(PAINTS), default=list(PAINTS))
    parser.add_argument("--sheet-only", action="store_true", help="compose from what is there")
    parser.add_argument("--sheet", type=Path, default=SHEET, help="where the sheet goes (default: %(default)s)")
    options, extra = parser.parse_known_args()
    OUT.mkdir(parents=True, exist_ok=True)
    for name in [] if options.sheet_only else options.only:
        found = paint(name, extra)
        (OUT / f"{name}.json").write_text(json.dumps(found, indent=1))
        print(f"{name:14} paint {found['paint_seconds']:6} s, all {found['wall_seconds']:6} s, "
              f"validator {found['errors']} errors {found['warnings']} warnings, "
              f"{len(found['materials'])} materials in Blender", flush=True)  # fmt: skip
    wanted = options.only if options.sheet_only else PAINTS
    options.sheet.parent.mkdir(parents=True, exist_ok=True)
    compose([name for name in PAINTS if name in wanted and (OUT / f"{name}.json").exists()]).save(
        options.sheet, optimize=True
    )
    print(options.sheet)


if __name__ == "__main__":
    main()
