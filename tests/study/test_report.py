"""The report against numbers worked out by hand or published, and what it says of rounds that are not complete."""

from __future__ import annotations

import math

import numpy as np
import pytest

from paintit.study.answers import Answer, Collected
from paintit.study.report import RESAMPLES, agreement, report

METHODS = ("a", "b")
QUESTIONS = ("q1", "q2")


def collected(*answers: Answer, raters: int, methods: tuple[str, ...] = METHODS) -> Collected:
    return Collected("t", methods, QUESTIONS, tuple(range(1, raters + 1)), answers)


def test_means_counts_and_incomplete_rounds() -> None:
    found = report(
        collected(
            *(Answer(1, q, m, s) for q, m, s in (("q1", "a", 4), ("q1", "b", 2), ("q2", "a", 5), ("q2", "b", 2))),
            *(Answer(2, q, m, s) for q, m, s in (("q1", "a", 3), ("q1", "b", 1), ("q2", "a", 5))),
            raters=3,
        )
    )
    assert [(o.method, o.answers, o.counts) for o in found.opinions] == [
        ("a", 4, (0, 0, 1, 1, 2)),
        ("b", 3, (1, 2, 0, 0, 0)),
    ]
    assert found.opinions[0].mean == (4 + 5 + 3 + 5) / 4
    assert found.opinions[1].mean == pytest.approx((2 + 2 + 1) / 3)
    assert (found.raters, found.complete, found.silent, found.answers) == (2, 1, 1, 7)
    assert [(u.rater, u.answers, u.asked) for u in found.unfinished] == [(2, 3, 4)]


def test_the_interval_draws_raters_and_not_answers() -> None:
    """One rater said 5 once, another 1 twice. Drawn with replacement the mean is 5, 7/3 or 1: 1/4, 1/2, 1/4."""
    answers = [Answer(1, "q1", "a", 5), *(Answer(2, q, "a", 1) for q in QUESTIONS)]
    (opinion,) = report(collected(*answers, raters=2)).opinions
    assert (opinion.mean, opinion.low, opinion.high) == (pytest.approx(7 / 3), 1, 5)


def test_the_interval_of_many_raters_is_that_of_their_ratio() -> None:
    """Half of 60 raters answer once and like it, half twice and do not: the standard error of a ratio of sums."""
    draw = np.random.default_rng(0)
    answers = [Answer(rater, "q1", "a", int(draw.integers(3, 6))) for rater in range(1, 31)]
    answers += [Answer(r, q, "a", int(draw.integers(1, 4))) for r in range(31, 61) for q in QUESTIONS]
    (opinion,) = report(collected(*answers, raters=60)).opinions
    given = [[a.score for a in answers if a.rater == rater] for rater in range(1, 61)]
    off = [sum(scores) - opinion.mean * len(scores) for scores in given]
    half = 1.96 * math.sqrt(sum(x * x for x in off)) / len(answers)
    assert opinion.mean == pytest.approx(np.mean([a.score for a in answers]))
    assert opinion.low == pytest.approx(opinion.mean - half, abs=0.1 * half)
    assert opinion.high == pytest.approx(opinion.mean + half, abs=0.1 * half)
    assert report(collected(*answers, raters=60)).opinions == (opinion,), "one seed, one report"
    assert report(collected(*answers, raters=60), seed=1).opinions != (opinion,)


def test_one_rater_has_neither_interval_nor_agreement() -> None:
    found = report(collected(Answer(1, "q1", "a", 4), raters=1))
    assert (found.opinions[0].low, found.opinions[0].high, found.agreement) == (None, None, None)
    assert [o.method for o in found.opinions] == ["a"]


def test_nobody_has_answered() -> None:
    found = report(collected(raters=0))
    assert (found.opinions, found.answers, found.raters, found.agreement) == ((), 0, 0, None)


#: Krippendorff's own example (Computing Krippendorff's Alpha-Reliability, 2011): four observers, twelve units, gaps.
OBSERVERS = ("123321412...", "1233224125.3", ".3332342251.", "12332441251.")


def test_agreement_is_the_published_figure() -> None:
    methods = tuple(f"m{i}" for i in range(6))
    units = [(q, m) for q in QUESTIONS for m in methods]
    answers = [
        Answer(rater, *unit, int(score))
        for rater, scores in enumerate(OBSERVERS, 1)
        for unit, score in zip(units, scores, strict=True)
        if score != "."
    ]
    assert agreement(collected(*answers, raters=4, methods=methods)) == pytest.approx(0.815, abs=5e-4)


def test_agreement_is_full_where_all_say_the_same() -> None:
    answers = [Answer(r, q, m, s) for r in (1, 2) for q, m, s in (("q1", "a", 4), ("q1", "b", 1))]
    assert agreement(collected(*answers, raters=2)) == 1
    same = [Answer(r, "q1", "a", 4) for r in (1, 2)]
    assert agreement(collected(*same, raters=2)) is None, "without spread there is nothing to agree on"


def test_the_resamples_are_stated() -> None:
    assert report(collected(raters=0)).resamples == RESAMPLES
