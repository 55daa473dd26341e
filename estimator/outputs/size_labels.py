"""Format the sizes of an object for images and views: estimate, interval, and true size."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from statistics import NormalDist

from estimator.records.objects import MeasuredObject
from estimator.records.result import ObjectReport, ScaleResult
from metric_tree.axes import AXES

_SHORT = ("l", "w", "h")


@dataclass(frozen=True, slots=True)
class DimensionLabel:
    """Text of one dimension of an object."""

    #: 0 length, 1 width, 2 height.
    axis: int
    #: True if the dimension was used for the scale.
    is_used: bool
    text: str


def dimension_labels(
    item: MeasuredObject, report: ObjectReport, result: ScaleResult, truth: Mapping[str, float]
) -> tuple[DimensionLabel, ...]:
    """Return the labels of an object: dimensions in metres, with intervals for those that were used for the scale.

    If the scale is unresolved, the sizes are those at its highest mode, without intervals.

    Parameters
    ----------
    item : MeasuredObject
    report : ObjectReport
    result : ScaleResult
    truth : mapping of str to float
        True sizes in metres by dimension, may be empty.
    """
    labels = []
    for axis, name in enumerate(AXES):
        size = float(item.extents[axis])
        if not math.isfinite(size) or result.best_scale is None:
            continue
        is_used = report.verdict == "used" and name in report.used
        text = f"{'>' if item.truncated[axis] else ''}{size * result.best_scale:.2f}"
        if is_used and result.interval is not None:
            low, high = size_interval(size, float(item.sigma[axis]), result)
            text += f" [{low:.2f}, {high:.2f}]"
        true_size = f"  G {truth[name]:.2f}" if name in truth else ""
        mark = "E " if truth else ""
        labels.append(DimensionLabel(axis, is_used, f"{_SHORT[axis]} {mark}{text}{true_size}"))
    return tuple(labels)


def size_interval(size: float, sigma: float, result: ScaleResult) -> tuple[float, float]:
    """Return the interval of a size in metres, with the errors of scale and measurement added in quadrature.

    The lower and upper half widths of the scale differ, because its posterior may be asymmetric.

    Parameters
    ----------
    size : float
        Extent in scene units.
    sigma : float
        Standard deviation of its logarithm, may be NaN.
    result : ScaleResult

    Raises
    ------
    ValueError
        The scale is not resolved.
    """
    if result.interval is None or result.scale is None:
        raise ValueError("size_interval: expected a resolved result")
    quantile = NormalDist().inv_cdf(0.5 + result.interval.level / 2)
    half_width = quantile * sigma if math.isfinite(sigma) else 0.0
    down = math.hypot(math.log(result.scale / result.interval.low), half_width)
    up = math.hypot(math.log(result.interval.high / result.scale), half_width)
    metres = size * result.scale
    return metres * math.exp(-down), metres * math.exp(up)
