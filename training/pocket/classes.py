"""Materials that the ruler tells apart: wordings of each and its constructor, and decoys.

A decoy has the two colours of a pattern in the same proportions in another structure, so that a classifier which only
looks at colours fails.
"""

from __future__ import annotations

from collections.abc import Callable

from surfaces import (
    Layer,
    Material,
    Rng,
    Split,
    camouflage,
    family,
    finished,
    hide,
    layer_of,
    patterned,
    rusty,
)
from vocabulary import COLORS, NATURAL, TINTED, Color, hex_color

Make = Callable[[Rng], Material]
BLACK, WHITE, RED = COLORS["black"], COLORS["white"], COLORS["red"]
MORTAR = hex_color("#c8c0b2")


def _plain(name: str, color: str = "", finish: str = "") -> Make:
    """A family in a colour with a finish."""

    def make(rng: Rng) -> Material:
        material = family(name, rng, color)
        return finished(material, finish, rng) if finish else material

    return make


def _layer(name: str, color: Color, rng: Rng) -> Layer:
    """A family's plain surface in a colour."""
    return layer_of((TINTED.get(name) or NATURAL[name]), rng, color)


def _two(kind: str, surface: str, base: Color, other: Color) -> Make:
    """A pattern of two colours on a surface."""
    return lambda rng: patterned(_layer(surface, base, rng), kind, other, rng, bump=TINTED[surface].bump)


def _decoy(of: Make, kind: str, share: float, scale: float) -> Make:
    """The layers of a pattern's material, the overlay laid by a random kind over the same ``share``."""

    def make(rng: Rng) -> Material:
        material = of(rng)
        other = material.overlays[0][0]
        where = Split(kind, share, scale * float(rng.uniform(0.8, 1.25)), 0.04)
        return Material(material.base, ((other, where),), material.bump)

    return make


_ZEBRA: Make = lambda rng: hide("zebra", rng)  # noqa: E731
_BRICK = _plain("brick", "red")
_CHECKS = _two("checks", "plastic", BLACK, WHITE)
_DOTS = _two("dots", "fabric", RED, WHITE)
_LEOPARD: Make = lambda rng: hide("leopard", rng)  # noqa: E731
_OAK = _plain("oak wood")

_PROMPTS: dict[str, tuple[tuple[str, ...], Make]] = {
    "glossy red plastic": (
        ("glossy red plastic", "shiny red plastic", "a glossy red plastic toy"),
        _plain("plastic", "red", "glossy"),
    ),
    "matte blue plastic": (
        ("matte blue plastic", "matt blue plastic", "a matte blue plastic toy"),
        _plain("plastic", "blue", "matte"),
    ),
    "polished gold": (("polished gold", "shiny gold"), _plain("gold", finish="polished")),
    "brushed steel": (("brushed steel", "brushed stainless steel"), _plain("steel", finish="brushed")),
    "white porcelain": (("white porcelain", "a white porcelain object"), _plain("porcelain", "white")),
    "black rubber": (("black rubber", "a black rubber object"), _plain("rubber", "black")),
    "zebra": (("a zebra", "zebra fur", "zebra hide"), _ZEBRA),
    "red brick": (("red brick", "red bricks", "a red brick wall"), _BRICK),
    "black and white checks": (
        (
            "black and white checkered plastic",
            "black and white checked plastic",
            "plastic with a black and white checkerboard pattern",
        ),
        _CHECKS,
    ),
    "white polka dots on red": (
        ("red fabric with white polka dots", "white polka dots on red fabric", "red and white polka dotted fabric"),
        _DOTS,
    ),
    "leopard": (("leopard fur", "leopard print fur", "fur with leopard spots"), _LEOPARD),
    "oak wood with grain": (("oak wood with visible grain", "oak wood with wood grain", "oak wood"), _OAK),
}
_OTHERS: dict[str, tuple[tuple[str, ...], Make]] = {
    "copper": (("copper", "a copper object"), _plain("copper")),
    "green plastic": (("green plastic", "a green plastic object"), _plain("plastic", "green")),
    "yellow rubber": (("yellow rubber", "a yellow rubber toy"), _plain("rubber", "yellow")),
    "white marble": (("white marble", "a white marble sculpture"), _plain("marble", "white")),
    "moss": (("moss", "a mossy rock"), _plain("moss")),
    "denim": (("denim", "a denim jacket"), _plain("denim")),
    "brown leather": (("brown leather", "a brown leather object"), _plain("leather", "brown")),
    "rusty iron": (("rusty iron", "rusted iron"), lambda rng: rusty("iron", rng)),
    "giraffe": (("giraffe fur", "giraffe hide", "giraffe pattern"), lambda rng: hide("giraffe", rng)),
    "tiger": (("tiger fur", "tiger skin", "tiger striped fur"), lambda rng: hide("tiger", rng)),
    "cow patches": (
        ("cow hide", "cow fur", "cow print fur"),
        _two("patches", "fur", hex_color("#f0ebe0"), hex_color("#14110f")),
    ),
    "camouflage": (("camouflage", "camouflage fabric"), lambda rng: camouflage("", rng)),
    "black and white vertical stripes": (
        ("black and white vertical stripes", "plastic with black and white vertical stripes"),
        _two("vertical_stripes", "plastic", BLACK, WHITE),
    ),
    "tiles": (("white tiles", "white square tiles"), _plain("tiles", "white")),
    "snow": (("snow", "a snowy rock"), _plain("snow")),
    "lava": (("lava", "a lava rock"), _plain("lava")),
}
#: Shares are the means that the canonical patterns cover on a sphere.
_DECOYS: dict[str, tuple[tuple[str, ...], Make]] = {
    "decoy: zebra colours in specks": ((), _decoy(_ZEBRA, "specks", 0.5, 0.6)),
    "decoy: brick colours in patches": ((), _decoy(_BRICK, "blotches", 0.22, 2.5)),
    "decoy: black and white plastic in patches": ((), _decoy(_CHECKS, "blotches", 0.5, 1.8)),
    "decoy: red and white fabric in patches": ((), _decoy(_DOTS, "blotches", 0.26, 1.8)),
    "decoy: leopard colours in patches": ((), _decoy(_LEOPARD, "blotches", 0.33, 1.8)),
    "decoy: oak colours in patches": ((), _decoy(_OAK, "blotches", 0.29, 2.2)),
}
_ALL = _PROMPTS | _OTHERS | _DECOYS
#: Class name -> its wordings; a decoy's only one is its name, which is no sentence for a prior.
RETRIEVAL: dict[str, tuple[str, ...]] = {name: wordings or (name,) for name, (wordings, _) in _ALL.items()}
#: Names of the classes that are decoys, and the pattern class that each imitates.
DECOYS: dict[str, str] = dict(
    zip(
        _DECOYS,
        ("zebra", "red brick", "black and white checks", "white polka dots on red", "leopard", "oak wood with grain"),
        strict=True,
    )
)
_BY_WORDING: dict[str, Make] = {
    wording: make for name, (wordings, make) in _ALL.items() for wording in (name, *wordings)
}


def material_of(prompt: str, rng: Rng) -> Material:
    """A draw of the material that a class name or one of its wordings means.

    Raises:
        KeyError: no class has that wording.
    """
    return _BY_WORDING[prompt](rng)
