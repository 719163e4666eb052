"""Materials and the phrases that name them: "polished gold", "red fabric with white polka dots", "rusty iron".

A ``Material`` is a base layer and up to three overlays, each laid where its split says. Where a split is canonical the
words alone decide its scale and share; only the random kinds draw theirs.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
from vocabulary import (
    ANIMALS,
    BAND_SIZES,
    CAMOUFLAGE,
    CANONICAL,
    COLORS,
    COMMON,
    FAMILY_COLORS,
    FINISHES,
    HIDES,
    METAL_FINISHES,
    METALS,
    NATURAL,
    PATTERNS,
    SHAPE_SIZES,
    SHARES,
    SIZES,
    TINTED,
    Coat,
    Color,
    Kind,
    Pattern,
    coded,
    hex_color,
)

Rng = np.random.Generator
T = TypeVar("T")
#: Splits by part or by geometry, whose layers keep their own finish.
PART_SPLITS = frozenset({"belly", "limbs", "head", "accent", "top", "limbs_accent"})
#: Patterns whose overlay has a colour of its own (mortar, rims) whatever the base's.
_OWN_SECOND = frozenset({"bricks", "tiles", "veins", "cells", "cracks", "planks", "herringbone"})
_FAMILIES: dict[str, Kind] = {**TINTED, **NATURAL, **METALS}
#: Survey names that are materials too ("velvet", "brick", "rust") mean the material.
_COLOR_NAMES = tuple(n for n in COLORS if n not in _FAMILIES or n in ("gold", "silver", "chocolate", "jade", "ivory"))


@dataclass(frozen=True)
class Layer:
    """One surface: sRGB-coded colours, the second mixed in by noise of strength ``vary`` and frequency ``grain``."""

    color: Color
    second: Color
    vary: float
    grain: float
    rough: float
    metal: float
    rough_vary: float = 0.05


@dataclass(frozen=True)
class Split:
    """Where an overlay lies: kind, share of the surface (0..1), frequency factor (1 usual, more is finer), edge softness."""

    kind: str
    share: float = 0.4
    scale: float = 1.0
    soft: float = 0.05


@dataclass(frozen=True)
class Material:
    """Base layer, overlays in order, and bump strength."""

    base: Layer
    overlays: tuple[tuple[Layer, Split], ...] = field(default=())
    bump: float = 0.0


Phrase = tuple[str, str, Material]
"""Noun form ("red plastic"), adjective form ("red plastic", "wooden", "red fabric{n} with white dots"), material."""


def pick(rng: Rng, options: Sequence[T]) -> T:
    """One of a sequence."""
    return options[int(rng.random() * len(options))]


class Chooser:
    """Draws names by their weights; the running sums are made once."""

    def __init__(self, weights: dict[str, float]) -> None:
        self.names = tuple(weights)
        self.sums = np.cumsum(list(weights.values()))

    def __call__(self, rng: Rng) -> str:
        return self.names[int(np.searchsorted(self.sums, rng.random() * self.sums[-1], side="right"))]


_metal_name = Chooser({n: k.weight for n, k in METALS.items()})
_tinted_name = Chooser({n: k.weight for n, k in TINTED.items()})
_natural_name = Chooser({n: k.weight for n, k in NATURAL.items()})
_metal_finish = Chooser(METAL_FINISHES)
_hide_name = Chooser({n: weight for n, (weight, _) in HIDES.items()})
_pattern_index = Chooser({str(i): p.weight for i, p in enumerate(PATTERNS)})
_FINISH_NAMES = tuple(FINISHES)


def clipped(value: float, low: float = 0.01, high: float = 0.99) -> float:
    return float(min(max(value, low), high))


def jittered(color: Color, rng: Rng, amount: float = 0.008) -> Color:
    """The colour a little off, normally by ``amount`` of sRGB: a colour word means one colour."""
    a, b, c = rng.normal(0, amount, 3)
    return clipped(color[0] + a), clipped(color[1] + b), clipped(color[2] + c)


def scaled(color: Color, value: float) -> Color:
    return clipped(color[0] * value), clipped(color[1] * value), clipped(color[2] * value)


def blended(a: Color, b: Color, t: float) -> Color:
    return a[0] + (b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t, a[2] + (b[2] - a[2]) * t


def decoded(color: Color) -> Color:
    """sRGB-coded -> linear."""
    r, g, b = (v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in color)
    return r, g, b


def around(mean: Color, dark: Color, share: float) -> Color:
    """The base colour that, with a ``share`` of ``dark`` over it, has ``mean`` as its linear mean."""
    r, g, b = (clipped((m - share * d) / (1 - share)) for m, d in zip(decoded(mean), decoded(dark), strict=True))
    return coded((r, g, b))


def color_word(rng: Rng) -> tuple[str, Color]:
    """A colour name: more often than not a common one, else any CSS or xkcd name."""
    name = pick(rng, COMMON) if rng.random() < 0.6 else pick(rng, _COLOR_NAMES)
    return name, COLORS[name]


def two_colors(rng: Rng) -> tuple[tuple[str, Color], tuple[str, Color]]:
    """Two colour names that can be told apart; black and white more often than chance."""
    if rng.random() < 0.12:
        pair = ("black", COLORS["black"]), ("white", COLORS["white"])
        return pair if rng.random() < 0.5 else (pair[1], pair[0])
    one = color_word(rng)
    for _ in range(8):
        two = ("white", COLORS["white"]) if rng.random() < 0.15 else color_word(rng)
        if sum(abs(x - y) for x, y in zip(one[1], two[1], strict=True)) > 0.6:
            return one, two
    return one, ("white", COLORS["white"]) if sum(one[1]) < 1.8 else ("black", COLORS["black"])


def split(kind: str, rng: Rng, share: float | None = None, scale: float = 1.0, soft: float = 0.04) -> Split:
    """A split with the usual share of its kind; canonical kinds draw nothing."""
    factor = 1.0 if kind in CANONICAL else float(rng.uniform(0.75, 1.35))
    return Split(kind, SHARES.get(kind, 0.4) if share is None else share, scale * factor, soft)


def layer_of(kind: Kind, rng: Rng, color: Color | None = None) -> Layer:
    """A family's plain surface without its pattern, in ``color`` or in one of its own."""
    base = jittered(hex_color(pick(rng, kind.colors)) if color is None else color, rng)
    own = bool(kind.second) and color is None and not kind.pattern
    second = hex_color(pick(rng, kind.second)) if own else scaled(base, 0.75 if kind.pattern else 0.65)
    return Layer(
        base, second, kind.vary, kind.grain * rng.uniform(0.7, 1.4), float(rng.uniform(*kind.rough)), kind.metal
    )


