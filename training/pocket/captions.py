"""Sentences and the materials they mean: ``random_caption(rng, archetype)`` -> (caption, Material).

Stated materials always win over what an object is usually made of, and word order matters: "gold coloured plastic" is
plastic; in "A with B dots" and in "A and B checks" the first colour is the base's.
"""

from __future__ import annotations

import re
from functools import cache

import numpy as np
from phrases import (
    Phrase,
    article,
    color_word,
    hide_phrase,
    material_phrase,
    metal_phrase,
    named,
    pattern_phrase,
    plain_phrase,
    rust_phrase,
    spelt,
)
from surfaces import (
    Material,
    Rng,
    family_color,
    finished,
    kind_material,
    over,
    pick,
)
from subjects import animal_caption, inflatable_caption, person_caption, produce_caption, tree_caption
from vocabulary import (
    ANIMALS,
    CAMOUFLAGE,
    COLORS,
    COMMON,
    FINISHES,
    FUR_WORDS,
    HIDES,
    METAL_FINISHES,
    METALS,
    NATURAL,
    OBJECTS,
    PATTERNS,
    PEOPLE,
    PRODUCE,
    SHARES,
    SIZES,
    TINTED,
)


#: Sentences of the showcase, never trained on.
HELD_OUT = frozenset(
    {
        "a brown and white dairy cow with short fur",
        "an inflatable rubber duck swim ring, glossy vinyl",
        "a koala with thick grey fur",
        "a rusty steel wing nut",
        "a blue and white porcelain teapot",
        "a firefighter in uniform",
        "a red fox with a white chest, realistic fur",
        "a 1930s leather flight helmet with brass goggles on a wooden stand",
        "a carved wooden toy cow",
    }
)
_OBJECT_NAMES = tuple(OBJECTS)
ARCHETYPES = tuple(sorted({a for _, where in OBJECTS.values() for a in where.split()} - {"*"}))
#: Nouns that say nothing of what the thing is made of.
_GENERIC = frozenset({"toy", "thing", "shape", "object", "model", "ornament", "sculpture", "figurine", "statue"})
_NOUNS = (*OBJECTS, *ANIMALS)


@cache
def _fitting(archetype: str) -> tuple[str, ...]:
    """Objects that have an archetype's shape."""
    return tuple(n for n, (_, where) in OBJECTS.items() if where == "*" or archetype in where.split())


def _object_caption(rng: Rng, archetype: str) -> tuple[str, Material]:
    fitting = _fitting(archetype)
    name = pick(rng, fitting) if fitting and rng.random() < 0.75 else pick(rng, _OBJECT_NAMES)
    if name not in _GENERIC and rng.random() < 0.25:  # nothing said: what it is usually made of
        usual = pick(rng, OBJECTS[name][0].split()).replace("-", " ")
        kind = METALS.get(usual) or NATURAL.get(usual) or TINTED[usual]
        material, text = kind_material(kind, rng), name
        if rng.random() < 0.35:
            word = pick(rng, ("old", "worn", "weathered", "dusty", "shiny", "dirty", "vintage"))
            material, text = finished(material, word, rng), f"{word} {name}"
        elif rng.random() < 0.25 and usual in TINTED:
            color, value = color_word(rng)
            material, text = kind_material(kind, rng, value), f"{color} {name}"
        return article(text, rng), material
    noun, form, material = material_phrase(rng)
    if rng.random() < 0.1:
        form = pick(rng, ("1930s", "1950s", "modern", "medieval", "small", "large", "simple", "decorated")) + " " + form
    text = named(form, name) if rng.random() < 0.6 else pick(rng, (f"{name} made of {noun}", f"{name}, {noun}"))
    if rng.random() < 0.35:
        _, form2, second = plain_phrase(rng)
        detail, split = pick(
            rng,
            (
                ("with {f} details", "accent"),
                ("with {f} handles", "limbs"),
                ("with a {f} lid", "top"),
                ("on a {f} stand", "limbs"),
                ("on a {f} base", "below"),
                ("with {f} trim", "accent"),
                ("with {f} buttons", "accent"),
                ("with {f} goggles", "accent"),
                ("with {f} legs", "limbs"),
                ("with {f} straps", "bands"),
                ("with a {f} top", "top"),
                ("with {f} rivets", "accent"),
                ("with {f} edges", "edges"),
                ("with {f} wheels", "accent"),
            ),
        )
        material = over(material, second, split, 0.25)
        text += " " + detail.format(f=form2)
        if rng.random() < 0.25 and split != "below":
            _, form3, third = plain_phrase(rng)
            material, text = (
                over(material, third, "below" if split == "limbs" else "limbs", 0.25),
                f"{text} on a {form3} stand",
            )
    return article(text, rng), material


