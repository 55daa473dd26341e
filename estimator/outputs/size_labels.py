"""Sizes in words, as they stand beside an object in a picture: estimate, interval, truth."""

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
    """One dimension of one object in words: its axis (0 to 2), whether it counted, and its text."""

    axis: int
    trusted: bool
    text: str


def dimension_labels(
    item: MeasuredObject, report: ObjectReport, result: ScaleResult, truth: Mapping[str, float]
) -> tuple[DimensionLabel, ...]:
    """What to write of an object: each dimension in metres with its interval, those that did not count without.

    Of an unresolved scale the metres are those of its highest mode, without an interval.
    """
    labels = []
    for axis, name in enumerate(AXES):
        size = float(item.extents[axis])
        if not math.isfinite(size) or result.best_scale is None:
            continue
        trusted = report.verdict == "used" and name in report.used
        text = f"{'>' if item.truncated[axis] else ''}{size * result.best_scale:.2f}"
        if trusted and result.interval is not None:
            low, high = size_interval(size, float(item.sigma[axis]), result)
            text += f" [{low:.2f}, {high:.2f}]"
        known = f"  G {truth[name]:.2f}" if name in truth else ""
        mark = "E " if truth else ""
        labels.append(DimensionLabel(axis, trusted, f"{_SHORT[axis]} {mark}{text}{known}"))
    return tuple(labels)


def size_interval(size: float, sigma: float, result: ScaleResult) -> tuple[float, float]:
    """The interval of a size in metres at the result's level: those of the scale and of the measurement, in quadrature.

    The scale's own half-widths in log scale are kept apart, for its posterior need not be even.
    """
    if result.interval is None or result.scale is None:
        raise ValueError("size_interval: expected a resolved result")
    quantile = NormalDist().inv_cdf(0.5 + result.interval.level / 2)
    spread = quantile * sigma if math.isfinite(sigma) else 0.0
    down = math.hypot(math.log(result.scale / result.interval.low), spread)
    up = math.hypot(math.log(result.interval.high / result.scale), spread)
    metres = size * result.scale
    return metres * math.exp(-down), metres * math.exp(up)
