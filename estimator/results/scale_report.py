"""Build the result of a method (`build_result`): a report for each object, its verdict and reason, and the warnings."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np

from estimator.posterior.axis_assignments import is_sorted
from estimator.posterior.posterior import Estimate
from estimator.records.digests import options_digest
from estimator.records.objects import MeasuredObject
from estimator.records.options import EstimateOptions
from estimator.records.result import (
    Alternative,
    EvidenceReport,
    Help,
    Interval,
    ObjectReport,
    ResultContext,
    ScaleResult,
    Status,
    Verdict,
)
from estimator.results.object_priors import EvidenceSet, dimension_names, names_of
from metric_base.arrays import FloatArray
from metric_tree.axes import AXES, EXTENTS
from metric_tree.prior import Prior
from metric_tree.tree import Tree

#: Minimum probability that an object matches its label; an object below it is an outlier.
MIN_OBJECT_WEIGHT = 0.5
#: Mass of the interval of typical sizes of a class.
TYPICAL_LEVEL = 0.9
#: Names of sorted extents in messages.
_EXTENT_NAMES = dict(zip(EXTENTS, ("longest side", "middle side", "shortest side"), strict=True))
#: Minimum number of outliers for a warning. One of two objects is often an outlier, which the interval shows already.
MIN_WARNED_OUTLIERS = 2
#: Minimum fraction of outliers among the objects for the warning.
MIN_WARNED_OUTLIER_FRACTION = 0.5
#: Maximum number of characters of a category in a warning; longer names are truncated.
MAX_NAME_CHARS = 200


def build_result(
    evidence: EvidenceSet,
    estimate: Estimate | None,
    tree: Tree,
    options: EstimateOptions,
    context: ResultContext,
    *,
    status: Status,
    reason: str | None = None,
    notes: Sequence[str] = (),
    reports: Sequence[EvidenceReport] = (),
    would_help: Sequence[Help] = (),
    without_support: Alternative | None = None,
    leave_one_class_out: tuple[Alternative, ...] | None = None,
    object_curves: Mapping[str, FloatArray] | None = None,
    seconds: Mapping[str, float],
) -> ScaleResult:
    """Build the result of any method that estimates a density over log scale.

    Parameters
    ----------
    evidence : EvidenceSet
        The objects, used or not.
    estimate : Estimate or None
        None if there is no evidence.
    tree : Tree
        Release of the priors.
    options : EstimateOptions
    context : ResultContext
        A fatal problem makes the result unresolved, without scale, curve and advice, and a doubtful one uncertain.
    status : {"resolved", "uncertain", "unresolved"}
        Status of the scale without regard to the problems.
    reason : str, optional
        Reason if it is not resolved.
    notes : sequence of str
        Warnings of the method.
    reports : sequence of EvidenceReport
        Reports on the evidence other than objects.
    would_help, without_support, leave_one_class_out, object_curves
        Fields of `ScaleResult`; a curve has the shape (g,) of its grid.
    seconds : dict
        Duration of each stage.
    """
    is_invalid = any(problem.is_fatal for problem in context.problems)
    is_doubtful = any(problem.is_doubtful for problem in context.problems)
    status = "uncertain" if status == "resolved" and is_doubtful else status
    is_stated = estimate is not None and status != "unresolved" and not is_invalid
    rows = {index: row for row, index in enumerate(evidence.indices)}
    digests: dict[str, str | None] = {}
    if context.digests is not None:
        up = None if options.up is None else [float(value) for value in options.up]
        others = [(row.kind, row.id, row.scale, row.sd_log) for row in reports]
        where, release = str(options.where), (tree.name, tree.version)
        values = (options.method, options.level, options.trust_known_length, where, up, others, release)
        digests = {**context.digests, "options": options_digest(values)}
    warnings = []  # outliers, categories without a prior, and the reason for the status
    if estimate is not None and status != "unresolved":
        verdicts = [verdict(float(weight)) for weight in estimate.weight]
        outliers = verdicts.count("outlier")
        # If half of the objects are outliers, the others may agree by chance.
        if outliers >= max(MIN_WARNED_OUTLIERS, MIN_WARNED_OUTLIER_FRACTION * len(verdicts)):
            warnings.append(f"{outliers} of {len(verdicts)} objects are outliers: check their labels and masks")
    for name in sorted({item.category for item in evidence.measured}):
        if evidence.matches[name].prior is not None:
            continue
        message = evidence.matches[name].reason or ""
        if repr(name) not in message:
            short = name if len(name) <= MAX_NAME_CHARS else f"{name[:MAX_NAME_CHARS]}..."
            message = f"category {short!r}: {message}"
        warnings.append(message)
    if estimate is None:
        nothing = "no usable object" if evidence.measured else "no object, and no other evidence that could be used"
        warnings.append(f"unresolved: {nothing}")
    elif reason is not None:
        warnings.append(f"{status}: {reason}")
    return ScaleResult(
        status="unresolved" if is_invalid else status,
        method=options.method,
        scale=estimate.modes[0].scale if estimate is not None and is_stated else None,
        interval=Interval(options.level, *estimate.interval) if estimate is not None and is_stated else None,
        modes=estimate.modes if estimate is not None else (),
        tree=(tree.name, tree.version),
        objects=tuple(
            _object_report(evidence, index, rows.get(index), estimate) for index in range(len(evidence.measured))
        ),
        up=context.up,
        warnings=(
            *(
                f"uncertain: {problem.message}" if problem.is_doubtful and status == "uncertain" else problem.message
                for problem in context.problems
                if not problem.is_fatal
            ),
            *notes,
            *warnings,
            *(f"unresolved: {problem.message}" for problem in context.problems if problem.is_fatal),
        ),
        without_support=without_support,
        leave_one_class_out=leave_one_class_out,
        evidence=tuple(reports),
        would_help=() if is_invalid else tuple(would_help),
        seconds=seconds,
        of=digests,
        # An invalid scene has no curve and is not drawn, because its sizes are wrong.
        curve=estimate.curve if estimate is not None and not is_invalid else None,
        object_curves=object_curves or {},
    )


def verdict(weight: float | None) -> Verdict:
    """Return `used` or `outlier` by the probability that an object matches its label; `skipped` for None."""
    if weight is None:
        return "skipped"
    return "used" if weight >= MIN_OBJECT_WEIGHT else "outlier"


def outlier_reason(
    item: MeasuredObject, prior: Prior, scale: float, own_scale: float, height_is: str | None = None
) -> str:
    """Return the dimension that is furthest outside the typical sizes of the class, or the proportions if none is.

    Parameters
    ----------
    item : MeasuredObject
    prior : Prior
        Prior of its class.
    scale, own_scale : float
        Scale of the scene, and the scale by the object, in metres per unit.
    height_is : str, optional
        Definition of the height of the class, if it needs one.
    """
    extents = np.asarray(item.extents) * scale * 1000
    names = AXES
    if is_sorted(prior):
        extents, names = np.sort(extents)[::-1], EXTENTS
    furthest, message = 1.0, f"its proportions are unlike its class; the scale by this object is {own_scale:.3g}"
    for name, (low, high) in zip(prior.dims, _typical_sizes(prior), strict=True):
        size = float(extents[names.index(name)])
        # Distance from the centre of the typical sizes in half widths, in log size; a distance over 1 is outside.
        centre, half = 0.5 * np.log(low * high), 0.5 * np.log(high / low)
        distance = float(abs(np.log(size) - centre) / max(half, 1e-9)) if np.isfinite(size) else 0.0
        if distance > furthest:
            side = "only " if size < low else ""
            definition = f" ({height_is})" if height_is and name == "height" else ""
            typical = f"usual {low / 1000:.3g} m to {high / 1000:.3g} m{definition}"
            furthest, message = distance, f"{_EXTENT_NAMES.get(name, name)} {side}{size / 1000:.3g} m, {typical}"
    return message


@lru_cache(maxsize=1024)
def _typical_sizes(prior: Prior) -> FloatArray:
    """Return the bounds (d, 2) of typical sizes in millimetres."""
    return prior.interval(TYPICAL_LEVEL)


def _object_report(evidence: EvidenceSet, index: int, row: int | None, estimate: Estimate | None) -> ObjectReport:
    """Return the report on measured object `index`, which has index `row` among the used ones, or None."""
    item, reason = evidence.measured[index], evidence.reasons[index]
    match = evidence.matches[item.category]
    weight, own_scale, outcome = 0.0, None, verdict(None)
    used: tuple[str, ...] = ()
    if row is not None and estimate is not None:
        weight, own_scale = float(estimate.weight[row]), float(estimate.own_scale[row])
        used, outcome = evidence.used[row], verdict(weight)
        if outcome == "outlier" and match.prior is not None:
            height_is = match.node.height_is if match.node is not None else None
            reason = outlier_reason(item, match.prior, estimate.modes[0].scale, own_scale, height_is)
    return ObjectReport(
        id=item.id,
        category=item.category,
        node=match.node.node_id if match.node is not None else None,
        points=item.points,
        dimensions=_named_values(item, item.extents),
        confidence=_named_values(item, item.confidence),
        truncated=names_of(item, item.truncated.tolist()),
        used=used,
        scale=own_scale,
        weight=weight,
        verdict=outcome,
        reason=reason,
        score=item.score,
        notes=(*item.notes, *match.notes),
        views=item.views,
        tier=match.prior.tier if match.prior is not None else None,
    )


def _named_values(item: MeasuredObject, values: FloatArray) -> dict[str, float]:
    """Return the finite values among (3,), by the names of the extents."""
    return {
        name: float(value) for name, value in zip(dimension_names(item), values, strict=True) if math.isfinite(value)
    }
