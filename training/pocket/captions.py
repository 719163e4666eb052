"""Sentences and the materials they mean: ``random_caption(rng, archetype)`` -> (caption, Material).

A ``Material`` is a base layer and up to three overlays, each laid where its split says. Stated materials always win
over what an object is usually made of, and word order matters: "gold coloured plastic" is plastic.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from vocabulary import (
    ANIMALS,
    COLORS,
    COMMON,
    FINISHES,
    FUR_WORDS,
    METAL_FINISHES,
    METALS,
    NATURAL,
    OBJECTS,
    PEOPLE,
    PRODUCE,
    TINTED,
    Coat,
    Color,
    Kind,
    hex_color,
)

Rng = np.random.Generator

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
#: Kinds of split: where an overlay lies.
SPLITS = (
    "none",
    "patches",
    "stripes",
    "spots",
    "cracks",
    "bricks",
    "checks",
    "bands",
    "veins",
    "rings",
    "specks",
    "rosettes",
    "florals",
    "tiles",
    "below",
    "up",
    "belly",
    "limbs",
    "head",
    "accent",
    "top",
    "limbs_accent",
    "streaks",
)
PART_SPLITS = SPLITS[17:22]


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
    """Where an overlay lies: kind, share of the surface (0..1), frequency, edge softness."""

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


def pick(rng: Rng, options):
    """One of a sequence."""
    return options[int(rng.integers(len(options)))]


def _weighted(rng: Rng, table: dict[str, Kind]) -> str:
    names = list(table)
    weights = np.array([table[n].weight for n in names])
    return names[int(rng.choice(len(names), p=weights / weights.sum()))]


def _jitter(color: Color, rng: Rng, amount: float = 0.02) -> Color:
    return tuple(float(np.clip(v + rng.normal(0, amount), 0.01, 0.99)) for v in color)  # type: ignore[return-value]


def _scaled(color: Color, value: float) -> Color:
    return tuple(float(np.clip(v * value, 0.01, 0.99)) for v in color)  # type: ignore[return-value]


def _blend(a: Color, b: Color, t: float) -> Color:
    return tuple(x + (y - x) * t for x, y in zip(a, b, strict=True))  # type: ignore[return-value]


def color_word(rng: Rng) -> tuple[str, Color]:
    """A colour name: half of the time a common one, else any CSS or xkcd name."""
    name = pick(rng, COMMON) if rng.random() < 0.6 else pick(rng, list(COLORS))
    return name, COLORS[name]


def _kind_material(kind: Kind, rng: Rng, color: Color | None = None) -> Material:
    """The material of a family, in ``color`` or in one of its own."""
    base = color or hex_color(pick(rng, kind.colors))
    base = _jitter(base, rng, 0.012 if kind.metal == 1 else 0.02)
    second = (
        hex_color(pick(rng, kind.second)) if kind.second and color is None else _scaled(base, rng.uniform(0.45, 0.7))
    )
    rough = float(rng.uniform(*kind.rough))
    grain = kind.grain * rng.uniform(0.7, 1.4)
    plain_second = second if not kind.pattern else _scaled(base, 0.75)
    layer = Layer(base, plain_second, kind.vary, grain, rough, kind.metal)
    if not kind.pattern:
        return Material(layer, bump=kind.bump)
    other = replace(layer, color=_jitter(second, rng), second=_scaled(second, 0.8))
    if kind.pattern in ("bricks", "cracks") and kind.metal == 0:
        other = replace(other, rough=min(0.95, rough + 0.05))
    split = Split(kind.pattern, kind.share, kind.scale * rng.uniform(0.75, 1.35), 0.04)
    return Material(layer, ((other, split),), kind.bump)


def _finish(material: Material, word: str, rng: Rng) -> Material:
    """Apply a finish word to every layer that is not a part overlay."""
    rule = FINISHES[word]
    low, high = rule.get("low"), rule.get("high")

    def change(layer: Layer) -> Layer:
        rough = layer.rough + rule.get("offset", 0.0)
        if low is not None and high is not None:
            rough = float(rng.uniform(low, high))
        color, second = (_scaled(c, rule.get("value", 1.0)) for c in (layer.color, layer.second))
        if "dust" in rule:
            color, second = (_blend(c, (0.72, 0.69, 0.64), rule["dust"]) for c in (color, second))
        metal = layer.metal * (1 - 0.6 * rule.get("dust", 0.0))
        return replace(
            layer,
            color=color,
            second=second,
            rough=float(np.clip(rough, 0.05, 0.98)),
            metal=metal,
            vary=min(0.8, layer.vary + rule.get("vary", 0.0)),
            rough_vary=0.05 + 0.2 * rule.get("vary", 0.0),
        )

    overlays = tuple(
        (change(layer) if split.kind not in PART_SPLITS else layer, split) for layer, split in material.overlays
    )
    if "crack" in rule:
        dark = change(
            replace(material.base, color=_scaled(material.base.color, 0.3), second=_scaled(material.base.color, 0.2))
        )
        overlays = (*overlays[:2], (dark, Split("cracks", 0.12, rng.uniform(0.8, 1.4), 0.02)))
    return Material(change(material.base), overlays, max(material.bump, rule.get("bump", 0.0)))


Phrase = tuple[str, str, Material]
"""Noun form ("red plastic"), adjective form ("red plastic", "wooden"), material."""


def _metal_phrase(rng: Rng) -> Phrase:
    name = _weighted(rng, METALS)
    material = _kind_material(METALS[name], rng)
    if rng.random() < 0.6:
        words = list(METAL_FINISHES)
        weights = np.array(list(METAL_FINISHES.values()))
        word = words[int(rng.choice(len(words), p=weights / weights.sum()))]
        text = f"{word} {name}"
        return text, text, _finish(material, word, rng)
    return name, "golden" if name == "gold" and rng.random() < 0.3 else name, material


def _rusty_phrase(rng: Rng) -> Phrase:
    """Two-phase metals: rust, verdigris, chipped paint, gilding."""
    which = rng.random()
    if which < 0.45:
        name = pick(rng, ("iron", "steel", "metal", "iron", "steel", "cast iron"))
        metal, rust = _kind_material(METALS[name], rng), _kind_material(NATURAL["rust"], rng)
        share = rng.uniform(0.4, 0.7)
        base = replace(metal.base, rough=float(rng.uniform(0.35, 0.6)), color=_scaled(metal.base.color, 0.85))
        text = pick(
            rng, (f"rusty {name}", f"rusted {name}", f"corroded {name}", f"{name} with rust", f"old rusty {name}")
        )
        return (
            text,
            text if "with" not in text else f"rusty {name}",
            Material(base, ((rust.base, Split("patches", share, rng.uniform(0.8, 1.6), 0.12)),), 0.2),
        )
    if which < 0.65:
        name = pick(rng, ("copper", "bronze", "brass"))
        metal, green = _kind_material(METALS[name], rng), _kind_material(NATURAL["verdigris"], rng)
        text = pick(
            rng, (f"{name} with green patina", f"oxidised {name}", f"weathered {name}", f"{name} with verdigris")
        )
        return (
            text,
            f"weathered {name}",
            Material(
                _finish(metal, "tarnished", rng).base,
                ((green.base, Split("patches", rng.uniform(0.35, 0.6), 1.1, 0.15)),),
                0.1,
            ),
        )
    color, value = color_word(rng)
    paint = _kind_material(TINTED["paint"], rng, value)
    if which < 0.85:
        under = _kind_material(METALS[pick(rng, ("steel", "iron"))], rng)
        text = pick(
            rng, (f"chipped {color} paint on metal", f"{color} painted metal, chipped", f"worn {color} painted steel")
        )
        return (
            text,
            f"chipped {color} painted metal",
            Material(paint.base, ((under.base, Split("patches", 0.22, 1.3, 0.03)),), 0.05),
        )
    if which < 0.93:
        text = f"{color} painted {pick(rng, ('metal', 'steel', 'iron'))}"
        return text, text, paint
    wood, gold = _kind_material(NATURAL["wood"], rng), _kind_material(METALS["gold"], rng)
    return "wood with gold leaf", "gilded wooden", Material(wood.base, ((gold.base, Split("patches", 0.4, 1.0, 0.05)),))


def _tinted_phrase(rng: Rng) -> Phrase:
    """ "<finish> <colour> <material>"."""
    name = _weighted(rng, TINTED)
    kind = TINTED[name]
    form = kind.adjective or name
    if rng.random() < 0.8:
        color, value = color_word(rng)
        material, noun, form = _kind_material(kind, rng, value), f"{color} {name}", f"{color} {form}"
    else:
        material, noun = _kind_material(kind, rng), name
    if rng.random() < 0.3 and name != "fur":
        word = pick(rng, list(FINISHES))
        material = _finish(material, word, rng)
        noun, form = f"{word} {noun}", f"{word} {form}"
    return noun, form, material


def _natural_phrase(rng: Rng) -> Phrase:
    name = _weighted(rng, NATURAL)
    material = _kind_material(NATURAL[name], rng)
    form = NATURAL[name].adjective or name
    if rng.random() < 0.35:
        word = pick(rng, list(FINISHES))
        return f"{word} {name}", f"{word} {form}", _finish(material, word, rng)
    return name, form, material


def _pattern_phrase(rng: Rng) -> Phrase:
    """Two colours in a pattern, on a surface."""
    (one, a), (two, b) = color_word(rng), color_word(rng)
    kind, words = pick(
        rng,
        (
            ("stripes", "{a} and {b} striped {m}"),
            ("bands", "{a} {m} with {b} horizontal stripes"),
            ("spots", "{a} {m} with {b} dots"),
            ("spots", "{a} {m} with {b} spots"),
            ("checks", "{a} and {b} checkered {m}"),
            ("patches", "{a} {m} with {b} patches"),
            ("patches", "{a} and {b} {m}"),
            ("patches", "{a} and {b} patched {m}"),
            ("florals", "{a} {m} with {b} flowers"),
            ("florals", "{a} {m} with a {b} painted pattern"),
            ("veins", "{a} marble with {b} veins"),
            ("specks", "{b} speckled {a} {m}"),
            ("stripes", "{a} {m} with {b} stripes"),
        ),
    )
    name = pick(
        rng,
        ("plastic", "porcelain", "ceramic", "fabric", "cloth", "fur", "rubber", "wool", "vinyl", "leather", "enamel"),
    )
    material = _kind_material(TINTED[name], rng, a)
    other = replace(material.base, color=_jitter(b, rng), second=_scaled(b, 0.7))
    share = {"spots": 0.3, "florals": 0.32, "veins": 0.15, "specks": 0.25}.get(kind, 0.5)
    text = words.format(a=one, b=two, m=name)
    return (
        text,
        text,
        Material(material.base, ((other, Split(kind, share, rng.uniform(0.7, 1.6), 0.04)),), material.bump),
    )


def material_phrase(rng: Rng) -> Phrase:
    """Any material, metals about a quarter."""
    return pick(
        rng,
        (
            _metal_phrase,
            _metal_phrase,
            _tinted_phrase,
            _tinted_phrase,
            _tinted_phrase,
            _natural_phrase,
            _natural_phrase,
            _rusty_phrase,
            _pattern_phrase,
        ),
    )(rng)


def plain_phrase(rng: Rng) -> Phrase:
    """A material that fits a second place in a sentence: "with brass buttons"."""
    return pick(rng, (_metal_phrase, _tinted_phrase, _natural_phrase))(rng)


def article(text: str, rng: Rng) -> str:
    """ "a", "an", "the" or none before ``text``."""
    draw = rng.random()
    if draw < 0.7:
        return ("an " if text[0] in "aeiou" else "a ") + text
    return f"the {text}" if draw < 0.78 else text


def _over(material: Material, other: Material, kind: str, share: float = 0.5, soft: float = 0.03) -> Material:
    return replace(material, overlays=(*material.overlays[:2], (other.base, Split(kind, share, 1.0, soft))))


def coat_material(coat: Coat, rng: Rng, color: Color | None = None) -> Material:
    """An animal's own look, or with its base colour replaced."""
    kind = TINTED.get(coat.surface) or NATURAL.get(coat.surface) or Kind((0.15, 0.4), vary=0.2)
    material = _kind_material(kind, rng, color or hex_color(pick(rng, coat.colors)))
    if coat.second and color is None:
        value = hex_color(pick(rng, coat.second))
        other = replace(material.base, color=_jitter(value, rng), second=_scaled(value, 0.7))
        material = replace(
            material, overlays=((other, Split(coat.pattern, coat.share, coat.scale * rng.uniform(0.8, 1.25), 0.04)),)
        )
    for kind_name, code in (("belly", coat.belly), ("limbs", coat.limbs), ("accent", coat.accent)):
        if code and (color is None or kind_name == "accent") and len(material.overlays) < 3:
            value = hex_color(code)
            layer = replace(material.base, color=value, second=_scaled(value, 0.75))
            if kind_name == "accent":
                layer = replace(layer, rough=float(rng.uniform(0.3, 0.5)), vary=0.05)
            material = replace(material, overlays=(*material.overlays, (layer, Split(kind_name, 0.3, 1.0, 0.1))))
    return material


