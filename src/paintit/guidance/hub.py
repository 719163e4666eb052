"""Checkpoints that diffusers saved, of any family: found in a folder or on the hub, checked, loaded part by part."""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import json
import logging
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from paintit.errors import PriorError
from paintit.guidance import remote
from paintit.guidance.families import CONTROLNET, FAMILIES, Family, family_of, foreign_schedule, supported
from paintit.guidance.known import known_prior
from paintit.guidance.parts import inside, select

if TYPE_CHECKING:
    import torch

log = logging.getLogger(__name__)

#: The files that say what a folder is, the one of a whole checkpoint first.
INDICES = tuple(dict.fromkeys(family.index for family in (*FAMILIES.values(), CONTROLNET)))
DTYPES = ("float32", "bfloat16", "float16", "float64")


@dataclass(frozen=True)
class Checkpoint:
    """A whole checkpoint on this machine."""

    folder: Path
    id: str
    """As it was asked for: hub id or folder."""
    revision: str
    """Commit; or, of a folder, SHA-256 of the weights of the network that denoises."""
    variant: str | None
    """``fp16`` where the weights are there in that precision only."""
    index: Mapping[str, Any]
    """``model_index.json``, or a single network's ``config.json``: its class, ``_class_name``, and its settings."""

    @property
    def scheduler(self) -> str:
        """Its class; empty where it is not said, or there is none."""
        file = self.folder / "scheduler/scheduler_config.json"
        return str(json.loads(file.read_text("utf-8")).get("_class_name", "")) if file.is_file() else ""

    def has(self, part: str) -> bool:
        return (self.folder / part).is_dir()

    def part(self, cls: Any, name: str, dtype: torch.dtype | None = None) -> Any:
        """``cls`` with the weights and settings in the subfolder ``name``; ``""`` for a single network.

        Args:
            cls: a class of diffusers or transformers.
            dtype: of a model; None for what has no weights, tokenizers and schedulers.

        Raises:
            PriorError: it cannot be read.
        """
        options: dict[str, Any] = {"local_files_only": True} | ({"subfolder": name} if name else {})
        if dtype is not None:
            precision = "dtype" if cls.__module__.startswith("transformers") else "torch_dtype"
            options |= {precision: dtype, "use_safetensors": True, "variant": self.variant}
        try:
            with _without_bars():
                return cls.from_pretrained(self.folder, **options)
        except Exception as error:
            reason = next(iter(str(error).strip().splitlines()), "") or type(error).__name__
            raise PriorError(
                "prior.load",
                f"the {name or 'network'} of '{self.id}' cannot be loaded: {reason}",
                "fetch it again; a file may be cut short",
            ) from error


def open_checkpoint(
    source: str | Path, family: Family, *, revision: str = "", allow_download: bool = False
) -> Checkpoint:
    """The checkpoint in the folder ``source``, or with the hub id ``source``: from the cache where it is whole there.

    Args:
        revision: commit, tag or branch of a hub id.
        allow_download: fetches what the cache lacks; the licence is logged before.

    Raises:
        PriorError: it is not there, cannot be had, is of another family, or lacks a part.
    """
    folder = Path(source).expanduser()
    id = str(source)
    if folder.is_dir():
        return _checkpoint(folder, id, family, "")
    try:
        return _cached(id, family, revision)
    except PriorError as error:
        if error.code != "prior.not_cached" or not allow_download:
            raise
    plan = plan_download(id, family, revision)
    log.warning("downloading %s; licence: %s", plan.summary, plan.licence)
    folder = remote.fetch(id, revision, tuple(plan.sizes))
    return _checkpoint(folder, id, family, folder.name)


@dataclass(frozen=True)
class Download:
    """What a download would fetch."""

    source: str
    asked: str
    """The revision that was asked for; empty for the newest."""
    revision: str
    """The commit."""
    licence: str
    """Of the table, else as the model's card states it."""
    sizes: Mapping[str, int]
    """Path -> bytes, of every file that is used."""
    missing: Mapping[str, int]
    """Those of them that the cache lacks."""

    @property
    def megabytes(self) -> float:
        return sum(self.missing.values()) / 1e6

    @property
    def summary(self) -> str:
        return f"{self.megabytes:.1f} MB of {self.source}"


