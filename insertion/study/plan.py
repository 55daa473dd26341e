"""How many people a study needs: the intervals to expect with a curve as flat as the paper's."""

from __future__ import annotations

import numpy as np

from insertion.study.curve import JUST_NOTICEABLE, Observer
from insertion.study.page import STEPS
from metric_base.arrays import FloatArray

__all__ = ["FLAT", "expected_intervals", "plan_text"]

#: At most 0.65 say "right", at -5 %, as in the paper; an error of a quarter in perceived size makes it so.
FLAT = Observer(bias=float(-np.log(0.95)), sigma=0.25, criterion=0.234)
#: Standard deviation of people's own biases, in log size: a guess, on the careful side.
BIAS_SPREAD = 0.05
#: 95 % intervals.
_Z = 1.959964
#: Numbers of people that the plan names; the paper asked 27.
PEOPLE = (10, 27, 100)


def expected_intervals(people: int, repeats: int, observer: Observer = FLAT) -> tuple[float, float]:
    """Half the widths of the 95 % intervals of the peak and of the just-noticeable step, in per cent.

    By the Fisher information of the answers; every size is shown `repeats` times to each person.
    """
    steps = np.array(STEPS, dtype=float)
    values = np.array([observer.bias, observer.sigma, observer.criterion])
    slopes = np.stack([_slope(values, row, steps) for row in range(3)])
    shares = observer.shares(steps)
    information = repeats * np.einsum("ank,bnk,nk->ab", slopes, slopes, 1 / shares)
    spread = np.linalg.inv(information) / people
    peak = np.sqrt(spread[0, 0] + BIAS_SPREAD**2 / people)
    noticeable = JUST_NOTICEABLE * np.sqrt(spread[1, 1])
    return 100 * _Z * float(peak), 100 * _Z * float(noticeable)


def plan_text(repeats: int) -> str:
    """What to expect, in a line for each number of people."""
    lines = [f"with a curve as flat as the paper's (at most 0.65 say right), {11 * repeats} pictures each:"]
    for people in PEOPLE:
        peak, step = expected_intervals(people, repeats)
        lines.append(
            f"  {people:3d} people: the peak within {peak:.0f} %, the just-noticeable step within {step:.0f} %"
        )
    return "\n".join(lines)


def _slope(values: FloatArray, row: int, steps: FloatArray) -> FloatArray:
    """(n, 3) change of the shares at steps (n,) with one of the observer's numbers, values (3,)."""
    small = 1e-4
    ends = [values.copy(), values.copy()]
    ends[0][row] -= small
    ends[1][row] += small
    low, high = (Observer(*end.tolist()).shares(steps) for end in ends)
    return np.asarray((high - low) / (2 * small))
