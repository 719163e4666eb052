"""Look at the prior by itself: DDIM samples on shapes it never saw, as a grid of pictures and a table of means.

``python sample.py --out grid.png "polished gold" "red plastic"``; without prompts, the showcase and plain materials.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import torch
from captions import HELD_OUT
from PIL import Image, ImageDraw
from probes import ddim
from ruler import PROMPTS
from shapes import FOV, look_at, random_shape, trace
from torch import Tensor

from paintit.color import decode_srgb
from paintit.guidance.pocket import PocketPrior

#: The evaluation's prompts and some more.
SHOWN = (
    *PROMPTS,
    "polished copper",
    "rusty iron",
    "gold coloured plastic",
    "brown leather",
    "moss",
    "an emerald ceramic vase",
    "a tiger",
    "a giraffe",
    "blue and white vertical stripes",
    "a bronze statue of a cow",
    "a yellow rubber duck",
    "white marble",
    "camouflage",
    "green tartan fabric",
    "a red fox",
)


def geometry(
    count: int, seed: int = 99, archetypes: tuple[str, ...] = ("quadruped", "vessel", "ball", "bird")
) -> dict[str, Tensor]:
    """What the prior sees (count, 64, 64, c) of new shapes seen from slightly above."""
    rng = np.random.default_rng(seed)
    seen: list[dict[str, Tensor]] = []
    while len(seen) < count:
        shape = random_shape(rng)
        if shape.archetype != archetypes[len(seen) % len(archetypes)]:
            continue
        angle = torch.tensor([rng.uniform(-0.9, 0.9)], dtype=torch.float32)
        b = trace(shape, look_at(angle, torch.tensor([0.3]), 2.6, FOV))
        mask = b.mask[..., None].float()
        normal = torch.einsum("vij,vhwj->vhwi", b.frame, b.normal) * mask
        seen.append({"normal": normal, "mask": mask, "position": b.position, "normal_object": b.normal})
    return {name: torch.cat([one[name] for one in seen]) for name in seen[0]}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("prompts", nargs="*")
    parser.add_argument("--weights", type=Path)
    parser.add_argument("--scale", type=float, default=3.0)
    parser.add_argument("--steps", type=int, default=20)
    parser.add_argument("--shapes", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("grid.png"))
    a = parser.parse_args()
    torch.set_num_threads(1)
    prior = PocketPrior(a.weights, dtype=torch.bfloat16)
    prompts = a.prompts or [*SHOWN, *sorted(HELD_OUT)]
    shown = prior.encode_geometry(geometry(a.shapes))
    cell, columns = 64, 12
    rows = -(-len(prompts) // columns)
    high = a.shapes * 4 * cell + 58
    sheet = Image.new("RGB", (columns * cell, rows * high), "white")
    pen = ImageDraw.Draw(sheet)
    print(f"{'prompt':44s} base colour (linear)   rough  metal")
    for first in range(0, len(prompts), columns):
        some = prompts[first : first + columns]
        each = [p for p in some for _ in range(a.shapes)]
        x = ddim(prior, each, shown.repeat(len(some), 1, 1, 1), a.seed, a.scale, a.steps)
        mask = (shown[:, 3:4] > 0.9).float().repeat(len(some), 1, 1, 1)
        mean = (x * mask).sum((2, 3)) / mask.sum((2, 3))
        for i, prompt in enumerate(some):
            m = mean[i * a.shapes : (i + 1) * a.shapes].mean(0)
            red, green, blue = decode_srgb(m[3:6]).tolist()
            print(f"{prompt[:44]:44s} ({red:.2f} {green:.2f} {blue:.2f})     {m[6]:.2f}   {m[7]:.2f}")
            left, top = i * cell, (first // columns) * high
            for j in range(a.shapes):
                one = x[i * a.shapes + j]
                for k, part in enumerate((one[:3], one[3:6], one[6:7].expand(3, -1, -1), one[7:8].expand(3, -1, -1))):
                    pixels = (part.permute(1, 2, 0).numpy() * 255).round().astype(np.uint8)
                    sheet.paste(
                        Image.fromarray(pixels).resize((cell, cell), Image.Resampling.NEAREST),
                        (left, top + (j * 4 + k) * cell),
                    )
            for line in range(5):
                pen.text(
                    (left + 1, top + a.shapes * 4 * cell + line * 11), prompt[line * 11 : line * 11 + 11], fill="black"
                )
    sheet.save(a.out)


if __name__ == "__main__":
    main()