#: Animals that people ask for most: half of all.
FAVOURITES = (
    "cow", "dairy cow", "fox", "red fox", "koala", "duck", "zebra", "tiger", "leopard", "giraffe", "panda", "dog", "cat", "horse", "bear",
    "sheep", "pig", "penguin", "elephant", "rabbit", "frog", "lion", "dalmatian", "chicken",
)  # fmt: skip
#: Simple stated materials of figures: "wooden", "porcelain".
FIGURE_FORMS = (
    "wood", "wood", "wood", "oak", "stone", "marble", "granite", "chocolate", "gold", "bronze", "silver", "copper", "steel", "porcelain",
    "ceramic", "plastic", "rubber", "glass", "leather", "knitted wool", "clay", "paint",
)  # fmt: skip


#: Colours that coats come in.
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
        return f"{color} {form}", _kind_material(kind, rng, value)
    return form, _kind_material(kind, rng)


def _inflatable_caption(rng: Rng) -> tuple[str, Material]:
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
    material = _finish(_kind_material(TINTED["vinyl"], rng, value), "glossy", rng)
    if accent:
        code = hex_color(accent)
        material = _over(material, Material(replace(material.base, color=code, second=code)), "accent")
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


def _animal_caption(rng: Rng) -> tuple[str, Material]:
    name = pick(rng, FAVOURITES) if rng.random() < 0.5 else pick(rng, list(ANIMALS))
    coat = ANIMALS[name]
    surface = {"wet": "skin"}.get(coat.surface, coat.surface)
    draw = rng.random()
    if draw < 0.3:
        material, text = coat_material(coat, rng), name
        if rng.random() < 0.4 and coat.surface == "fur":
            word = pick(rng, list(FUR_WORDS))
            material = replace(material, bump=FUR_WORDS[word].get("bump", material.bump))
            text = pick(rng, (f"{name} with {word} fur", f"{word} furred {name}", f"{name}, {word} fur"))
    elif draw < 0.55:
        color, value = color_word(rng)
        value = _natural(color, name, value)
        material = coat_material(replace(coat, belly="", limbs=""), rng, value)
        word = pick(rng, list(FUR_WORDS)) + " " if rng.random() < 0.5 and coat.surface == "fur" else ""
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
    elif draw < 0.75:
        (one, a), (two, b) = color_word(rng), color_word(rng)
        if rng.random() < 0.4:
            one, a = pick(rng, COAT_COLORS)
        if rng.random() < 0.4:
            two, b = "white", COLORS["white"]
        a = _natural(one, name, a)
        material = coat_material(Coat(("#808080",), surface=coat.surface), rng, a)
        other = replace(material.base, color=_jitter(b, rng), second=_scaled(b, 0.75))
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
                ("head", f"{one} {name} with a {two} head"),
                ("accent", f"{one} {name} with a {two} nose"),
            ),
        )
        split = Split(kind, 0.45 if kind == "patches" else 0.35, rng.uniform(0.8, 1.3), 0.05)
        material = replace(material, overlays=((other, split),))
    else:  # a figure of something else: the stated material wins
        form, material = _figure_phrase(rng) if rng.random() < 0.5 else material_phrase(rng)[1:]
        toy = pick(rng, ("", "", "toy ", "statue of a ", "figurine of a ", "sculpture of a ", "model of a "))
        if toy.endswith("of a "):
            text = f"{form} {toy}{name}"
        elif rng.random() < 0.25:
            word = pick(rng, ("carved", "hand-carved", "polished", "old", "shiny", "small", "cute", "inflatable"))
            material = _finish(material, word, rng) if word in FINISHES and word != "polished" else material
            text = f"{word} {form} {toy}{name}"
        else:
            text = f"{form} {toy}{name}"
    return article(text, rng), material


