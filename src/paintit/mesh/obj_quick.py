"""The statements of an OBJ file without oddities, by array operations: the fast twin of ``obj_statements.py``."""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray

from paintit.mesh.mesh import Floats, Ints
from paintit.mesh.obj_statements import Names, Statements

Bytes = NDArray[np.uint8]
Bools = NDArray[np.bool_]
_BLANK, _NEWLINE, _SLASH, _HASH = 32, 10, 47, 35


class _Odd(Exception):
    """Something that is left to the careful reader."""


def read_quickly(data: bytes, lines: list[str]) -> Statements | None:
    """The statements, or None where a line is not plain: the careful reader then says what it means, or what is wrong.

    Args:
        data: the file with ``\\n`` as line end. lines: the same, decoded and split.
    """
    if b"\\\n" in data:
        return None
    try:
        return _read(np.frombuffer(data + b"\n", np.uint8), lines)
    except _Odd:
        return None


def _read(text: Bytes, lines: list[str]) -> Statements:
    begin, is_kind = _kinds(text)
    names = Names()
    changes, runs_there = [-1], [names.run]
    for number in np.flatnonzero(~np.logical_or.reduce(list(is_kind.values()))).tolist():
        fields = lines[number].split(None, 1)
        if not fields or fields[0][0] == "#":
            continue
        if fields[0] in ("v", "vt", "vn", "f", "fo"):
            raise _Odd
        names.read(fields[0], lines[number])
        changes.append(number)
        runs_there.append(names.run)
    v, width = _table(text, begin, is_kind["v"], 1, 3)
    vt, _ = _table(text, begin, is_kind["vt"], 2, 2)
    vn, _ = _table(text, begin, is_kind["vn"], 2, 3)
    if width == 4 or not np.isfinite(v).all():
        raise _Odd
    line = np.flatnonzero(is_kind["f"])
    corners, size = _faces(text, begin, is_kind)
    whole = size >= 3
    small = tuple(zip(line[~whole].tolist(), size[~whole].tolist(), strict=True))
    corners, size, polygon_line = corners[np.repeat(whole, size)], size[whole], line[whole]
    if not len(corners) or (corners.max(0) >= (len(v), len(vt), len(vn))).any():
        raise _Odd
    # Which state of names holds at each polygon, and those states numbered by their first use.
    state = np.searchsorted(changes, polygon_line) - 1
    cuts = np.concatenate([[0], np.flatnonzero(np.diff(state)) + 1])
    runs: dict[tuple[str, str | None], int] = {}
    numbers = [runs.setdefault(runs_there[state[at]], len(runs)) for at in cuts.tolist()]
    return Statements(
        v,
        vt,
        vn,
        corners,
        np.concatenate([[0], np.cumsum(size)]),
        polygon_line,
        np.repeat(numbers, np.diff([*cuts, len(polygon_line)])).astype(np.int64),
        tuple(runs),
        tuple(names.libraries),
        names.other,
        small,
        False,
    )


def _kinds(text: Bytes) -> tuple[Ints, dict[str, Bools]]:
    """Where each line begins (one more for the end), and which lines are plain v, vt, vn and f statements."""
    begin = np.concatenate([[0], np.flatnonzero(text == _NEWLINE) + 1])
    head = [np.pad(text, (0, 3))[begin[:-1] + k] for k in range(3)]
    blank = [(byte == _BLANK) | (byte == 9) for byte in head]
    is_v = head[0] == ord("v")
    return begin, {
        "v": is_v & blank[1],
        "vt": is_v & (head[1] == ord("t")) & blank[2],
        "vn": is_v & (head[1] == ord("n")) & blank[2],
        "f": (head[0] == ord("f")) & blank[1],
    }


def _body(text: Bytes, begin: Ints, chosen: Bools, word: int) -> tuple[Bytes, Ints]:
    """The chosen lines without their first ``word`` bytes, one after another, and where each begins."""
    size = np.diff(begin)
    keep = np.repeat(chosen, size)
    for k in range(word):
        keep[begin[:-1][chosen] + k] = False
    body = text[keep]
    if (body == _HASH).any():
        raise _Odd
    return body, np.concatenate([[0], np.cumsum(size[chosen] - word)])


def _words(body: Bytes, begin: Ints) -> tuple[Ints, Ints]:
    """Where each word of the body begins, and the number of words on each line; each line begins with a blank."""
    solid = body > _BLANK
    first = np.flatnonzero(solid[1:] & ~solid[:-1]) + 1
    return first, np.diff(np.searchsorted(first, begin))


def _numbers(body: Bytes, kind: type, count: int) -> NDArray[np.generic]:
    """The ``count`` numbers that the body holds, and nothing else."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            values = np.fromstring(body.tobytes(), kind, sep=" ")
        except (DeprecationWarning, ValueError):
            raise _Odd from None
    if len(values) != count:
        raise _Odd
    return values


def _table(text: Bytes, begin: Ints, chosen: Bools, word: int, width: int) -> tuple[Floats, int]:
    """(n, width) the first numbers of each chosen line, and how many the first line has."""
    if not chosen.any():
        return np.zeros((0, width)), 0
    body, line = _body(text, begin, chosen, word)
    _, count = _words(body, line)
    if count.min() < width:
        raise _Odd
    values = _numbers(body, np.float64, int(count.sum())).astype(np.float64)
    at = np.cumsum(count) - count
    return values[at[:, None] + np.arange(width)], int(count[0])


def _faces(text: Bytes, begin: Ints, is_kind: dict[str, Bools]) -> tuple[Ints, Ints]:
    """(c, 3) zero-based indices of each face corner, -1 where left out, and the number of corners of each face."""
    if not is_kind["f"].any():
        raise _Odd
    body, line = _body(text, begin, is_kind["f"], 1)
    first, size = _words(body, line)
    if not len(first):
        raise _Odd
    slash = body == _SLASH
    parts = body.copy()
    parts[slash] = _BLANK
    begins, _ = _words(parts, line)
    # The column of a number is the number of slashes before it in its word.
    if slash[first].any():
        raise _Odd
    slashes = np.concatenate([[0], np.cumsum(slash)])
    corner = np.searchsorted(first, begins, side="right") - 1
    column = slashes[begins] - slashes[first[corner]]
    most = np.diff(np.append(slashes[first], slashes[-1]))
    last = column[np.searchsorted(begins, np.append(first[1:], len(body))) - 1]
    if most.max(initial=0) > 2 or (last != most).any():
        raise _Odd
    values = _numbers(parts, np.int64, len(begins)).astype(np.int64)
    before = np.stack([np.cumsum(is_kind[word]) for word in ("v", "vt", "vn")], 1)[is_kind["f"]]
    counts = before[np.repeat(np.arange(len(size)), size)[corner], column]
    corners = np.full((len(first), 3), -1, np.int64)
    # Relative indices count back from the last one so far; absolute ones may point ahead.
    index = np.where(values > 0, values - 1, counts + values)
    if (values == 0).any() or index.min() < 0:
        raise _Odd
    corners[corner, column] = index
    return corners, size
