"""The curve of a user study agrees with closed forms, and its report prints only digits that the interval supports."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.user_study.answers import ANSWERS, StudyAnswer
from benchmarks.user_study.curve import (
    LAPSE_RATE,
    Observer,
    Point,
    StudyCurve,
    answer_counts,
    curve_of,
    fit_observer,
    wilson,
)
from benchmarks.user_study.page import BIAS_SPREAD, expected_intervals
from benchmarks.user_study.report import report_text

STEPS = np.array([-30.0, -10, 0, 10, 30])


def _normal_cdf(x: float) -> float:
    return 0.5 * (1 + math.erf(x / math.sqrt(2)))


def _answers(person: str, counts: dict[float, tuple[int, ...]]) -> list[StudyAnswer]:
    """Return answers of a person with the given counts of the three answers at each step."""
    return [
        StudyAnswer(person, step, answer)
        for step, numbers in counts.items() for answer, number in zip(ANSWERS, numbers, strict=True)
        for _ in range(number)
    ]  # fmt: skip


def _exact_answers(person: str, observer: Observer, total: int) -> list[StudyAnswer]:
    """Return about `total` answers at each step in the proportions of an observer."""
    probabilities = zip(STEPS, observer.shares(STEPS), strict=True)
    return _answers(person, {float(step): tuple(int(n) for n in np.rint(total * row)) for step, row in probabilities})


def test_observer_probabilities_equal_normal_distribution_with_lapses() -> None:
    observer = Observer(0.05, 0.2, 0.12)
    x = np.log(1.1) + 0.05
    low, high = _normal_cdf((-0.12 - x) / 0.2), _normal_cdf((0.12 - x) / 0.2)
    expected = (1 - LAPSE_RATE) * np.array([low, high - low, 1 - high]) + LAPSE_RATE / 3
    assert observer.shares(np.array([10.0]))[0] == pytest.approx(expected)
    assert observer.shares(np.array([-30.0, 0.0, 50.0])).sum(axis=1) == pytest.approx(1)
    assert observer.peak == pytest.approx(100 * (np.exp(-0.05) - 1))
    assert observer.noticeable == pytest.approx(100 * (np.exp(0.6744898 * 0.2) - 1), rel=1e-5)


def test_wilson_interval_equals_closed_form() -> None:
    root = np.sqrt(0.16 * 10 + 1.959964**2 / 4)
    expected = tuple((8 + 1.959964**2 / 2 + s * 1.959964 * root) / (10 + 1.959964**2) for s in (-1, 1))
    assert wilson(8, 10) == pytest.approx(expected)


def test_answers_are_counted_by_participant_and_step() -> None:
    answers = [*_answers("a", {0.0: (1, 2, 3), 10.0: (0, 4, 0)}), *_answers("c", {10.0: (0, 1, 0)})]
    steps, counts = answer_counts(answers)
    assert steps.tolist() == [0, 10]
    assert counts.tolist() == [[[1, 2, 3], [0, 4, 0]], [[0, 0, 0], [0, 1, 0]]]


def test_fit_to_exact_proportions_recovers_observer_and_its_likelihood_gain() -> None:
    true = Observer(0.04, 0.12, 0.1)
    answers = _exact_answers("b", true, 400)
    observer, gain = fit_observer(answers)
    assert (observer.bias, observer.sigma, observer.criterion) == pytest.approx((0.04, 0.12, 0.1), rel=0.05)
    counts = answer_counts(answers)[1][0]
    flat = (counts.sum(axis=0) * np.log(counts.sum(axis=0) / counts.sum())).sum()
    assert gain == pytest.approx(float((counts * np.log(true.shares(STEPS))).sum()) - flat, rel=1e-3)


def test_participant_with_equal_answers_at_all_sizes_is_excluded_from_observer() -> None:
    attentive = _exact_answers("b", Observer(0.04, 0.12, 0.1), 400)
    careless = _answers("d", dict.fromkeys(map(float, STEPS), (20, 20, 20)))
    curve = curve_of([*attentive, *careless])
    assert (curve.participants, curve.careless) == (2, 1)
    assert curve.observer.sigma == pytest.approx(0.12, rel=0.05)


def test_expected_intervals_shrink_with_repeats_and_with_sharper_observers() -> None:
    few, repeated = expected_intervals(10, 1), expected_intervals(10, 4)
    assert repeated[1] == pytest.approx(few[1] / 2)
    bias2 = (100 * 1.959964) ** 2 * BIAS_SPREAD**2 / 10  # the part that repeats do not reduce
    assert repeated[0] ** 2 - bias2 == pytest.approx((few[0] ** 2 - bias2) / 4)
    assert expected_intervals(10, 1, Observer(0.0, 0.1, 0.1))[1] < 0.5 * few[1]


def _curve(observer: Observer, peaks: tuple[float, float] | None, steps: tuple[float, float] | None) -> StudyCurve:
    points = tuple(Point(step, 20, 0.1, 0.8, 0.1, 0.6, 0.9) for step in (-20.0, -5.0, 0.0, 5.0, 30.0))
    return StudyCurve(points, observer, 9, 0, peaks, steps, False)


def test_report_prints_as_many_digits_as_the_interval_supports() -> None:
    observer = Observer(0.05, 0.1, 0.12)
    fraction = observer.shares(np.array([observer.peak]))[0, 1]
    fine = report_text(_curve(observer, (-6.0, -4.0), (6.0, 9.5)))
    assert f"most say right at -4.9 % (95 %: -6.0 to -4.0 %); there it is {fraction:.2f} of them" in fine
    assert "just-noticeable step: 7 % (95 %: 6 to 10 %)" in fine
    assert "  -20 %        20        0.10    0.80        0.10   0.60 to 0.90" in fine
    assert "9 participant(s)" in fine
    assert "no intervals" not in fine


def test_report_does_not_print_values_outside_the_sizes_shown() -> None:
    observer = Observer(0.05, 0.1, 0.12)
    wide = report_text(_curve(observer, (-25.0, -2.0), (6.0, 45.0)))
    assert "most say right at -5 % (95 %: beyond the sizes shown to -2 %)" in wide
    assert "just-noticeable step: 7 % (95 %: 6 to beyond the sizes shown %)" in wide
    assert "less than half of 5 %" in report_text(_curve(Observer(0.0, 0.02, 0.1), None, None))
    assert "more than 30 %" in report_text(_curve(Observer(0.0, 0.5, 0.1), None, None))
    assert "most say right beyond +30 %" in report_text(_curve(Observer(-0.4, 0.1, 0.1), None, None))


def test_report_without_intervals_states_how_many_participants_are_needed() -> None:
    text = report_text(_curve(Observer(0.05, 0.1, 0.12), None, None))
    assert "most say right at about -5 %" in text
    assert "no intervals: they need three attentive participants" in text


def test_report_of_flat_curve_states_that_there_is_no_just_noticeable_step() -> None:
    observer = Observer(0.05, 0.1, 0.12)
    points = _curve(observer, None, None).points
    assert "no just-noticeable step" in report_text(StudyCurve(points, observer, 9, 0, None, None, True))
