"""The methods that are compared, by name: the paper's own, its ablations and its rivals (paper 4, 5, supp. B)."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from paintit.config import PaintConfig
from paintit.errors import UsageError


@dataclass(frozen=True)
class Variant:
    """One method as a change of settings."""

    title: str
    """A few words for tables and plots."""
    section: str
    """Where the paper has it."""
    overrides: Mapping[str, Any]
    """Setting, dotted -> value; one value for a setting that lists several stands for each of them."""


#: Learning rates were found with the preset ``pocket`` (docs/design/parameterisations.md). A logit takes Adam's steps
#: alone, where a network's weights add theirs up, so ``pixels`` needs far larger ones.
VARIANTS: dict[str, Variant] = {
    "dcpbr": Variant("DC-PBR", "3.3", {"texture.kind": "dcpbr"}),
    "dcpbr-no-skip": Variant("DC-PBR without skips", "supp. B.2", {"texture.kind": "dcpbr", "texture.skip_widths": 0}),
    "pixels": Variant(
        "pixels + TV", "4.1, eq. 4", {"texture.kind": "pixels", "texture.tv_weight": 1.0, "optim.lr": 0.2}
    ),
    "base-color": Variant("base colour only", "5.4", {"texture.kind": "dcpbr", "texture.maps": "base_color"}),
    "hash-grid": Variant("hash grid + MLP", "supp. B.1", {"texture.kind": "hash-grid", "optim.lr": 1e-2}),
    "points": Variant("MLP on 3D points", "5.3, Fantasia3D", {"texture.kind": "points", "optim.lr": 1e-2}),
    "projection": Variant("projection", "5.3, TEXTure and Text2Tex", {"method": "projection"}),
}


def apply(config: PaintConfig, name: str) -> PaintConfig:
    """``config`` as the method ``name`` has it; what the method does not say stays.

    Raises:
        UsageError: there is no such method; the message lists those there are.
    """
    if name not in VARIANTS:
        raise UsageError("variant.unknown", f"there is no method '{name}'", f"choose one of {', '.join(VARIANTS)}")
    for setting, value in VARIANTS[name].overrides.items():
        config = _replaced(config, setting.split("."), value)
    return config


def _replaced(config: Any, path: list[str], value: Any) -> Any:
    first, *rest = path
    current = getattr(config, first)
    if rest:
        value = _replaced(current, rest, value)
    elif isinstance(current, tuple) and not isinstance(value, tuple):
        value = (value,) * len(current)
    return dataclasses.replace(config, **{first: value})
