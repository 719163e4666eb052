"""Contact sheet of painted cells: a row for each prompt, a column for each mesh and seed, two views of each."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from cells import Cell, load_maps
from PIL import Image, ImageDraw, ImageFont
from ruler import PROMPTS, subject

from paintit.export.preview import preview

VIEWS, MARGIN, HEADER, LABEL = 2, 6, 26, 210


def contact_sheet(folder: Path, cells: Sequence[Cell], size: int = 144) -> Image.Image:
    """Views of ``size`` pixels under the preview's own light. Cells that are missing stay white."""
    order = {prompt: i for i, prompt in enumerate(PROMPTS)}
    prompts = sorted({c.prompt for c in cells}, key=lambda p: (order.get(p, len(order)), p))
    columns = sorted({(c.mesh, c.seed) for c in cells}, key=lambda c: (c[0] != "spot", c))
    wide = VIEWS * size + MARGIN
    out = Image.new("RGB", (LABEL + len(columns) * wide, HEADER + len(prompts) * (size + MARGIN)), "white")
    pen, font = ImageDraw.Draw(out), ImageFont.load_default(15)
    for i, (mesh, seed) in enumerate(columns):
        pen.text((LABEL + i * wide + 4, 5), f"{mesh}, seed {seed}", "black", font)
    for j, prompt in enumerate(prompts):
        pen.multiline_text((4, HEADER + j * (size + MARGIN) + 6), wrapped(prompt, font, LABEL - 12), "black", font)
    for cell in cells:
        maps = load_maps(folder, cell)
        picture = preview(subject(cell.mesh, maps.size[0]).mesh, maps, size=size, views=VIEWS)
        left = LABEL + columns.index((cell.mesh, cell.seed)) * wide
        out.paste(picture, (left, HEADER + prompts.index(cell.prompt) * (size + MARGIN)))
    return out


def wrapped(text: str, font: ImageFont.FreeTypeFont | ImageFont.ImageFont, width: float) -> str:
    """``text`` broken between words into lines of at most ``width`` pixels."""
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        lines = [*lines, word] if font.getlength(longer) > width else [*lines[:-1], longer]
    return "\n".join(lines)
