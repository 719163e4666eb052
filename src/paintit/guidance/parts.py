"""Which files of a checkpoint are used, and whether all are there: from names alone, so that a folder and a listing of
the hub are judged alike."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass

from paintit.errors import PriorError
from paintit.guidance.families import Family

#: transformers makes an empty tokenizer of a missing vocabulary, without a word.
VOCABULARIES = ("vocab.json", "tokenizer.json", "spiece.model")
PICKLES = (".bin", ".ckpt", ".pt", ".pth")


@dataclass(frozen=True)
class Selection:
    """The files that are used."""

    variant: str | None
    """``fp16`` where the weights are there in that precision only."""
    files: tuple[str, ...]
    """Paths inside the checkpoint, sorted."""


def select(names: Collection[str], family: Family, source: str) -> Selection:
    """The files of ``family`` among ``names``, paths inside the checkpoint ``source``.

    Raises:
        PriorError: a part is missing, cut short, or there only as pickle.
    """
    if family.index not in names:
        raise PriorError("prior.folder", f"'{source}' has no {family.index}", "give a folder that diffusers saved")
    folders = {name.split("/")[0] for name in names}
    left_out = set(family.optional) - folders
    if "" not in family.weights:
        _require(names, "scheduler", ("scheduler_config.json",), source)
    for tokenizer in (name for name in family.tokenizers if name not in left_out):
        _require(names, tokenizer, VOCABULARIES, source)
    parts = {part: stem for part, stem in family.weights.items() if part not in left_out}
    for part in parts:
        _require(names, part, ("config.json",), source)
    found = {part: _weights(names, part, stem, source) for part, stem in parts.items()}
    variant = next((kind for kind in (None, "fp16") if all(kind in kinds for kinds in found.values())), "")
    if variant == "":
        raise PriorError(
            "prior.weights", f"'{source}' mixes fp16 and plain weight files", "keep one precision of all parts"
        )
    chosen = {family.index} | {name for kinds in found.values() for name in kinds[variant]}
    chosen |= {name for name in names if name.split("/")[0] in ("scheduler", *family.tokenizers)}
    chosen |= {name for part in parts for name in _settings(names, part)}
    return Selection(variant, tuple(sorted(chosen)))


def _require(names: Collection[str], folder: str, choices: tuple[str, ...], source: str) -> None:
    if not any(inside(folder) + choice in names for choice in choices):
        missing = inside(folder) + choices[0]
        raise PriorError(
            "prior.weights", f"'{source}' has no {missing}", "fetch it again, or choose another checkpoint"
        )


def inside(folder: str) -> str:
    """What the paths of the files of a part begin with; nothing for a single network at the root."""
    return f"{folder}/" if folder else ""


def _settings(names: Collection[str], part: str) -> Iterator[str]:
    """The small files of a part: its configuration and the index of its shards."""
    return (name for name in names if re.fullmatch(rf"{inside(part)}[^/]*\.json", name))


def _weights(names: Collection[str], part: str, stem: str, source: str) -> dict[str | None, list[str]]:
    """Precision (None: plain) -> safetensors files of a part that are whole in it."""
    pattern = re.compile(rf"{inside(part)}{stem}(\.fp16)?(?:-\d{{5}}-of-(\d{{5}}))?(\.fp16)?\.safetensors")
    single: dict[str | None, list[str]] = {}
    shards: dict[tuple[str | None, int], list[str]] = {}
    for name in sorted(names):
        if found := pattern.fullmatch(name):
            kind = "fp16" if found[1] or found[3] else None
            if found[2]:
                shards.setdefault((kind, int(found[2])), []).append(name)
            else:
                single[kind] = [name]
    whole = {kind: files for (kind, count), files in shards.items() if len(files) == count} | single
    if whole:
        return whole
    about = part or "network"
    if shards:
        (_, count), files = next(iter(shards.items()))
        raise PriorError(
            "prior.weights", f"'{source}' has {len(files)} of the {count} weight files of its {about}", "fetch it again"
        )
    if any(name.startswith(inside(part)) and name.endswith(PICKLES) for name in names):
        raise PriorError(
            "prior.pickle",
            f"'{source}' has its {about} only as pickle, which can run code when read",
            "choose a checkpoint with safetensors, or convert it with diffusers",
        )
    raise PriorError(
        "prior.weights", f"'{source}' has no weights for its {about}", "fetch it again, or choose another checkpoint"
    )
