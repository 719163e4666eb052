"""What a study asks: one question per mesh, one picture per method. Read from and written as ``study.toml``."""

from __future__ import annotations

import hashlib
import json
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from paintit.errors import StudyError
from paintit.settings import nearest

#: Name of the table inside a study folder.
TABLE = "study.toml"
#: Supp. A.4: "1: very unrealistic, 2: unrealistic, 3: neutral, 4: realistic, and 5: very realistic".
SCALE = {1: "very unrealistic", 2: "unrealistic", 3: "neutral", 4: "realistic", 5: "very realistic"}
_STUDY_KEYS = ("title", "seed", "methods", "question")
_QUESTION_KEYS = ("name", "prompt", "untextured", "pictures")


@dataclass(frozen=True)
class Question:
    """One mesh, as every method textured it.

    Attributes:
        name: of the mesh; unique in the study, shown in reports and never to raters.
        prompt: the text that all methods were given; may be empty.
        pictures: method -> picture, in the study's order of methods.
        untextured: a picture of the bare mesh.
    """

    name: str
    prompt: str
    pictures: dict[str, Path]
    untextured: Path | None = None


@dataclass(frozen=True)
class Study:
    """All questions, in the order in which they are asked. ``seed`` decides how the methods are shuffled."""

    title: str
    seed: int
    methods: tuple[str, ...]
    questions: tuple[Question, ...]

    def fingerprint(self) -> str:
        """SHA-256 of all that raters judge and in which order: answers to one study are no answers to another."""
        asked = [
            [q.name, q.prompt, [_digest(path) for path in q.pictures.values()], q.untextured and _digest(q.untextured)]
            for q in self.questions
        ]
        return hashlib.sha256(json.dumps([self.seed, self.methods, asked]).encode()).hexdigest()


def order(seed: int, question: int, methods: tuple[str, ...]) -> tuple[str, ...]:
    """``methods`` as the rater with this ``seed`` sees them in question number ``question``, first to last."""
    return tuple(methods[i] for i in np.random.default_rng([seed, question]).permutation(len(methods)))


def read_study(path: Path) -> Study:
    """The study in a folder that holds ``study.toml``, or in a table of that form; pictures are relative to the table.

    Raises:
        StudyError: there is none, it is not of that form, a picture is missing or damaged.
    """
    table = path / TABLE if path.is_dir() else path
    if not table.is_file():
        message = f"{path} is not a study: there is no {table.name if path.is_dir() else 'such file'}"
        raise StudyError("study.missing", message, "make one: paintit study create STUDY METHOD=FOLDER METHOD=FOLDER")
    try:
        data = tomllib.loads(table.read_text("utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, OSError) as error:
        raise StudyError("study.table", f"cannot read {table}: {error}", "docs/study.md shows its form") from None
    _check_keys(table, "", data, _STUDY_KEYS)
    methods = tuple(_value(table, data, "methods", list, []))
    if not all(isinstance(m, str) and m for m in methods) or len(set(methods)) != len(methods):
        raise _bad_table(table, f"methods is {list(methods)}", "name each method once, in quotes")
    if len(methods) < 2:
        raise _bad_table(table, f"{len(methods)} methods are named", "a study compares at least 2")
    rows = _value(table, data, "question", list, [])
    if not rows:
        raise _bad_table(table, "it asks no question", "add [[question]] tables")
    questions = tuple(_question(table, row, methods) for row in rows)
    names = [question.name for question in questions]
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise _bad_table(table, f"two questions are named '{twice}'", "give each a name of its own")
    seed = _value(table, data, "seed", int, 0)
    if seed < 0:
        raise _bad_table(table, f"seed is {seed}", "it must be 0 or more")
    return Study(_value(table, data, "title", str, "How realistic is it?"), seed, methods, questions)


def write_study(folder: Path, study: Study) -> None:
    """Write ``study.toml`` into ``folder``, which holds the pictures already."""
    lines = [f"title = {_text(study.title)}", f"seed = {study.seed}", f"methods = {_text(list(study.methods))}"]
    for question in study.questions:
        lines += ["", "[[question]]", f"name = {_text(question.name)}", f"prompt = {_text(question.prompt)}"]
        if question.untextured:
            lines.append(f"untextured = {_text(question.untextured.relative_to(folder).as_posix())}")
        lines.append("[question.pictures]")
        lines += [f"{_text(m)} = {_text(p.relative_to(folder).as_posix())}" for m, p in question.pictures.items()]
    (folder / TABLE).write_text("\n".join(lines) + "\n", "utf-8")


def _question(table: Path, row: Any, methods: tuple[str, ...]) -> Question:
    if not isinstance(row, dict):
        raise _bad_table(table, f"a question is {row!r}", "write [[question]] tables")
    _check_keys(table, "question.", row, _QUESTION_KEYS)
    name = _value(table, row, "name", str, "")
    if not name:
        raise _bad_table(table, "a question has no name", 'add name = "..."')
    given = _value(table, row, "pictures", dict, {})
    _check_keys(table, f"the pictures of '{name}': ", given, methods)
    if absent := [method for method in methods if method not in given]:
        raise _bad_table(
            table, f"question '{name}' has no picture of '{absent[0]}'", "add it under [question.pictures]"
        )
    pictures = {method: _picture(table, given[method]) for method in methods}
    bare = _value(table, row, "untextured", str, "")
    return Question(name, _value(table, row, "prompt", str, ""), pictures, _picture(table, bare) if bare else None)


def _picture(table: Path, name: Any) -> Path:
    path = table.parent / str(name)
    try:
        with Image.open(path) as image:
            image.verify()
    except FileNotFoundError:
        raise StudyError("study.picture", f"there is no picture {path}", f"check the path in {table}") from None
    except Exception as error:  # Pillow's decoders raise nearly anything on damaged files
        raise StudyError("study.picture", f"cannot read the picture {path}: {error}", "export it again") from None
    return path


def _value(table: Path, data: dict[str, Any], key: str, kind: type, default: Any) -> Any:
    value = data.get(key, default)
    if not isinstance(value, kind) or isinstance(value, bool):
        raise _bad_table(table, f"{key} is {value!r}", "docs/study.md shows its form")
    return value


def _check_keys(table: Path, where: str, data: dict[str, Any], known: tuple[str, ...]) -> None:
    for key in data:
        if key not in known:
            near = nearest(key, known)
            hint = f"did you mean '{near}'?" if near else f"known: {', '.join(known)}"
            raise _bad_table(table, f"unknown {where}{key}", hint)


def _bad_table(table: Path, what: str, hint: str) -> StudyError:
    return StudyError("study.table", f"cannot use {table}: {what}", hint)


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _text(value: str | list[str]) -> str:
    """As TOML writes it: JSON's strings and lists of strings are TOML's, but for DEL."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
