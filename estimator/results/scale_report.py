"""Why an object counted or not, in words: the verdict, and the dimension that speaks against it.

The result of any method: what was asked, what was answered, and a report on every object.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from estimator.posterior.axis_assignments import is_sorted
from estimator.posterior.object_likelihood import ObjectEvidence
from estimator.posterior.posterior import Estimate
from estimator.records.objects import MeasuredObject
from estimator.records.options import EstimateOptions
from estimator.records.result import EvidenceReport, Interval, ObjectReport, ScaleResult, UpReport, Verdict
from estimator.results.object_priors import LabelMeaning
from metric_base.arrays import BoolArray, FloatArray
from metric_tree.axes import AXES, EXTENTS
from metric_tree.prior import Prior
from metric_tree.tree import Tree

#: An object is an outlier when this is less likely than not.
OUTLIER_WEIGHT = 0.5
#: "Usual" sizes are the middle 90 % of the class.
USUAL_LEVEL = 0.9
#: What a person calls the sorted extents.
_IN_WORDS = dict(zip(EXTENTS, ("longest side", "middle side", "shortest side"), strict=True))
# One outlier of two is the usual case of a scene of two objects; the interval says so itself.
MIN_OUTLIERS = 2
# Characters of a category that a warning shows: more than any name has.
LONGEST_NAME = 200


def verdict(weight: float | None) -> Verdict:
    """`used` or `outlier` by the probability of not being an outlier; `skipped` for an object that did not speak."""
    if weight is None:
        return "skipped"
    return "used" if weight >= OUTLIER_WEIGHT else "outlier"


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


@dataclass(frozen=True, slots=True, eq=False)
class ScaleAnswer:
    """What a method estimate, and about which objects.

    places : of the n objects that spoke, among all; used : the dimensions of each that counted; reasons : for every
    object why it did not speak, or None. evidence : the rows of the other evidence.
    """

    estimate: Estimate | None
    places: Sequence[int]
    used: Sequence[tuple[str, ...]]
    reasons: Sequence[str | None]
    evidence: tuple[EvidenceReport, ...] = ()


def result_of(
    objects: Sequence[MeasuredObject],
    tree: Tree,
    by_name: Mapping[str, LabelMeaning],
    answer: ScaleAnswer,
    options: EstimateOptions,
    up: UpReport | None,
    warnings: Sequence[str],
    seconds: Mapping[str, float],
) -> ScaleResult:
    """The result of any method that ends in a posterior over log scale."""
    estimate = answer.estimate
    answered = estimate is not None and estimate.status != "unresolved"
    scale = estimate.modes[0].scale if estimate is not None and answered else None
    interval = Interval(options.level, *estimate.interval) if estimate is not None and answered else None
    return ScaleResult(
        status="unresolved" if estimate is None else estimate.status,
        method=options.method,
        scale=scale,
        interval=interval,
        modes=estimate.modes if estimate is not None else (),
        tree=(tree.name, tree.version),
        objects=tuple(_reports(objects, by_name, answer)),
        up=up,
        warnings=(*warnings, *_outlier_warnings(estimate), *_warnings(estimate, objects, by_name)),
        evidence=answer.evidence,
        seconds=seconds,
        curve=estimate.curve if estimate is not None else None,
    )


def _reports(
    objects: Sequence[MeasuredObject], by_name: Mapping[str, LabelMeaning], answer: ScaleAnswer
) -> list[ObjectReport]:
    row_of = {place: row for row, place in enumerate(answer.places)}
    return [
        _report(item, by_name[item.category], answer, row_of.get(place), answer.reasons[place])
        for place, item in enumerate(objects)
    ]


def _report(
    item: MeasuredObject, meaning: LabelMeaning, answer: ScaleAnswer, row: int | None, reason: str | None
) -> ObjectReport:
    weight, own, said = 0.0, None, verdict(None)
    used: tuple[str, ...] = ()
    if row is not None and answer.estimate is not None:
        weight, own = float(answer.estimate.weight[row]), float(answer.estimate.own_scale[row])
        used, said = answer.used[row], verdict(weight)
        if said == "outlier" and meaning.prior is not None:
            node = meaning.node
            judged = ObjectEvidence(item, meaning.prior, node.pose if node is not None else "upright")
            height_is = node.height_is if node is not None else None
            reason = outlier_reason(judged, answer.estimate.modes[0].scale, own, height_is)
    return ObjectReport(
        id=item.id,
        category=item.category,
        node=meaning.node.node_id if meaning.node is not None else None,
        points=item.points,
        dimensions=named_values(item, item.extents),
        confidence=named_values(item, item.confidence),
        truncated=names_of(item, np.asarray(item.truncated, dtype=bool)),
        used=used,
        scale=own,
        weight=weight,
        verdict=said,
        reason=reason,
        score=item.score,
        notes=(*item.notes, *meaning.notes),
        views=item.views,
        tier=meaning.prior.tier if meaning.prior is not None else None,
    )


def names_of(item: MeasuredObject, chosen: BoolArray) -> tuple[str, ...]:
    """Names of the extents that are chosen, (3,) bool."""
    names = dimension_names(item)
    return tuple(name for name, keep in zip(names, chosen, strict=True) if keep)


def named_values(item: MeasuredObject, values: FloatArray) -> dict[str, float]:
    """The finite ones of the values (3,), by the names of the object's extents."""
    return {
        name: float(value) for name, value in zip(dimension_names(item), values, strict=True) if math.isfinite(value)
    }


def _outlier_warnings(estimate: Estimate | None) -> list[str]:
    """A line where half of the objects or more are outliers: what the rest says may be chance."""
    if estimate is None or estimate.status == "unresolved":
        return []
    weights = [verdict(float(weight)) for weight in estimate.weight]
    outliers = weights.count("outlier")
    if 2 * outliers < len(weights) or outliers < MIN_OUTLIERS:
        return []
    return [f"{outliers} of {len(weights)} objects are outliers: check their labels and masks"]


def _warnings(
    estimate: Estimate | None, objects: Sequence[MeasuredObject], by_name: Mapping[str, LabelMeaning]
) -> list[str]:
    unknown = sorted({item.category for item in objects if by_name[item.category].prior is None})
    lines = [_reason_with_name(name, by_name[name].reason) for name in unknown]
    if estimate is None:
        lines.append(
            "unresolved: no usable object"
            if objects
            else "unresolved: no object, and no other evidence that could be used"
        )
    elif estimate.doubt is not None:
        lines.append(f"{estimate.status}: {estimate.doubt}")
    return lines


def _reason_with_name(name: str, reason: str | None) -> str:
    """What a warning states about a category; most reasons say its name themselves."""
    reason = reason or ""
    if reason.startswith(f"{name!r}: "):
        return f"category {reason}"
    short = name if len(name) <= LONGEST_NAME else f"{name[:LONGEST_NAME]}..."
    return reason if repr(name) in reason else f"category {short!r}: {reason}"
