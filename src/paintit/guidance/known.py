"""The priors that have a short name: ``priors.toml``, read when it is asked for. No torch: ``priors list`` is quick."""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

from paintit.errors import PriorError


@dataclass(frozen=True)
class PriorInfo:
    """A prior that has a short name."""

    name: str
    """What ``--prior`` takes."""
    family: str
    """As in ``PriorSpec.family``."""
    sources: tuple[str, ...]
    """Hub ids of the same weights, the one to ask first in front; none for what ships with paintit."""
    withdrawn: tuple[str, ...]
    """Hub ids under which these weights can no longer be had."""
    revision: str
    """Commit of the first source; empty where none is pinned."""
    licence: str
    gated: bool
    """Whether the publisher wants the licence accepted before a download."""
    resolution: int
    """Side of the image it looks at, in pixels."""
    size_mb: int
    """Download, in megabytes; 0 where there is none."""
    memory_mb: int
    """Its weights in 16-bit floats, in megabytes; 0 where they are negligible."""
    guidance: float
    """Default s in uncond + s (cond - uncond)."""
    sees: tuple[str, ...]
    """What it is shown of the mesh without a ControlNet, as ``Prior.sees``; empty for most."""
    control: Mapping[str, str]
    """Kind of picture -> hub id of the ControlNet for it that is used."""
    adapter: str
    """``OWNER/NAME/FILE`` of the IP-Adapter that is used for reference pictures; empty where none is known."""
    tiny: str
    """Hub id of a tiny autoencoder that speaks of its latents; empty where there is none."""
    note: str
    """One line for the list."""

    @property
    def pins(self) -> tuple[tuple[str, str], ...]:
        """(hub id, revision) in the order in which they are asked; the newest where the pinned one cannot be had."""
        newest = [(source, "") for source in self.sources]
        return ((self.sources[0], self.revision), *newest) if self.revision else tuple(newest)


@cache
def known_priors() -> Mapping[str, PriorInfo]:
    """Short name -> what stands behind it, in the order of the file."""
    text = files("paintit.guidance").joinpath("priors.toml").read_text(encoding="utf-8")
    return {
        name: PriorInfo(name, **row | {key: tuple(row[key]) for key in ("sources", "withdrawn", "sees")})
        for name, row in tomllib.loads(text).items()
    }


def known_prior(name: str) -> PriorInfo | None:
    """The entry of a short name or of a hub id that it comes from; None for anything else."""
    table = known_priors()
    return table.get(name) or next((info for info in table.values() if name in info.sources), None)


def prior_info(name: str) -> PriorInfo:
    """The entry of a short name.

    Raises:
        PriorError: there is none; the message names the nearest.
    """
    if name not in known_priors():
        raise unknown_prior(name)
    return known_priors()[name]


def unknown_prior(name: str) -> PriorError:
    near = difflib.get_close_matches(name.lower(), known_priors(), n=1, cutoff=0.5)
    hint = f"did you mean {near[0]}? " if near else ""
    return PriorError(
        "prior.unknown",
        f"there is no prior '{name}'",
        f"{hint}known: {', '.join(known_priors())}; a folder or a hub id OWNER/NAME also works",
    )


def instead_of(source: str) -> str:
    """What to use in place of a hub id that cannot be had, in words."""
    for info in known_priors().values():
        others = [other for other in info.sources if other != source]
        if source in info.withdrawn or (source in info.sources and others):
            return f"the same weights: --prior {info.name} ({' or '.join(others)})"
        for kind, net in info.control.items():
            if net == source:
                return f"another one: --control {kind}=FOLDER_OR_ID"
    family = next((info.family for info in known_priors().values() if source in info.sources), "")
    names = [info.name for info in known_priors().values() if info.sources and source not in info.sources]
    names.sort(key=lambda name: known_priors()[name].family != family)
    return f"others: --prior {', '.join(names[:5])}; 'paintit priors list' shows all"
