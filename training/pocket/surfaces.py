"""Materials and what words do to them: families, finishes, colours, patterns laid over a base.

A ``Material`` is a base layer and up to three overlays, each laid where its split says. Where a split is canonical the
words alone decide its scale and share.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
from vocabulary import (
    ANIMALS,
    CAMOUFLAGE,
    CANONICAL,
    COLORS,
    FAMILY_COLORS,
    FINISHES,
    METALS,
    NATURAL,
    SHARES,
    SIZES,
    TINTED,
    Coat,
    Color,
    Kind,
    coded,
    hex_color,
)

Rng = np.random.Generator
T = TypeVar("T")
#: Splits by part or by geometry, whose layers keep their own finish.
PART_SPLITS = frozenset({"belly", "limbs", "head", "accent", "top", "limbs_accent"})
#: Patterns whose overlay has a colour of its own (mortar, rims) whatever the base's.
OWN_SECOND = frozenset({"bricks", "tiles", "veins", "cells", "cracks", "planks", "herringbone"})
FAMILIES: dict[str, Kind] = {**TINTED, **NATURAL, **METALS}


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


def pick(rng: Rng, options: Sequence[T]) -> T:
    """One of a sequence."""
    return options[int(rng.random() * len(options))]


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
    elif kind.second and (color is None or kind.pattern in OWN_SECOND):
        second = hex_color(pick(rng, kind.second))
    else:
        second = scaled(layer.color, 0.5)
    metal = 0.0 if kind.pattern in OWN_SECOND else kind.metal
    other = replace(layer, color=jittered(second, rng), second=scaled(second, 0.8), metal=metal)
    return Material(layer, ((other, split(kind.pattern, rng, share, kind.scale)),), kind.bump)


def family(name: str, rng: Rng, color: str = "") -> Material:
    """The material of a named family, in a named colour (as that family has it) or in its own."""
    kind = FAMILIES[name]
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


def patterned(base: Layer, kind: str, value: Color, rng: Rng, size: str = "", share: float | None = None,
              scale: float = 1.0, bump: float = 0.0) -> Material:  # fmt: skip
    """A pattern of one colour over a base layer, as large as ``size`` says."""
    other = replace(base, color=jittered(value, rng), second=scaled(value, 0.8))
    return Material(base, ((other, split(kind, rng, share, scale * SIZES.get(size, 1.0))),), bump)


def camouflage(name: str, rng: Rng, surface: str = "fabric") -> Material:
    """Blotches of two colours over a third."""
    base, one, two = (hex_color(code) for code in CAMOUFLAGE[name])
    layer = replace(layer_of(FAMILIES[surface], rng, base), vary=0.05)
    first, second = (replace(layer, color=c, second=scaled(c, 0.85)) for c in (one, two))
    return Material(
        layer,
        ((first, split("patches", rng, 0.32, 1.4)), (second, split("camouflage", rng, 0.3, 1.4))),
        FAMILIES[surface].bump,
    )


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


def rusty(name: str, rng: Rng, share: float | None = None) -> Material:
    """A metal with rust over half of it."""
    metal, rust = family(name, rng), family("rust", rng)
    base = replace(metal.base, rough=float(rng.uniform(0.42, 0.58)), color=scaled(metal.base.color, 0.85))
    where = Split("patches", 0.55 if share is None else share, 1.3, 0.12)
    return Material(base, ((rust.base, where),), 0.2)
