"""What the answers say: mean opinion per method, bootstrap intervals over raters, agreement between raters."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from paintit.study.answers import Answer, Collected
from paintit.study.questions import SCALE

CONFIDENCE = 0.95
RESAMPLES = 9999


@dataclass(frozen=True)
class Opinion:
    """Of one method.

    Attributes:
        mean: over all its answers, from 1 to 5.
        low, high: percentile bootstrap interval of the mean, raters drawn with replacement; None with fewer than 2.
        answers: how many.
        counts: how often each score was given, 1 first.
    """

    method: str
    mean: float
    low: float | None
    high: float | None
    answers: int
    counts: tuple[int, ...]


@dataclass(frozen=True)
class Unfinished:
    """A rater who began to answer and has not answered all."""

    rater: int
    answers: int
    asked: int


@dataclass(frozen=True)
class Report:
    """Of one study.

    Attributes:
        opinions: best mean first.
        questions: how many the study asks.
        raters: who answered anything; ``complete`` answered everything.
        silent: who opened the study and answered nothing.
        agreement: Krippendorff's alpha for ordinal data over all rated pictures: 1 is full agreement, 0 is what
            chance gives; None where no picture has two raters or all scores are the same.
    """

    title: str
    opinions: tuple[Opinion, ...]
    questions: int
    answers: int
    raters: int
    complete: int
    silent: int
    unfinished: tuple[Unfinished, ...]
    agreement: float | None
    confidence: float = CONFIDENCE
    resamples: int = RESAMPLES
    seed: int = 0


def report(collected: Collected, seed: int = 0) -> Report:
    """The figures; ``seed`` draws the bootstrap. Methods nobody rated are left out."""
    by_rater = {number: [a for a in collected.answers if a.rater == number] for number in collected.raters}
    asked = len(collected.questions) * len(collected.methods)
    given = {number: len(answers) for number, answers in by_rater.items() if answers}
    opinions = (
        _opinion(method, [a for a in collected.answers if a.method == method], seed) for method in collected.methods
    )
    return Report(
        collected.title,
        tuple(sorted((o for o in opinions if o.answers), key=lambda o: -o.mean)),
        questions=len(collected.questions),
        answers=len(collected.answers),
        raters=len(given),
        complete=sum(count == asked for count in given.values()),
        silent=len(by_rater) - len(given),
        unfinished=tuple(Unfinished(number, count, asked) for number, count in given.items() if count < asked),
        agreement=agreement(collected),
        seed=seed,
    )


def _opinion(method: str, answers: list[Answer], seed: int) -> Opinion:
    if not answers:
        return Opinion(method, float("nan"), None, None, 0, (0,) * len(SCALE))
    raters, index = np.unique([a.rater for a in answers], return_inverse=True)
    scores = np.array([a.score for a in answers])
    sums, numbers = np.bincount(index, scores), np.bincount(index)
    low, high = _interval(sums, numbers, seed) if len(raters) > 1 else (None, None)
    counts = tuple(int((scores == score).sum()) for score in SCALE)
    return Opinion(method, float(scores.mean()), low, high, len(answers), counts)


def _interval(sums: np.ndarray, numbers: np.ndarray, seed: int) -> tuple[float, float]:
    """Percentile bootstrap of ``sums / numbers`` (one entry per rater). Raters are the sample: their answers depend."""
    from scipy.stats import bootstrap

    def mean(sums: np.ndarray, numbers: np.ndarray, axis: int) -> np.ndarray:
        return sums.sum(axis) / numbers.sum(axis)

    found = bootstrap(
        (sums, numbers), mean, paired=True, vectorized=True, method="percentile", confidence_level=CONFIDENCE,
        n_resamples=RESAMPLES, rng=np.random.default_rng(seed),
    ).confidence_interval  # fmt: skip
    return float(found.low), float(found.high)


def agreement(collected: Collected) -> float | None:
    """Krippendorff's alpha for ordinal data, raters over (question, method) units; missing answers are allowed.

    Written from "Computing Krippendorff's Alpha-Reliability" (2011), section E: a pair of raters of a unit is a
    coincidence of two scores, and two scores differ by how many answers lie between their middles.
    """
    units = {unit: i for i, unit in enumerate(itertools.product(collected.questions, collected.methods))}
    given = np.zeros((len(units), len(SCALE)))
    for answer in collected.answers:
        given[units[answer.question, answer.method], answer.score - 1] += 1
    given = given[given.sum(1) > 1]
    weighted = given / (given.sum(1, keepdims=True) - 1)
    coincidences = weighted.T @ given - np.diag(weighted.sum(0))
    totals = coincidences.sum(0)
    middles = totals.cumsum() - totals / 2
    distances = (middles[:, None] - middles) ** 2
    expected = (np.outer(totals, totals) * distances).sum()
    if expected == 0:
        return None
    return float(1 - (totals.sum() - 1) * (coincidences * distances).sum() / expected)
