"""One HTML page of an evaluation with its pictures inside: nothing is fetched when it is opened."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from html import escape
from importlib import resources
from string import Template

from PIL import Image

from paintit.evaluate.measure import Evaluation, Painted
from paintit.evaluate.protocol import Protocol, pictures
from paintit.evaluate.scores import Scores

#: Pixels of each small picture, and which of the protocol's views are shown.
THUMBNAIL, SHOWN = 192, 4


@dataclass(frozen=True)
class Meaning:
    """What a score is, in words, and what is good: ``low``, ``high``, a number, or "" where nothing is."""

    text: str
    best: str | float = ""


#: By the first word of a score's name.
MEANINGS = {
    "fid": Meaning("Frechet distance from the reference's pictures; depends on how many there are", "low"),
    "kid": Meaning("kernel distance from the reference's pictures; does not depend on how many there are", "low"),
    "cmmd": Meaning("CLIP maximum mean discrepancy from the reference's pictures", "low"),
    "score": Meaning("CLIP score: 100 times the cosine between views and prompt", "high"),
    "seam": Meaning("colour difference across UV seams over that across other edges; up to 1 it cannot be seen", "low"),
    "saturation": Meaning("mean chroma C*ab of the base colour: 0 for greys, about 100 for the primaries"),
    "saturation_ratio": Meaning("mean chroma of the base colour over the truth's", 1.0),
    "flatness": Meaning("correlation of the base colour with the light on it; light that is baked in is positive", 0.0),
    "janus": Meaning("how much of one side recurs on the others; read it only where the prompt has a front", "low"),
    "delta_e": Meaning("CIEDE2000 between mean base colours; with _pixels, the mean over pixels", "low"),
    "roughness_error": Meaning("difference of mean roughness from the truth", "low"),
    "metallic_error": Meaning("difference of mean metalness from the truth", "low"),
    "relighting": Meaning("mean difference from the truth's pictures under the held-out light, 0 to 1", "low"),
}


def meaning(score: str) -> Meaning:
    """What the score of that name is."""
    found = MEANINGS.get(score) or next((m for start, m in MEANINGS.items() if score.startswith(start)), Meaning(""))
    return replace(found, text=f"{found.text}, under the second light") if score.endswith("_relit") else found


def page(result: Evaluation, painted: Sequence[Painted]) -> str:
    """The whole page.

    Args:
        painted: the assets, in the order of ``result.assets``.
    """
    template = Template((resources.files("paintit.evaluate") / "page.html").read_text("utf-8"))
    rows = [
        ((a.set, a.name), _thumbnails(each, result.protocol), a.prompt, a.scores)
        for a, each in zip(result.assets, painted, strict=True)
    ]
    names = list(dict.fromkeys(name for *_, scores in rows for name in scores))
    set_names = list(dict.fromkeys(name for s in result.sets for name in s.scores))
    return template.substitute(
        summary=escape(_summary(result)),
        notes="".join(f"<p class=note>{escape(note)}</p>" for note in result.notes),
        set_head=_head(set_names, ("set", "assets")),
        set_rows="".join(
            f"<tr><th>{escape(s.name)}</th><td data-v={s.assets}>{s.assets}</td>{cells}</tr>"
            for s, cells in zip(result.sets, _cells([s.scores for s in result.sets], set_names), strict=True)
        ),
        asset_head=_head(names, ("asset", "views")),
        asset_rows="".join(
            f"<tr><th>{escape(name)}<small>{escape(in_set)}{f' · {escape(prompt)}' if prompt else ''}</small></th>"
            f"<td class=views>{images}</td>{cells}</tr>"
            for ((in_set, name), images, prompt, _), cells in zip(
                rows, _cells([scores for *_, scores in rows], names), strict=True
            )
        ),
        glossary="".join(
            f"<dt>{escape(name)}</dt><dd>{escape(_words(meaning(name)))}</dd>"
            for name in dict.fromkeys([*set_names, *names])
        ),
    )


def number(value: float | None) -> str:
    """Three significant digits, and all that stand before the point."""
    if value is None:
        return "–"
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def _summary(result: Evaluation) -> str:
    p = result.protocol
    reference = f"; reference {result.reference}, {result.reference_pictures} pictures" if result.reference else ""
    return (
        f"Network {result.network}; {p.views} views of {p.size} pixels, {' and '.join(f'{e:g}' for e in p.elevations)} "
        f"degrees from above, light {p.light}, second light {p.relight}, grey {p.background:g}{reference}."
    )


def _words(said: Meaning) -> str:
    aim = f"{said.best:g} is good" if isinstance(said.best, float) else said.best and f"{said.best} is good"
    return f"{said.text}; {aim}" if aim else said.text


def _head(names: Iterable[str], first: tuple[str, ...]) -> str:
    sortable = "".join(f"<th><button>{name}</button></th>" for name in first)
    plain = sortable.replace("<th><button>views</button></th>", "<th class=views>views</th>")
    return plain + "".join(f"<th><button title='{escape(_words(meaning(n)))}'>{escape(n)}</button></th>" for n in names)


def _cells(rows: Sequence[Scores], names: Sequence[str]) -> list[str]:
    """The cells of each row; the best of several values is marked."""
    best = {name: _best(name, [row.get(name) for row in rows]) for name in names}
    return [
        "".join(
            f"<td{' class=best' if value is not None and value == best[name] else ''}"
            f" data-v={'' if value is None else value}>{number(value)}</td>"
            for name in names
            for value in [row.get(name)]
        )
        for row in rows
    ]


def _best(name: str, values: Sequence[float | None]) -> float | None:
    known, aim = [v for v in values if v is not None], meaning(name).best
    if len(set(known)) < 2 or aim == "":
        return None
    if isinstance(aim, float):
        return min(known, key=lambda v: abs(v - aim))
    return min(known) if aim == "low" else max(known)


def _thumbnails(painted: Painted, protocol: Protocol) -> str:
    cameras = protocol.cameras()
    first = [int((k + 0.5) * protocol.ring / SHOWN) for k in range(SHOWN)]
    small = replace(protocol, size=THUMBNAIL)
    return "".join(
        f"<img width={THUMBNAIL // 2} height={THUMBNAIL // 2} alt='' src='{_data(image)}'>"
        for i in first
        for image in pictures(painted.mesh, painted.maps, small, cameras[i : i + 1])
    )


def _data(pixels: object) -> str:
    """The picture as a data URL."""
    out = io.BytesIO()
    Image.fromarray(pixels).save(out, "WEBP", quality=88)  # type: ignore[arg-type]
    return f"data:image/webp;base64,{base64.b64encode(out.getvalue()).decode()}"
