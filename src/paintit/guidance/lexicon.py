"""Words that no training caption held, read as their nearest known meaning.

A prior knows the words of its captions and nothing else: to it "vermilion" is a handful of n-grams, and what it paints
is grey. ``Lexicon(known).rewrite(prompt)`` says the same in known words before the text is encoded. In order:

1. a phrase of two to four words in the table, in any spelling or number, one of them unknown ("mother of pearl")
2. a known word: never touched, so a prompt of known words comes back as it was, byte for byte
3. the table, ``lexicon.txt``: ``word<TAB>known words``. It comes before the rules, since a stated meaning beats a
   derived one (a boxer is a dog, not a box)
4. British and American spelling, accents, plurals, derivations: "silvery", "rusting", "oaken", "cherrycoloured"
5. closed compounds of two words that can be read: "goldplated", "limegreen" (hyphens part words anyway)
6. a slip of the finger: one letter off (two from a known word, in seven letters or more), first letter right, one
   best reading

A line of the table without a meaning is an ordinary word without a look ("sitting"): it stays, and is no misspelling.
Meanings are themselves read through the table where ``known`` lacks their words, to a depth of three. What nothing
explains stays as it is: the encoder's n-grams speak for it. No network, no torch; the file is read on first use.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from importlib.resources import files
from itertools import pairwise

DEPTH = 3
"""Readings of readings before an entry is given up."""
LONGEST = 4
"""Words in the longest phrase that is looked up."""
STOP = frozenset({
    "a", "an", "and", "at", "by", "for", "from", "in", "into", "its", "of", "off", "on", "or", "over", "the", "to",
    "under", "up", "with", "without",
})  # fmt: skip
GRADED = frozenset({
    "black", "blue", "bright", "brown", "clean", "curly", "dark", "deep", "dirty", "dry", "dull", "faded", "fluffy",
    "glossy", "green", "grey", "light", "long", "old", "pale", "pink", "red", "rough", "rusty", "shaggy", "shiny",
    "short", "smooth", "soft", "thick", "warm", "wet", "white", "worn", "yellow",
})  # fmt: skip
"""What may be compared: a "redder" is red, but a corner is no corn."""

_WORD = re.compile(r"[^\W_]+")
_GAP = re.compile(r"[ \t]+|[-'’]")
#: Endings, and what may stand in their place in the word that they came from.
_ENDINGS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("coloured", ("",)),
    ("colored", ("",)),
    ("like", ("",)),
    ("esque", ("", "e")),
    ("ishly", ("", "ish")),
    ("ish", ("", "e")),
    ("ies", ("y",)),
    ("ves", ("f", "fe")),
    ("es", ("", "e")),
    ("s", ("",)),
    ("ed", ("", "e", "s", "y")),
    ("ing", ("ed", "", "e")),
    ("en", ("", "e")),
    ("ly", ("", "le")),
    ("ey", ("", "y")),
    ("y", ("", "e", "s")),
)
#: What a bare word may take to become a known one: "polish" is known as "polished", "feather" as "feathers".
_ADDED = (
    ("", "s"),
    ("", "es"),
    ("f", "ves"),
    ("fe", "ves"),
    ("", "ed"),
    ("e", "ed"),
    ("", "y"),
    ("e", "y"),
    ("", "en"),
)
#: British and American spellings, each way.
_SPELLINGS = (("our", "or"), ("grey", "gray"), ("ise", "ize"), ("fibre", "fiber"), ("tre", "ter"), ("ae", "e"),
              ("ll", "l"), ("ium", "um"), ("mould", "mold"), ("tyre", "tire"), ("sulph", "sulf"), ("ogue", "og"),
              ("oe", "e"), ("plough", "plow"), ("que", "k"))  # fmt: skip


@cache
def table() -> Mapping[str, str]:
    """``lexicon.txt``: words or phrases -> their meaning, empty for ordinary words."""
    text = files("paintit.guidance").joinpath("lexicon.txt").read_text(encoding="utf-8")
    return {key: meaning for key, _, meaning in (line.partition("\t") for line in text.splitlines())}


@cache
def _by_initial() -> Mapping[str, tuple[str, ...]]:
    """Single words of the table that have a meaning, by their first letter."""
    groups: dict[str, list[str]] = {}
    for key, meaning in table().items():
        if meaning and " " not in key:
            groups.setdefault(key[0], []).append(key)
    return {initial: tuple(words) for initial, words in groups.items()}


def distance(a: str, b: str, limit: int) -> int:
    """Letters inserted, left out, replaced or swapped with their neighbour; ``limit + 1`` if more than ``limit``."""
    if abs(len(a) - len(b)) > limit:
        return limit + 1
    before: list[int] = []
    row = list(range(len(b) + 1))
    for i, x in enumerate(a, 1):
        before, last, row = row, before, [i]
        for j, y in enumerate(b, 1):
            cost = min(before[j] + 1, row[-1] + 1, before[j - 1] + (x != y))
            if i > 1 and j > 1 and x == b[j - 2] and a[i - 2] == y:
                cost = min(cost, last[j - 2] + 1)
            row.append(cost)
        if min(row) > limit and min(before) > limit:
            return limit + 1
    return min(row[-1], limit + 1)


def derived(word: str) -> Iterator[str]:
    """Words that ``word`` may be another form of, the likeliest first; whether they exist is the caller's question."""
    plain = "".join(c for c in unicodedata.normalize("NFKD", word) if not unicodedata.combining(c))
    if plain != word:
        yield plain
    for british, american in _SPELLINGS:
        for here, there in ((british, american), (american, british)):
            if here in word:
                yield word.replace(here, there, 1)
    for ending, instead in _ENDINGS:
        stem = word.removesuffix(ending)
        if stem == word or len(stem) < 3 or (ending == "s" and stem.endswith("s")):
            continue
        yield from (stem + other for other in instead)
        if ending in ("ed", "ing", "y", "en", "ish") and stem[-1] == stem[-2] and len(stem) > 3:
            yield stem[:-1]
    for ending in ("er", "est"):
        stem = word.removesuffix(ending)
        if stem != word and len(stem) > 2:
            grown = (stem, stem + "e", stem[:-1], stem[:-1] + "y" if stem.endswith("i") else stem)
            yield from (base for base in grown if base in GRADED)
    for cut, ending in _ADDED:
        if word.endswith(cut) and len(word) > 2:
            yield word.removesuffix(cut) + ending


