"""What a short phrase means to the data generator: the truth of prompts and of the words that unseen ones stand for."""

from __future__ import annotations

from collections.abc import Mapping

from classes import RETRIEVAL, material_of
from surfaces import (
    FAMILIES,
    Material,
    Rng,
    family,
    finished,
)
from vocabulary import COLORS, FINISHES

_CLASS_WORDS = frozenset(RETRIEVAL) | {wording for wordings in RETRIEVAL.values() for wording in wordings}


def meaning(phrase: str, rng: Rng) -> Material:
    """A draw of the material of a class wording or of "<finish> <colour> <family>"; a bare colour is of plastic.

    Raises:
        KeyError: the generator has no such words.
    """
    if phrase in _CLASS_WORDS:
        return material_of(phrase, rng)
    words = phrase.lower().split()
    start = next((i for i in range(len(words)) if " ".join(words[i:]) in FAMILIES), len(words))
    name = " ".join(words[start:]) or "plastic"
    finish, color = _split(words[:start], FINISHES)
    if color and color not in COLORS:
        raise KeyError(f"the generator has no colour '{color}' (in '{phrase}')")
    material = family(name, rng, color)
    return finished(material, finish, rng) if finish else material


def _split(words: list[str], known: Mapping[str, object]) -> tuple[str, str]:
    """The longest beginning that is among ``known``, else "", and the rest."""
    for end in range(len(words), 0, -1):
        if " ".join(words[:end]) in known:
            return " ".join(words[:end]), " ".join(words[end:])
    return "", " ".join(words)