def _bare_caption(rng: Rng) -> tuple[str, Material]:
    noun, form, material = material_phrase(rng)
    if rng.random() < 0.3 and "{n}" not in form:
        noun2, _, second = plain_phrase(rng)
        words, kind = pick(
            rng,
            (
                ("{a} and {b}", "patches"),
                ("{a} with {b}", "patches"),
                ("{a} with patches of {b}", "patches"),
                ("{a} covered in {b}", "up"),
                ("{a} with {b} on top", "up"),
                ("{a} above, {b} below", "below"),
                ("half {a}, half {b}", "below"),
                ("{a} with {b} stripes", "bands"),
                ("{a} with {b} spots", "spots"),
                ("{a} with {b} edges", "edges"),
                ("{a} with {b} in the crevices", "crevices"),
                ("{a} with cracks of {b}", "cracks"),
            ),
        )
        share = 0.6 if "covered" in words else SHARES.get(kind, 0.45)
        material = over(material, second, kind, share, 0.05)
        noun = words.format(a=noun, b=noun2)
    return noun, material


def _core_caption(rng: Rng) -> tuple[str, Material]:
    """Short plain sentences that people try first: "glossy red plastic", "polished gold", "brown leather"."""
    draw = rng.random()
    if draw < 0.4:
        noun, form, material = metal_phrase(rng)
    elif draw < 0.56:
        noun = pick(rng, _CORE_NATURAL)
        material, form = kind_material(NATURAL[noun], rng), NATURAL[noun].adjective or noun
    else:
        name = pick(rng, _CORE_FAMILIES)
        kind = TINTED[name]
        color = pick(rng, COMMON)
        if rng.random() < 0.12 and name == "plastic":
            color = pick(rng, ("gold coloured", "silver coloured", "copper coloured", "bronze coloured", "golden"))
        noun = f"{color} {name}"
        material = kind_material(kind, rng, family_color(name, color))
        if rng.random() < 0.45:
            word = pick(rng, _CORE_FINISHES)
            material, noun = finished(material, word, rng), f"{word} {noun}"
        form = noun
    return (noun if rng.random() < 0.7 else article(named(form, pick(rng, _NOUNS)), rng)), material


def _pattern_caption(rng: Rng) -> tuple[str, Material]:
    """A pattern alone or on an object, or the coat of an animal as a material."""
    draw = rng.random()
    noun, form, material = hide_phrase(rng) if draw < 0.12 else _grained(rng) if draw < 0.2 else pattern_phrase(rng)
    if rng.random() < 0.55:
        return (noun if rng.random() < 0.8 else article(noun, rng)), material
    return article(named(form, pick(rng, _NOUNS)), rng), material


def _grained(rng: Rng) -> Phrase:
    """Wood with its grain said."""
    name = pick(rng, _WOODS)
    form = NATURAL[name].adjective
    grain = pick(
        rng,
        (
            "with visible grain",
            "with wood grain",
            "with a visible wood grain",
            "with dark grain lines",
            ", visible grain",
        ),
    )
    text = form + "{n} " + grain if form.endswith("wood") or rng.random() < 0.3 else form + " wood{n} " + grain
    text = text.replace("wooden wood", "wood").replace(" ,", ",")
    return text.replace("{n}", ""), text, kind_material(NATURAL[name], rng)


_CORE_FAMILIES = (
    "plastic", "plastic", "plastic", "rubber", "rubber", "porcelain", "porcelain", "ceramic", "leather", "fabric", "vinyl", "paint",
    "marble", "tiles", "brick", "fur", "glass", "wool", "knitted wool",
)  # fmt: skip
_CORE_NATURAL = (
    "moss", "snow", "lava", "denim", "ice", "sand", "grass", "rust", "stone", "wood", "oak wood", "bark", "concrete", "camouflage",
    "terracotta", "mud", "granite", "leaves", "chocolate", "wicker", "honeycomb", "tartan",
)  # fmt: skip
_CORE_FINISHES = ("glossy", "glossy", "matte", "matte", "shiny", "polished", "satin finish", "rough", "matt")
_WOODS = ("wood", "wood", "oak wood", "oak wood", "oak", "walnut wood", "pine wood", "cherry wood", "mahogany", "teak")
PREFIXES = ("a photo of ", "a DSLR photo of ", "a 3d render of ", "a picture of ", "a close-up of ")
SUFFIXES = (
    ", best quality",
    ", highly detailed",
    ", front view",
    ", side view",
    ", back view",
    ", overhead view",
    ", realistic",
    ", studio light",
)


