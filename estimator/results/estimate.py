"""The scale from measured objects: names to priors, posterior, verdicts, one result."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from estimator.posterior.likelihood import ObjectEvidence, usable
from estimator.posterior.posterior import (
    FAR_MASS,
    FAR_MODE,
    RATIO_LIMIT,
    Estimate,
    Posterior,
    object_curves,
    posterior,
    status_of,
)
from estimator.records.measured_object import MeasuredObject
from estimator.records.result import Alternative, Interval, ObjectReport, ScaleResult, UpReport
from estimator.results.categories import Meaning, meanings
from estimator.results.contradiction import contradiction_of
from estimator.results.verdicts import dimension_names, outlier_reason, verdict
from metric_base.arrays import BoolArray, FloatArray
from metric_tree.tree import Tree

__all__ = ["HEIGHT", "Answer", "Options", "evidence_of", "result_of", "scale_of_objects"]

#: The dimensions of `--method height`.
HEIGHT = ("height",)


@dataclass(frozen=True, slots=True)
class Options:
    """What the caller asks of an estimate. known : (mean, sd) of log scale per known length."""

    method: str = "default"
    level: float = 0.9
    known: tuple[tuple[float, float], ...] = ()
    leave_one_class_out: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """What a method found, and about which objects.

    places : of the n objects that spoke, among all; used : the dimensions of each that counted; reasons : for every
    object why it did not speak, or None.
    """

    estimate: Estimate | None
    places: Sequence[int]
    used: Sequence[tuple[str, ...]]
    reasons: Sequence[str | None]


def scale_of_objects(
    objects: Sequence[MeasuredObject],
    tree: Tree,
    options: Options | None = None,
    up: UpReport | None = None,
    warnings: Sequence[str] = (),
    seconds: Mapping[str, float] | None = None,
) -> ScaleResult:
    """The scale by our posterior (methods `default` and `height`).

    Parameters
    ----------
    objects : measured objects in scene units
    tree : where their categories' priors are
    options : method, level, known lengths, and whether to leave each class out in turn
    up, warnings, seconds : what the geometry found, handed on
    """
    options = options or Options()
    by_name = meanings(tree, {item.category for item in objects}, HEIGHT if options.method == "height" else None)
    started = time.perf_counter()
    known = np.array(options.known, dtype=float).reshape(-1, 2)
    evidence, reasons = evidence_of(objects, by_name)
    places = list(evidence)
    found = posterior(list(evidence.values()), known, options.level) if places or len(known) else None
    clash = contradiction_of(found, list(evidence.values())) if found is not None else None
    if found is not None and clash is not None and clash.total:
        found = replace(found, status="unresolved")
    elapsed = {**(seconds or {}), "posterior": time.perf_counter() - started}
    used = _used(list(evidence.values()))
    answer = Answer(found, places, used, reasons)
    heard = warnings if clash is None else (*warnings, clash.line())
    result = result_of(objects, tree, by_name, answer, options, up, heard, elapsed)
    if found is None or not places:
        return result
    curves = object_curves(list(evidence.values()), found.curve.log_scale)
    return replace(
        result,
        without_support=_without_support(objects, by_name, known, options.level),
        leave_one_class_out=_left_out(found, list(evidence.values())) if options.leave_one_class_out else None,
        object_curves={objects[place].id: row for place, row in zip(places, curves, strict=True)},
    )


def evidence_of(
    objects: Sequence[MeasuredObject], by_name: Mapping[str, Meaning]
) -> tuple[dict[int, ObjectEvidence], list[str | None]]:
    """The objects that can speak, by place, and per object the reason why it cannot, or None."""
    reasons = [item.skipped or by_name[item.category].reason for item in objects]
    stated: dict[int, ObjectEvidence] = {}
    for place, item in enumerate(objects):
        meaning = by_name[item.category]
        if reasons[place] is None and meaning.node is not None and meaning.prior is not None:
            stated[place] = ObjectEvidence(item, meaning.prior, meaning.node.pose)
    for place, there in zip(list(stated), usable(list(stated.values())).tolist(), strict=True):
        if not any(there):
            reasons[place] = f"none of its extents is among {', '.join(stated.pop(place).prior.dims)}"
    return stated, reasons


def result_of(
    objects: Sequence[MeasuredObject],
    tree: Tree,
    by_name: Mapping[str, Meaning],
    answer: Answer,
    options: Options,
    up: UpReport | None,
    warnings: Sequence[str],
    seconds: Mapping[str, float],
) -> ScaleResult:
    """The result of any method that ends in a posterior over log scale."""
    found = answer.estimate
    resolved = found is not None and found.status == "resolved"
    scale = found.modes[0].scale if found is not None and resolved else None
    interval = Interval(options.level, *found.interval) if found is not None and resolved else None
    return ScaleResult(
        status="resolved" if resolved else "unresolved",
        method=options.method,
        scale=scale,
        interval=interval,
        modes=found.modes if found is not None else (),
        tree=(tree.name, tree.version),
        objects=tuple(_reports(objects, by_name, answer)),
        up=up,
        warnings=(*warnings, *_warnings(found, objects, by_name)),
        known_lengths=options.known,
        seconds=seconds,
        curve=found.curve if found is not None else None,
    )


def _reports(objects: Sequence[MeasuredObject], by_name: Mapping[str, Meaning], answer: Answer) -> list[ObjectReport]:
    row_of = {place: row for row, place in enumerate(answer.places)}
    return [
        _report(item, by_name[item.category], answer, row_of.get(place), answer.reasons[place])
        for place, item in enumerate(objects)
    ]


def _report(
    item: MeasuredObject, meaning: Meaning, answer: Answer, row: int | None, reason: str | None
) -> ObjectReport:
    weight, own, said = 0.0, None, verdict(None)
    used: tuple[str, ...] = ()
    if row is not None and answer.estimate is not None:
        weight, own = float(answer.estimate.weight[row]), float(answer.estimate.own_scale[row])
        used, said = answer.used[row], verdict(weight)
        if said == "outlier" and meaning.prior is not None:
            pose = meaning.node.pose if meaning.node is not None else "upright"
            reason = outlier_reason(ObjectEvidence(item, meaning.prior, pose), answer.estimate.modes[0].scale, own)
    return ObjectReport(
        id=item.id,
        category=item.category,
        node=meaning.node.node_id if meaning.node is not None else None,
        points=item.points,
        dimensions=_named(item, item.extents),
        confidence=_named(item, item.confidence),
        truncated=_names(item, np.asarray(item.truncated, dtype=bool)),
        used=used,
        scale=own,
        weight=weight,
        verdict=said,
        reason=reason,
        score=item.score,
        notes=item.notes,
    )


def _used(evidence: Sequence[ObjectEvidence]) -> list[tuple[str, ...]]:
    """The dimensions of each object that count in full: there, known to the prior, not cut."""
    return [
        _names(item.object, there & ~np.asarray(item.object.truncated, dtype=bool))
        for item, there in zip(evidence, usable(evidence), strict=True)
    ]


def _names(item: MeasuredObject, chosen: BoolArray) -> tuple[str, ...]:
    names = dimension_names(item)
    return tuple(name for name, keep in zip(names, chosen, strict=True) if keep)


def _named(item: MeasuredObject, values: FloatArray) -> dict[str, float]:
    return {
        name: float(value) for name, value in zip(dimension_names(item), values, strict=True) if math.isfinite(value)
    }


def _without_support(
    objects: Sequence[MeasuredObject], by_name: Mapping[str, Meaning], known: FloatArray, level: float
) -> Alternative | None:
    """The scale if no object reached down to the plane it stands on; None where none does."""
    if all(item.unsupported_height is None for item in objects):
        return None
    bare = [
        item
        if item.unsupported_height is None
        else replace(item, extents=np.append(item.extents[:2], item.unsupported_height))
        for item in objects
    ]
    evidence, _ = evidence_of(bare, by_name)
    found = posterior(list(evidence.values()), known, level)
    return Alternative("without_support", found.modes[0].scale, *found.interval, len(evidence))


def _left_out(found: Posterior, evidence: Sequence[ObjectEvidence]) -> tuple[Alternative, ...]:
    """The scale without each class in turn, the most influential first."""
    if len(found.classes) + len(found.known) < 2:
        return ()
    rows = []
    for node_id in found.classes:
        _, modes, (low, high) = found.without(node_id)
        count = sum(item.prior.node_id == node_id for item in evidence)
        rows.append(Alternative(node_id, modes[0].scale, low, high, count))
    best = found.modes[0].scale
    return tuple(sorted(rows, key=lambda row: -abs(math.log(row.scale / best))))


def _warnings(found: Estimate | None, objects: Sequence[MeasuredObject], by_name: Mapping[str, Meaning]) -> list[str]:
    unknown = sorted({item.category for item in objects if by_name[item.category].prior is None})
    lines = [f"category {_said_once(name, by_name[name].reason)}" for name in unknown]
    if found is None:
        lines.append("unresolved: no usable object" if objects else "unresolved: no object")
    elif found.status == "unresolved" and status_of(found.modes, found.interval) == "unresolved":
        low, high = found.interval
        if high / low > RATIO_LIMIT:
            lines.append(f"unresolved: the interval's high/low is {high / low:.3g}, over {RATIO_LIMIT}")
        else:
            lines.append(f"unresolved: modes over {FAR_MODE - 1:.0%} apart, the lesser with mass over {FAR_MASS}")
    return lines


def _said_once(name: str, reason: str | None) -> str:
    """Name and reason; most reasons begin with the name."""
    reason = reason or ""
    return reason if reason.startswith(f"{name!r}: ") else f"{name!r}: {reason}"
