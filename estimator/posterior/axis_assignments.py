"""How the measured extents of one object may be its prior's axes, and what each way says about sides that are cut.

Which axis is which: with the vertical known both horizontal sides are sorted and the order matters only
where one is cut or noisy; with the vertical unknown, or for an object that also stands or lies otherwise, the density
is the sum over the assignments that the pose allows. A cut side is more often short than long: its log extent is
shifted by a mixture of amounts, of which one is wide.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import permutations, product

import numpy as np

from metric_base.arrays import BoolArray, FloatArray, IntArray
from metric_tree.axes import AXES, EXTENTS
from metric_tree.prior import Prior

#: Width of the flat density over log size that stands for "anything": sizes over a factor of 50.
LOG_BOX = math.log(50.0)
#: Of a cut side: weight, mean and standard deviation of ln(true / measured). A flag is often wrong, and smear along the
#: ray lengthens sides that are cut: most are near their length, the others are short by any amount or, less often,
#: long. Chosen on hard synthetic rooms (docs/evidence/results.md).
TRUNCATION_SHIFTS = ((0.6, 0.05, 0.15), (0.4, 0.3, 0.8))
#: Of a dimension that is neither cut nor flagged: the probability that it is grossly wrong all the same (points of the
#: object behind, a part that was not reconstructed, an object that leans), and its error then, one standard deviation
#: of ln(true / measured): a third. At most one dimension of an object; two make it an outlier.
#: In `benchmarks/estimator/simulation.py` with 20 % of dimensions off by up to a half it brings the 90th percentile
#: of the error
#: from 8.7 to 7.6 % and the coverage from 85 to 88 %, and costs nothing where none is.
GROSS_ERROR_SHARE, GROSS_ERROR_SD_LOG = 0.1, 0.4
#: Probability that each axis of the prior (length, width, height) is the vertical one, by the node's ordinary pose.
#: `flat`: one such object in five stands on an edge (a book in a row, a phone on its stand); `any`: no pose is usual.
VERTICAL = {"upright": (0.0, 0.0, 1.0), "flat": (0.1, 0.1, 0.8), "any": (1 / 3, 1 / 3, 1 / 3)}
#: Weight of each of the six orders of a free box by how many of its extents are missing. None missing: the density
#: of sorted extents is the plain sum over orders. Else the six orders stand for three, or thrice two, equal ones.
FREE_ORDER_WEIGHT = (1.0, 1 / 3, 1 / 6, 0.0)


@dataclass(frozen=True, slots=True)
class Layout:
    """What decides the assignments of an object; hashable, so that equal objects share one table.

    missing, truncated, modelled : one bool per measured extent (two) and per axis of the prior (one).
    sorted_prior : the prior is over sorted extents, and so are the measured ones.
    horizontal_close : the two horizontal sides are too near each other for their order to be sure.
    """

    pose: str
    vertical_known: bool
    sorted_prior: bool
    missing: tuple[bool, bool, bool]
    truncated: tuple[bool, bool, bool]
    modelled: tuple[bool, bool, bool]
    horizontal_close: bool


@dataclass(frozen=True, slots=True, eq=False)
class Variants:
    """The v ways to read one object.

    measured : (v, 3) row of the measured extent that stands on each axis of the prior; active : (v, 3) bool, the axis
    has both a prior and a measurement; shift, variance : (v, 3) mean and variance of ln(true / measured) from a cut;
    log_weight : (v,), plus ln(LOG_BOX) for every active axis, so that ways of unlike dimension compare; gross : (v,)
    bool, a dimension is taken to be grossly wrong.
    """

    measured: IntArray
    active: BoolArray
    shift: FloatArray
    variance: FloatArray
    log_weight: FloatArray
    gross: BoolArray

    def of_reading(self, vertical: int) -> Variants:
        """The variants whose vertical is this measured extent, as the distribution given that; all if there is none."""
        chosen = self.measured[:, 2] == vertical
        if not chosen.any():
            return self
        these = self._of(chosen)
        return replace(these, log_weight=these.log_weight + math.log(3))

    def without_gross_errors(self) -> Variants:
        """The variants in which no dimension is grossly wrong."""
        return self._of(~self.gross)

    def of_wide_cuts(self) -> Variants:
        """The variants in which no cut side is taken to be near its measured length."""
        return self._of(~(self.variance == TRUNCATION_SHIFTS[0][2] ** 2).any(axis=1))

    def _of(self, chosen: BoolArray) -> Variants:
        """The variants of a mask (v,)."""
        return Variants(
            measured=self.measured[chosen],
            active=self.active[chosen],
            shift=self.shift[chosen],
            variance=self.variance[chosen],
            log_weight=self.log_weight[chosen],
            gross=self.gross[chosen],
        )


@lru_cache(maxsize=1024)
def variants(layout: Layout) -> Variants:
    """The assignments of a layout, each with every combination of shifts of its cut sides.

    log_weight holds ln(weight) + a ln(LOG_BOX) for a active axes: relative to the outlier's flat
    density, so that the outlier itself has weight one whatever was measured.
    """
    rows = [
        (order, active, errors, math.log(weight), gross)
        for order, weight in _orders(layout)
        for active in [tuple(layout.modelled[axis] and not layout.missing[order[axis]] for axis in range(3))]
        for errors, gross in _errors(active, tuple(layout.truncated[order[axis]] for axis in range(3)))
        if any(active)
    ]
    shape = (len(rows), 3)
    errors = np.array([errors for _, _, errors, _, _ in rows]).reshape(*shape, 3)  # weight, mean, sd by axis
    active_axes = np.array([active for _, active, *_ in rows], dtype=bool).reshape(shape)
    log_order = np.array([log_weight for *_, log_weight, _ in rows])
    return Variants(
        measured=np.array([order for order, *_ in rows], dtype=np.int64).reshape(shape),
        active=active_axes,
        shift=errors[:, :, 1],
        variance=errors[:, :, 2] ** 2,
        log_weight=log_order + np.log(errors[:, :, 0]).sum(axis=1) + math.log(LOG_BOX) * active_axes.sum(axis=1),
        gross=np.array([gross for *_, gross in rows], dtype=bool),
    )


def _orders(layout: Layout) -> list[tuple[tuple[int, ...], float]]:
    """(measured extent of each axis of the prior, weight) of every assignment that is allowed."""
    if layout.sorted_prior:
        certain = not (any(layout.missing) or any(layout.truncated))
        return [((0, 1, 2), 1.0)] if certain else _free_orders(layout)
    return _standing_orders(layout) if layout.vertical_known else _free_orders(layout)


def _free_orders(layout: Layout) -> list[tuple[tuple[int, ...], float]]:
    weight = FREE_ORDER_WEIGHT[sum(layout.missing)]
    return [(order, weight) for order in permutations(range(3)) if weight > 0]


def _standing_orders(layout: Layout) -> list[tuple[tuple[int, ...], float]]:
    """Orders with the vertical known: the axis that stands up takes the height, the others both orders of the sides.

    Sorted sides have the sum of both orders as their density, so each order has the whole weight of its pose.
    """
    sides_may_swap = layout.horizontal_close or layout.truncated[0] or layout.truncated[1]
    orders = []
    for vertical, weight in enumerate(VERTICAL[layout.pose]):
        if weight == 0:
            continue
        usual = vertical == 2
        first, second = (axis for axis in range(3) if axis != vertical)
        for long_side, short_side in ((first, second), (second, first)):
            if usual and (long_side, short_side) == (1, 0) and not sides_may_swap:
                continue
            order = [0, 0, 0]
            order[long_side], order[short_side], order[vertical] = 0, 1, 2
            orders.append((tuple(order), weight))
    return orders


def _errors(
    active: tuple[bool, ...], cut: tuple[bool, ...]
) -> list[tuple[tuple[tuple[float, float, float], ...], bool]]:
    """Every combination of (weight, shift, standard deviation) over the three axes, and whether one is grossly wrong.

    A gross error needs another dimension to show it, and a cut side has its own wide component.
    """
    none, cuts = (1.0, 0.0, 0.0), [on and is_cut for on, is_cut in zip(active, cut, strict=True)]
    suspects = (
        [axis for axis in range(3) if active[axis] and not cuts[axis]]
        if sum(active) > 1 and GROSS_ERROR_SHARE > 0
        else []
    )
    combinations = list(product(*(TRUNCATION_SHIFTS if is_cut else (none,) for is_cut in cuts)))
    if not suspects:
        return [(errors, False) for errors in combinations]
    ways = []
    for errors in combinations:
        for wrong in (None, *suspects):
            weight = 1 - len(suspects) * GROSS_ERROR_SHARE if wrong is None else GROSS_ERROR_SHARE
            axis = suspects[0] if wrong is None else wrong
            changed = (weight, 0.0, 0.0 if wrong is None else GROSS_ERROR_SD_LOG)
            ways.append(((*errors[:axis], changed, *errors[axis + 1 :]), wrong is not None))
    return ways


def is_sorted(prior: Prior) -> bool:
    """Whether the prior is over sorted extents, not over length, width, height."""
    return prior.dims[0] in EXTENTS


def prior_axes(prior: Prior) -> IntArray:
    """(d,) place of each of the prior's dimensions among length, width, height, or among the sorted extents."""
    names = EXTENTS if is_sorted(prior) else AXES
    return np.array([names.index(name) for name in prior.dims])
