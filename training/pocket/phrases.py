"""The phrases that name materials: "polished gold", "red fabric with white polka dots", "rusty iron"."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Generic

import numpy as np
from surfaces import (
    FAMILIES,
    OWN_SECOND,
    Material,
    Rng,
    T,
    Split,
    camouflage,
    family,
    family_color,
    finished,
    hide,
    kind_material,
    layer_of,
    over,
    patterned,
    pick,
    rusty,
    scaled,
)
from vocabulary import (
    BAND_SIZES,
    CAMOUFLAGE,
    COLORS,
    COMMON,
    FINISHES,
    HIDES,
    METALS,
    METAL_FINISHES,
    NATURAL,
    PATTERNS,
    SHAPE_SIZES,
    TINTED,
    Color,
    Pattern,
    hex_color,
)

#: Survey names that are materials too ("velvet", "brick", "rust") mean the material.
_COLOR_NAMES = tuple(n for n in COLORS if n not in FAMILIES or n in ("gold", "silver", "chocolate", "jade", "ivory"))


Phrase = tuple[str, str, Material]
"""Noun form ("red plastic"), adjective form ("red plastic", "wooden", "red fabric{n} with white dots"), material."""


class Chooser(Generic[T]):
    """Draws keys by their weights; the running sums are made once."""

    def __init__(self, weights: dict[T, float]) -> None:
        self.keys = tuple(weights)
        self.sums = np.cumsum(list(weights.values()))

    def __call__(self, rng: Rng) -> T:
        return self.keys[int(np.searchsorted(self.sums, rng.random() * self.sums[-1], side="right"))]


_metal_name = Chooser({n: k.weight for n, k in METALS.items()})
_tinted_name = Chooser({n: k.weight for n, k in TINTED.items()})
_natural_name = Chooser({n: k.weight for n, k in NATURAL.items()})
_metal_finish = Chooser(METAL_FINISHES)
_hide_name = Chooser({n: weight for n, (weight, _) in HIDES.items()})
_pattern_index = Chooser({str(i): p.weight for i, p in enumerate(PATTERNS)})
_FINISH_NAMES = tuple(FINISHES)


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


def named(form: str, noun: str) -> str:
    """A phrase's adjective form with a noun in its place: before "with", else at the end."""
    return form.replace("{n}", f" {noun}").strip() if "{n}" in form else f"{form} {noun}"


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
        said = pattern.unsaid[1] and ("{a}" not in words or pattern.kind in OWN_SECOND)
        b = hex_color(pattern.unsaid[1]) if said else scaled(a, 0.5)
        if (
            pattern.kind in OWN_SECOND | {"vertical_stripes"}
            and sum(abs(x - y) for x, y in zip(a, b, strict=True)) < 0.5
        ):
            b = scaled(a, 0.4) if sum(a) > 1 else COLORS["light grey"]
    size = ""
    if "{s}" in words and rng.random() < 0.2:
        size = pick(rng, BAND_SIZES if "stripe" in pattern.kind or pattern.kind == "bands" else SHAPE_SIZES)
    kind = FAMILIES[surface]
    base = layer_of(replace(kind, pattern="", vary=min(kind.vary, 0.12)), rng, a)
    material = patterned(base, pattern.kind, b, rng, size, pattern.share, pattern.scale, kind.bump)
    if "{m}" in words and not words.startswith("{m}") and rng.random() < 0.15:
        finish = pick(rng, ("glossy", "matte", "shiny", "old", "worn"))
        material, words = finished(material, finish, rng), f"{finish} {words}"
    form = words.replace("{a}", one).replace("{b}", two).replace("{m}", surface)
    form = form.replace("{s}", f"{size} " if size else "")
    bare = _LEADING.sub("", " ".join(form.replace("{n}", "").split()))
    return bare, form if "{n}" in form else "{n} with " + form, material  # "polka dots" stand after an object's noun


def camouflage_phrase(rng: Rng) -> Phrase:
    name = pick(rng, tuple(CAMOUFLAGE))
    surface = pick(rng, ("fabric", "fabric", "cloth", "nylon", "paint", "plastic"))
    said = surface if rng.random() < 0.6 else "pattern" if rng.random() < 0.3 else ""
    form = f"{name}{pick(rng, ('camouflage', 'camouflage', 'camo'))} {said}".strip()
    return form, form, camouflage(name, rng, surface)


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


def rust_phrase(rng: Rng) -> Phrase:
    name = pick(rng, ("iron", "steel", "metal", "iron", "steel", "cast iron"))
    text = pick(rng, (f"rusty {name}", f"rusty {name}", f"rusted {name}", f"corroded {name}", f"{name} with rust", f"old rusty {name}"))  # fmt: skip
    return text, text if "with" not in text else f"rusty {name}", rusty(name, rng)


def _patina_words(rng: Rng) -> Phrase:
    name = pick(rng, ("copper", "bronze", "brass"))
    base = finished(family(name, rng), "tarnished", rng).base
    green = (family("verdigris", rng).base, Split("patches", 0.48, 1.0, 0.15))
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


_two_phase = Chooser(
    {
        rust_phrase: 4,
        _patina_words: 1.8,
        _chipped_words: 2.2,
        _painted_words: 0.8,
        _gilded_words: 1.2,
        _grimy_words: 2.5,
    }
)


def two_phase_phrase(rng: Rng) -> Phrase:
    """Rust, verdigris, chipped paint, gilding, worn edges, dirt in crevices, moss and snow on top."""
    return _two_phase(rng)(rng)


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


_phrases = Chooser(
    {
        metal_phrase: 2.6,
        tinted_phrase: 2.6,
        natural_phrase: 2.0,
        two_phase_phrase: 1.5,
        pattern_phrase: 1.2,
        hide_phrase: 0.3,
    }
)


def material_phrase(rng: Rng) -> Phrase:
    """Any material, metals about a quarter."""
    return _phrases(rng)(rng)


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