def kind_material(kind: Kind, rng: Rng, color: Color | None = None) -> Material:
    """The material of a family, with its own pattern."""
    if kind.pattern == "camouflage":
        return camouflage("", rng)
    layer = layer_of(kind, rng, color)
    if not kind.pattern:
        return Material(layer, bump=kind.bump)
    share = SHARES.get(kind.pattern, 0.4) if kind.share is None else kind.share
    if kind.pattern == "grain":
        dark = scaled(layer.color, 0.58)
        base = around(layer.color, dark, share)
        layer, second = replace(layer, color=base, second=scaled(base, 0.85)), dark
    elif kind.second and (color is None or kind.pattern in _OWN_SECOND):
        second = hex_color(pick(rng, kind.second))
    else:
        second = scaled(layer.color, 0.5)
    metal = 0.0 if kind.pattern in _OWN_SECOND else kind.metal
    other = replace(layer, color=jittered(second, rng), second=scaled(second, 0.8), metal=metal)
    return Material(layer, ((other, split(kind.pattern, rng, share, kind.scale)),), kind.bump)


def family(name: str, rng: Rng, color: str = "") -> Material:
    """The material of a named family, in a named colour (as that family has it) or in its own."""
    kind = _FAMILIES[name]
    if not color:
        return kind_material(kind, rng)
    return kind_material(kind, rng, family_color(name, color))


def family_color(name: str, color: str, value: Color | None = None) -> Color:
    """What a colour word means on a family."""
    code = FAMILY_COLORS.get((name, color))
    return hex_color(code) if code else (value or COLORS[color])