def _person_caption(rng: Rng) -> tuple[str, Material]:
    name = pick(rng, list(PEOPLE))
    body, legs, stripe = PEOPLE[name]
    skin = _kind_material(NATURAL["skin"], rng)
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
    material = _kind_material(cloth, rng, value)
    if legs:
        code = hex_color(legs)
        material = replace(
            material,
            overlays=((replace(material.base, color=code, second=_scaled(code, 0.8)), Split("below", 0.45, 1, 0.02)),),
        )
    if stripe:
        code = hex_color(stripe)
        material = replace(
            material,
            overlays=(
                *material.overlays,
                (
                    replace(material.base, color=code, second=code, vary=0.02, rough=0.5),
                    Split("bands", 0.14, 0.7, 0.02),
                ),
            ),
        )
    return article(text, rng), _over(material, skin, "head")


def _produce_caption(rng: Rng) -> tuple[str, Material]:
    name = pick(rng, list(PRODUCE))
    one, two, rough = PRODUCE[name]
    color = _jitter(hex_color(one), rng, 0.02)
    layer = Layer(
        color, hex_color(two), 0.45, rng.uniform(0.8, 2), float(np.clip(rng.normal(rough, 0.05), 0.06, 0.95)), 0.0
    )
    text = pick(rng, (name, f"ripe {name}", f"fresh {name}", f"shiny {name}", f"{name} skin"))
    material = Material(layer, bump=0.08)
    if rng.random() < 0.25:
        leaf = _kind_material(NATURAL["leaves"], rng)
        material, text = _over(material, leaf, "top"), f"{name} with a green leaf"
    return article(text, rng), _finish(material, "shiny", rng) if text.startswith("shiny") else material


