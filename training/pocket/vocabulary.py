"""Words and what they look like: colours, materials, coats, people, objects. Tables; ``captions.py`` makes sentences.

Colours are sRGB hex or names of ``COLORS``; metals are written as linear reflectance at normal incidence (the usual
published figures) and coded when loaded. Roughness is perceptual.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

Color = tuple[float, float, float]


def hex_color(code: str) -> Color:
    """``"#rrggbb"`` or a name of ``COLORS`` -> sRGB in [0, 1]."""
    if not code.startswith("#"):
        return COLORS[code]
    return tuple(int(code[i : i + 2], 16) / 255 for i in (1, 3, 5))  # type: ignore[return-value]


def coded(linear: Color) -> Color:
    """Linear -> sRGB-coded."""
    return tuple(12.92 * v if v < 0.0031308 else 1.055 * v ** (1 / 2.4) - 0.055 for v in linear)  # type: ignore[return-value]


def _load_colors() -> dict[str, Color]:
    colors: dict[str, Color] = {}
    for table in ("xkcd.txt", "css.txt"):
        lines = (Path(__file__).parent / table).read_text().splitlines()[1:]
        colors |= {line.rpartition(" ")[0]: hex_color(line.rpartition(" ")[2]) for line in lines}
    return colors | {name: hex_color(code) for name, code in PLAIN.items()}


#: The words people use most, with the value of a painted thing rather than of a screen primary.
PLAIN = {
    "red": "#d0161b",
    "blue": "#1f49c8",
    "green": "#1f9a38",
    "yellow": "#f5d21c",
    "orange": "#f07a16",
    "purple": "#7a2a9e",
    "pink": "#f08cb0",
    "brown": "#6b4226",
    "black": "#121212",
    "white": "#f0efec",
    "grey": "#808080",
    "gray": "#808080",
    "beige": "#d9c7a0",
    "cream": "#f3e8cc",
    "tan": "#c8a274",
    "turquoise": "#30c8bc",
    "teal": "#0d7a7c",
    "navy": "#152348",
    "navy blue": "#152348",
    "maroon": "#6e1423",
    "crimson": "#b0122e",
    "scarlet": "#d81e10",
    "violet": "#8a3cc8",
    "magenta": "#d41a94",
    "cyan": "#20c8e0",
    "lime": "#9be022",
    "olive": "#74742a",
    "khaki": "#b0a06a",
    "indigo": "#36208c",
    "light blue": "#8cc4ee",
    "dark blue": "#122468",
    "sky blue": "#7cbcec",
    "light green": "#92d88e",
    "dark green": "#124c22",
    "dark red": "#7a0c12",
    "dark grey": "#3c3c3e",
    "dark gray": "#3c3c3e",
    "light grey": "#c0c0c0",
    "light gray": "#c0c0c0",
    "dark brown": "#40261a",
    "light brown": "#a67a52",
    "mint": "#a4e8c4",
    "ivory": "#f2ecd8",
    "lavender": "#b8a4dc",
    "salmon": "#f0937c",
    "coral": "#f4715a",
    "mustard": "#d2a51e",
    "burgundy": "#64121f",
    "charcoal": "#333538",
    "emerald": "#14985c",
    "ruby": "#a80e30",
    "sapphire": "#123c94",
    "jade": "#2a9468",
    "amber": "#e89a14",
    "golden": "#e0a832",
    "gold coloured": "#e4b03c",
    "silver coloured": "#b8babc",
    "copper coloured": "#b86e42",
    "bronze coloured": "#8a6234",
    "rose": "#e05a7c",
    "peach": "#f8c09c",
    "lilac": "#c4a0d8",
    "aqua": "#48d4d0",
}
COLORS = _load_colors()
COMMON = (
    "red",
    "blue",
    "green",
    "yellow",
    "orange",
    "purple",
    "pink",
    "brown",
    "black",
    "white",
    "grey",
    "gray",
    "beige",
    "turquoise",
    "teal",
    "navy blue",
    "cream",
    "tan",
    "dark blue",
    "light blue",
    "dark green",
    "light green",
    "dark red",
)


@dataclass(frozen=True)
class Kind:
    """One material family.

    ``colors``: its own colours, empty where any colour word may stand before it. ``second``: colours that its grain
    varies towards, by ``vary`` with features of size 1 / ``grain``. ``pattern``: a second phase of ``second`` colours.
    """

    rough: tuple[float, float]
    colors: tuple[str, ...] = ()
    second: tuple[str, ...] = ()
    vary: float = 0.15
    grain: float = 1.0
    metal: float = 0.0
    bump: float = 0.0
    pattern: str = ""
    share: float | None = None
    scale: float = 1.0
    weight: float = 1.0
    adjective: str = ""


def _metal(linear: Color, rough: tuple[float, float] = (0.12, 0.4), weight: float = 1.0, **more: object) -> Kind:
    code = "#" + "".join(f"{round(min(max(v, 0), 1) * 255):02x}" for v in coded(linear))
    return Kind(rough, (code,), metal=1.0, vary=0.05, weight=weight, **more)  # type: ignore[arg-type]


METALS: dict[str, Kind] = {
    "gold": _metal((1.0, 0.71, 0.29), (0.12, 0.26), 4),
    "silver": _metal((0.95, 0.93, 0.88), (0.14, 0.28), 2),
    "copper": _metal((0.955, 0.638, 0.538), (0.16, 0.3), 2.5),
    "brass": _metal((0.89, 0.70, 0.36), (0.16, 0.3), 2),
    "bronze": _metal((0.62, 0.43, 0.22), (0.26, 0.42), 2),
    "steel": _metal((0.58, 0.57, 0.56), (0.22, 0.38), 3),
    "stainless steel": _metal((0.62, 0.60, 0.58), (0.2, 0.34), 1.5),
    "iron": _metal((0.45, 0.45, 0.45), (0.4, 0.58), 2),
    "cast iron": _metal((0.2, 0.2, 0.205), (0.55, 0.72), bump=0.15),
    "chrome": _metal((0.72, 0.73, 0.75), (0.05, 0.12), 1.5),
    "aluminium": _metal((0.91, 0.92, 0.92), (0.26, 0.42)),
    "aluminum": _metal((0.91, 0.92, 0.92), (0.26, 0.42)),
    "titanium": _metal((0.54, 0.50, 0.45), (0.28, 0.44)),
    "nickel": _metal((0.66, 0.61, 0.53), (0.18, 0.32)),
    "platinum": _metal((0.67, 0.64, 0.59), (0.14, 0.28)),
    "tin": _metal((0.75, 0.73, 0.70), (0.3, 0.46)),
    "zinc": _metal((0.66, 0.68, 0.70), (0.36, 0.52)),
    "galvanised steel": _metal((0.62, 0.64, 0.66), (0.36, 0.52)),
    "lead": _metal((0.3, 0.3, 0.33), (0.48, 0.66)),
    "pewter": _metal((0.4, 0.4, 0.38), (0.38, 0.54)),
    "gunmetal": _metal((0.14, 0.15, 0.17), (0.28, 0.44)),
    "rose gold": _metal((0.93, 0.58, 0.48), (0.12, 0.26)),
    "white gold": _metal((0.90, 0.87, 0.79), (0.12, 0.26)),
    "metal": _metal((0.58, 0.57, 0.57), (0.24, 0.42), 2),
    "mercury": _metal((0.78, 0.78, 0.78), (0.05, 0.1)),
    "wrought iron": _metal((0.1, 0.1, 0.1), (0.5, 0.66)),
    "tungsten": _metal((0.5, 0.5, 0.5), (0.28, 0.44)),
    "foil": _metal((0.88, 0.88, 0.88), (0.14, 0.28), bump=0.3),
}

#: Colourable families: "<colour> <material>"; the plain word takes one of ``colors``.
TINTED: dict[str, Kind] = {
    "plastic": Kind((0.28, 0.42), ("white", "red", "blue", "yellow", "green", "black", "grey"), vary=0.02, weight=5),
    "rubber": Kind((0.7, 0.85), ("charcoal", "black", "black", "red", "yellow"), vary=0.03, weight=3),
    "vinyl": Kind((0.14, 0.28), ("yellow", "red", "white", "black", "blue"), vary=0.02, weight=2),
    "paint": Kind(
        (0.28, 0.44), ("white", "red", "blue", "green", "yellow"), vary=0.04, weight=1.5, adjective="painted"
    ),
    "lacquer": Kind((0.06, 0.16), ("red", "black"), vary=0.03, adjective="lacquered"),
    "enamel": Kind((0.1, 0.2), ("white", "blue", "red", "cream"), vary=0.03, adjective="enamelled"),
    "porcelain": Kind((0.1, 0.2), ("#eeebe5",), vary=0.02, weight=3),
    "ceramic": Kind((0.16, 0.3), ("#eae6dd", "#d8c9b4", "#c9d6da"), vary=0.05, weight=2.5),
    "glazed pottery": Kind((0.12, 0.24), ("#8c5a34", "#3a6a78", "#d8cdb8"), vary=0.2, adjective="glazed"),
    "crackle glaze": Kind(
        (0.12, 0.24),
        ("#cfdcd0", "#e6dfcc"),
        ("#6a5a48",),
        0.1,
        1,
        pattern="cracks",
        share=0.08,
        adjective="crackle glazed",
    ),
    "glass": Kind((0.05, 0.13), ("#a8ccc4", "#c8dcdc", "#88b49c"), vary=0.04, weight=1.5),
    "frosted glass": Kind((0.42, 0.58), ("#c4d6d4",), vary=0.04),
    "fabric": Kind((0.8, 0.93), ("#8a8478", "#4a5a78", "#a05a4a"), vary=0.1, grain=4, bump=0.12, weight=2),
    "cloth": Kind((0.8, 0.93), ("#b4a88c", "#5a6a80", "#8c3a3a"), vary=0.1, grain=4, bump=0.1, weight=2),
    "cotton": Kind((0.82, 0.94), ("#ece6d8",), vary=0.08, grain=4, bump=0.08),
    "linen": Kind((0.82, 0.94), ("#d8ccb0",), vary=0.15, grain=5, bump=0.1),
    "velvet": Kind((0.72, 0.86), ("#6a1028", "#2a1a5a", "#124a34"), vary=0.2, grain=1.5, weight=1.2),
    "silk": Kind((0.28, 0.42), ("#e8d8c0", "#b02848"), vary=0.12, grain=0.7),
    "satin": Kind((0.3, 0.44), ("#f0e0e0", "#7a1030"), vary=0.12, grain=0.7),
    "wool": Kind((0.88, 0.97), ("#e6dcc8", "#8a7c6a"), vary=0.15, grain=4, bump=0.25, weight=1.2, adjective="woollen"),
    "felt": Kind((0.9, 0.97), ("#5c7a48", "#a83a3a", "#787878"), vary=0.08, grain=5, bump=0.1),
    "leather": Kind(
        (0.44, 0.6), ("#6a3d20", "#8a5428", "#5c3420", "#74482a"), ("#3c2214",), 0.25, 2, bump=0.12, weight=3
    ),
    "suede": Kind((0.84, 0.95), ("#9a7048", "#6e5038"), vary=0.15, grain=3),
    "corduroy": Kind(
        (0.82, 0.94),
        ("#8a6038", "#4c5a34"),
        vary=0.1,
        grain=4,
        bump=0.1,
        pattern="vertical_stripes",
        share=0.3,
        scale=2.4,
    ),
    "wax": Kind((0.34, 0.48), ("#eadfb8", "#c8262a"), vary=0.05),
    "clay": Kind((0.8, 0.93), ("#a86a4a", "#b8a898"), vary=0.12, bump=0.08),
    "paper": Kind((0.86, 0.95), ("#f0ece0",), vary=0.04, weight=1),
    "fur": Kind(
        (0.8, 0.92), ("#7a5a3c", "#a08870", "#6a6058"), vary=0.3, grain=3.5, bump=0.25, weight=3, adjective="furry"
    ),
    "feathers": Kind(
        (0.7, 0.84),
        ("#e8e4dc", "#6a5a48"),
        vary=0.2,
        grain=3,
        bump=0.15,
        pattern="scales",
        share=0.22,
        scale=0.8,
        adjective="feathered",
    ),
    "scales": Kind(
        (0.36, 0.52),
        ("#4a7a34", "#5a6a58"),
        vary=0.15,
        grain=2,
        bump=0.1,
        pattern="scales",
        share=0.25,
        adjective="scaly",
    ),
    "marble": Kind((0.1, 0.22), ("#ebe8e3",), ("#7c7a7a", "#5a5a60"), 0.05, 1, pattern="veins", share=0.15, weight=2),
    "brick": Kind((0.82, 0.94), ("#9c4632", "#a44a34"), ("#c8c0b2",), 0.2, 2, bump=0.12, pattern="bricks", weight=2.5),
    "tiles": Kind(
        (0.12, 0.24), ("#d8e0e0", "#4a88a8"), ("#8c8880",), 0.05, 1, pattern="tiles", adjective="tiled", weight=2
    ),
    "cobblestone": Kind((0.78, 0.92), ("#85817a",), ("#3c3a36",), 0.3, 2, bump=0.15, pattern="cells"),
    "knitted wool": Kind(
        (0.88, 0.97),
        ("#c8b8a0", "#a83a3a", "#3a5a8a"),
        vary=0.12,
        grain=5,
        bump=0.15,
        pattern="knit",
        adjective="knitted",
        weight=2,
    ),
    "car paint": Kind((0.08, 0.18), ("#a8101c", "#182a6a", "#1a1a1c", "#c8cacc"), vary=0.03),
    "powder coated metal": Kind((0.48, 0.62), ("#2a2a2c", "#3a6a8a", "#c8c8c4"), vary=0.03, adjective="powder coated"),
    "nylon": Kind((0.44, 0.6), ("#2a2c34", "#c83a1c"), vary=0.05),
    "foam": Kind((0.88, 0.97), ("#f0dc6a", "#e8e8e4"), vary=0.1),
    "candy": Kind((0.12, 0.26), ("#e84a7a", "#f08ac0", "#6ac8e0"), vary=0.08),
    "jelly": Kind((0.06, 0.16), ("#c81c34", "#3cb048", "#f0a020"), vary=0.08),
    "icing": Kind((0.38, 0.54), ("#f4b8cc", "#f6f2ea"), vary=0.05),
    "resin": Kind((0.1, 0.22), ("#d89a30", "#e8d8a8"), vary=0.08),
    "silicone": Kind((0.5, 0.64), ("#d8d8dc", "#e890a8", "#78c0b0"), vary=0.02),
    "metallic paint": Kind((0.24, 0.38), ("#8c9096", "#3a5a8a", "#8a2a2a"), vary=0.05, metal=0.6),
}
#: Colour words that mean another colour on a family: nobody's red brick is the red of a toy.
FAMILY_COLORS: dict[tuple[str, str], str] = {
    ("brick", "red"): "#a4452f",
    ("brick", "dark red"): "#6e2a20",
    ("brick", "orange"): "#b8623a",
    ("brick", "brown"): "#744834",
    ("brick", "yellow"): "#d2ac68",
    ("fur", "red"): "#a84c1e",
    ("fur", "grey"): "#85807a",
    ("fur", "gray"): "#85807a",
    ("fur", "orange"): "#d6761e",
    ("leather", "tan"): "#b07840",
}

#: Families with colours of their own.
NATURAL: dict[str, Kind] = {
    "wood": Kind((0.55, 0.7), ("#9a6a3c", "#a87848"), vary=0.08, pattern="grain", weight=5, adjective="wooden"),
    "oak wood": Kind((0.5, 0.66), ("#b58a54",), vary=0.08, pattern="grain", weight=1.5, adjective="oak"),
    "oak": Kind((0.5, 0.66), ("#b58a54",), vary=0.08, pattern="grain", adjective="oak"),
    "walnut wood": Kind((0.46, 0.62), ("#5e3d26",), vary=0.08, pattern="grain", adjective="walnut"),
    "pine wood": Kind((0.55, 0.7), ("#d8b078",), vary=0.08, pattern="grain", adjective="pine"),
    "cherry wood": Kind((0.45, 0.6), ("#8c4a2c",), vary=0.08, pattern="grain", adjective="cherry wood"),
    "mahogany": Kind((0.3, 0.44), ("#5c2416",), vary=0.08, pattern="grain", adjective="mahogany"),
    "teak": Kind((0.5, 0.64), ("#9c6a38",), vary=0.08, pattern="grain", adjective="teak"),
    "plywood": Kind((0.6, 0.76), ("#d0a872",), vary=0.08, pattern="grain", adjective="plywood"),
    "ebony": Kind((0.32, 0.48), ("#221a16",), ("#0e0a08",), 0.2, 1, adjective="ebony"),
    "wooden planks": Kind((0.6, 0.76), ("#9a6a3c", "#84603c"), ("#2a1a0e",), 0.2, 2, pattern="planks", weight=1.5),
    "floorboards": Kind((0.45, 0.6), ("#a8743c",), ("#2e1c10",), 0.2, 2, pattern="planks"),
    "parquet": Kind((0.34, 0.5), ("#b07c44",), ("#452a14",), 0.15, 2, pattern="herringbone"),
    "bamboo": Kind((0.42, 0.58), ("#cdb472",), ("#8c7438",), 0.1, 1, pattern="bands", share=0.12, adjective="bamboo"),
    "driftwood": Kind((0.82, 0.94), ("#a09486",), ("#5e554c",), 0.2, 2, pattern="grain", bump=0.15),
    "bark": Kind((0.85, 0.97), ("#5a4636",), ("#2c2018",), 0.4, 2, pattern="cracks", share=0.3, bump=0.35),
    "cork": Kind((0.8, 0.95), ("#b8885a",), ("#7c5430",), 0.3, 3, pattern="specks", share=0.15),
    "stone": Kind(
        (0.77, 0.93), ("#8c8880", "#7a7872"), ("#5c5a56",), 0.45, 1.5, bump=0.2, weight=2.5, adjective="stone"
    ),
    "granite": Kind((0.42, 0.58), ("#8e8884",), ("#3c3a3a",), 0.3, 3, pattern="specks", share=0.35, weight=1.2),
    "limestone": Kind((0.8, 0.95), ("#cfc3a8",), ("#a89a7c",), 0.3, 2, bump=0.12),
    "sandstone": Kind((0.8, 0.95), ("#c8985e",), ("#9a6434",), 0.15, 2, pattern="bands", share=0.4, bump=0.12),
    "slate": Kind((0.6, 0.76), ("#434a50",), ("#2c3136",), 0.4, 2, bump=0.15),
    "basalt": Kind((0.75, 0.9), ("#343436",), ("#1e1e20",), 0.4, 2, bump=0.2),
    "obsidian": Kind((0.05, 0.15), ("#121216",)),
    "black marble": Kind((0.08, 0.25), ("#18181a",), ("#c8c4bc",), 0.05, 1, pattern="veins", share=0.1),
    "green marble": Kind((0.08, 0.25), ("#1e5a44",), ("#c0d4c4",), 0.1, 1, pattern="veins", share=0.15),
    "alabaster": Kind((0.22, 0.38), ("#eee4d4",), ("#d8c4a8",), 0.3, 0.8),
    "chalk": Kind((0.9, 0.98), ("#f0f0ea",)),
    "jade": Kind((0.12, 0.3), ("#3a9468",), ("#8cc8a0",), 0.5, 0.8),
    "turquoise stone": Kind((0.29, 0.46), ("#3ab8b0",), ("#4a3a2c",), 0.1, 1, pattern="cracks", share=0.12),
    "lapis lazuli": Kind((0.17, 0.33), ("#1f3f94",), ("#c8a850",), 0.2, 2, pattern="specks", share=0.1),
    "malachite": Kind((0.12, 0.3), ("#1c9a66",), ("#0a4a34",), 0.05, 1, pattern="rings", share=0.45),
    "amethyst": Kind((0.06, 0.2), ("#8a4cb4",), ("#c8a0dc",), 0.4, 1),
    "ruby gemstone": Kind((0.05, 0.15), ("#a80e30",)),
    "emerald gemstone": Kind((0.05, 0.15), ("#0e8a54",)),
    "sapphire gemstone": Kind((0.05, 0.15), ("#123c94",)),
    "pearl": Kind((0.12, 0.3), ("#f0e8e0",), ("#e0d0e0",), 0.4, 0.6),
    "quartz": Kind((0.08, 0.25), ("#e4dcdc",)),
    "coal": Kind((0.65, 0.8), ("#161616",), ("#2e2e30",), 0.4, 2, bump=0.25),
    "moss": Kind((0.9, 0.98), ("#4a6a20",), ("#2a4412",), 0.6, 3, bump=0.35, weight=1.5, adjective="mossy"),
    "grass": Kind((0.8, 0.95), ("#4c8a26",), ("#2a5c14",), 0.6, 4, bump=0.35, weight=1.2, adjective="grassy"),
    "leaves": Kind((0.6, 0.76), ("#3c7a26",), ("#1c4a14",), 0.6, 2.5, bump=0.3, weight=1.2, adjective="leafy"),
    "autumn leaves": Kind((0.65, 0.8), ("#b8581c",), ("#d8a028",), 0.7, 2, bump=0.3),
    "rust": Kind((0.8, 0.95), ("#8a4420", "#7a3a1c"), ("#4c2414",), 0.6, 1.5, bump=0.2, weight=2),
    "verdigris": Kind((0.72, 0.88), ("#5aa890",), ("#2c6c5c",), 0.5, 1.5, bump=0.1),
    "patina": Kind((0.7, 0.85), ("#62a48c",), ("#4a5a40",), 0.5, 1.5, bump=0.1),
    "concrete": Kind((0.8, 0.95), ("#98958f",), ("#78756f",), 0.35, 1.5, bump=0.1, weight=1.5),
    "cement": Kind((0.85, 0.95), ("#a4a29c",), ("#86847e",), 0.3, 1.5, bump=0.08),
    "plaster": Kind((0.85, 0.95), ("#e8e2d6",)),
    "terracotta": Kind((0.75, 0.92), ("#b85c38",), ("#9a4628",), 0.3, 1.5, weight=1.2),
    "sand": Kind((0.9, 0.98), ("#d8b87c",), ("#b89458",), 0.35, 4, bump=0.2, adjective="sandy"),
    "mud": Kind((0.6, 0.76), ("#54402c",), ("#382818",), 0.4, 1.5, bump=0.2, adjective="muddy"),
    "dirt": Kind((0.9, 0.98), ("#5e4630",), ("#40301e",), 0.5, 2.5, bump=0.2),
    "snow": Kind((0.72, 0.88), ("#f4f7fa",), ("#dce6f0",), 0.3, 1.5, bump=0.1, adjective="snowy"),
    "ice": Kind((0.07, 0.23), ("#bcdcec",), ("#f0f8fc",), 0.5, 1, weight=1.2, adjective="icy"),
    "lava": Kind((0.74, 0.9), ("#241814",), ("#ff5a10", "#ff7c18"), 0.2, 1.5, pattern="cracks", share=0.35, bump=0.2),
    "denim": Kind((0.8, 0.95), ("#34507c", "#28406a"), ("#6c88b0",), 0.35, 5, bump=0.12, weight=1.2),
    "burlap": Kind((0.9, 0.98), ("#b0925e",), ("#80663c",), 0.4, 5, bump=0.2),
    "canvas": Kind((0.85, 0.95), ("#d0c4a4",)),
    "straw": Kind((0.75, 0.9), ("#dcbc60",), ("#a88838",), 0.6, 4, bump=0.25),
    "wicker": Kind((0.67, 0.83), ("#b08850",), ("#5c3e1e",), 0.15, 3, pattern="weave", bump=0.15, weight=1.5),
    "cardboard": Kind((0.85, 0.95), ("#b88c5c",), ("#a07848",), 0.2, 1.5),
    "newspaper": Kind((0.85, 0.95), ("#d0ccc0",), ("#4c4a48",), 0.2, 4, pattern="specks", share=0.3),
    "skin": Kind((0.47, 0.63), ("#d8a280", "#a46c48", "#6c4430", "#e8bc9c"), ("#c07860",), 0.2, 1),
    "bone": Kind((0.49, 0.65), ("#e4d8bc",), ("#b8a47c",), 0.3, 1.5),
    "horn": Kind((0.32, 0.48), ("#5c4a38",), ("#c0a884",), 0.5, 1),
    "ivory": Kind((0.22, 0.38), ("#f0e6cc",), ("#d8c8a0",), 0.2, 1),
    "chocolate": Kind((0.29, 0.46), ("#4a2614",)),
    "white chocolate": Kind((0.32, 0.48), ("#f0dfb8",)),
    "caramel": Kind((0.12, 0.3), ("#b4681c",)),
    "cheese": Kind((0.42, 0.58), ("#f0bc3c",), ("#c88c1c",), 0.1, 1, pattern="dots", share=0.2),
    "honey": Kind((0.05, 0.15), ("#d48a14",)),
    "bread": Kind((0.77, 0.93), ("#c08840",), ("#e8c890",), 0.5, 2, bump=0.15),
    "carbon fiber": Kind((0.15, 0.3), ("#1a1a1c",), ("#4a4a50",), 0.05, 1, pattern="weave", scale=1.6),
    "asphalt": Kind((0.8, 0.95), ("#38383a",), ("#58585a",), 0.4, 4, bump=0.2),
    "coral reef": Kind((0.72, 0.88), ("#e8765e",), ("#f4b09c",), 0.5, 2.5, bump=0.3),
    "camouflage": Kind((0.8, 0.93), ("#5c6440",), ("#2e3422",), 0.05, 1, pattern="camouflage", weight=1.2),
    "crocodile skin": Kind(
        (0.39, 0.55), ("#4a4c2c",), ("#20220f",), 0.2, 1, pattern="cracks", share=0.35, scale=2, bump=0.2
    ),
    "snake skin": Kind((0.32, 0.48), ("#8a7c4c",), ("#3c3420",), 0.15, 1, pattern="diamonds", scale=1.6),
    "plaid fabric": Kind((0.8, 0.95), ("#a02028",), ("#1c2c3c",), 0.05, 1, pattern="plaid", share=0.4),
    "blue and white porcelain": Kind(
        (0.1, 0.22), ("#edecea",), ("#1c3c94", "#234aa8"), 0.03, 1, pattern="florals", share=0.32, weight=6
    ),
    "tartan": Kind((0.82, 0.93), ("#a02028", "#1f5a38"), ("#142438",), 0.05, 1, pattern="plaid", share=0.4, weight=1.5),
    "gingham": Kind((0.82, 0.93), ("#f0efec",), ("#c8222a", "#2a58b0"), 0.04, 1, pattern="plaid", share=0.4),
    "houndstooth": Kind((0.82, 0.93), ("#efece6",), ("#161616",), 0.04, 1, pattern="checks", share=0.5, scale=1.6),
    "tweed": Kind((0.86, 0.95), ("#7c6c54",), ("#3c3428",), 0.15, 4, pattern="specks", share=0.3, bump=0.15),
    "honeycomb": Kind((0.28, 0.42), ("#e8a826",), ("#7c4c0c",), 0.1, 1, pattern="hexagons", share=0.08, weight=1.5),
    "mosaic": Kind((0.18, 0.32), ("#2a7c9c", "#d8cdb4"), ("#e0b040", "#b0402c"), 0.1, 2, pattern="mosaic", share=0.45),
    "fish scales": Kind(
        (0.26, 0.4), ("#9cb0b8", "#e08a3c"), ("#44545c",), 0.1, 2, pattern="scales", share=0.25, weight=1.5
    ),
    "dragon scales": Kind((0.32, 0.46), ("#8c1c1c", "#1c6a34"), ("#1c100c",), 0.15, 2, pattern="scales", share=0.28),
    "snake scales": Kind((0.32, 0.46), ("#6a7c34",), ("#22280f",), 0.1, 2, pattern="scales", share=0.25, scale=1.6),
    "roof tiles": Kind((0.74, 0.88), ("#b05a3a",), ("#5c2a1a",), 0.2, 2, pattern="scales", share=0.2, scale=0.62),
    "chainmail": Kind(
        (0.34, 0.48), ("#8c8c8e",), ("#2c2c30",), 0.05, 2, metal=1.0, pattern="scales", share=0.35, scale=1.6
    ),
    "basket weave": Kind((0.7, 0.84), ("#c0985c",), ("#6a4824",), 0.1, 3, pattern="weave", bump=0.1),
    "rattan": Kind((0.6, 0.75), ("#c89a5c",), ("#745026",), 0.1, 3, pattern="weave", bump=0.1),
    "waffle": Kind((0.68, 0.84), ("#d89c4c",), ("#9a5c20",), 0.1, 2, pattern="tiles", share=0.3),
    "biscuit": Kind((0.78, 0.92), ("#d0984c",), ("#a86c28",), 0.3, 3, bump=0.08),
    "butter": Kind((0.28, 0.42), ("#f4dc84",), vary=0.04),
    "chocolate chip cookie": Kind(
        (0.78, 0.92), ("#c08c4c",), ("#3c2010",), 0.2, 2, pattern="spots", share=0.2, scale=1.6
    ),
    "salami": Kind((0.4, 0.55), ("#9c3430",), ("#ecd4c0",), 0.2, 2, pattern="specks", share=0.25),
    "cracked mud": Kind((0.84, 0.95), ("#9c8058",), ("#4a3822",), 0.2, 2, pattern="cells", share=0.14, bump=0.15),
    "dry cracked earth": Kind((0.86, 0.95), ("#a88458",), ("#4e3a24",), 0.2, 2, pattern="cells", share=0.14, bump=0.15),
    "gravel": Kind((0.82, 0.94), ("#8a867e",), ("#4c4a46",), 0.4, 4, pattern="specks", share=0.35, bump=0.3),
    "agate": Kind((0.1, 0.22), ("#c8703c", "#6c7c94"), ("#f0dcc0",), 0.05, 1, pattern="rings", share=0.4),
    "lichen": Kind((0.86, 0.95), ("#9aa86c",), ("#d8d8a8",), 0.4, 2, bump=0.2),
    "ivy": Kind((0.55, 0.7), ("#2c5c22",), ("#5c8c3c",), 0.5, 2.5, bump=0.25),
    "hay": Kind((0.82, 0.94), ("#cdae5a",), ("#94782e",), 0.5, 4, bump=0.25),
    "seaweed": Kind((0.3, 0.45), ("#3c4c1c",), ("#222e10",), 0.4, 2, bump=0.15),
    "cobweb": Kind((0.86, 0.95), ("#c4c4c0",), ("#8c8c88",), 0.3, 4),
    "ash": Kind((0.88, 0.97), ("#6c6a68",), ("#484644",), 0.4, 3),
    "charred wood": Kind((0.78, 0.92), ("#221e1c",), ("#5c5854",), 0.1, 2, pattern="cells", share=0.14, bump=0.15),
    "magma": Kind((0.78, 0.92), ("#241814",), ("#ff5a10",), 0.1, 1.5, pattern="cells", share=0.2, bump=0.1),
    "slime": Kind((0.06, 0.16), ("#6cc020",), ("#94d83c",), 0.3, 1),
    "frost": Kind((0.5, 0.66), ("#dceaf2",), ("#b4ccdc",), 0.3, 3),
    "egg shell": Kind((0.5, 0.64), ("#ecdcc4",), ("#d8c0a0",), 0.15, 3),
    "stained glass": Kind((0.08, 0.18), ("#1f5cc0", "#c02030"), ("#f0b428",), 0.1, 1, pattern="mosaic", share=0.45),
}


@dataclass(frozen=True)
class Coat:
    """What an animal wears unless the sentence says otherwise."""

    colors: tuple[str, ...]
    second: tuple[str, ...] = ()
    pattern: str = ""
    share: float = 0.4
    surface: str = "fur"
    belly: str = ""
    accent: str = ""
    limbs: str = ""
    scale: float = 1.0


ANIMALS: dict[str, Coat] = {
    "cow": Coat(("#eee8dc",), ("#16130f", "#5c3a22", "#7a4a2a"), "patches", 0.45, accent="#d8a090", scale=0.9),
    "dairy cow": Coat(("#f0ebe0",), ("#14110f", "#5c3a22"), "patches", 0.45, accent="#d8a090", scale=0.9),
    "calf": Coat(("#9a683e",), ("#efe8dc",), "patches", 0.3),
    "bull": Coat(("#2c1e16", "#5c3a22"), accent="#d8ccb4"),
    "horse": Coat(("#6c3e20", "#3c2416", "#c8a070"), limbs="#2a1a12"),
    "zebra": Coat(("#f0eee8",), ("#121212",), "stripes", 0.5),
    "tiger": Coat(("#e07c1e",), ("#181210",), "tiger", 0.35, belly="#f0e6d6"),
    "leopard": Coat(("#d8a04c",), ("#1c140e",), "rosettes", 0.4, belly="#f0e2c4"),
    "cheetah": Coat(("#dcac58",), ("#1c140e",), "spots", 0.25, scale=1.6),
    "jaguar": Coat(("#c88c3a",), ("#1c140e",), "rosettes", 0.4),
    "giraffe": Coat(("#b0702e",), ("#f0dcae",), "cells", 0.18),
    "dalmatian": Coat(("#f4f2ee",), ("#121212",), "spots", 0.25),
    "lion": Coat(("#c8964e",), belly="#e4c890"),
    "panda": Coat(("#f0eee8",), limbs="#141414", accent="#141414"),
    "koala": Coat(("#8c8882", "#827d77", "#979289"), belly="#dcd8d0", accent="#2a2626"),
    "fox": Coat(("#c8541a", "#cc5e1c"), belly="#f4efe6", limbs="#2a1c16", accent="#1c1612"),
    "red fox": Coat(("#c8541a",), belly="#f4efe6", limbs="#2a1c16"),
    "arctic fox": Coat(("#f0f0ee",)),
    "wolf": Coat(("#78746e",), ("#3c3a38",), "patches", 0.3, belly="#d0ccc4"),
    "dog": Coat(("#b07c44", "#6a4426", "#2a2422", "#e0d0b0"), belly="#efe4d0"),
    "puppy": Coat(("#c89858", "#8a5c34")),
    "cat": Coat(("#d88434", "#4a4848", "#8a8684", "#1c1a1a"), belly="#f0e8dc"),
    "tabby cat": Coat(("#a07c50",), ("#3c2c1c",), "tiger", 0.4),
    "kitten": Coat(("#d89048", "#a8a4a0")),
    "bear": Coat(("#4c301c", "#3a2416")),
    "polar bear": Coat(("#f0ece0",), accent="#1c1a1a"),
    "teddy bear": Coat(("#a8743c", "#8c5a2c"), belly="#d8b888"),
    "rabbit": Coat(("#a48c74", "#e8e4dc", "#787068")),
    "bunny": Coat(("#eee8e0", "#a89078")),
    "squirrel": Coat(("#9c5426",), belly="#f0e4d0"),
    "mouse": Coat(("#8c8480",), accent="#e0a0a0"),
    "rat": Coat(("#5c5450",), accent="#d8a0a0"),
    "deer": Coat(("#9c6434",), ("#f0e4d0",), "spots", 0.1, belly="#f0e4d0"),
    "sheep": Coat(("#ece4d4",), surface="wool", limbs="#2c2624"),
    "lamb": Coat(("#f2ece0",), surface="wool"),
    "goat": Coat(("#e0d8c8", "#7a6048")),
    "pig": Coat(("#eaa8a0",), surface="skin"),
    "hedgehog": Coat(("#6c543c",), belly="#d8bc94"),
    "raccoon": Coat(("#78746e",), ("#1e1c1c",), "bands", 0.3),
    "badger": Coat(("#64625e",), ("#f0eee8",), "bands", 0.25),
    "otter": Coat(("#5c402a",)),
    "beaver": Coat(("#5c3a20",)),
    "monkey": Coat(("#6a4628",), accent="#d8a888"),
    "gorilla": Coat(("#242222",)),
    "camel": Coat(("#c49a60",)),
    "llama": Coat(("#e8dcc4", "#8c6440"), surface="wool"),
    "hamster": Coat(("#d8a058",), belly="#f4ece0"),
    "elephant": Coat(("#7c7876",), surface="skin"),
    "rhino": Coat(("#807c76",), surface="skin"),
    "hippopotamus": Coat(("#7a6a6c",), surface="skin"),
    "dolphin": Coat(("#6c8294",), surface="wet", belly="#d8e0e4"),
    "whale": Coat(("#34485c",), surface="wet", belly="#d8dcdc"),
    "shark": Coat(("#64727c",), surface="wet", belly="#e4e8e8"),
    "goldfish": Coat(("#f0801c",), surface="scales"),
    "fish": Coat(("#7898a8", "#e0903c"), surface="scales", belly="#e8ecec"),
    "frog": Coat(("#4c9a2c",), ("#2c5c18",), "spots", 0.2, "wet", belly="#d8dca0"),
    "turtle": Coat(("#4c6a34",), ("#2a3c1c",), "cells", 0.18, "scales"),
    "crocodile": Coat(("#4c5630",), surface="scales"),
    "lizard": Coat(("#5c9a34",), surface="scales"),
    "snake": Coat(("#5c7a2c", "#8a6c3c"), ("#1c2c10",), "bands", 0.4, "scales"),
    "dinosaur": Coat(("#5c8a3c", "#7a6a4c"), surface="scales", belly="#d0cc98"),
    "dragon": Coat(("#a01c1c", "#1c6a34"), surface="scales", belly="#d8b060"),
    "duck": Coat(("#f4cc1c", "#8a6c4c", "#f0eee8"), surface="feathers", accent="#f08a14"),
    "duckling": Coat(("#f4d43c",), surface="feathers", accent="#e08020"),
    "chicken": Coat(("#f0ece4", "#b0602c"), surface="feathers", accent="#d02c1c"),
    "rooster": Coat(("#a8441c",), ("#1c3428",), "patches", 0.35, "feathers", accent="#d01c1c"),
    "penguin": Coat(("#16181c",), surface="feathers", belly="#f4f4f0", accent="#f0a01c"),
    "flamingo": Coat(("#f48ca0",), surface="feathers", accent="#282020"),
    "parrot": Coat(("#d81c1c", "#1c9a3c"), ("#1c5cc8",), "patches", 0.35, "feathers", accent="#383434"),
    "crow": Coat(("#141418",), surface="feathers"),
    "raven": Coat(("#121216",), surface="feathers"),
    "owl": Coat(("#8a6a48",), ("#e0d0b0",), "spots", 0.3, "feathers", accent="#e0b030"),
    "swan": Coat(("#f6f4f0",), surface="feathers", accent="#e8741c"),
    "eagle": Coat(("#4c3420",), surface="feathers", accent="#e8b420"),
    "canary": Coat(("#f8dc28",), surface="feathers"),
    "ladybug": Coat(("#d01c14",), ("#141212",), "spots", 0.2, "lacquer"),
    "bee": Coat(("#f0b41c",), ("#1c1814",), "bands", 0.45),
    "caterpillar": Coat(("#7cb82c",), ("#2c4c14",), "bands", 0.3, "skin"),
}

#: People: colours of the clothes (body and arms), of legs where apart, and of stripes; the head is skin.
PEOPLE: dict[str, tuple[str, str, str]] = {
    "firefighter": ("#2a2c34 #8c7448 #20242c", "", "#e8e03c"),
    "fireman": ("#262830 #94784a", "", "#e8e03c"),
    "police officer": ("#1a2444", "#161c30", ""),
    "soldier": ("#5c6440", "#54583a", ""),
    "nurse": ("#e8eef0 #8cc4d0", "", ""),
    "doctor": ("#f0f2f2", "#4a5460", ""),
    "astronaut": ("#eeeeec", "", "#d86c2c"),
    "chef": ("#f2f2ee", "#34363c", ""),
    "businessman": ("#20242c #3c4048", "", ""),
    "construction worker": ("#f0741c", "#34486c", "#e8e83c"),
    "wizard": ("#2c2c84 #4c2c7c", "", ""),
    "monk": ("#5c3a20", "", ""),
    "king": ("#8c1420", "", "#d8a830"),
    "pirate": ("#7a1c1c #e4dcc8", "#2c2420", "#16181c"),
    "ninja": ("#16161a", "", ""),
    "farmer": ("#b03030 #4c6c9c", "#34507c", ""),
    "santa claus": ("#c8141c", "", "#f4f0ec"),
    "clown": ("#f0c828", "#d83c8c", "#2c9ad0"),
    "sailor": ("#f0f0ee", "#1c2c54", "#1c2c54"),
    "athlete": ("#d02c2c #1c5cb0 #1c8a4c", "#1c1c20", ""),
    "mechanic": ("#2c4468", "", ""),
    "priest": ("#16161a", "", ""),
    "superhero": ("#1c3ca8", "#c01c20", "#e8c028"),
    "diver": ("#1c1e22", "", "#e0d02c"),
    "pilot": ("#4c5038", "", ""),
    "football player": ("#1c7c3c #c0182c", "#f0f0ee", ""),
    "waiter": ("#f0f0ee", "#18181c", "#18181c"),
    "postman": ("#24408c", "", "#c8202c"),
    "gardener": ("#4c7c34", "#6a5438", ""),
    "princess": ("#f0a0c4", "", "#e8c860"),
}

#: Objects: what they are usually made of, and the shapes they fit; "*" fits all.
OBJECTS: dict[str, tuple[str, str]] = {
    "teapot": ("porcelain ceramic steel", "vessel"),
    "vase": ("porcelain ceramic glass", "vessel"),
    "cup": ("porcelain plastic", "vessel"),
    "mug": ("ceramic enamel", "vessel"),
    "bottle": ("glass plastic steel", "vessel"),
    "jug": ("ceramic porcelain", "vessel"),
    "bowl": ("ceramic wood", "vessel"),
    "pot": ("terracotta copper", "vessel"),
    "urn": ("bronze marble", "vessel"),
    "kettle": ("steel copper", "vessel"),
    "flask": ("steel glass", "vessel"),
    "bucket": ("zinc plastic", "vessel"),
    "plate": ("porcelain", "block ball"),
    "goblet": ("silver gold", "vessel"),
    "trophy": ("gold silver", "vessel"),
    "candlestick": ("brass silver", "vessel tool"),
    "bell": ("brass bronze", "vessel headgear"),
    "lamp": ("brass fabric", "headgear vessel"),
    "chair": ("wood plastic leather", "furniture"),
    "armchair": ("leather velvet fabric", "furniture"),
    "table": ("wood marble glass", "furniture"),
    "sofa": ("leather fabric velvet", "furniture"),
    "stool": ("wood steel", "furniture"),
    "bench": ("wood stone", "furniture"),
    "desk": ("oak wood", "furniture"),
    "bed": ("wood cotton", "furniture"),
    "throne": ("gold velvet", "furniture"),
    "cabinet": ("oak mahogany", "furniture block"),
    "box": ("cardboard wood", "block"),
    "crate": ("wood plastic", "block"),
    "chest": ("oak iron", "block"),
    "book": ("leather paper", "block"),
    "brick": ("brick", "block"),
    "dice": ("plastic ivory", "block"),
    "barrel": ("oak", "vessel block"),
    "drum": ("wood leather", "block vessel"),
    "helmet": ("leather steel plastic", "headgear"),
    "hat": ("felt leather straw", "headgear"),
    "cap": ("cotton leather", "headgear"),
    "flight helmet": ("leather", "headgear"),
    "aviator cap": ("leather", "headgear"),
    "crown": ("gold", "ring headgear"),
    "boot": ("leather rubber", "figure compound"),
    "glove": ("leather wool", "compound blob"),
    "bag": ("leather canvas", "block blob"),
    "shoe": ("leather fabric", "blob compound"),
    "ball": ("rubber leather plastic", "ball"),
    "beach ball": ("vinyl", "ball"),
    "football": ("leather", "ball"),
    "balloon": ("rubber vinyl", "ball blob"),
    "marble ball": ("marble", "ball"),
    "egg": ("chalk porcelain", "ball"),
    "pebble": ("stone granite", "ball blob"),
    "rock": ("stone basalt", "blob"),
    "boulder": ("granite stone", "blob"),
    "ring": ("gold silver", "ring"),
    "donut": ("bread chocolate", "ring"),
    "tire": ("rubber", "ring"),
    "wheel": ("rubber steel", "ring"),
    "swim ring": ("vinyl", "ring"),
    "life buoy": ("foam vinyl", "ring"),
    "float": ("vinyl", "ring bird blob"),
    "bracelet": ("silver gold jade", "ring"),
    "pipe": ("copper steel", "tool block"),
    "gear": ("steel brass", "tool"),
    "nut": ("steel brass", "tool"),
    "wing nut": ("steel brass zinc", "tool"),
    "bolt": ("steel zinc", "tool"),
    "screw": ("steel", "tool"),
    "wrench": ("chrome steel", "tool"),
    "hammer": ("steel iron", "tool"),
    "key": ("brass steel", "tool"),
    "anchor": ("iron", "tool"),
    "hinge": ("brass iron", "tool"),
    "door handle": ("brass chrome", "tool"),
    "valve": ("brass bronze", "tool"),
    "tap": ("chrome brass", "tool"),
    "spanner": ("chrome steel", "tool"),
    "chain": ("iron steel", "ring tool"),
    "sword": ("steel", "tool"),
    "shield": ("steel bronze", "block"),
    "cannon": ("cast-iron bronze", "tool vessel"),
    "anvil": ("cast-iron", "tool block"),
    "robot": ("steel plastic", "figure"),
    "statue": ("marble bronze stone", "figure quadruped bird"),
    "figurine": ("porcelain wood", "figure quadruped bird"),
    "doll": ("plastic porcelain", "figure"),
    "mannequin": ("plastic wood", "figure"),
    "knight": ("steel", "figure"),
    "suit of armour": ("steel iron", "figure"),
    "skeleton": ("bone", "figure"),
    "snowman": ("snow", "figure ball"),
    "scarecrow": ("straw burlap", "figure"),
    "mummy": ("canvas", "figure"),
    "toy": ("plastic wood", "*"),
    "sculpture": ("marble bronze clay", "*"),
    "ornament": ("glass gold", "*"),
    "object": ("plastic stone", "*"),
    "thing": ("plastic clay", "*"),
    "shape": ("plastic clay", "*"),
    "model": ("plastic resin", "*"),
    "rubber duck": ("vinyl", "bird"),
    "car": ("car-paint", "vehicle"),
    "truck": ("car-paint", "vehicle"),
    "train": ("paint iron", "vehicle"),
    "bus": ("car-paint", "vehicle"),
    "toy car": ("plastic paint", "vehicle"),
    "tank": ("camouflage", "vehicle"),
    "sports car": ("car-paint", "vehicle"),
    "skull": ("bone", "ball headgear"),
    "mask": ("wood gold", "headgear ball"),
    "candle": ("wax", "block vessel"),
    "soap": ("wax", "block"),
    "pillow": ("cotton silk", "blob block"),
    "cushion": ("velvet fabric", "blob block"),
    "carpet": ("wool", "block"),
    "boat": ("wood paint", "vehicle compound"),
    "house": ("brick plaster", "block"),
    "wall": ("brick concrete", "block"),
    "tower": ("stone brick", "vessel block"),
    "fountain": ("stone marble", "vessel"),
    "column": ("marble stone", "vessel block"),
    "guitar": ("mahogany pine-wood", "compound"),
    "violin": ("walnut-wood mahogany", "compound"),
    "piano": ("lacquer", "furniture"),
    "camera": ("plastic gunmetal", "block compound"),
    "phone": ("glass plastic", "block"),
    "clock": ("brass oak", "block headgear"),
    "basket": ("wicker", "vessel"),
    "lantern": ("iron brass", "vessel"),
    "thermos": ("steel plastic", "vessel"),
    "umbrella": ("nylon", "headgear"),
    "mushroom": ("chalk suede", "headgear"),
    "cactus": ("leaves", "plant figure"),
}

#: Fruit, plants and food that are a material by themselves: colours, variation, roughness; leaf or stem colour on top.
PRODUCE: dict[str, tuple[str, str, float]] = {
    "orange": ("#f0861c", "#e06c10", 0.45),
    "lemon": ("#f4dc2c", "#e0c020", 0.4),
    "lime": ("#8cc024", "#5c9418", 0.4),
    "tomato": ("#d42414", "#b8180c", 0.2),
    "apple": ("#c01c20", "#d8a03c", 0.25),
    "green apple": ("#8cbc34", "#a8d050", 0.25),
    "avocado": ("#3c4a1c", "#242c10", 0.5),
    "banana": ("#f4d43c", "#b89024", 0.45),
    "strawberry": ("#d01c2c", "#e8c070", 0.35),
    "pumpkin": ("#e07818", "#b8540c", 0.45),
    "watermelon": ("#2c6c24", "#7cac4c", 0.3),
    "peach": ("#f4a878", "#d8604c", 0.7),
    "pear": ("#b8c048", "#8c8c30", 0.45),
    "plum": ("#4c1c44", "#6c3460", 0.4),
    "cherry": ("#94101c", "#6c0814", 0.12),
    "grape": ("#5c2c6c", "#3c1c4c", 0.3),
    "carrot": ("#ec7c1c", "#c85c10", 0.55),
    "potato": ("#b08c58", "#846438", 0.8),
    "aubergine": ("#341c3c", "#1c0c24", 0.15),
    "cucumber": ("#3c7c2c", "#245418", 0.45),
    "coconut": ("#5c4028", "#3c2818", 0.9),
    "pineapple": ("#c89028", "#7c6c20", 0.7),
    "kiwi": ("#7c6438", "#5c4824", 0.85),
    "mango": ("#f0a024", "#d0502c", 0.35),
    "onion": ("#c88c48", "#a0642c", 0.35),
    "chestnut": ("#5c2c14", "#3c1c0c", 0.3),
    "olive": ("#6c742c", "#4c541c", 0.25),
    "blueberry": ("#343c6c", "#5c6494", 0.6),
    "cabbage": ("#94b85c", "#b8d488", 0.5),
    "pepper": ("#c8201c", "#a01410", 0.18),
    "corn": ("#f0c83c", "#d0a020", 0.4),
    "cookie": ("#c08c4c", "#4c2c18", 0.85),
    "rose": ("#c01c34", "#8c1024", 0.6),
    "sunflower": ("#f4c01c", "#5c3818", 0.7),
    "mushroom cap": ("#c02818", "#f0e8dc", 0.4),
    "walnut": ("#a07444", "#6c4824", 0.75),
}

#: Words for finish: how they change a material (roughness range or offset, colour, dust, bump).
FINISHES: dict[str, dict[str, float]] = {
    "shiny": {"low": 0.07, "high": 0.16},
    "glossy": {"low": 0.06, "high": 0.16},
    "polished": {"low": 0.06, "high": 0.14},
    "smooth": {"low": 0.16, "high": 0.3},
    "matte": {"low": 0.72, "high": 0.88},
    "matt": {"low": 0.72, "high": 0.88},
    "satin finish": {"low": 0.34, "high": 0.48},
    "satin": {"low": 0.34, "high": 0.48},
    "rough": {"low": 0.78, "high": 0.94, "bump": 0.2},
    "dull": {"low": 0.62, "high": 0.78},
    "wet": {"low": 0.06, "high": 0.16, "value": 0.75},
    "old": {"offset": 0.15, "value": 0.85, "vary": 0.3},
    "worn": {"offset": 0.15, "value": 0.9, "vary": 0.35},
    "weathered": {"offset": 0.2, "value": 0.9, "vary": 0.4},
    "vintage": {"offset": 0.1, "value": 0.88, "vary": 0.2},
    "antique": {"offset": 0.12, "value": 0.82, "vary": 0.25},
    "scratched": {"offset": 0.12, "vary": 0.15},
    "dusty": {"offset": 0.25, "dust": 0.35},
    "dirty": {"offset": 0.2, "value": 0.75, "vary": 0.35},
    "clean": {},
    "new": {},
    "faded": {"offset": 0.1, "dust": 0.25},
    "cracked": {"crack": 1.0},
    "carved": {"bump": 0.2},
    "hand-carved": {"bump": 0.2},
    "rough-hewn": {"bump": 0.3, "offset": 0.1},
    "textured": {"bump": 0.2},
    "hammered": {"bump": 0.3},
    "engraved": {"bump": 0.2},
    "varnished": {"low": 0.14, "high": 0.26},
    "glazed": {"low": 0.08, "high": 0.2},
    "waxed": {"low": 0.26, "high": 0.4},
}
METAL_FINISHES = {
    "polished": 3.0,
    "brushed": 2.5,
    "mirror": 0.3,
    "hammered": 1.0,
    "shiny": 1.5,
    "old": 0.7,
    "worn": 0.7,
    "antique": 0.7,
    "matte": 0.7,
    "scratched": 0.7,
    "dull": 0.5,
    "smooth": 0.4,
    "tarnished": 0.7,
    "satin finish": 0.3,
    "satin": 0.3,
    "glossy": 0.5,
    "rough": 0.4,
    "dusty": 0.4,
    "engraved": 0.3,
}
FINISHES |= {
    "mirror": {"low": 0.05, "high": 0.09},
    "brushed": {"low": 0.32, "high": 0.42},
    "tarnished": {"offset": 0.2, "value": 0.65, "vary": 0.4},
}
FUR_WORDS = {
    "short": {"bump": 0.12},
    "thick": {"bump": 0.35},
    "long": {"bump": 0.3},
    "fluffy": {"bump": 0.35},
    "soft": {"bump": 0.15},
    "shaggy": {"bump": 0.4},
    "realistic": {},
    "smooth": {"bump": 0.05},
    "curly": {"bump": 0.4},
}

#: Words of size before a pattern's noun: its frequency factor.
SIZES = {"small": 1.6, "fine": 1.6, "narrow": 1.6, "thin": 1.6, "large": 0.62, "big": 0.62, "wide": 0.62, "bold": 0.62}
BAND_SIZES = ("thin", "narrow", "fine", "wide", "bold", "large")
SHAPE_SIZES = ("small", "fine", "large", "big")

#: Kinds of split with a fixed phase in object space: what a sentence says decides them, no draw does.
CANONICAL = frozenset(
    {
        "checks", "dots", "bricks", "tiles", "mosaic", "plaid", "weave", "scales", "knit", "hexagons", "diamonds", "herringbone",
        "planks", "stripes", "tiger", "vertical_stripes", "bands", "diagonal_stripes", "spots", "rosettes", "cells", "grain",
        "rings", "waves", "patches", "streaks", "camouflage", "veins", "cracks", "florals",
    }
)  # fmt: skip
#: Share that the overlay of a kind covers unless a table says otherwise.
SHARES = {
    "checks": 0.5, "dots": 0.28, "bricks": 0.12, "tiles": 0.1, "mosaic": 0.45, "plaid": 0.4, "weave": 0.5, "scales": 0.25, "knit": 0.3,
    "hexagons": 0.08, "diamonds": 0.5, "herringbone": 0.12, "planks": 0.08, "stripes": 0.5, "tiger": 0.35, "vertical_stripes": 0.5,
    "bands": 0.5, "diagonal_stripes": 0.5, "spots": 0.25, "rosettes": 0.4, "cells": 0.18, "grain": 0.3, "rings": 0.45, "waves": 0.5,
    "patches": 0.45, "camouflage": 0.3, "florals": 0.32, "veins": 0.15, "specks": 0.25, "cracks": 0.12, "streaks": 0.4,
}  # fmt: skip


@dataclass(frozen=True)
class Pattern:
    """One pattern and its wordings.

    ``words``: ``{a}`` base colour, ``{b}`` overlay colour, ``{m}`` surface, ``{n}`` place of an object's noun, ``{s}``
    place of a word of ``SIZES``. ``unsaid``: colours of base and overlay where the wording names none; an empty overlay
    colour is a darker shade of the base's. ``surfaces``: families that it lies on, the first where none is named.
    """

    kind: str
    words: tuple[str, ...]
    surfaces: tuple[str, ...]
    unsaid: tuple[str, str] = ("#efeeea", "#141414")
    share: float | None = None
    scale: float = 1.0
    weight: float = 1.0


SOLIDS = (
    "plastic",
    "plastic",
    "fabric",
    "cloth",
    "porcelain",
    "ceramic",
    "rubber",
    "vinyl",
    "leather",
    "paint",
    "wool",
    "enamel",
)
WOVEN = ("fabric", "fabric", "cloth", "cotton", "wool", "silk", "linen")
_STRIPE_SURFACES = ("plastic", "fabric", "fabric", "cloth", "cotton", "paint", "vinyl", "porcelain", "wool", "ceramic")
PATTERNS: tuple[Pattern, ...] = (
    Pattern(
        "checks",
        (
            "{a} and {b} {s}checkered {m}{n}", "{a} and {b} {s}checkered {m}{n}", "{a} and {b} {s}checked {m}{n}",
            "{a} and {b} {s}chequered {m}{n}", "{a} and {b} {s}checks on {m}", "{m}{n} with {a} and {b} {s}checks",
            "{a} and {b} {s}checkerboard {m}{n}", "{a} and {b} {s}checkerboard pattern", "{m}{n} with a {a} and {b} {s}checkerboard pattern",
            "{a} {m}{n} with {s}{b} checks", "{s}{b} checks on {a} {m}", "{a} and {b} {s}squares", "{a} {m}{n} with {s}{b} squares",
            "{a} and {b} {m}{n} with a {s}check pattern",
        ),
        SOLIDS,
        weight=3,
    ),
    Pattern(
        "checks",
        (
            "{s}checkered {m}{n}", "{s}checkerboard {m}{n}", "{s}chequered {m}{n}", "chess board pattern", "{m}{n} with a chess board pattern",
            "black and white {s}checkered {m}{n}", "black and white {s}checks", "black and white chess board pattern",
            "black and white {s}checkered {m}{n}", "black and white {s}checkerboard {m}{n}", "chessboard{n}", "{s}checkerboard pattern",
        ),
        SOLIDS,
        ("#121212", "#f0efec"),
        weight=3,
    ),
    Pattern(
        "dots",
        (
            "{a} {m}{n} with {s}{b} polka dots", "{a} {m}{n} with {s}{b} polka dots", "{a} {m}{n} with {s}{b} dots",
            "{a} and {b} {s}polka dotted {m}{n}", "{a} and {b} {s}polka dot {m}{n}", "{s}{b} polka dots on {a} {m}", "{s}{b} dots on {a} {m}",
            "{s}{b} dotted {a} {m}{n}", "{a} and {b} dotted {m}{n}", "{a} with {s}{b} polka dots", "{a} {m}{n} dotted in {b}",
        ),
        ("fabric", *SOLIDS),
        weight=3,
    ),
    Pattern(
        "dots",
        (
            "red {m}{n} with {s}white polka dots", "red {m}{n} with {s}white dots", "red and white {s}polka dotted {m}{n}",
            "{s}polka dotted {m}{n}", "{s}polka dot {m}{n}", "{m}{n} with {s}polka dots", "dotted {m}{n}", "{s}polka dots",
        ),
        ("fabric", "fabric", *SOLIDS),
        ("#d0161b", "#f0efec"),
        weight=2.5,
    ),
    Pattern(
        "stripes",
        (
            "{a} and {b} zebra striped {m}{n}", "{a} {m}{n} with {s}{b} zebra stripes", "{a} and {b} zebra print {m}{n}",
            "{a} {m}{n} with {s}wavy {b} stripes", "{a} and {b} zebra pattern {m}{n}", "{s}{b} zebra stripes on {a} {m}",
        ),
        ("fur", *WOVEN, "plastic", "leather", "paint"),
    ),
    Pattern(
        "stripes",
        (
            "zebra print {m}{n}", "zebra striped {m}{n}", "zebra stripes", "{m}{n} with zebra stripes", "zebra pattern{n}", "zebra patterned {m}{n}",
            "zebra print{n}", "black and white zebra stripes", "white {m}{n} with black zebra stripes",
        ),
        ("fur", "fur", "fabric", "leather", "plastic", "paint"),
        ("#f0eee8", "#121212"),
        weight=1.5,
    ),
    Pattern(
        "tiger",
        ("{a} and {b} tiger striped {m}{n}", "{a} {m}{n} with {b} tiger stripes", "{b} tiger stripes on {a} {m}", "{a} and {b} tiger print {m}{n}"),
        ("fur", *WOVEN, "plastic", "leather"),
    ),
    Pattern(
        "tiger",
        (
            "tiger striped {m}{n}", "tiger print {m}{n}", "tiger stripes", "{m}{n} with tiger stripes", "tiger pattern{n}",
            "orange {m}{n} with black tiger stripes", "orange and black tiger striped {m}{n}", "tiger print{n}", "tiger patterned {m}{n}",
        ),
        ("fur", "fur", "fabric", "leather", "plastic"),
        ("#e07c1e", "#181210"),
        weight=1.5,
    ),
    Pattern(
        "vertical_stripes",
        (
            "{a} and {b} {s}striped {m}{n}", "{a} and {b} {s}striped {m}{n}", "{a} and {b} vertically striped {m}{n}",
            "{a} {m}{n} with {s}{b} stripes", "{a} {m}{n} with {s}vertical {b} stripes", "{a} and {b} {s}vertical stripes",
            "{s}{b} stripes on {a} {m}", "{a} and {b} {s}stripes", "{b} striped {a} {m}{n}", "{m}{n} with {a} and {b} {s}vertical stripes",
        ),
        _STRIPE_SURFACES,
        weight=4,
    ),
    Pattern(
        "vertical_stripes",
        ("{a} {m}{n} with {b} pinstripes", "{a} pinstriped {m}{n}", "{a} {m}{n} pinstriped in {b}", "{a} and {b} pinstriped {m}{n}"),
        ("fabric", "cloth", "wool", "cotton"),
        ("#1a2444", "#d8d8d4"),
        share=0.2,
        scale=1.6,
        weight=0.6,
    ),
    Pattern(
        "vertical_stripes",
        ("{s}striped {m}{n}", "vertically striped {m}{n}", "black and white {s}vertical stripes", "black and white {s}striped {m}{n}"),
        _STRIPE_SURFACES,
        ("#121212", "#f0efec"),
        weight=1.8,
    ),
    Pattern(
        "bands",
        (
            "{a} {m}{n} with {s}{b} horizontal stripes", "{a} and {b} horizontally striped {m}{n}", "{a} and {b} {s}horizontal stripes",
            "{a} {m}{n} with {s}horizontal {b} stripes", "{a} {m}{n} with {s}{b} bands", "{a} and {b} banded {m}{n}", "{s}{b} bands on {a} {m}",
            "{a} {m}{n} with {s}{b} hoops", "{m}{n} with {a} and {b} {s}horizontal stripes",
        ),
        _STRIPE_SURFACES,
        weight=2,
    ),
    Pattern(
        "diagonal_stripes",
        (
            "{a} and {b} diagonally striped {m}{n}", "{a} {m}{n} with {s}diagonal {b} stripes", "{a} and {b} {s}diagonal stripes",
            "{a} {m}{n} with {s}{b} diagonal stripes", "{s}{b} diagonal stripes on {a} {m}",
        ),
        _STRIPE_SURFACES,
        weight=1.5,
    ),
    Pattern("diagonal_stripes", ("candy cane{n}", "candy cane stripes", "candy striped {m}{n}"), ("candy", "plastic"), ("#f0efec", "#d0161b"), weight=0.4),
    Pattern("diagonal_stripes", ("hazard stripes", "black and yellow hazard stripes", "warning stripes on {m}"), ("paint", "plastic"),
            ("#f5d21c", "#121212"), weight=0.4),
    Pattern(
        "spots",
        (
            "{a} {m}{n} with {s}{b} spots", "{a} and {b} {s}spotted {m}{n}", "{s}{b} spots on {a} {m}", "{b} spotted {a} {m}{n}",
            "{a} {m}{n} with {s}{b} blobs",
        ),
        ("fur", *SOLIDS),
        weight=2,
    ),
    Pattern("spots", ("dalmatian print {m}{n}", "dalmatian spots", "dalmatian pattern{n}", "white {m}{n} with black dalmatian spots"),
            ("fur", "fabric", "plastic"), ("#f4f2ee", "#121212"), weight=0.7),
    Pattern("spots", ("cheetah print {m}{n}", "cheetah spots", "cheetah patterned {m}{n}", "cheetah print{n}"), ("fur", "fabric"),
            ("#dcac58", "#1c140e"), scale=1.6, weight=0.8),
    Pattern(
        "rosettes",
        (
            "leopard print {m}{n}", "leopard print{n}", "leopard patterned {m}{n}", "{m}{n} with leopard spots", "leopard spots", "leopard spotted {m}{n}",
            "leopard pattern{n}", "leopard {m}{n}", "jaguar print {m}{n}", "{m}{n} with leopard rosettes",
        ),
        ("fur", "fur", "fur", "fabric", "leather"),
        ("#d8a04c", "#1c140e"),
        weight=2,
    ),
    Pattern("rosettes", ("{a} and {b} leopard print {m}{n}", "{a} {m}{n} with {b} leopard spots", "{a} {m}{n} with {b} rosettes"),
            ("fur", *WOVEN, "leather"), weight=0.8),
    Pattern(
        "cells",
        (
            "giraffe pattern{n}", "giraffe print {m}{n}", "giraffe patterned {m}{n}", "{m}{n} with a giraffe pattern", "giraffe spots",
            "giraffe print{n}", "giraffe {m}{n}",
        ),
        ("fur", "fur", "fabric", "leather"),
        ("#b0702e", "#f0dcae"),
        weight=1.5,
    ),
    Pattern("cells", ("{a} {m}{n} with a {b} giraffe pattern", "{a} and {b} giraffe print {m}{n}"), ("fur", "fabric", "plastic"), weight=0.5),
    Pattern(
        "patches",
        (
            "cow print {m}{n}", "cow print{n}", "cow hide{n}", "cowhide{n}", "cow patches", "cow patterned {m}{n}", "white {m}{n} with black cow patches",
            "black and white cow print {m}{n}", "cow spots",
        ),
        ("fur", "fur", "fabric", "leather"),
        ("#f0ebe0", "#14110f"),
        weight=1.2,
    ),
    Pattern("patches", ("{a} and {b} patched {m}{n}", "{a} {m}{n} with {b} patches", "{a} and {b} {m}{n}", "{b} patches on {a} {m}"), ("fur", *SOLIDS),
            weight=1.5),
    Pattern(
        "bricks",
        (
            "{a} bricks", "{a} brick wall", "{a} brickwork", "{a} brick{n} with {b} mortar", "{a} bricks with {b} mortar", "{n} built of {a} bricks",
            "{a} {s}bricks", "{a} painted bricks", "{a} brick{n}", "wall of {a} bricks",
        ),
        ("brick",),
        ("#9c4632", "#c8c0b2"),
        weight=1.5,
    ),
    Pattern(
        "bricks",
        (
            "red brick{n}", "red bricks", "red brick wall", "brick wall", "brickwork", "{s}bricks", "{n} built of red bricks", "red bricks with grey mortar",
            "red brickwork", "brick{n}", "old red bricks", "wall of red bricks", "red brick{n}", "{s}red bricks",
        ),
        ("brick",),
        ("#a4452f", "#c8c0b2"),
        weight=3.5,
    ),
    Pattern(
        "tiles",
        (
            "{a} {s}tiles", "{a} {s}ceramic tiles", "{a} {s}tiles with {b} grout", "{a} {s}bathroom tiles", "{n} covered in {a} {s}tiles", "{a} tiled{n}",
            "{s}{a} square tiles", "{a} tiles with {b} lines", "{a} glazed {s}tiles", "{a} {m}{n} with a {b} grid", "{a} {m}{n} with {b} grid lines",
        ),
        ("tiles",),
        ("#e4e6e4", "#8c8880"),
        weight=2,
    ),
    Pattern("tiles", ("{s}tiles", "bathroom tiles", "{s}square tiles", "{s}white tiles", "tiled wall", "kitchen tiles"), ("tiles",), ("#e9e9e6", "#8c8880"), weight=1.6),
    Pattern(
        "mosaic",
        (
            "{a} and {b} {s}mosaic{n}", "{s}mosaic tiles of {a} and {b}", "{a} and {b} {s}mosaic tiles", "{n} with a {a} and {b} {s}mosaic",
            "{a} mosaic{n} with {b} pieces", "mosaic of {a} and {b} {m}",
        ),
        ("ceramic", "glass", "marble", "stone"),
        weight=1.5,
    ),
    Pattern(
        "plaid",
        (
            "{a} and {b} {s}plaid{n}", "{a} and {b} {s}plaid {m}{n}", "{a} and {b} {s}tartan{n}", "{a} tartan{n} with {b} bands", "{a} and {b} tartan {m}{n}",
            "{a} {m}{n} with {b} {s}plaid", "{a} plaid {m}{n} with {b} lines", "{a} and {b} gingham{n}",
        ),
        WOVEN,
        weight=2,
    ),
    Pattern("plaid", ("plaid {m}{n}", "tartan{n}", "tartan {m}{n}", "scottish tartan", "red plaid {m}{n}", "lumberjack plaid{n}", "{s}plaid"), WOVEN,
            ("#a02028", "#142438")),
    Pattern(
        "weave",
        ("{a} and {b} woven {m}{n}", "{a} woven {m}{n} with {b}", "{a} and {b} basket weave{n}", "{a} and {b} wicker{n}", "{a} and {b} woven straps"),
        ("fabric", "nylon", "leather", "straw"),
    ),
    Pattern("weave", ("{a} wicker{n}", "{a} basket weave{n}", "{a} woven {m}{n}", "{a} {s}weave", "woven {a} {m}{n}"), ("straw", "fabric", "leather"),
            ("#b08850", "")),
    Pattern("weave", ("wicker{n}", "woven wicker{n}", "wicker basket", "basket weave{n}", "woven straw{n}", "woven {m}{n}"), ("straw",),
            ("#b08850", "#5c3e1e")),
    Pattern(
        "scales",
        (
            "{a} {s}scales", "{a} fish scales", "{a} dragon scales", "{a} reptile scales", "{n} covered in {a} {s}scales", "{a} scaly skin", "{a} {s}scales with {b} rims",
            "{a} scaly{n}", "{a} snake scales", "{a} roof shingles",
        ),
        ("scales",),
        ("#4a7a34", ""),
        weight=1.8,
    ),
    Pattern(
        "knit",
        (
            "{a} {s}knit{n}", "{a} knitted{n}", "{a} {s}knitted wool{n}", "{a} knitted fabric{n}", "{a} cable knit{n}", "{a} knitted sweater", "{a} woollen knit",
            "{n} knitted from {a} wool", "{a} chunky knit{n}", "{a} knitwear",
        ),
        ("knitted wool",),
        ("#c8b8a0", ""),
        weight=2,
    ),
    Pattern(
        "hexagons",
        (
            "{a} {s}hexagons with {b} lines", "{a} honeycomb{n}", "{a} {s}hexagonal tiles", "{a} {m}{n} with a {b} honeycomb pattern",
            "{a} {m}{n} with {s}{b} hexagons", "{a} and {b} {s}hexagon pattern", "{a} hexagon tiles with {b} grout",
        ),
        ("ceramic", "plastic", "fabric", "tiles"),
        ("#e8a826", ""),
        weight=1.3,
    ),
    Pattern(
        "diamonds",
        (
            "{a} and {b} {s}argyle {m}{n}", "{a} {m}{n} with {s}{b} diamonds", "{a} and {b} {s}diamond pattern", "{a} and {b} {s}argyle{n}",
            "{a} and {b} harlequin {m}{n}", "{a} and {b} diamond patterned {m}{n}", "{s}{b} diamonds on {a} {m}", "{a} argyle {m}{n} with {b} diamonds",
        ),
        ("fabric", "wool", *SOLIDS),
        weight=1.5,
    ),
    Pattern(
        "herringbone",
        (
            "{a} herringbone {m}{n}", "{a} and {b} herringbone {m}{n}", "{a} herringbone tiles", "{a} {m}{n} with a {b} herringbone pattern",
            "{a} herringbone bricks", "{a} herringbone parquet",
        ),
        ("fabric", "wool", "ceramic", "wood"),
        ("#b07c44", ""),
    ),
    Pattern("herringbone", ("herringbone parquet", "herringbone wood floor", "wood{n} in a herringbone pattern", "herringbone oak"), ("wood",),
            ("#b07c44", "#452a14"), weight=0.6),
    Pattern(
        "planks",
        ("{a} painted planks", "{a} wooden planks", "{a} {s}planks", "{a} painted boards", "{n} made of {a} planks", "{a} planks with {b} gaps"),
        ("paint", "wood"),
        ("#9a6a3c", "#2a1a0e"),
    ),
    Pattern("planks", ("wooden planks", "wood planks", "{s}wooden boards", "planks of wood", "{n} made of wooden planks", "barn wood"), ("wood",),
            ("#94663a", "#24160c")),
    Pattern("waves", ("{a} {m}{n} with {s}{b} waves", "{a} and {b} wavy {m}{n}", "{a} and {b} {s}waves", "{a} and {b} wave pattern {m}{n}"),
            ("fabric", "ceramic", "plastic", "porcelain", "paint")),
    Pattern("rings", ("{a} {m}{n} with {s}{b} rings", "{a} and {b} agate{n}", "{a} {m}{n} with concentric {b} circles", "{a} and {b} {s}rings"),
            ("stone", "plastic", "ceramic", "paint"), weight=0.8),
    Pattern("florals", ("{a} {m}{n} with {b} flowers", "{a} {m}{n} with a {b} painted pattern", "{a} and {b} floral {m}{n}", "{a} {m}{n} with {b} ornaments"),
            ("porcelain", "porcelain", "ceramic", "fabric", "enamel")),
    Pattern("veins", ("{a} marble{n} with {b} veins", "{a} and {b} marble{n}", "{a} marble{n} veined with {b}"), ("marble",)),
    Pattern("specks", ("{b} speckled {a} {m}{n}", "{a} {m}{n} with {b} speckles", "{a} and {b} terrazzo{n}", "{a} {m}{n} with {b} specks"),
            ("ceramic", "stone", "plastic", "enamel")),
    Pattern("streaks", ("{a} {m}{n} with {b} streaks", "{a} and {b} streaked {m}{n}"), ("stone", "glass", "paint", "ceramic"), weight=0.6),
    Pattern("cracks", ("{a} {m}{n} with {b} cracks", "cracked {a} {m}{n} with {b} cracks"), ("paint", "stone", "clay", "porcelain"), weight=0.6),
)  # fmt: skip
#: Camouflage: name, base and the two colours over it.
CAMOUFLAGE: dict[str, tuple[str, str, str]] = {
    "": ("#5c6440", "#2e3422", "#8a7c54"),
    "woodland ": ("#55603a", "#262a1c", "#6a4c30"),
    "green ": ("#5a6c3a", "#2c3c20", "#93a068"),
    "desert ": ("#c8ad7c", "#8c6c44", "#e4d4ac"),
    "arctic ": ("#e4e6e6", "#8c9296", "#4c5054"),
    "grey ": ("#8a8a88", "#3c3c3c", "#c4c4c2"),
    "blue ": ("#4c6488", "#1c2c4c", "#8ca0b8"),
    "army ": ("#5c6440", "#2e3422", "#8a7c54"),
    "military ": ("#5c6440", "#2e3422", "#8a7c54"),
}
#: Animals whose coat is named as a material: "zebra fur", "cow hide".
HIDES: dict[str, tuple[float, tuple[str, ...]]] = {
    "zebra": (3, ("fur", "skin", "hide", "coat")),
    "tiger": (2.5, ("fur", "skin", "coat")),
    "leopard": (3, ("fur", "fur", "skin", "coat")),
    "jaguar": (0.7, ("fur", "coat")),
    "cheetah": (1, ("fur", "coat")),
    "giraffe": (2, ("fur", "hide", "skin", "coat")),
    "dalmatian": (1, ("fur", "coat")),
    "cow": (2, ("hide", "fur", "skin")),
    "fox": (1.5, ("fur", "coat")),
    "red fox": (1.5, ("fur", "coat")),
    "bear": (0.6, ("fur",)),
    "polar bear": (0.5, ("fur",)),
    "koala": (0.7, ("fur",)),
    "lion": (0.7, ("fur",)),
    "wolf": (0.5, ("fur",)),
    "elephant": (0.7, ("skin", "hide")),
    "sheep": (0.6, ("wool", "fleece")),
    "rabbit": (0.4, ("fur",)),
    "crocodile": (0.6, ("skin", "scales")),
    "snake": (0.5, ("skin", "scales")),
    "flamingo": (0.3, ("feathers",)),
    "owl": (0.4, ("feathers",)),
    "parrot": (0.3, ("feathers",)),
}