def finished(material: Material, word: str, rng: Rng) -> Material:
    """Apply a finish word to every layer that is not a part overlay."""
    rule = FINISHES[word]
    low, high = rule.get("low"), rule.get("high")
    stated = float(rng.uniform(low, high)) if low is not None and high is not None else None

    def change(layer: Layer) -> Layer:
        rough = layer.rough + rule.get("offset", 0.0) if stated is None else stated
        color, second = (scaled(c, rule.get("value", 1.0)) for c in (layer.color, layer.second))
        if "dust" in rule:
            color, second = (blended(c, (0.72, 0.69, 0.64), rule["dust"]) for c in (color, second))
        return replace(
            layer,
            color=color,
            second=second,
            rough=clipped(rough, 0.05, 0.98),
            metal=layer.metal * (1 - 0.6 * rule.get("dust", 0.0)),
            vary=min(0.8, layer.vary + rule.get("vary", 0.0)),
            rough_vary=(0.05 if stated is None else 0.03) + 0.2 * rule.get("vary", 0.0),
        )

    overlays = tuple((change(layer) if s.kind not in PART_SPLITS else layer, s) for layer, s in material.overlays)
    if "crack" in rule:
        dark = scaled(material.base.color, 0.3)
        crack = change(replace(material.base, color=dark, second=scaled(dark, 0.7)))
        overlays = (*overlays[:2], (crack, split("cracks", rng, soft=0.02)))
    return Material(change(material.base), overlays, max(material.bump, rule.get("bump", 0.0)))


def over(material: Material, other: Material, kind: str, share: float = 0.5, soft: float = 0.03) -> Material:
    """``other``'s base laid over ``material`` where ``kind`` says."""
    return replace(material, overlays=(*material.overlays[:2], (other.base, Split(kind, share, 1.0, soft))))


def named(form: str, noun: str) -> str:
    """A phrase's adjective form with a noun in its place: before "with", else at the end."""
    return form.replace("{n}", f" {noun}").strip() if "{n}" in form else f"{form} {noun}"


def patterned(base: Layer, kind: str, value: Color, rng: Rng, size: str = "", share: float | None = None,
              scale: float = 1.0, bump: float = 0.0) -> Material:  # fmt: skip
    """A pattern of one colour over a base layer, as large as ``size`` says."""
    other = replace(base, color=jittered(value, rng), second=scaled(value, 0.8))
    return Material(base, ((other, split(kind, rng, share, scale * SIZES.get(size, 1.0))),), bump)


def pattern_phrase(rng: Rng) -> Phrase:
    """One of the patterns in one of its wordings."""
    if rng.random() < 0.045:
        return camouflage_phrase(rng)
    pattern = PATTERNS[int(_pattern_index(rng))]
    words = pick(rng, pattern.words)
    return phrase_of(pattern, words, rng)


#: What joins a pattern to an object's noun, left out where there is none.
_LEADING = re.compile(r"^(?:with an? |with |covered in |built of |made of |knitted from )")


def phrase_of(pattern: Pattern, words: str, rng: Rng) -> Phrase:
    """A wording filled in and what it means."""
    surface = pick(rng, pattern.surfaces) if "{m}" in words else pattern.surfaces[0]
    if "fur" in pattern.surfaces[:1] and "{m}" not in words and rng.random() < 0.3:
        surface = "fabric"  # "zebra stripes" need not be an animal's
    (one, a), (two, b) = two_colors(rng) if "{b}" in words else (color_word(rng), ("", (0.0, 0.0, 0.0)))
    a = family_color(surface, one, a) if "{a}" in words else hex_color(pattern.unsaid[0])
    if "{b}" not in words:
        said = pattern.unsaid[1] and ("{a}" not in words or pattern.kind in _OWN_SECOND)
        b = hex_color(pattern.unsaid[1]) if said else scaled(a, 0.5)
        if (
            pattern.kind in _OWN_SECOND | {"vertical_stripes"}
            and sum(abs(x - y) for x, y in zip(a, b, strict=True)) < 0.5
        ):
            b = scaled(a, 0.4) if sum(a) > 1 else COLORS["light grey"]
    size = ""
    if "{s}" in words and rng.random() < 0.3:
        size = pick(rng, BAND_SIZES if "stripe" in pattern.kind or pattern.kind == "bands" else SHAPE_SIZES)
    kind = _FAMILIES[surface]
    base = layer_of(replace(kind, pattern="", vary=min(kind.vary, 0.12)), rng, a)
    material = patterned(base, pattern.kind, b, rng, size, pattern.share, pattern.scale, kind.bump)
    if "{m}" in words and not words.startswith("{m}") and rng.random() < 0.15:
        finish = pick(rng, ("glossy", "matte", "shiny", "old", "worn"))
        material, words = finished(material, finish, rng), f"{finish} {words}"
    form = words.replace("{a}", one).replace("{b}", two).replace("{m}", surface)
    form = form.replace("{s}", f"{size} " if size else "")
    bare = _LEADING.sub("", " ".join(form.replace("{n}", "").split()))
    return bare, form if "{n}" in form else "{n} with " + form, material  # "polka dots" stand after an object's noun