def _tree_caption(rng: Rng) -> tuple[str, Material]:
    bark = _kind_material(NATURAL["bark"], rng)
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
    return article(name, rng), _over(_kind_material(NATURAL[leaf], rng), bark, "limbs")


def _object_caption(rng: Rng, archetype: str) -> tuple[str, Material]:
    fitting = [n for n, (_, where) in OBJECTS.items() if where == "*" or archetype in where.split()]
    name = pick(rng, fitting) if fitting and rng.random() < 0.75 else pick(rng, list(OBJECTS))
    if rng.random() < 0.22:  # nothing said: what it is usually made of
        usual = pick(rng, OBJECTS[name][0].split()).replace("-", " ")
        kind = METALS.get(usual) or NATURAL.get(usual) or TINTED[usual]
        material, text = _kind_material(kind, rng), name
        if rng.random() < 0.35:
            word = pick(rng, ("old", "worn", "weathered", "dusty", "shiny", "dirty", "vintage"))
            material, text = _finish(material, word, rng), f"{word} {name}"
        elif rng.random() < 0.25 and usual in TINTED:
            color, value = color_word(rng)
            material, text = _kind_material(kind, rng, value), f"{color} {name}"
        return article(text, rng), material
    noun, form, material = material_phrase(rng)
    if rng.random() < 0.1:
        form = pick(rng, ("1930s", "1950s", "modern", "medieval", "small", "large", "simple", "decorated")) + " " + form
    text = pick(
        rng, (f"{form} {name}", f"{form} {name}", f"{form} {name}", f"{name} made of {noun}", f"{name}, {noun}")
    )
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
                ("with {f} rivets", "spots"),
                ("with {f} wheels", "accent"),
            ),
        )
        material = _over(material, second, split, 0.25)
        text += " " + detail.format(f=form2)
        if rng.random() < 0.25 and split != "below":
            _, form3, third = plain_phrase(rng)
            material, text = (
                _over(material, third, "below" if split == "limbs" else "limbs", 0.25),
                f"{text} on a {form3} stand",
            )
    return article(text, rng), material