def plan_download(source: str, family: Family, revision: str = "") -> Download:
    """Ask the hub which files of ``source`` are needed. Nothing is fetched.

    Raises:
        PriorError: as :func:`open_checkpoint`.
    """
    listing = remote.ask(source, revision)
    sizes = {name: listing.sizes[name] for name in select(listing.sizes, family, source).files}
    missing = {name: size for name, size in sizes.items() if not remote.cached(source, listing.revision, name)}
    known = known_prior(source)
    licence = known.licence if known else listing.licence
    return Download(
        source, revision, listing.revision, licence or "not stated; read the page of the model", sizes, missing
    )


def family_at(source: str | Path, revision: str = "", allow_download: bool = False) -> Family:
    """The family of a folder or hub id, by its index, which alone is fetched where that is allowed.

    Raises:
        PriorError: it cannot be had, or no family reads such checkpoints.
    """
    folder = Path(source).expanduser()
    id = str(source)
    if folder.is_dir():
        file = next((folder / name for name in INDICES if (folder / name).is_file()), folder / INDICES[0])
        return _family(_index(file, id), id)
    file = next((file for name in INDICES if (file := remote.cached(id, revision, name))), None)
    if file is None and not allow_download:
        raise remote.not_cached(id, revision)
    if file is None:
        names = remote.ask(id, revision).sizes
        index = next((name for name in INDICES if name in names), None)
        if index is None:
            raise _no_index(id, INDICES[0])
        file = remote.fetch(id, revision, [index]) / index
    return _family(_index(file, id), id)


def first_source(pins: Sequence[tuple[str, str]], family: Family, allow_download: bool) -> tuple[str, str]:
    """The first (hub id, revision) that is whole in the cache; where none is, the first that the hub would give.

    Raises:
        PriorError: there is none; why the first one is not.
    """
    for source, revision in pins:
        if on_this_machine(source, family, revision):
            return source, revision
    if not allow_download:
        raise remote.not_cached(*pins[0])
    plan = first_plan(pins, family)
    return plan.source, plan.asked


def first_plan(pins: Sequence[tuple[str, str]], family: Family) -> Download:
    """What would be fetched of the first (hub id, revision) that the hub would give.

    Raises:
        PriorError: there is none; why the first one is not.
    """
    refusals: list[PriorError] = []
    for source, revision in pins:
        try:
            return plan_download(source, family, revision)
        except PriorError as error:
            log.info("%s", error)
            refusals.append(error)
    raise refusals[0]


def on_this_machine(source: str, family: Family, revision: str = "") -> bool:
    """Whether the checkpoint of a hub id is whole in the local cache. Nothing is loaded or downloaded."""
    try:
        _cached(source, family, revision)
    except (PriorError, ImportError):
        return False
    return True


def _cached(source: str, family: Family, revision: str) -> Checkpoint:
    """The checkpoint in the cache. Half of one is as good as none."""
    file = remote.cached(source, revision, family.index)
    if file is None:
        raise remote.not_cached(source, revision)
    try:
        return _checkpoint(file.parent, source, family, file.parent.name)
    except PriorError as error:
        if error.code == "prior.weights":
            raise remote.not_cached(source, revision) from error
        raise


def _checkpoint(folder: Path, id: str, family: Family, revision: str) -> Checkpoint:
    """``folder``, once it is seen to hold every part of such a checkpoint."""
    index = _index(folder / family.index, id)
    kind = index["_class_name"]
    if kind not in family.pipelines:
        actual = family_of(kind)
        of = f", of {actual.about}" if actual else ""
        raise PriorError("prior.kind", f"'{id}' is a {kind}{of}", f"choose one of {family.about}")
    names = [path.relative_to(folder).as_posix() for depth in ("*", "*/*") for path in folder.glob(depth)]
    selection = select(names, family, id)
    denoiser = next(iter(family.weights))
    weights = [name for name in selection.files if name.startswith(inside(denoiser)) and name.endswith(".safetensors")]
    found = Checkpoint(folder, id, revision or _fingerprint(folder, weights), selection.variant, index)
    _check_schedule(found.scheduler, family, id)
    return found


def _index(file: Path, id: str) -> dict[str, Any]:
    if not file.is_file():
        raise _no_index(id, file.name)
    try:
        index = json.loads(file.read_text(encoding="utf-8"))
        index["_class_name"]
    except (ValueError, KeyError, TypeError) as error:
        raise PriorError("prior.folder", f"'{file}' is not a diffusers index", "fetch the checkpoint again") from error
    return index


