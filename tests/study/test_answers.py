"""The file of answers on its own: whose it is, and what the report command prints of it."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from pathlib import Path

import pytest
from PIL import Image
from tests.cli.conftest import Ran
from tests.study.conftest import METHODS, PROMPTS

from paintit.errors import StudyError
from paintit.study.answers import Answers, read_answers
from paintit.study.questions import read_study


def test_a_file_belongs_to_one_study(study: Path, tmp_path: Path) -> None:
    path = tmp_path / "a.sqlite"
    Answers(path, read_study(study)).close()
    Answers(path, read_study(study)).close()
    Image.new("RGB", (64, 64)).save(study / "hat" / "untextured.png")
    with pytest.raises(StudyError, match="holds answers to another study, or its pictures have changed"):
        Answers(path, read_study(study))


def test_a_database_of_someone_else_is_left_alone(study: Path, tmp_path: Path) -> None:
    path = tmp_path / "theirs.sqlite"
    with sqlite3.connect(path) as file:
        file.execute("CREATE TABLE theirs (x)")
    file.close()
    with pytest.raises(StudyError, match="holds no answers to a study"):
        Answers(path, read_study(study))
    with pytest.raises(StudyError, match="holds no answers to a study"):
        read_answers(path)


def test_all_of_a_form_or_nothing(study: Path, tmp_path: Path) -> None:
    answers = Answers(tmp_path / "a.sqlite", read_study(study))
    rater = answers.new_rater()
    with pytest.raises(sqlite3.IntegrityError):
        answers.record(rater, 0, {METHODS[0]: 3, METHODS[1]: 6})
    assert answers.counts() == (0, 0)
    answers.close()


def test_the_report_in_words(study: Path, tmp_path: Path, paintit: Callable[..., Ran]) -> None:
    answers = Answers(tmp_path / "a.sqlite", read_study(study))
    for scores in ((5, 3, 1), (4, 3, 1)):
        rater = answers.new_rater()
        for question in range(len(PROMPTS)):
            answers.record(rater, question, dict(zip(METHODS, scores, strict=True)))
    answers.record(answers.new_rater(), 1, {METHODS[0]: 3})
    answers.new_rater()
    ran = paintit("study", "report", tmp_path / "a.sqlite")
    answers.close()
    assert ran.code == 0
    # (3 * 5 + 3 * 4 + 3) / 7; of the others both raters say the same, so every resample does.
    lines = ran.out.splitlines()
    assert lines[0].split() == ["method", "mean", "95", "%", "interval", "answers", "1", "2", "3", "4", "5"]
    assert lines[1].split() == [METHODS[0], "4.29", "3.00", "to", "5.00", "7", "0", "0", "1", "3", "3"]
    assert lines[2].split() == [METHODS[1], "3.00", "3.00", "to", "3.00", "6", "0", "0", "6", "0", "0"]
    assert lines[3].split() == [METHODS[2], "1.00", "1.00", "to", "1.00", "6", "6", "0", "0", "0", "0"]
    assert "19 answers by 3 raters to 3 questions; 2 raters answered all, 1 began and answered none" in lines
    assert lines[-1] == "incomplete rounds: rater 3 (1 of 9)"
