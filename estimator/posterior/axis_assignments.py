"""Enumerate the assignments of the measured extents of an object to the axes of its prior, with their errors.

If the vertical is known, the two horizontal sides are sorted, and their order is ambiguous only if one is truncated or
they are similar. If it is unknown, or the object may have another pose, the density is the sum over all assignments
that the pose allows. A truncated side is more often too short than too long: its log extent is shifted by a mixture
with one wide component.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from itertools import permutations, product

import numpy as np

from metric_base.arrays import BoolArray, FloatArray, IntArray
from metric_tree.axes import AXES, EXTENTS
from metric_tree.prior import Prior

#: Width of the flat density of an outlier in log size: sizes within a factor of 50.
LOG_BOX = math.log(50.0)
#: Components of ln(true / measured) of a truncated side: weight, mean, standard deviation. Many flags are wrong, and
#: noise along the line of sight lengthens truncated sides: most have about their true length, the others are too short
#: by any amount, or less often too long. Chosen on hard synthetic rooms (docs/evidence/calibration.md).
TRUNCATION_MIXTURE = ((0.6, 0.05, 0.15), (0.4, 0.3, 0.8))
#: Probability that a dimension without a flag has a gross error (points of an object behind it, a part that was not
#: reconstructed, an object that leans). At most one dimension of an object has one; with two, it is an outlier. In
#: `benchmarks/estimator/simulation.py`, with 20 % of the dimensions off by up to a half, it reduces the 90th percentile
#: of the error from 8.7 to 7.6 % and increases the coverage from 85 to 88 %; without such errors it has no effect.
GROSS_ERROR_PROBABILITY = 0.1
#: Standard deviation of ln(true / measured) of a gross error.
GROSS_ERROR_SD_LOG = 0.4
#: Probability that each axis of the prior (length, width, height) is vertical, by the usual pose of the category. One
#: in five `flat` objects is on its edge (a book in a row, a phone on its stand).
VERTICAL = {"upright": (0.0, 0.0, 1.0), "flat": (0.1, 0.1, 0.8), "any": (1 / 3, 1 / 3, 1 / 3)}
#: Weight of each of the six orders of a box with unknown vertical, by the number of its missing extents. If none is
#: missing, the density of sorted extents is the sum over all orders; otherwise several orders are equal.
FREE_ORDER_WEIGHT = (1.0, 1 / 3, 1 / 6, 0.0)


@dataclass(frozen=True, slots=True)
class Layout:
    """Properties of an object that determine its assignments; hashable, so that similar objects share one table."""

    pose: str
    vertical_known: bool
    #: The prior is over sorted extents, and so are the measured ones.
    sorted_prior: bool
    #: For each measured extent.
    missing: tuple[bool, bool, bool]
    #: For each measured extent.
    truncated: tuple[bool, bool, bool]
    #: For each axis of the prior.
    modelled: tuple[bool, bool, bool]
    #: The difference of the two horizontal sides is too small for a certain order.
    horizontal_close: bool


@dataclass(frozen=True, slots=True, eq=False)
class Variants:
    """The v variants of an object: an assignment with errors of its sides."""

    #: (v, 3) measured extent of each axis of the prior.
    measured: IntArray
    #: (v, 3) the axis has both a prior and a measurement.
    active: BoolArray
    #: (v, 3) mean of ln(true / measured) due to truncation.
    shift: FloatArray
    #: (v, 3) variance of ln(true / measured) due to truncation.
    variance: FloatArray
    #: (v,) including ln(LOG_BOX) for each active axis, so that variants with different dimensions are comparable.
    log_weight: FloatArray
    #: (v, 3) log probability of a gross error of each dimension, relative to none; -inf if impossible.
    log_gross: FloatArray

    def with_vertical(self, vertical: int) -> Variants:
        """Return the conditional distribution of the variants with this vertical extent; all if none has it."""
        chosen = self.measured[:, 2] == vertical
        if not chosen.any():
            return self
        these = self.of(chosen)
        return replace(these, log_weight=these.log_weight + math.log(3))

    def of(self, chosen: BoolArray) -> Variants:
        """Return the variants of a mask (v,)."""
        return Variants(*(getattr(self, field.name)[chosen] for field in fields(self)))


@lru_cache(maxsize=1024)
def variants(layout: Layout) -> Variants:
    """Return the assignments of a layout, each with all combinations of errors of its truncated sides.

    `log_weight` is ln(weight) + a ln(LOG_BOX) for a active axes, which is relative to the flat density of an outlier:
    the outlier has the weight 1 for any number of measurements.
    """
    is_ordered = layout.sorted_prior and not (any(layout.missing) or any(layout.truncated))
    orders: list[tuple[tuple[int, ...], float]]
    if is_ordered:
        orders = [((0, 1, 2), 1.0)]
    elif layout.vertical_known and not layout.sorted_prior:
        # The vertical axis has the measured height. The density of sorted sides is the sum over both orders of the
        # horizontal axes, so that each order has the full weight of its pose.
        sides_may_swap = layout.horizontal_close or layout.truncated[0] or layout.truncated[1]
        orders = []
        for vertical, weight in enumerate(VERTICAL[layout.pose]):
            if weight == 0:
                continue
            first, second = (axis for axis in range(3) if axis != vertical)
            for long_side, short_side in ((first, second), (second, first)):
                if vertical == 2 and (long_side, short_side) == (1, 0) and not sides_may_swap:
                    continue
                axes_order = [0, 0, 0]
                axes_order[long_side], axes_order[short_side], axes_order[vertical] = 0, 1, 2
                orders.append((tuple(axes_order), weight))
    else:
        weight = FREE_ORDER_WEIGHT[sum(layout.missing)]
        orders = [(order, weight) for order in permutations(range(3)) if weight > 0]
    rows = [
        (order, active, errors, math.log(weight))
        for order, weight in orders
        for active in [[layout.modelled[axis] and not layout.missing[order[axis]] for axis in range(3)]]
        for errors in product(
            *(
                TRUNCATION_MIXTURE if active[axis] and layout.truncated[order[axis]] else ((1.0, 0.0, 0.0),)
                for axis in range(3)
            )
        )
        if any(active)
    ]
    shape = (len(rows), 3)
    errors = np.array([errors for _, _, errors, _ in rows]).reshape(*shape, 3)  # weight, mean, sd by axis
    active = np.array([active for _, active, *_ in rows], dtype=bool).reshape(shape)
    # A gross error is possible if there is another dimension; a truncated side already has a wide component.
    may_be_gross = active & (errors[:, :, 2] == 0) & (active.sum(axis=1, keepdims=True) > 1)
    right = 1 - GROSS_ERROR_PROBABILITY * may_be_gross.sum(axis=1)
    with np.errstate(divide="ignore"):
        log_gross = np.log(GROSS_ERROR_PROBABILITY * may_be_gross / right[:, None])
    log_order = np.array([log_weight for *_, log_weight in rows])
    return Variants(
        measured=np.array([order for order, *_ in rows], dtype=np.int64).reshape(shape),
        active=active,
        shift=errors[:, :, 1],
        variance=errors[:, :, 2] ** 2,
        log_weight=log_order + np.log(errors[:, :, 0].prod(axis=1) * right) + math.log(LOG_BOX) * active.sum(axis=1),
        log_gross=log_gross,
    )


def is_sorted(prior: Prior) -> bool:
    """Return True if the prior is over sorted extents instead of length, width and height."""
    return prior.dims[0] in EXTENTS


def prior_axes(prior: Prior) -> IntArray:
    """Return the indices (d,) of the dimensions of a prior in length, width, height or in the sorted extents."""
    names = EXTENTS if is_sorted(prior) else AXES
    return np.array([names.index(name) for name in prior.dims])