def _no_index(id: str, name: str) -> PriorError:
    return PriorError("prior.folder", f"'{id}' has no {name}", "give a folder that diffusers saved")


def _family(index: Mapping[str, Any], id: str) -> Family:
    family = family_of(index["_class_name"])
    if family is None:
        raise PriorError("prior.kind", f"'{id}' is a {index['_class_name']}", f"choose one of {supported()}")
    _, scheduler = index.get("scheduler") or ("", "")  # library and class
    _check_schedule(str(scheduler or ""), family, id)
    return family


def _check_schedule(scheduler: str, family: Family, id: str) -> None:
    if scheduler and foreign_schedule(family, scheduler):
        raise PriorError(
            "prior.schedule",
            f"'{id}' has the noise schedule of {scheduler}, which is not that of {family.about}",
            f"choose another checkpoint of {family.about}",
        )


def _fingerprint(folder: Path, names: Sequence[str]) -> str:
    """SHA-256 of weight files, what a folder has in place of a commit."""
    digest = hashlib.sha256()
    for name in names:
        with (folder / name).open("rb") as file:
            digest.update(hashlib.file_digest(file, "sha256").digest())
    return digest.hexdigest()


def require_extra(about: str, modules: Sequence[str] = ("diffusers", "transformers"), pipeline: str = "") -> None:
    """
    Args:
        about: a family or a task, in words.
        modules: what it imports.
        pipeline: the class of diffusers that it needs.

    Raises:
        PriorError: a package is not installed, is broken, or is too old.
    """
    extra = "'paintit[diffusers]'"
    for module in modules:
        try:
            importlib.import_module(module)
        except ImportError as error:
            if isinstance(error, ModuleNotFoundError) and module.startswith(error.name or module):
                words, command = "which is not installed", "pip install"
            else:
                words = f"which cannot be imported: {next(iter(str(error).splitlines()), '')}"
                command = "pip install --upgrade"
            raise PriorError(
                "prior.extra", f"{about} needs the package '{module}', {words}", f"{command} {extra}"
            ) from error
    if not pipeline:
        return
    with quiet():
        there = hasattr(importlib.import_module("diffusers"), pipeline)
    if not there:
        raise PriorError(
            "prior.extra", f"{about} needs a newer version of diffusers than {version('diffusers')}, which has no "
            f"{pipeline}", f"pip install --upgrade {extra}",
        )  # fmt: skip


def precision(device: torch.device, dtype: str) -> torch.dtype:
    """``auto`` is float32 on a CPU or MPS and, on CUDA, bfloat16 or, where the card has none, float16.

    Raises:
        PriorError: there is no precision of that name.
    """
    import torch

    if dtype == "auto":
        if device.type != "cuda":
            return torch.float32
        return torch.bfloat16 if torch.cuda.is_bf16_supported(including_emulation=False) else torch.float16
    if dtype not in DTYPES:
        raise PriorError("prior.dtype", f"there is no precision '{dtype}'", f"choose auto, {', '.join(DTYPES)}")
    return getattr(torch, dtype)


def vae_precision(precision: torch.dtype) -> torch.dtype:
    """Of an autoencoder beside a network of ``precision``: its gradients overflow in float16."""
    import torch

    return torch.float32 if precision == torch.float16 else precision


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Without what the libraries say of image processors, schedulers and LoRAs: it is of no use here, or an error that
    is raised as well and is ours to tell."""
    import diffusers
    import transformers

    libraries: list[Any] = [diffusers.utils.logging, transformers.utils.logging]
    levels = [library.get_verbosity() for library in libraries]
    for library in libraries:
        library.set_verbosity(logging.CRITICAL)
    try:
        with _without_bars(), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        for library, level in zip(libraries, levels, strict=True):
            library.set_verbosity(level)


@contextlib.contextmanager
def _without_bars() -> Iterator[None]:
    """Loading without the libraries' progress bars, which stay as they were."""
    import diffusers
    import transformers

    switches: list[Any] = [library.utils.logging for library in (diffusers, transformers)]
    shown = [switch for switch in switches if switch.is_progress_bar_enabled()]
    for switch in shown:
        switch.disable_progress_bar()
    try:
        yield
    finally:
        for switch in shown:
            switch.enable_progress_bar()
