"""The result of any method: what was asked, what was answered, and a report on every object."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from estimator.posterior.likelihood import ObjectEvidence
from estimator.posterior.posterior import Estimate
from estimator.records.measured_object import MeasuredObject
from estimator.records.result import Interval, ObjectReport, ScaleResult, UpReport
from estimator.records.scale_evidence import EvidenceReport, ScaleEvidence
from estimator.results.categories import LabelMeaning
from estimator.results.object_verdicts import dimension_names, outlier_reason, verdict
from metric_base.arrays import BoolArray, FloatArray
from metric_tree.context import Where
from metric_tree.tree import Tree

__all__ = ["EstimateOptions", "ScaleAnswer", "named_values", "names_of", "result_of"]

# One outlier of two is the usual case of a scene of two objects; the interval says so itself.
MIN_OUTLIERS = 2
# Characters of a category that a warning shows: more than any name has.
LONGEST_NAME = 200


@dataclass(frozen=True, slots=True)
class EstimateOptions:
    """What the caller asks of an estimate.

    evidence : beside the objects; trust_known_length : a known length that contradicts the objects is believed;
    up : the vertical in the scene's axes where it is known from outside; where : region and year of the objects, which
    the baselines do not use.
    """

    method: str = "default"
    level: float = 0.9
    evidence: tuple[ScaleEvidence, ...] = ()
    leave_one_class_out: bool = False
    trust_known_length: bool = False
    up: Sequence[float] | None = None
    where: Where | None = None


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
