"""Why an object counted or not, in words: the verdict, and the dimension that speaks against it."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from estimator.posterior.axes import is_sorted
from estimator.posterior.likelihood import ObjectEvidence
from estimator.records.measured_object import MeasuredObject
from estimator.records.result import Verdict
from metric_base.arrays import FloatArray
from metric_tree.axes import AXES, EXTENTS
from metric_tree.prior import Prior

__all__ = ["USUAL_LEVEL", "dimension_names", "outlier_reason", "verdict"]

#: An object is an outlier when this is less likely than not.
OUTLIER_WEIGHT = 0.5

#: "Usual" sizes are the middle 90 % of the class.
USUAL_LEVEL = 0.9


def verdict(weight: float | None) -> Verdict:
    """`used` or `outlier` by the probability of not being an outlier; `skipped` for an object that did not speak."""
    if weight is None:
        return "skipped"
    return "used" if weight >= OUTLIER_WEIGHT else "outlier"


#: What a person calls the sorted extents.
_IN_WORDS = dict(zip(EXTENTS, ("longest side", "middle side", "shortest side"), strict=True))


def dimension_names(item: MeasuredObject) -> tuple[str, str, str]:
    """What the object's three extents are called: a free box has sorted extents."""
    return (AXES[0], AXES[1], AXES[2]) if item.vertical_known else EXTENTS


def outlier_reason(item: ObjectEvidence, scale: float, own_scale: float, height_is: str | None = None) -> str:
    """The dimension that lies furthest from the class's usual sizes at `scale`, else that the proportions do.

    height_is : what the height of the class is, where that needs words
    """
    names, sizes = _judged_sizes(item, scale)
    off = [
        (_excess(size, *bounds), name, size, bounds)
        for name, size, bounds in zip(names, sizes, _usual(item.prior), strict=True)
    ]
    share, name, size, (low, high) = max(off, key=lambda entry: entry[0])
    if share > 1:
        side = "only " if size < low else ""
        meant = f" ({height_is})" if height_is and name == "height" else ""
        return f"{_IN_WORDS.get(name, name)} {side}{_metres(size)}, usual {_metres(low)} to {_metres(high)}{meant}"
    return f"proportions unlike its class; alone it says scale {own_scale:.3g}"


def _judged_sizes(item: ObjectEvidence, scale: float) -> tuple[tuple[str, ...], list[float]]:
    """The prior's dimensions and the object's sizes on them in mm; a free box is judged by its sorted extents."""
    extents = np.asarray(item.object.extents) * scale * 1000
    if is_sorted(item.prior):
        extents = np.sort(extents)[::-1]
        return item.prior.dims, [float(extents[EXTENTS.index(name)]) for name in item.prior.dims]
    return item.prior.dims, [float(extents[AXES.index(name)]) for name in item.prior.dims]


def _excess(size: float, low: float, high: float) -> float:
    """How many half-widths of the usual range a size lies from its middle, in log size; 0 where it is missing."""
    if not np.isfinite(size):
        return 0.0
    middle, half = 0.5 * np.log(low * high), 0.5 * np.log(high / low)
    return float(abs(np.log(size) - middle) / max(half, 1e-9))


@lru_cache(maxsize=1024)
def _usual(prior: Prior) -> FloatArray:
    """(d, 2) sizes in mm between which the prior's objects usually are."""
    return prior.interval(USUAL_LEVEL)


def _metres(mm: float) -> str:
    return f"{mm / 1000:.3g} m"
