"""Sentences about subjects: animals, people, fruit, trees, inflatables."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from phrases import (
    article,
    color_word,
    material_phrase,
    named,
    two_colors,
)
from surfaces import (
    Layer,
    Material,
    Rng,
    Split,
    coat_material,
    finished,
    jittered,
    kind_material,
    over,
    patterned,
    pick,
    scaled,
)
from vocabulary import (
    ANIMALS,
    COLORS,
    FINISHES,
    FUR_WORDS,
    METALS,
    NATURAL,
    PEOPLE,
    PRODUCE,
    TINTED,
    Coat,
    Color,
    hex_color,
)

#: Animals that people ask for most: half of all.
FAVOURITES = (
    "cow", "dairy cow", "fox", "red fox", "koala", "duck", "zebra", "tiger", "leopard", "giraffe", "panda", "dog", "cat", "horse", "bear",
    "sheep", "pig", "penguin", "elephant", "rabbit", "frog", "lion", "dalmatian", "chicken", "fox", "red fox", "red fox", "zebra", "zebra",
    "zebra", "tiger", "leopard", "leopard", "giraffe", "cow", "koala", "panda",
)  # fmt: skip
#: Simple stated materials of figures: "wooden", "porcelain".
FIGURE_FORMS = (
    "wood", "wood", "wood", "oak", "stone", "marble", "granite", "chocolate", "gold", "bronze", "silver", "copper", "steel", "porcelain",
    "ceramic", "plastic", "rubber", "glass", "leather", "knitted wool", "clay", "paint",
)  # fmt: skip


#: Colours that coats come in.
_ANIMAL_NAMES, _FUR_WORDS, _PEOPLE_NAMES, _PRODUCE_NAMES = (
    tuple(ANIMALS),
    tuple(FUR_WORDS),
    tuple(PEOPLE),
    tuple(PRODUCE),
)
COAT_COLORS = tuple(
    (name, COLORS[name]) for name in ("brown", "black", "grey", "red", "tan", "white", "cream", "orange", "dark brown")
)


def _natural(color: str, animal: str, value: Color) -> Color:
    """A red fox is not red: the coat of an animal known by that name, else ``value``."""
    coat = ANIMALS.get(f"{color} {animal}")
    return hex_color(coat.colors[0]) if coat else value


def _figure_phrase(rng: Rng) -> tuple[str, Material]:
    name = pick(rng, FIGURE_FORMS)
    kind = METALS.get(name) or NATURAL.get(name) or TINTED[name]
    form = {"gold": pick(rng, ("gold", "golden"))}.get(name, kind.adjective or name)
    if name in TINTED and rng.random() < 0.5:
        color, value = color_word(rng)
        return f"{color} {form}", kind_material(kind, rng, value)
    return form, kind_material(kind, rng)


def inflatable_caption(rng: Rng) -> tuple[str, Material]:
    """Glossy vinyl things; a duck is yellow with an orange beak."""
    name = pick(
        rng,
        (
            "duck",
            "duck",
            "flamingo",
            "ring",
            "swim ring",
            "float",
            "pool float",
            "ball",
            "unicorn",
            "boat",
            "toy",
            "swan",
            "dolphin",
        ),
    )
    coats = {
        "duck": ("yellow", "#f08a14"),
        "flamingo": ("pink", "#282020"),
        "swan": ("white", "#e8741c"),
        "dolphin": ("light blue", ""),
    }
    color, accent = coats.get(name, ("", ""))
    word, value = (color, COLORS[color]) if color and rng.random() < 0.7 else color_word(rng)
    material = finished(kind_material(TINTED["vinyl"], rng, value), "glossy", rng)
    if accent:
        code = hex_color(accent)
        material = over(material, Material(replace(material.base, color=code, second=code)), "accent")
    thing = pick(rng, ("", "", " toy", " float", " ring")) if name in coats else ""
    said = "" if word == color and rng.random() < 0.7 else f"{word} "
    text = pick(
        rng,
        (
            f"inflatable {said}{name}{thing}",
            f"{said}inflatable {name}{thing}",
            f"{said}rubber {name}{thing}" if accent else f"inflatable {said}{name}",
            f"inflatable {said}{name}{thing}, vinyl",
            f"{said}vinyl {name}{thing}, shiny",
        ),
    )
    return article(text, rng), material


def animal_caption(rng: Rng) -> tuple[str, Material]:
    name = pick(rng, FAVOURITES) if rng.random() < 0.55 else pick(rng, _ANIMAL_NAMES)
    coat = ANIMALS[name]
    surface = {"wet": "skin"}.get(coat.surface, coat.surface)
    draw = rng.random()
    if draw < 0.42:
        material, text = coat_material(coat, rng), name
        if rng.random() < 0.4 and coat.surface == "fur":
            word = pick(rng, _FUR_WORDS)
            material = replace(material, bump=FUR_WORDS[word].get("bump", material.bump))
            text = pick(rng, (f"{name} with {word} fur", f"{word} furred {name}", f"{name}, {word} fur"))
    elif draw < 0.6:
        color, value = color_word(rng)
        known = ANIMALS.get(f"{color} {name}")
        material = coat_material(known or replace(coat, belly="", limbs=""), rng, None if known else value)
        word = pick(rng, _FUR_WORDS) + " " if rng.random() < 0.5 and coat.surface == "fur" else ""
        if word:
            material = replace(material, bump=FUR_WORDS[word.strip()].get("bump", material.bump))
        text = pick(
            rng,
            (
                f"{color} {name}",
                f"{name} with {word}{color} {surface}",
                f"{color} {name} with {word}{surface}",
                f"{name}, {color} {surface}",
            ),
        )
    elif draw < 0.78:
        (one, a), (two, b) = two_colors(rng)
        if rng.random() < 0.4:
            one, a = pick(rng, COAT_COLORS)
        if rng.random() < 0.4 and one != "white":
            two, b = "white", COLORS["white"]
        a = _natural(one, name, a)
        material = coat_material(Coat(("#808080",), surface=coat.surface), rng, a)
        kind, text = pick(
            rng,
            (
                ("patches", f"{one} and {two} {name}"),
                ("patches", f"{one} and {two} {name} with {surface}"),
                ("patches", f"{one} {name} with {two} patches"),
                ("belly", f"{one} {name} with a {two} chest"),
                ("belly", f"{one} {name} with a {two} belly"),
                ("limbs", f"{one} {name} with {two} legs"),
                ("spots", f"{one} {name} with {two} spots"),
                ("stripes", f"{one} {name} with {two} stripes"),
                ("dots", f"{one} {name} with {two} polka dots"),
                ("checks", f"{one} and {two} checkered {name}"),
                ("bands", f"{one} {name} with {two} horizontal stripes"),
                ("head", f"{one} {name} with a {two} head"),
                ("accent", f"{one} {name} with a {two} nose"),
            ),
        )
        material = patterned(material.base, kind, b, rng, bump=material.bump)
    else:  # a figure of something else: the stated material wins
        form, material = _figure_phrase(rng) if rng.random() < 0.5 else material_phrase(rng)[1:]
        toy = pick(rng, ("", "", "toy ", "statue of a ", "figurine of a ", "sculpture of a ", "model of a "))
        if toy.endswith("of a "):
            text = named(form, toy + name)
        elif rng.random() < 0.25:
            word = pick(rng, ("carved", "hand-carved", "polished", "old", "shiny", "small", "cute", "inflatable"))
            material = finished(material, word, rng) if word in FINISHES and word != "polished" else material
            text = f"{word} {named(form, toy + name)}"
        else:
            text = named(form, toy + name)
    return article(text, rng), material


def person_caption(rng: Rng) -> tuple[str, Material]:
    name = pick(rng, _PEOPLE_NAMES)
    body, legs, stripe = PEOPLE[name]
    skin = kind_material(NATURAL["skin"], rng)
    value, text = hex_color(pick(rng, body.split())), name
    draw = rng.random()
    cloth = TINTED["cloth"]
    if draw < 0.55:
        text = pick(
            rng, (name, name, f"{name} in uniform", f"{name} wearing a uniform", f"young {name}", f"{name}, full body")
        )
    else:
        color, value = color_word(rng)
        garment = pick(rng, ("jacket", "suit", "coat", "shirt", "uniform", "sweater", "robe"))
        who = pick(rng, (name, "man", "woman", "person", "boy", "girl", "child", "human"))
        text, legs, stripe = f"{who} in a {color} {garment}", "", ""
        if rng.random() < 0.4:
            other, code = color_word(rng)
            text += pick(rng, (f" and {other} trousers", f" and {other} pants", f" with {other} trousers"))
            legs = "#" + "".join(f"{round(v * 255):02x}" for v in code)
        if garment in ("jacket", "suit", "coat") and rng.random() < 0.3:
            cloth, text = TINTED["leather"], text.replace(f"{color} {garment}", f"{color} leather {garment}")
    material = kind_material(cloth, rng, value)
    if legs:
        code = hex_color(legs)
        material = replace(
            material,
            overlays=((replace(material.base, color=code, second=scaled(code, 0.8)), Split("below", 0.45, 1, 0.02)),),
        )
    if stripe:
        code = hex_color(stripe)
        material = replace(
            material,
            overlays=(
                *material.overlays,
                (
                    replace(material.base, color=code, second=code, vary=0.02, rough=0.5),
                    Split("bands", 0.14, 0.5, 0.02),
                ),
            ),
        )
    return article(text, rng), over(material, skin, "head")


def produce_caption(rng: Rng) -> tuple[str, Material]:
    name = pick(rng, _PRODUCE_NAMES)
    one, two, rough = PRODUCE[name]
    color = jittered(hex_color(one), rng, 0.02)
    layer = Layer(
        color, hex_color(two), 0.45, rng.uniform(0.8, 2), float(np.clip(rng.normal(rough, 0.05), 0.06, 0.95)), 0.0
    )
    text = pick(rng, (name, f"ripe {name}", f"fresh {name}", f"shiny {name}", f"{name} skin"))
    material = Material(layer, bump=0.08)
    if rng.random() < 0.25:
        leaf = kind_material(NATURAL["leaves"], rng)
        material, text = over(material, leaf, "top"), f"{name} with a green leaf"
    return article(text, rng), finished(material, "shiny", rng) if text.startswith("shiny") else material


def tree_caption(rng: Rng) -> tuple[str, Material]:
    bark = kind_material(NATURAL["bark"], rng)
    name, leaf = pick(
        rng,
        (
            ("tree", "leaves"),
            ("oak tree", "leaves"),
            ("autumn tree", "autumn leaves"),
            ("bush", "leaves"),
            ("snowy tree", "snow"),
            ("apple tree", "leaves"),
            ("bonsai tree", "leaves"),
            ("plant", "leaves"),
        ),
    )
    return article(name, rng), over(kind_material(NATURAL[leaf], rng), bark, "limbs")
