"""The contact sheet of the comparison: a row for each mesh and prompt, a column for each method, the truth first."""

from __future__ import annotations

from pathlib import Path

from cells import Cell
from PIL import Image, ImageDraw, ImageFont
from ruler import subject
from sheet import wrapped

from paintit.export.preview import preview
from paintit.variants import VARIANTS
from reproduction.matrix import Plan
from reproduction.score import TRUTH, maps_of_method

SIZE, VIEWS, MARGIN, HEADER, LABEL = 112, 2, 6, 24, 150


def contact_sheet(plan: Plan, folder: Path, seed: int) -> Image.Image:
    """All prompts of one seed; the meshes take turns, so that each is seen with every fourth prompt."""
    columns = (TRUTH, *plan.variants)
    wide, high = VIEWS * SIZE + MARGIN, SIZE + MARGIN
    cells = [Cell(plan.meshes[i % len(plan.meshes)], prompt, seed) for i, prompt in enumerate(plan.prompts)]
    out = Image.new("RGB", (LABEL + len(columns) * wide, HEADER + len(cells) * high), "white")
    pen, font = ImageDraw.Draw(out), ImageFont.load_default(14)
    for i, name in enumerate(columns):
        pen.text(
            (LABEL + i * wide + 4, 4), VARIANTS[name].title if name in VARIANTS else "true material", "black", font
        )
    for j, cell in enumerate(cells):
        pen.multiline_text((4, HEADER + j * high + 6), wrapped(cell.prompt, font, LABEL - 10), "black", font)
        for i, name in enumerate(columns):
            maps = maps_of_method(plan, folder, name, cell)
            picture = preview(subject(cell.mesh, plan.size).mesh, maps, size=SIZE, views=VIEWS)
            out.paste(picture, (LABEL + i * wide, HEADER + j * high))
    return out
