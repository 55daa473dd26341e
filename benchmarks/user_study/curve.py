"""What the answers say: the share of "right" at each step, and the observer behind them.

The observer perceives the log size with an error, x = ln(1 + step) + bias + sigma z, z ~ N(0, 1), and says "too small"
below -c, "too large" above c, "right" between; one answer in fifty is a slip (Wichmann and Hill, 2001). Three numbers
make the whole curve: its peak is at exp(-bias) - 1, and the just-noticeable step is the one that the observer tells
from the right size in three of four cases, 0.6745 sigma (the usual definition in psychophysics).

People who answer without looking would make that step several times too large. Somebody whose answers are more likely
under shares of their own that do not depend on the size (two numbers more, which have their price) than
under the observer of the others is left out of the observer; the shares at each step are those of all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.user_study.answers import ANSWERS, StudyAnswer
from metric_base.arrays import BoolArray, FloatArray

#: 95 % intervals.
_Z = 1.959964
#: Three of four cases of a normal distribution.
JUST_NOTICEABLE = 0.6744898
#: The log likelihood must be better than that of a flat curve by this much (chi-squared, 2 degrees of freedom, 1 %).
NOT_FLAT = 4.605
#: Draws of the bootstrap over participants.
DRAWS = 150
#: Over simulated studies of 27 people the just-noticeable step spreads so many times wider than the bootstrap says,
#: which does not see who else might have been left out (docs/evidence/insertion.md).
WIDER = 1.35
#: The share of slips.
SLIPS = 0.02
#: What shares of one's own cost, as a log likelihood: Akaike's 2, and 1.5 so that of 27 people who look, and whose
#: curve is as flat as the paper's, fewer than one is left out. Rounds until the same people look.
OWN_SHARES, ROUNDS = 3.5, 8
_RANGES = ((-0.5, 0.5), (0.01, 5.0), (0.005, 5.0))


@dataclass(frozen=True, slots=True)
class Point:
    """One step in per cent: the number of answers and the shares of the three, with the interval of "right"."""

    step: float
    count: int
    too_small: float
    right: float
    too_large: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Observer:
    """bias, sigma, criterion on log size."""

    bias: float
    sigma: float
    criterion: float

    def shares(self, steps: FloatArray) -> FloatArray:
        """(n, 3) probability of too small, right, too large at steps in per cent."""
        from scipy.special import ndtr

        x = np.log1p(np.asarray(steps) / 100) + self.bias
        low, high = ndtr((-self.criterion - x) / self.sigma), ndtr((self.criterion - x) / self.sigma)
        return (1 - SLIPS) * np.column_stack([low, high - low, 1 - high]) + SLIPS / 3

    @property
    def peak(self) -> float:
        """The step, in per cent, at which most say "right"."""
        return float(100 * np.expm1(-self.bias))

    @property
    def noticeable(self) -> float:
        """The just-noticeable step in per cent."""
        return float(100 * np.expm1(JUST_NOTICEABLE * self.sigma))


@dataclass(frozen=True, slots=True)
class StudyCurve:
    """The result of a study.

    careless : how many participants answer without regard to the size, and are not part of the observer. The intervals
    are of the observer's peak and just-noticeable step, 95 %, over the other participants; None with fewer than three.
    flat : whether the answers do not depend on the size.
    """

    points: tuple[Point, ...]
    observer: Observer
    participants: int
    careless: int
    peak_interval: tuple[float, float] | None
    noticeable_interval: tuple[float, float] | None
    flat: bool


def curve_of(answers: Sequence[StudyAnswer]) -> StudyCurve:
    """Everything that the report shows."""
    steps, tables = _tables(answers)
    gain = fit_observer(answers)[1]
    looking, observer = _looking(steps, tables)
    flat = gain < NOT_FLAT or not looking.any()
    peaks, noticeable = (None, None)
    if not flat and np.count_nonzero(looking) >= 3:
        peaks, noticeable = _bootstrap(steps, tables[looking], observer)
    careless = int(np.count_nonzero(~looking))
    return StudyCurve(_points(answers), observer, len(tables), careless, peaks, noticeable, flat)


def wilson(right: int, count: int) -> tuple[float, float]:
    """The 95 % interval of a share (Wilson 1927)."""
    share, spread = right / count, _Z**2 / count
    middle = (share + spread / 2) / (1 + spread)
    half = _Z / (1 + spread) * np.sqrt(share * (1 - share) / count + spread / (4 * count))
    return float(max(middle - half, 0.0)), float(min(middle + half, 1.0))


def fit_observer(answers: Sequence[StudyAnswer]) -> tuple[Observer, float]:
    """The most likely observer, and how much better its log likelihood is than that of one who does not look."""
    steps, counts = _table(answers)
    observer, cost = _best_fit(steps, counts)
    total = counts.sum(axis=0)
    flat = float((total[total > 0] * np.log(total[total > 0] / total.sum())).sum())
    return observer, -cost - flat


def _best_fit(steps: FloatArray, counts: FloatArray) -> tuple[Observer, float]:
    """The best of three starts; steps : (n,) per cent; counts : (n, 3) of the three answers at each."""
    return min((_fit(steps, counts, sigma) for sigma in (0.08, 0.25, 1.0)), key=lambda fit: fit[1])


def _table(answers: Sequence[StudyAnswer]) -> tuple[FloatArray, FloatArray]:
    """(n,) steps and (n, 3) counts of the three answers."""
    steps = sorted({answer.step for answer in answers})
    rows = {step: row for row, step in enumerate(steps)}
    counts = np.zeros((len(steps), 3))
    for answer in answers:
        counts[rows[answer.step], ANSWERS.index(answer.answer)] += 1
    return np.array(steps), counts


def _fit(steps: FloatArray, counts: FloatArray, sigma: float) -> tuple[Observer, float]:
    """The observer from one start, and its negative log likelihood.

    steps : (n,) per cent; counts : (n, 3) of the three answers at each.
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