@dataclass(frozen=True)
class Lexicon:
    """Reads prompts for a prior that knows the words ``known`` (lower case; phrases count as their words)."""

    known: frozenset[str]

    @cached_property
    def words(self) -> frozenset[str]:
        """Single known words."""
        return frozenset(word for entry in self.known for word in _WORD.findall(entry.lower()))

    def known_form(self, word: str) -> str | None:
        """The known word or phrase that a word (or a phrase of the table) is read as; itself if known, else None."""
        word = " ".join(_WORD.findall(word.lower()))
        found = self._exact(word, DEPTH)
        if found is not None or " " in word or table().get(word) == "":
            return found
        forms = tuple(derived(word))
        for form in forms:
            if (found := self._exact(form, DEPTH)) is not None:
                return found
        if any(table().get(form) == "" for form in forms):
            return None
        return self._compound(word) or self._misspelt(word)

    def readings(self, prompt: str) -> dict[str, str]:
        """What is read as something else: words or phrases as they stand in the prompt -> known words."""
        return {prompt[start:end]: meaning for start, end, meaning in self._replacements(prompt)}

    def rewrite(self, prompt: str) -> str:
        """The prompt with unknown words replaced by their known meaning; all else, spaces and marks too, as it was."""
        parts, done = [], 0
        for start, end, meaning in self._replacements(prompt):
            parts += [prompt[done:start], meaning]
            done = end
        return "".join([*parts, prompt[done:]])

    def _replacements(self, prompt: str) -> Iterator[tuple[int, int, str]]:
        """(start, end, meaning) in order, apart from one another."""
        tokens = list(_WORD.finditer(prompt))
        words = [token.group().lower() for token in tokens]
        joined = [bool(_GAP.fullmatch(prompt[one.end() : two.start()])) for one, two in pairwise(tokens)]
        i = 0
        while i < len(tokens):
            size, meaning = self._longest(words, joined, i)
            if meaning is None:
                i += 1
                continue
            last = i + size
            # "a Holstein cow" is "a dairy cow", not "a dairy cow cow"
            if last < len(tokens) and joined[last - 1] and meaning.split()[-1] in (words[last], words[last] + "s"):
                last += 1
            yield tokens[i].start(), tokens[last - 1].end(), meaning
            i = last

    def _longest(self, words: list[str], joined: list[bool], i: int) -> tuple[int, str | None]:
        """How many words from the i-th on are read as one, and as what; None where they stay."""
        for size in range(min(LONGEST, len(words) - i), 1, -1):
            here = words[i : i + size]
            if all(joined[i : i + size - 1]) and not all(word in self.words for word in here):
                phrase = " ".join(here)
                forms = (phrase, *derived(phrase))
                meaning = next((found for form in forms if (found := self._exact(form, DEPTH)) is not None), None)
                if meaning is not None:
                    return size, meaning
        if words[i] in self.words or words[i] in STOP:
            return 1, None
        return 1, self.known_form(words[i])

    def _exact(self, word: str, depth: int) -> str | None:
        """The word if known, else its meaning in the table, read on where that is not known; no guessing."""
        if word in self.words:
            return word
        meaning = table().get(word)
        if not meaning or depth == 0:
            return None
        parts = [self._part(part, depth - 1) for part in meaning.split()]
        return None if None in parts else " ".join(part for part in parts if part)

    def _part(self, word: str, depth: int) -> str | None:
        """A word within a meaning: stop words pass, and a known inflection serves."""
        if word in STOP:
            return word
        if (found := self._exact(word, depth)) is not None:
            return found
        return next((form for form in derived(word) if form in self.words), None)

    def _compound(self, word: str) -> str | None:
        """The closed compound taken apart, both parts being words that can be read; known parts go first."""
        best: tuple[int, str] | None = None
        for cut in range(3, len(word) - 2):
            head, tail = word[:cut], word[cut:]
            if len(word) < 7 or head in STOP or tail in STOP:
                continue
            parts = [self._exact(part, DEPTH) or self._inflected(part) for part in (head, tail)]
            if parts[0] is None or parts[1] is None:
                continue
            rank = (head in self.words) + (tail in self.words)
            if best is None or rank > best[0]:
                best = rank, f"{parts[0]} {parts[1]}"
        return best[1] if best else None

    def _inflected(self, word: str) -> str | None:
        return next((form for form in derived(word) if form in self.words), None) if len(word) > 3 else None

    def _misspelt(self, word: str) -> str | None:
        """The one nearest word by letters. Four letters bear an omission or a swap, not another letter: like, lime."""
        if len(word) < 4 or not word.isalpha():
            return None
        found: dict[str, int] = {}
        for group, limit in ((self._initial, 2 if len(word) >= 7 else 1), (_by_initial(), 1)):
            for other in group.get(word[0], ()):
                if len(other) < 4 or (len(word) == 4 and len(other) == 4 and sorted(other) != sorted(word)):
                    continue
                gap = distance(word, other, limit)
                if gap <= limit:
                    found[other] = gap
        nearest = [other for other, gap in found.items() if gap == min(found.values())]
        meanings = {self._exact(other, DEPTH) for other in nearest if other in self.words} - {None}
        meanings = meanings or {self._exact(other, DEPTH) for other in nearest} - {None}
        return meanings.pop() if len(meanings) == 1 else None

    @cached_property
    def _initial(self) -> Mapping[str, tuple[str, ...]]:
        """Known words by their first letter."""
        groups: dict[str, list[str]] = {}
        for word in sorted(self.words - STOP):
            groups.setdefault(word[0], []).append(word)
        return {initial: tuple(words) for initial, words in groups.items()}
