"""Fit a psychometric curve to the responses: the fraction of "right" at each step, and an observer model.

The observer perceives the log size with an error, x = ln(1 + step) + bias + sigma z, z ~ N(0, 1), and responds "too
small" below -c, "too large" above c and "right" otherwise; 2 % of the responses are random (lapse rate, Wichmann and
Hill, 2001). The peak of the curve is at exp(-bias) - 1. The just-noticeable step is the step that the observer
distinguishes from the right size in 75 % of the cases, 0.6745 sigma (the usual definition in psychophysics).

Inattentive participants would make that step several times too large. A participant is excluded from the fit of the
observer if constant probabilities, independent of the size, explain the responses better than the observer of the other
participants, with a penalty for their two additional parameters. The fractions at each step include all participants.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.user_study.answers import ANSWERS, StudyAnswer
from metric_base.arrays import BoolArray, FloatArray

#: Half width of the central 95 % interval of a normal distribution, in standard deviations.
_Z = 1.959964
#: 75 % quantile of the normal distribution, in standard deviations.
JUST_NOTICEABLE = 0.6744898
#: Minimum gain of the log likelihood over a flat curve (chi-squared, 2 degrees of freedom, 1 %).
MIN_GAIN = 4.605
#: Number of bootstrap resamples of the participants.
N_RESAMPLES = 150
#: Factor on the log width of the bootstrap interval. In simulated studies of 27 people the bootstrap underestimates the
#: spread of the just-noticeable step by this factor, because it ignores the exclusion of participants
#: (docs/evidence/insertion.md).
BOOTSTRAP_INFLATION = 1.35
#: Fraction of random responses.
LAPSE_RATE = 0.02
#: Penalty of constant probabilities, as a log likelihood: Akaike's 2, and 1.5 so that on average fewer than one of 27
#: attentive participants is excluded if the curve is as flat as the paper's.
INATTENTION_PENALTY = 3.5
#: Maximum number of iterations until the set of excluded participants is stable.
MAX_ROUNDS = 8
#: Bounds of bias, sigma and criterion.
_RANGES = ((-0.5, 0.5), (0.01, 5.0), (0.005, 5.0))


@dataclass(frozen=True, slots=True)
class Point:
    """Step in per cent, number of responses, fractions of the three responses, and 95 % interval of "right"."""

    step: float
    count: int
    too_small: float
    right: float
    too_large: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Observer:
    """Observer model with bias, sigma and criterion c in log size."""

    bias: float
    sigma: float
    criterion: float

    def shares(self, steps: FloatArray) -> FloatArray:
        """Return the probabilities (n, 3) of too small, right and too large at steps (n,) in per cent."""
        from scipy.special import ndtr

        x = np.log1p(np.asarray(steps) / 100) + self.bias
        low, high = ndtr((-self.criterion - x) / self.sigma), ndtr((self.criterion - x) / self.sigma)
        return (1 - LAPSE_RATE) * np.column_stack([low, high - low, 1 - high]) + LAPSE_RATE / 3

    @property
    def peak(self) -> float:
        """Step in per cent with the most responses "right"."""
        return float(100 * np.expm1(-self.bias))

    @property
    def noticeable(self) -> float:
        """Just-noticeable step in per cent."""
        return float(100 * np.expm1(JUST_NOTICEABLE * self.sigma))


@dataclass(frozen=True, slots=True)
class StudyCurve:
    """Result of a study.

    careless : number of inattentive participants, who are excluded from the observer.
    peak_interval, noticeable_interval : 95 % intervals over the other participants; None with fewer than three.
    flat : whether the responses are independent of the size.
    """

    points: tuple[Point, ...]
    observer: Observer
    participants: int
    careless: int
    peak_interval: tuple[float, float] | None
    noticeable_interval: tuple[float, float] | None
    flat: bool


def curve_of(answers: Sequence[StudyAnswer]) -> StudyCurve:
    """Compute the fractions at each step, the observer and its intervals."""
    steps, tables = answer_counts(answers)
    points = []
    for step, (small, right, large) in zip(steps.tolist(), tables.sum(axis=0), strict=True):
        total = small + right + large
        low, high = wilson(int(right), int(total))
        points.append(Point(step, int(total), small / total, right / total, large / total, low, high))
    gain = fit_observer(answers)[1]
    attentive, observer = _attentive(steps, tables)
    flat = gain < MIN_GAIN or not attentive.any()
    peaks, noticeable = (None, None)
    if not flat and np.count_nonzero(attentive) >= 3:
        peaks, noticeable = _bootstrap(steps, tables[attentive], observer)
    careless = int(np.count_nonzero(~attentive))
    return StudyCurve(tuple(points), observer, len(tables), careless, peaks, noticeable, flat)


def wilson(right: int, count: int) -> tuple[float, float]:
    """Return the 95 % interval of a fraction (Wilson 1927)."""
    fraction, spread = right / count, _Z**2 / count
    centre = (fraction + spread / 2) / (1 + spread)
    half = _Z / (1 + spread) * np.sqrt(fraction * (1 - fraction) / count + spread / (4 * count))
    return float(max(centre - half, 0.0)), float(min(centre + half, 1.0))


def fit_observer(answers: Sequence[StudyAnswer]) -> tuple[Observer, float]:
    """Return the most likely observer, and the gain of its log likelihood over constant probabilities."""
    steps, tables = answer_counts(answers)
    counts = tables.sum(axis=0)
    observer, cost = _best_fit(steps, counts)
    total = counts.sum(axis=0)
    flat = float((total[total > 0] * np.log(total[total > 0] / total.sum())).sum())
    return observer, -cost - flat


def _best_fit(steps: FloatArray, counts: FloatArray) -> tuple[Observer, float]:
    """Return the best fit of three starts, for counts (n, 3) of the responses at steps (n,) in per cent."""
    return min((_fit(steps, counts, sigma) for sigma in (0.08, 0.25, 1.0)), key=lambda fit: fit[1])


def _fit(steps: FloatArray, counts: FloatArray, sigma: float) -> tuple[Observer, float]:
    """Fit the observer from one start; return it with its negative log likelihood.

    steps : (n,) in per cent.
    counts : (n, 3) numbers of the three responses at each step.
    """
    from scipy.optimize import minimize

    def cost(values: FloatArray) -> float:
        shares = Observer(values[0], np.exp(values[1]), np.exp(values[2])).shares(steps)
        return float(-(counts * np.log(np.clip(shares, 1e-9, 1))).sum())

    bounds = [_RANGES[0], *((float(np.log(low)), float(np.log(high))) for low, high in _RANGES[1:])]
    best = minimize(
        cost, np.array([0.0, np.log(sigma), np.log(0.1)]), bounds=bounds, method="L-BFGS-B", options={"ftol": 1e-7}
    )
    return Observer(float(best.x[0]), float(np.exp(best.x[1])), float(np.exp(best.x[2]))), float(best.fun)


def answer_counts(answers: Sequence[StudyAnswer]) -> tuple[FloatArray, FloatArray]:
    """Return the steps (n,) in per cent and the counts (p, n, 3) of the three responses of each participant."""
    steps = sorted({answer.step for answer in answers})
    people = sorted({answer.participant for answer in answers})
    columns, rows = ({value: index for index, value in enumerate(values)} for values in (steps, people))
    tables = np.zeros((len(people), len(steps), 3))
    for answer in answers:
        tables[rows[answer.participant], columns[answer.step], ANSWERS.index(answer.answer)] += 1
    return np.array(steps), tables


def _attentive(steps: FloatArray, tables: FloatArray) -> tuple[BoolArray, Observer]:
    """Return which participants (p,) answer by the size, and the observer fitted to them.

    steps : (n,) in per cent.
    tables : (p, n, 3) numbers of the three responses.
    """
    totals = tables.sum(axis=1)
    fractions = totals / totals.sum(axis=1, keepdims=True)
    constant = (totals * np.log(np.where(totals > 0, fractions, 1.0))).sum(axis=1) - INATTENTION_PENALTY
    attentive = np.ones(len(tables), dtype=bool)
    observer = _best_fit(steps, tables.sum(axis=0))[0]
    for _ in range(MAX_ROUNDS):
        by_size = (tables * np.log(observer.shares(steps))).sum(axis=(1, 2)) >= constant
        if not by_size.any() or (by_size == attentive).all():
            return by_size, observer
        attentive = by_size
        observer = _best_fit(steps, tables[attentive].sum(axis=0))[0]
    return attentive, observer


def _bootstrap(
    steps: FloatArray, tables: FloatArray, observer: Observer
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the 95 % intervals of peak and just-noticeable step by resampling participants.

    The responses of a participant are not independent, so responses are not resampled individually.
    tables : (p, n, 3) numbers of the three responses.
    """
    generator = np.random.default_rng(0)
    draws = [generator.choice(len(tables), len(tables)) for _ in range(N_RESAMPLES)]
    fits = [_fit(steps, tables[drawn].sum(axis=0), observer.sigma)[0] for drawn in draws]
    peaks = np.percentile([fit.peak for fit in fits], [2.5, 97.5])
    ratios = np.percentile([fit.noticeable / observer.noticeable for fit in fits], [2.5, 97.5])
    noticeable = observer.noticeable * ratios**BOOTSTRAP_INFLATION
    return (float(peaks[0]), float(peaks[1])), (float(noticeable[0]), float(noticeable[1]))