def _bare_caption(rng: Rng) -> tuple[str, Material]:
    noun, _, material = material_phrase(rng)
    if rng.random() < 0.3:
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
                ("{a} with cracks of {b}", "cracks"),
            ),
        )
        material = _over(material, second, kind, 0.6 if "covered" in words else 0.45, 0.05)
        noun = words.format(a=noun, b=noun2)
    return noun, material


def _core_caption(rng: Rng) -> tuple[str, Material]:
    """Short plain sentences that people try first: "<colour> plastic", "polished gold"."""
    if rng.random() < 0.45:
        noun, form, material = _metal_phrase(rng)
    else:
        name = pick(rng, ("plastic", "plastic", "rubber", "porcelain", "ceramic", "leather", "fabric", "vinyl"))
        color = pick(rng, COMMON)
        if rng.random() < 0.12 and name == "plastic":
            color = pick(rng, ("gold coloured", "silver coloured", "copper coloured", "bronze coloured", "golden"))
        material = _kind_material(TINTED[name], rng, COLORS[color])
        noun = form = f"{color} {name}"
    return (
        noun if rng.random() < 0.7 else article(f"{form} {pick(rng, list(OBJECTS) + list(ANIMALS))}", rng)
    ), material


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
        form, material = _rusty_phrase(rng)[1:]
        noun = pick(
            rng,
            ("bolt", "nut", "wing nut", "screw", "key", "gear", "anchor", "wrench", "hinge", "valve", "pipe", "chain"),
        )
    elif name == "leather":
        _, form2, second = _metal_phrase(rng)
        form, material = (
            pick(rng, ("leather", "brown leather", "old leather", "worn leather", "1930s leather", "vintage leather")),
            None,
        )
        material = _over(_kind_material(TINTED["leather"], rng), second, "accent")
        noun = (
            pick(rng, ("helmet", "flight helmet", "aviator cap", "cap", "hat", "bag"))
            + f" with {form2} "
            + pick(rng, ("goggles", "buckles", "buttons", "rivets", "details"))
        )
        if rng.random() < 0.4:
            stand = _kind_material(NATURAL["wood"], rng)
            noun, material = noun + " on a wooden " + pick(rng, ("stand", "base")), _over(material, stand, "limbs")
    else:
        form, material = name, _kind_material(NATURAL[name], rng)
        noun = pick(rng, ("teapot", "vase", "jug", "cup", "bowl", "plate", "jar", "elephant", "figurine", "mug", "pot"))
    return article(f"{form} {noun}" if rng.random() < 0.85 else form, rng), material


