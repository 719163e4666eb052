"""Answers in one SQLite file: each is on the disk before the rater is told so."""

from __future__ import annotations

import json
import secrets
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from paintit.errors import StudyError
from paintit.files import make_folder
from paintit.study.questions import Study, order

#: "pais" in ASCII: says that a SQLite file is ours.
APPLICATION = 0x70616973
_SCHEMA = (
    f"PRAGMA application_id = {APPLICATION}",
    "CREATE TABLE study (name TEXT PRIMARY KEY, value TEXT NOT NULL)",
    "CREATE TABLE raters (number INTEGER PRIMARY KEY, token TEXT UNIQUE NOT NULL, seed INTEGER NOT NULL,"
    " began TEXT NOT NULL)",
    "CREATE TABLE answers (rater INTEGER NOT NULL REFERENCES raters, question TEXT NOT NULL, method TEXT NOT NULL,"
    " score INTEGER NOT NULL CHECK (score BETWEEN 1 AND 5), place INTEGER NOT NULL, at TEXT NOT NULL,"
    " PRIMARY KEY (rater, question, method)) WITHOUT ROWID",
)


@dataclass(frozen=True)
class Rater:
    """Someone who rates: known by a number in reports and by a secret token in addresses."""

    number: int
    token: str
    seed: int


@dataclass(frozen=True)
class Answer:
    """One rating: ``score`` from 1 to 5."""

    rater: int
    question: str
    method: str
    score: int


@dataclass(frozen=True)
class Collected:
    """All that a file of answers holds, without tokens."""

    title: str
    methods: tuple[str, ...]
    questions: tuple[str, ...]
    raters: tuple[int, ...]
    answers: tuple[Answer, ...]


class Answers:
    """The open file. Every method that writes has committed when it returns (WAL, synchronous=FULL)."""

    def __init__(self, path: Path, study: Study) -> None:
        """Open ``path`` for ``study``, made if need be.

        Raises:
            StudyError: it is no file of answers, or of another study.
            OutputError: its folder cannot be made.
        """
        make_folder(path.parent)
        self.study = study
        with _readable(path):
            # The server has one thread that writes; tests open the file in another.
            self._connection = sqlite3.connect(path, check_same_thread=False, isolation_level=None, timeout=30)
            self._connection.execute("PRAGMA journal_mode = WAL")
            self._connection.execute("PRAGMA synchronous = FULL")
            self._begin(path)
        self.key = bytes.fromhex(self._facts()["key"])

    def _begin(self, path: Path) -> None:
        with self._transaction():
            if not self._connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]:
                for statement in _SCHEMA:
                    self._connection.execute(statement)
                facts = {
                    "title": self.study.title,
                    "fingerprint": self.study.fingerprint(),
                    "key": secrets.token_hex(32),
                    "methods": json.dumps(self.study.methods),
                    "questions": json.dumps([question.name for question in self.study.questions]),
                }
                self._connection.executemany("INSERT INTO study VALUES (?, ?)", facts.items())
        _check_ours(self._connection, path)
        if self._facts()["fingerprint"] != self.study.fingerprint():
            raise StudyError(
                "study.other", f"{path} holds answers to another study, or its pictures have changed since",
                "choose another file with -o",
            )  # fmt: skip

    def close(self) -> None:
        self._connection.close()

    def new_rater(self) -> Rater:
        """The next number, a token nobody can guess, and a seed drawn from the study's and the number."""
        token = secrets.token_urlsafe(16)
        with self._transaction():
            (last,) = self._connection.execute("SELECT coalesce(max(number), 0) FROM raters").fetchone()
            seed = int(np.random.SeedSequence([self.study.seed, last + 1]).generate_state(1)[0])
            self._connection.execute("INSERT INTO raters VALUES (?, ?, ?, ?)", (last + 1, token, seed, _now()))
        return Rater(last + 1, token, seed)

    def rater(self, token: str) -> Rater | None:
        """Who has ``token``."""
        row = self._connection.execute("SELECT number, token, seed FROM raters WHERE token = ?", (token,)).fetchone()
        return Rater(*row) if row else None

    def order(self, rater: Rater, question: int) -> tuple[str, ...]:
        """The methods as ``rater`` sees them in question number ``question`` (from 0)."""
        return order(rater.seed, question, self.study.methods)

    def scores(self, rater: Rater) -> dict[str, dict[str, int]]:
        """Question -> method -> score, of every question; unanswered ones are empty."""
        found: dict[str, dict[str, int]] = {question.name: {} for question in self.study.questions}
        rows = self._connection.execute("SELECT question, method, score FROM answers WHERE rater = ?", (rater.number,))
        for question, method, score in rows:
            found[question][method] = score
        return found

    def record(self, rater: Rater, question: int, scores: Mapping[str, int]) -> None:
        """Keep ``scores`` (method -> 1 to 5) for question number ``question`` (from 0): all of them or none.

        Said twice, it is kept once; a changed mind replaces what was said.
        """
        places = {method: place for place, method in enumerate(self.order(rater, question))}
        name = self.study.questions[question].name
        rows = [(rater.number, name, method, score, places[method], _now()) for method, score in scores.items()]
        with self._transaction():
            self._connection.executemany(
                "INSERT INTO answers VALUES (?, ?, ?, ?, ?, ?) ON CONFLICT DO UPDATE "
                "SET score = excluded.score, at = excluded.at WHERE score <> excluded.score",
                rows,
            )

    def counts(self) -> tuple[int, int]:
        """Answers, and raters who gave one."""
        return self._connection.execute("SELECT count(*), count(DISTINCT rater) FROM answers").fetchone()

    def _facts(self) -> dict[str, str]:
        return dict(self._connection.execute("SELECT name, value FROM study"))

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        self._connection.execute("BEGIN IMMEDIATE")
        try:
            yield
        except BaseException:
            self._connection.execute("ROLLBACK")
            raise
        self._connection.execute("COMMIT")


def read_answers(path: Path) -> Collected:
    """What was answered so far; a server may be writing at the same time.

    Raises:
        StudyError: there is no such file, or it is no file of answers.
    """
    if not path.is_file():
        raise StudyError("study.no_answers", f"there is no file {path}", "make one: paintit study serve STUDY -o FILE")
    with _readable(path), closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as connection:
        _check_ours(connection, path)
        facts = dict(connection.execute("SELECT name, value FROM study"))
        raters = tuple(number for (number,) in connection.execute("SELECT number FROM raters ORDER BY number"))
        rows = connection.execute("SELECT rater, question, method, score FROM answers ORDER BY rater, question, method")
        answers = tuple(Answer(*row) for row in rows)
    methods, questions = (tuple(json.loads(facts[name])) for name in ("methods", "questions"))
    return Collected(facts["title"], methods, questions, raters, answers)


def _check_ours(connection: sqlite3.Connection, path: Path) -> None:
    if connection.execute("PRAGMA application_id").fetchone()[0] != APPLICATION:
        raise StudyError("study.not_answers", f"{path} holds no answers to a study", "choose another file")


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    try:
        yield
    except sqlite3.Error as error:
        hint = "check that it is a file of answers that you may write to"
        raise StudyError("study.not_answers", f"cannot open {path}: {error}", hint) from error


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