def _patterned_caption(rng: Rng) -> tuple[str, Material]:
    """Painted porcelain and other things known by their pattern, and rusty hardware."""
    name = pick(
        rng, ("blue and white porcelain", "blue and white porcelain", "camouflage", "plaid fabric", "rust", "leather")
    )
    if name == "rust":
        form, material = rust_phrase(rng)[1:]
        noun = pick(
            rng,
            ("bolt", "nut", "wing nut", "screw", "key", "gear", "anchor", "wrench", "hinge", "valve", "pipe", "chain"),
        )
    elif name == "leather":
        _, form2, second = metal_phrase(rng)
        form, material = (
            pick(rng, ("leather", "brown leather", "old leather", "worn leather", "1930s leather", "vintage leather")),
            None,
        )
        material = over(kind_material(TINTED["leather"], rng), second, "accent")
        noun = (
            pick(rng, ("helmet", "flight helmet", "aviator cap", "cap", "hat", "bag"))
            + f" with {form2} "
            + pick(rng, ("goggles", "buckles", "buttons", "rivets", "details"))
        )
        if rng.random() < 0.4:
            stand = kind_material(NATURAL["wood"], rng)
            noun, material = noun + " on a wooden " + pick(rng, ("stand", "base")), over(material, stand, "limbs")
    else:
        form = name
        material = kind_material(NATURAL[name], rng)
        noun = pick(rng, ("teapot", "vase", "jug", "cup", "bowl", "plate", "jar", "elephant", "figurine", "mug", "pot"))
    return article(f"{form} {noun}" if rng.random() < 0.85 else form, rng), material


def _focus_caption(rng: Rng) -> tuple[str, Material]:
    """What people paint first and the plain mixture shows too rarely: animals, people, inflatables, painted porcelain, rust."""
    return pick(
        rng,
        (animal_caption, animal_caption, animal_caption, person_caption, inflatable_caption, _patterned_caption),
    )(rng)


def held_out(text: str) -> bool:
    """Whether a sentence of the showcase is in ``text``."""
    return any(sentence in text for sentence in HELD_OUT)


def _subject_caption(rng: Rng, archetype: str) -> tuple[str, Material]:
    """A thing that the shape could be."""
    draw = rng.random()
    if archetype in ("bird", "ring", "ball") and draw < 0.12:
        return inflatable_caption(rng)
    if draw < 0.15:
        return person_caption(rng)
    if archetype in ("quadruped", "bird") and draw < 0.9:
        return animal_caption(rng)
    if archetype == "figure" and draw < 0.85:
        return person_caption(rng)
    if archetype == "plant" and draw < 0.5:
        return tree_caption(rng)
    if archetype in ("ball", "blob") and draw < 0.4:
        return produce_caption(rng)
    return animal_caption(rng) if draw < 0.28 else _object_caption(rng, archetype)


def all_words(samples: int = 60_000, seed: int = 0) -> list[str]:
    """Every word that a caption can hold, sorted: those of the tables and of ``samples`` sentences.

    Lower case; a hyphenated word is there whole and in its parts.
    """
    rng = np.random.default_rng(seed)
    texts = {
        *COLORS,
        *METALS,
        *TINTED,
        *NATURAL,
        *ANIMALS,
        *PEOPLE,
        *OBJECTS,
        *PRODUCE,
        *FINISHES,
        *METAL_FINISHES,
        *FUR_WORDS,
    }
    texts |= {*HIDES, *SIZES, *PREFIXES, *SUFFIXES, *CAMOUFLAGE} | {
        k.adjective for t in (TINTED, NATURAL) for k in t.values()
    }
    texts |= {re.sub(r"\{.\}", " ", words) for pattern in PATTERNS for words in pattern.words}
    for i in range(samples):
        texts.add(random_caption(rng, ARCHETYPES[i % len(ARCHETYPES)], 0.3)[0])
    words = {w for text in texts for w in re.findall(r"[a-z0-9]+(?:[-'][a-z0-9]+)*", text.lower())}
    return sorted(words | {part for w in words for part in re.split(r"[-']", w) if part})


def random_caption(rng: Rng, archetype: str, focus: float = 0.0) -> tuple[str, Material]:
    """A sentence that fits a shape's archetype more often than not, and its material; a share ``focus`` is of those too rare."""
    draw = rng.random()
    if rng.random() < focus:
        text, material = _focus_caption(rng)
    elif draw < 0.2:
        text, material = _core_caption(rng)
    elif draw < 0.44:
        text, material = _pattern_caption(rng)
    elif draw < 0.54:
        text, material = _bare_caption(rng)
    else:
        text, material = _subject_caption(rng, archetype)
    if rng.random() < 0.06:
        text = pick(rng, PREFIXES) + text
    if rng.random() < 0.08:
        text += pick(rng, SUFFIXES)
    text = spelt(text)
    if held_out(text):
        return random_caption(rng, archetype, focus)
    return text, material


if __name__ == "__main__":
    generator = np.random.default_rng(0)
    for _ in range(60):
        print(random_caption(generator, pick(generator, ARCHETYPES))[0])
