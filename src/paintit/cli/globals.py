"""Flags that every command takes, anywhere on the line. No import beyond the standard library, so help stays quick."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

GLOBAL_FLAGS = ("--version", "-v", "--verbose", "-q", "--quiet", "--json", "--offline", "--no-color")


@dataclass(frozen=True)
class Globals:
    """How to speak."""

    version: bool = False
    verbose: bool = False
    quiet: bool = False
    json: bool = False
    offline: bool = False
    """Nothing is fetched, whatever else is asked."""
    no_color: bool = False


_FIELDS = {
    "--version": "version",
    "-v": "verbose",
    "--verbose": "verbose",
    "-q": "quiet",
    "--quiet": "quiet",
    "--json": "json",
    "--offline": "offline",
    "--no-color": "no_color",
}


def split_globals(arguments: Sequence[str]) -> tuple[Globals, list[str]]:
    """The global flags among ``arguments``, and the rest in order. ``--`` ends the search."""
    found: dict[str, bool] = {}
    rest: list[str] = []
    for index, token in enumerate(arguments):
        if token == "--":
            rest += arguments[index:]
            break
        if token in _FIELDS:
            found[_FIELDS[token]] = True
        else:
            rest.append(token)
    return Globals(**found), rest
