"""Priors by name. No torch at import."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from paintit.control import Control
from paintit.errors import PriorError
from paintit.guidance import additions, hub
from paintit.guidance.economy import Choice
from paintit.guidance.families import CONTROLNET, FAMILIES, Family
from paintit.guidance.known import PriorInfo, known_prior, unknown_prior
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
    if loading.replicas:
        from paintit.guidance.replicas import Replicas

        devices = (loading.device, *loading.replicas)
        return Replicas([load_prior(name, replace(loading, device=at, replicas=())) for at in devices], devices)
    if name == "pocket":
        from paintit.guidance.pocket import PocketPrior

        controls_for(name, loading.control)
        additions.check(name, loading, None)
        return PocketPrior.load(device=loading.device, dtype=loading.dtype)
    known = known_prior(name)
    _check_name(name, known)
    hub.require_extra(FAMILIES[known.family].about if known else "a diffusion model")
    family = FAMILIES[known.family] if known else hub.family_at(name, loading.revision, loading.allow_download)
    if not family.place:
        hint = f"put it beside one: --control depth={name}" if family is CONTROLNET else f"--compute.tiny-vae {name}"
        raise PriorError("prior.kind", f"'{name}' is one of {family.about}, not a prior", hint)
    controls = controls_for(name, loading.control, family)
    loading = additions.with_adapter(name, loading)
    additions.check(name, loading, family)
    source, revision = locate(name, loading.revision, loading.allow_download)
    licence = known.licence if known else ""
    prior = prior_class(family).load(
        source,
        replace(loading, revision=revision, licence=licence, control=controls, tiny=known.tiny if known else ""),
    )
    if known:
        prior.spec = replace(prior.spec, guidance_scale=known.guidance)
    return prior


def controls_for(name: str, controls: Sequence[Control], family: Family | None = None) -> tuple[Control, ...]:
    """``controls`` with the model that each one means beside the prior ``name``: its own, or the one of the table.

    Args:
        family: of an unknown prior, where it is one of diffusers' checkpoints.

    Raises:
        PriorError: the prior takes no ControlNet, or none of that kind is known for it.
    """
    known = known_prior(name)
    family = family or (FAMILIES.get(known.family) if known else None)
    if controls and not (family and family.controlled):
        about = f", of {family.about}," if family else ""
        raise PriorError(
            "prior.control", f"'{name}'{about} takes no ControlNet",
            "leave --control out, or choose a prior of Stable Diffusion 1.x, 2.x or XL",
        )  # fmt: skip
    nets = known.control if known else {}
    for control in controls:
        if not control.model and control.kind not in nets:
            others = f"; known for it: {', '.join(nets)}" if nets else ""
            raise PriorError(
                "prior.control", f"no ControlNet for {control.kind} is known for '{name}'{others}",
                f"name one that was made for this model: --control {control.kind}=FOLDER_OR_ID",
            )  # fmt: skip
    return tuple(replace(control, model=control.model or nets[control.kind]) for control in controls)


def locate(name: str, revision: str = "", allow_download: bool = False) -> tuple[str, str]:
    """(folder or hub id, revision) behind ``name``: of what is known, the first place where it can be had.

    Raises:
        PriorError: none can.
    """
    known = known_prior(name)
    if known is None or (name != known.name and Path(name).is_dir()):
        return name, revision
    return hub.first_source(_pins(known, name, revision), FAMILIES[known.family], allow_download)


def on_this_machine(info: PriorInfo, name: str = "", revision: str = "") -> bool:
    """Whether a known prior, under its short name or a hub id, could be loaded now without a download."""
    return not info.sources or any(
        hub.on_this_machine(source, FAMILIES[info.family], at)
        for source, at in _pins(info, name or info.name, revision)
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
    if known is None:
        return hub.plan_download(name, hub.family_at(name, revision, allow_download=True), revision)
    return hub.first_plan(_pins(known, name, revision), FAMILIES[known.family])


def plan_memory(name: str, loading: Loading) -> Choice | None:
    """What would be done to keep ``loading.budget``, and what the paint would then take: from the configurations alone.

    None for what is not on this machine, and for a prior too small to ask.

    Raises:
        PriorError: the budget cannot be kept, or the checkpoint is of another kind.
    """
    known = known_prior(name)
    if known and not known.sources:
        return None
    try:
        source, revision = locate(name, loading.revision)
        family = FAMILIES[known.family] if known else hub.family_at(source, revision)
        found = hub.open_checkpoint(source, family, revision=revision)
    except PriorError as error:
        if error.code == "prior.not_cached":
            return None
        raise
    controls = controls_for(name, loading.control, family)
    loading = additions.with_adapter(name, loading)
    loading = replace(loading, control=controls, tiny=known.tiny if known else "")
    return prior_class(family).choice(found, loading)


def prior_class(family: Family) -> Any:
    """The class that loads checkpoints of ``family``."""
    module, _, name = family.place.partition(":")
    return getattr(import_module(module), name)


def _pins(info: PriorInfo, name: str, revision: str) -> list[tuple[str, str]]:
    """(hub id, revision) to ask for: of a short name any source's, of a hub id its own alone."""
    pins = [(source, revision or pinned) for source, pinned in info.pins if name in (info.name, source)]
    return list(dict.fromkeys(pins))


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