def camouflage(name: str, rng: Rng, surface: str = "fabric") -> Material:
    """Blotches of two colours over a third."""
    base, one, two = (hex_color(code) for code in CAMOUFLAGE[name])
    layer = replace(layer_of(_FAMILIES[surface], rng, base), vary=0.05)
    first, second = (replace(layer, color=c, second=scaled(c, 0.85)) for c in (one, two))
    return Material(
        layer,
        ((first, split("patches", rng, 0.32, 1.4)), (second, split("camouflage", rng, 0.3, 1.4))),
        _FAMILIES[surface].bump,
    )


def camouflage_phrase(rng: Rng) -> Phrase:
    name = pick(rng, tuple(CAMOUFLAGE))
    surface = pick(rng, ("fabric", "fabric", "cloth", "nylon", "paint", "plastic"))
    said = surface if rng.random() < 0.6 else "pattern" if rng.random() < 0.3 else ""
    form = f"{name}{pick(rng, ('camouflage', 'camouflage', 'camo'))} {said}".strip()
    return form, form, camouflage(name, rng, surface)


def coat_material(coat: Coat, rng: Rng, color: Color | None = None, parts: bool = True) -> Material:
    """An animal's own look, or with its base colour replaced; without ``parts`` its hide alone."""
    kind = TINTED.get(coat.surface) or NATURAL.get(coat.surface) or Kind((0.2, 0.34), vary=0.15)
    value = hex_color(pick(rng, coat.colors)) if color is None else color
    if coat.second and color is None:
        plain = layer_of(replace(kind, pattern=""), rng, value)
        dark = jittered(hex_color(pick(rng, coat.second)), rng)
        other = replace(plain, color=dark, second=scaled(dark, 0.7))
        material = Material(plain, ((other, split(coat.pattern, rng, coat.share, coat.scale)),), kind.bump)
    else:
        material = kind_material(kind, rng, value)
    for kind_name, code in (("belly", coat.belly), ("limbs", coat.limbs), ("accent", coat.accent)) if parts else ():
        if code and (color is None or kind_name == "accent") and len(material.overlays) < 3:
            part = hex_color(code)
            layer = replace(material.base, color=part, second=scaled(part, 0.75))
            if kind_name == "accent":
                layer = replace(layer, rough=float(rng.uniform(0.3, 0.45)), vary=0.05)
            material = replace(material, overlays=(*material.overlays, (layer, Split(kind_name, 0.3, 1.0, 0.1))))
    return material


def hide(name: str, rng: Rng) -> Material:
    """An animal's coat as a material: "leopard fur"."""
    return coat_material(ANIMALS[name], rng, parts=False)


def hide_phrase(rng: Rng) -> Phrase:
    name = _hide_name(rng)
    text = f"{name} {pick(rng, HIDES[name][1])}"
    return text, text, hide(name, rng)


def metal_phrase(rng: Rng) -> Phrase:
    name = _metal_name(rng)
    material = kind_material(METALS[name], rng)
    if rng.random() < 0.6:
        word = _metal_finish(rng)
        text = f"{word} {name}"
        return text, text, finished(material, word, rng)
    return name, "golden" if name == "gold" and rng.random() < 0.3 else name, material