def _points(answers: Sequence[StudyAnswer]) -> tuple[Point, ...]:
    points = []
    steps, counts = _table(answers)
    for step, (small, right, large) in zip(steps.tolist(), counts, strict=True):
        total = small + right + large
        low, high = wilson(int(right), int(total))
        points.append(Point(step, int(total), small / total, right / total, large / total, low, high))
    return tuple(points)


def _tables(answers: Sequence[StudyAnswer]) -> tuple[FloatArray, FloatArray]:
    """(n,) steps and (p, n, 3) counts of the three answers of each participant."""
    steps = sorted({answer.step for answer in answers})
    people = sorted({answer.participant for answer in answers})
    rows, own = ({value: row for row, value in enumerate(values)} for values in (steps, people))
    tables = np.zeros((len(people), len(steps), 3))
    for answer in answers:
        tables[own[answer.participant], rows[answer.step], ANSWERS.index(answer.answer)] += 1
    return np.array(steps), tables


def _looking(steps: FloatArray, tables: FloatArray) -> tuple[BoolArray, Observer]:
    """(p,) who answers by the size, and the observer of these; steps : (n,); tables : (p, n, 3) counts."""
    totals = tables.sum(axis=1)
    shares = totals / totals.sum(axis=1, keepdims=True)
    own = (totals * np.log(np.where(totals > 0, shares, 1.0))).sum(axis=1) - OWN_SHARES
    looking = np.ones(len(tables), dtype=bool)
    observer = _best_fit(steps, tables.sum(axis=0))[0]
    for _ in range(ROUNDS):
        seen = (tables * np.log(observer.shares(steps))).sum(axis=(1, 2)) >= own
        if not seen.any() or (seen == looking).all():
            return seen, observer
        looking = seen
        observer = _best_fit(steps, tables[looking].sum(axis=0))[0]
    return looking, observer


def _bootstrap(
    steps: FloatArray, tables: FloatArray, observer: Observer
) -> tuple[tuple[float, float], tuple[float, float]]:
    """95 % intervals over participants, since the answers of one are not independent; tables : (p, n, 3) counts."""
    generator = np.random.default_rng(0)
    draws = [generator.choice(len(tables), len(tables)) for _ in range(DRAWS)]
    fits = [_fit(steps, tables[drawn].sum(axis=0), observer.sigma)[0] for drawn in draws]
    peaks = np.percentile([fit.peak for fit in fits], [2.5, 97.5])
    ratios = np.percentile([fit.noticeable / observer.noticeable for fit in fits], [2.5, 97.5])
    noticeable = observer.noticeable * ratios**WIDER
    return (float(peaks[0]), float(peaks[1])), (float(noticeable[0]), float(noticeable[1]))
