"""Paint six plain words on the two unseen meshes and measure what came out; a table and one picture.

    python training/pocket/evaluate.py [--meshes spot bob] [--only "red plastic" ...] [--seed 0] [--set optim.steps=60 ...]

Statistics are over the texels that some camera can see. "Nearest" is by CIE76 in Lab between the mean base colour and
the true colour of each of the six words. True colours are the words' own: CSS names for the plastics, measured
reflectance for gold, and a white and a black that porcelain and rubber have. Nothing is tuned per word.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
from pathlib import Path

import torch
from PIL import Image, ImageDraw, ImageFont
from torch import Tensor

from paintit.color import decode_srgb, encode_srgb
from paintit.config import PaintConfig, preset
from paintit.export.finish import finish
from paintit.export.preview import preview
from paintit.mesh.mesh import Mesh
from paintit.mesh.read import read_mesh
from paintit.paint.painter import Painter
from paintit.render.geometry import Geometry
from paintit.render.texels import seen
from paintit.texture.maps import TextureMaps

ROOT = Path(__file__).parents[2]
OUT = ROOT / "outputs" / "words"
#: The six words of the check: true base colour (linear) and metalness.
WORDS: dict[str, tuple[Tensor, float]] = {
    "red plastic": (decode_srgb(torch.tensor([1.0, 0.0, 0.0])), 0.0),
    "blue plastic": (decode_srgb(torch.tensor([0.0, 0.0, 1.0])), 0.0),
    "green plastic": (decode_srgb(torch.tensor([0.0, 0.5, 0.0])), 0.0),
    "polished gold": (torch.tensor([1.0, 0.71, 0.29]), 1.0),
    "white porcelain": (decode_srgb(torch.tensor([0.93, 0.92, 0.90])), 0.0),
    "black rubber": (decode_srgb(torch.tensor([0.08, 0.08, 0.08])), 0.0),
}


def lab(linear: Tensor) -> Tensor:
    """Linear Rec. 709 (..., 3) -> CIE L*a*b* under D65."""
    matrix = linear.new_tensor([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    x = linear @ matrix.T / linear.new_tensor([0.9505, 1.0, 1.089])
    f = torch.where(x > 216 / 24389, x.clamp_min(1e-9) ** (1 / 3), (24389 / 27 * x + 16) / 116)
    return torch.stack([116 * f[..., 1] - 16, 500 * (f[..., 0] - f[..., 1]), 200 * (f[..., 1] - f[..., 2])], -1)


def measure(mesh: Mesh, maps: TextureMaps) -> dict[str, list[float] | float | str]:
    """Means over the texels that a camera sees, the nearest word, and the distance to each."""
    visible = seen(mesh, Geometry.from_mesh(mesh), maps.size[0])
    base = maps.base_color[visible].mean(0)
    distance = {word: float((lab(base) - lab(color)).norm()) for word, (color, _) in WORDS.items()}
    return {
        "base_linear": [round(float(c), 3) for c in base],
        "base_srgb": [round(float(c), 3) for c in encode_srgb(base)],
        "roughness": round(float(maps.roughness[visible].mean()), 3),
        "metallic": round(float(maps.metallic[visible].mean()), 3),
        "nearest": min(distance, key=lambda word: distance[word]),
        "delta_e": {word: round(d, 1) for word, d in distance.items()},
    }


def changed(config: PaintConfig, assignments: list[str]) -> PaintConfig:
    """``config`` with ``group.name=JSON`` replaced."""
    for assignment in assignments:
        path, value = assignment.split("=", 1)
        parsed = json.loads(value)
        parsed = tuple(parsed) if isinstance(parsed, list) else parsed
        *groups, name = path.split(".")
        if groups:
            group = getattr(config, groups[0])
            config = dataclasses.replace(config, **{groups[0]: dataclasses.replace(group, **{name: parsed})})
        else:
            config = dataclasses.replace(config, **{name: parsed})
    return config


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--meshes", nargs="*", default=["spot", "bob"])
    parser.add_argument("--only", nargs="*", default=list(WORDS), help="prompts; others than the six are only shown")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--set", nargs="*", default=[], help="settings to change, group.name=JSON")
    parser.add_argument("--out", type=Path, default=OUT, help="without extension: a .png and a .json are written")
    options = parser.parse_args()
    config = dataclasses.replace(changed(preset("pocket"), options.set), seed=options.seed)
    rows, pictures = [], []
    for name in options.meshes:
        path = next((ROOT / "assets" / "meshes").rglob(f"{name}.*"))
        path = path if path.is_file() else path / f"{name}.obj"
        mesh = read_mesh(path)
        for prompt in options.only:
            painter = Painter(mesh, prompt, config)
            seconds = sum(step.seconds for step in painter)
            maps = painter.maps()
            row = {"mesh": name, "prompt": prompt, "seconds": round(seconds, 1), **measure(mesh, maps)}
            rows.append(row)
            print(f"{name:8}{prompt[:42]:44}sRGB {row['base_srgb']}  rough {row['roughness']:.2f}  metal {row['metallic']:.2f}  "
                  f"nearest {row['nearest']:16} {row['seconds']} s", flush=True)  # fmt: skip
            picture = preview(mesh, finish(mesh, maps, painter.support), size=256, views=2)
            ImageDraw.Draw(picture).text((6, 4), prompt, "black", ImageFont.load_default(14))
            pictures.append(picture)
    columns = min(3, len(pictures))
    width, height = pictures[0].size
    sheet = Image.new("RGB", (columns * width, -(-len(pictures) // columns) * height), "white")
    for i, picture in enumerate(pictures):
        sheet.paste(picture, (i % columns * width, i // columns * height))
    options.out.parent.mkdir(parents=True, exist_ok=True)
    sheet.save(options.out.with_suffix(".png"), optimize=True)
    options.out.with_suffix(".json").write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