def rusty(name: str, rng: Rng, share: float | None = None) -> Material:
    """A metal with rust over 0.4 to 0.7 of it."""
    metal, rust = family(name, rng), family("rust", rng)
    base = replace(metal.base, rough=float(rng.uniform(0.42, 0.58)), color=scaled(metal.base.color, 0.85))
    where = Split("patches", rng.uniform(0.4, 0.7) if share is None else share, rng.uniform(0.8, 1.6), 0.12)
    return Material(base, ((rust.base, where),), 0.2)


def rust_phrase(rng: Rng) -> Phrase:
    name = pick(rng, ("iron", "steel", "metal", "iron", "steel", "cast iron"))
    text = pick(rng, (f"rusty {name}", f"rusty {name}", f"rusted {name}", f"corroded {name}", f"{name} with rust", f"old rusty {name}"))  # fmt: skip
    return text, text if "with" not in text else f"rusty {name}", rusty(name, rng)


def _patina_words(rng: Rng) -> Phrase:
    name = pick(rng, ("copper", "bronze", "brass"))
    base = finished(family(name, rng), "tarnished", rng).base
    green = (family("verdigris", rng).base, Split("patches", rng.uniform(0.35, 0.6), 1.1, 0.15))
    text = pick(rng, (f"{name} with green patina", f"oxidised {name}", f"weathered {name}", f"{name} with verdigris", f"patinated {name}"))  # fmt: skip
    return text, f"weathered {name}", Material(base, (green,), 0.1)


def _chipped_words(rng: Rng) -> Phrase:
    color, value = color_word(rng)
    paint = kind_material(TINTED["paint"], rng, value)
    under = family(pick(rng, ("steel", "iron", "rust", "wood")), rng)
    name = "wood" if under.base.metal == 0 and rng.random() < 0.5 else "metal"
    under = family("wood", rng) if name == "wood" else under
    if rng.random() < 0.5:
        text = pick(rng, (f"chipped {color} paint on {name}", f"{color} painted {name}, chipped", f"{name} with peeling {color} paint", f"worn {color} painted {name}"))  # fmt: skip
        return text, f"chipped {color} painted {name}", Material(paint.base, ((under.base, Split("patches", 0.22, 1.3, 0.03)),), 0.05)  # fmt: skip
    text = pick(rng, (f"{color} painted {name} with worn edges", f"{color} paint worn at the edges", f"{color} painted {name}, edges worn bare"))  # fmt: skip
    return text, f"edge worn {color} painted {name}", Material(paint.base, ((under.base, Split("edges", 0.4, 1.0, 0.03)),), 0.03)  # fmt: skip


def _painted_words(rng: Rng) -> Phrase:
    color, value = color_word(rng)
    text = f"{color} painted {pick(rng, ('metal', 'steel', 'iron', 'wood'))}"
    return text, text, kind_material(TINTED["paint"], rng, value)


def _gilded_words(rng: Rng) -> Phrase:
    gold = family("gold", rng).base
    if rng.random() < 0.5:
        return "wood with gold leaf", "gilded wooden", Material(family("wood", rng).base, ((gold, Split("patches", 0.4, 1.0, 0.05)),))  # fmt: skip
    _, form, material = tinted_phrase(rng)
    metal = metal_phrase(rng)
    text = f"{form}{{n}} with {metal[1]} edges"
    return text.replace("{n}", ""), text, over(material, metal[2], "edges", 0.5)


def _grimy_words(rng: Rng) -> Phrase:
    """Dirt where it gathers, growth and snow where they fall."""
    _, form, material = plain_phrase(rng)
    if rng.random() < 0.45:
        text = (
            form + "{n}" + pick(rng, (" with {d} in the crevices", " with {d} in the corners", ", {d} in the cracks"))
        )
        word = pick(rng, ("dirt", "dirt", "mud", "rust", "moss"))
        text = text.replace("{d}", word)
        return text.replace("{n}", ""), text, over(material, family(word, rng), "crevices", 0.5, 0.1)
    word = pick(rng, ("moss", "snow", "dust", "sand", "frost", "grass", "lichen", "snow", "moss", "ash"))
    top = family({"dust": "ash"}.get(word, word), rng)
    if word == "dust":
        top = Material(replace(top.base, color=(0.72, 0.69, 0.64), second=(0.6, 0.57, 0.53)))
    text = form + "{n}" + pick(rng, (" with {d} on top", " covered in {d}", " topped with {d}", " with {d} on it"))
    return (
        text.replace("{n}", "").replace("{d}", word),
        text.replace("{d}", word),
        over(material, top, "up", 0.6 if "covered" in text else 0.45, 0.05),
    )