def _focus_caption(rng: Rng) -> tuple[str, Material]:
    """What people paint first and the plain mixture shows too rarely: animals, people, inflatables, painted porcelain, rust."""
    return pick(
        rng,
        (_animal_caption, _animal_caption, _animal_caption, _person_caption, _inflatable_caption, _patterned_caption),
    )(rng)


def random_caption(rng: Rng, archetype: str, focus: float = 0.0) -> tuple[str, Material]:
    """A sentence that fits a shape's archetype more often than not, and its material; a share ``focus`` is of those too rare."""
    draw = rng.random()
    if rng.random() < focus:
        text, material = _focus_caption(rng)
    elif draw < 0.2:
        text, material = _core_caption(rng)
    elif draw < 0.38:
        text, material = _bare_caption(rng)
    elif archetype in ("bird", "ring", "ball") and draw < 0.44:
        text, material = _inflatable_caption(rng)
    elif draw < 0.395:
        text, material = _person_caption(rng)
    elif archetype in ("quadruped", "bird") and draw < 0.9:
        text, material = _animal_caption(rng)
    elif archetype == "figure" and draw < 0.88:
        text, material = _person_caption(rng)
    elif archetype == "plant" and draw < 0.6:
        text, material = _tree_caption(rng)
    elif archetype in ("ball", "blob") and draw < 0.56:
        text, material = _produce_caption(rng)
    elif draw < 0.45:
        text, material = _animal_caption(rng)
    else:
        text, material = _object_caption(rng, archetype)
    if rng.random() < 0.06:
        text = pick(rng, PREFIXES) + text
    if rng.random() < 0.08:
        text += pick(rng, SUFFIXES)
    if any(sentence in text for sentence in HELD_OUT):
        return random_caption(rng, archetype, focus)
    return text, material


if __name__ == "__main__":
    from gbuffers import ARCHETYPES

    generator = np.random.default_rng(0)
    for _ in range(60):
        print(random_caption(generator, pick(generator, ARCHETYPES))[0])
