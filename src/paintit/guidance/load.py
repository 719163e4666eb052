"""Priors by name. No torch at import."""

from __future__ import annotations

import re
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from paintit.errors import PriorError
from paintit.guidance import hub
from paintit.guidance.families import FAMILIES, Family
from paintit.guidance.known import PriorInfo, known_prior, known_priors, unknown_prior
from paintit.guidance.loading import Loading

if TYPE_CHECKING:
    from paintit.guidance.prior import Prior

_HUB_ID = re.compile(r"[\w.-]+/[\w.-]+")


def load_prior(name: str, loading: Loading | None = None) -> Prior:
    """The prior called ``name``: a short name (see ``priors.toml``), a folder that diffusers saved, or a hub id.

    Args:
        loading: nothing is ever downloaded unless it allows that; what the cache holds is used.

    Raises:
        PriorError: unknown name, not on this machine, of another kind, or its extra is not installed.
    """
    loading = loading or Loading()
    if name == "pocket":
        from paintit.guidance.pocket import PocketPrior

        return PocketPrior.load(device=loading.device, dtype=loading.dtype)
    known = known_prior(name)
    _check_name(name, known)
    hub.require_extra(FAMILIES[known.family].about if known else "a diffusion model")
    source, revision = locate(name, loading.revision, loading.allow_download)
    family = FAMILIES[known.family] if known else hub.family_at(source, revision, loading.allow_download)
    licence = known.licence if known else ""
    prior = prior_class(family).load(source, replace(loading, revision=revision, licence=licence))
    if known:
        prior.spec = replace(prior.spec, guidance_scale=known.guidance)
    return prior


def locate(name: str, revision: str = "", allow_download: bool = False) -> tuple[str, str]:
    """(folder or hub id, revision) behind ``name``: of a short name, the first of its sources that can be had.

    Raises:
        PriorError: none can.
    """
    known = known_priors().get(name)
    if known is None:
        return name, revision
    return hub.first_source(_pins(known, revision), FAMILIES[known.family], allow_download)


def on_this_machine(info: PriorInfo, revision: str = "") -> bool:
    """Whether a known prior could be loaded now without a download."""
    return not info.sources or any(
        hub.on_this_machine(source, FAMILIES[info.family], at) for source, at in _pins(info, revision)
    )


def plan_download(name: str, revision: str = "") -> hub.Download:
    """What ``paintit priors pull`` would fetch for a short name or a hub id.

    Raises:
        PriorError: unknown name, or nothing can be had.
    """
    known = known_prior(name)
    _check_name(name, known)
    if Path(name).expanduser().is_dir() or (known and not known.sources):
        raise PriorError("prior.here", f"'{name}' is on this machine", f"use it: --prior {name}")
    hub.require_extra("downloading a prior", ["huggingface_hub"])
    if name not in known_priors():
        return hub.plan_download(name, hub.family_at(name, revision, allow_download=True), revision)
    return hub.first_plan(_pins(known_priors()[name], revision), FAMILIES[known_priors()[name].family])


def prior_class(family: Family) -> type:
    """The class that loads checkpoints of ``family``."""
    module, _, name = family.place.partition(":")
    return getattr(import_module(module), name)


def _pins(info: PriorInfo, revision: str) -> list[tuple[str, str]]:
    return [(source, revision or pinned) for source, pinned in info.pins]


def _check_name(name: str, known: PriorInfo | None) -> None:
    path = Path(name).expanduser()
    if known or path.is_dir():
        return
    if path.is_file():
        raise PriorError("prior.file", f"'{name}' is a single file", "give the folder that diffusers saved")
    if path.is_absolute() or name.startswith((".", "~")):
        raise PriorError("prior.missing", f"there is no folder '{name}'", "check the path")
    if not _HUB_ID.fullmatch(name):
        raise unknown_prior(name)