_two_phase = Chooser({"rust": 4, "patina": 1.8, "chipped": 2.2, "painted": 0.8, "gilded": 1.2, "grimy": 2.5})
_TWO_PHASE: dict[str, Callable[[Rng], Phrase]] = {
    "rust": rust_phrase,
    "patina": _patina_words,
    "chipped": _chipped_words,
    "painted": _painted_words,
    "gilded": _gilded_words,
    "grimy": _grimy_words,
}


def two_phase_phrase(rng: Rng) -> Phrase:
    """Rust, verdigris, chipped paint, gilding, worn edges, dirt in crevices, moss and snow on top."""
    return _TWO_PHASE[_two_phase(rng)](rng)


def tinted_phrase(rng: Rng) -> Phrase:
    """ "<finish> <colour> <material>"."""
    name = _tinted_name(rng)
    kind = TINTED[name]
    form = kind.adjective or name
    if rng.random() < 0.8:
        color, value = color_word(rng)
        material, noun, form = (
            kind_material(kind, rng, family_color(name, color, value)),
            f"{color} {name}",
            f"{color} {form}",
        )
    else:
        material, noun = kind_material(kind, rng), name
    if rng.random() < 0.3 and name not in ("fur", "satin"):
        word = pick(rng, _FINISH_NAMES)
        material = finished(material, word, rng)
        noun, form = f"{word} {noun}", f"{word} {form}"
    return noun, form, material


def natural_phrase(rng: Rng) -> Phrase:
    name = _natural_name(rng)
    kind = NATURAL[name]
    material = kind_material(kind, rng)
    form = kind.adjective or name
    if kind.pattern == "grain" and rng.random() < 0.45:
        grain = pick(rng, ("{n} with visible grain", "{n} with wood grain", "{n} with a visible wood grain", "{n} with dark grain lines", "{n} with a strong grain"))  # fmt: skip
        return name + grain.replace("{n}", ""), form + grain, material
    if kind.pattern == "grain" and rng.random() < 0.1:
        return f"{form} grain", f"{form} grained", material
    if rng.random() < 0.3:
        word = pick(rng, _FINISH_NAMES)
        return f"{word} {name}", f"{word} {form}", finished(material, word, rng)
    return name, form, material


_phrases = Chooser({"metal": 2.6, "tinted": 2.6, "natural": 2.0, "two": 1.5, "pattern": 1.2, "hide": 0.3})
_PHRASES: dict[str, Callable[[Rng], Phrase]] = {
    "metal": metal_phrase,
    "tinted": tinted_phrase,
    "natural": natural_phrase,
    "two": two_phase_phrase,
    "pattern": pattern_phrase,
    "hide": hide_phrase,
}


def material_phrase(rng: Rng) -> Phrase:
    """Any material, metals about a quarter."""
    return _PHRASES[_phrases(rng)](rng)


def plain_phrase(rng: Rng) -> Phrase:
    """A material that fits a second place in a sentence: "with brass buttons"."""
    noun, form, material = pick(rng, (metal_phrase, tinted_phrase, natural_phrase))(rng)
    return noun, form if "{n}" not in form else noun, material


def article(text: str, rng: Rng) -> str:
    """ "a", "the" or none before ``text``; ``spelt`` makes "an" of it."""
    draw = rng.random()
    if draw < 0.7:
        return "a " + text
    return f"the {text}" if draw < 0.78 else text


_VOWEL = re.compile(r"\ba (?=[aeiou])(?!uni|one|eu)")


def spelt(text: str) -> str:
    """Single spaces, and "an" before a vowel."""
    return _VOWEL.sub("an ", " ".join(text.split()))
