"""Estimate the scale from measured objects and other evidence (`scale_of_objects`).

The posterior weighs all evidence. Its status is overruled by known lengths that contradict the objects
(`known_length_conflict`) and, without other evidence, by objects of a single category that do not have its sizes
(`single_category_reason`) and by objects with scales far from the result (`disagreement`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from estimator.posterior.object_likelihood import ObjectEvidence
from estimator.posterior.posterior import MIN_JUDGED_OBJECTS, Posterior, object_curves, posterior
from estimator.records.objects import MeasuredObject
from estimator.records.options import EstimateOptions
from estimator.records.result import (
    Alternative,
    EvidenceReport,
    Mode,
    ResultContext,
    ScaleEvidence,
    ScaleResult,
    Verdict,
)
from estimator.results.advice import suggest_measurements
from estimator.results.object_priors import (
    EvidenceSet,
    object_evidence,
    resolve_categories,
    truncate_hidden_heights,
)
from estimator.results.scale_report import build_result, verdict
from metric_base.progress import stopwatch
from metric_tree.tree import Tree

#: Minimum summed weight of the objects with a known length, relative to their weight without it. Below it, most
#: objects would have to be outliers, so that the known length contradicts them.
MIN_KEPT_WEIGHT = 0.5
#: Minimum probability, by the objects, of a scale at least as extreme as a known length; below it, the
#: known length contradicts the objects.
MIN_TAIL_MASS = 1e-4
#: Minimum fraction of outliers among objects of a single category, and their minimum number, for labels that must be
#: wrong. In synthetic rooms with the category "person" for all masks the fraction is 0.31 to 1; among objects of one
#: category with right labels it is at most 0.2.
MIN_WRONG_LABEL_FRACTION = 0.3
MIN_WRONG_LABELS = 2
#: Probability of being right below which evidence is an outlier.
MIN_EVIDENCE_WEIGHT = 0.5
#: Maximum ratio of the scale by an object alone to the result, for an object that agrees with it.
MAX_OWN_RATIO = 1.6
#: Maximum fraction of objects beyond this ratio of a resolved scale: at most 0.25 in synthetic rooms (seeds 40 to 55)
#: and 0.32 in real scenes; 0.43 or more in most rooms with exchanged categories and a wrong scale.
MAX_DISTANT_FRACTION = 0.4
#: Minimum ratio between the scales of toys or models and of objects at full size: models at 1:4 are found in spite of
#: errors. In undamaged synthetic scenes (seeds 40 to 55), three objects of a street agree with a ratio of 2.5, and none
#: with 3.
MIN_MODEL_RATIO = 3.0
#: Maximum ratio of the scales of models that agree with each other: twice their standard deviation in synthetic rooms.
MAX_AGREEING_RATIO = 2.5
#: Minimum number of objects that agree on another scale, and their minimum fraction of all objects. Undamaged scenes,
#: synthetic (seeds 40 to 55) and real, have fewer.
MIN_AGREEING_OBJECTS = 2
MIN_AGREEING_FRACTION = 0.15
#: Factors between units that are mistaken for each other.
UNIT_FACTORS = {
    2.54: "inches and centimetres",
    3.2808: "feet and metres",
    10.0: "millimetres and centimetres",
    12.0: "inches and feet",
    25.4: "millimetres and inches",
    39.37: "inches and metres",
    100.0: "centimetres and metres",
    1000.0: "millimetres and metres",
}
#: Maximum deviation of the log of a factor from that of units: about the half width of the interval of a few objects.
MAX_UNIT_DEVIATION = 0.2
#: Maximum number of objects with a curve for the figure, which shows 45; the curves of 50,000 take 2 GB.
MAX_CURVES = 1000
#: Dimensions of `--method height`.
HEIGHT = ("height",)


class LengthConflict(NamedTuple):
    """A contradiction between known lengths and objects."""

    low: float  #: Interval of the scale by the objects, in metres per unit.
    high: float
    message: str
    is_decisive: bool  #: The scale is unresolved.


def scale_of_objects(
    objects: Sequence[MeasuredObject],
    tree: Tree,
    options: EstimateOptions | None = None,
    context: ResultContext | None = None,
) -> ScaleResult:
    """Estimate the scale from measured objects by the posterior (methods `default` and `height`).

    Parameters
    ----------
    objects : sequence of MeasuredObject
        Objects in scene units.
    tree : Tree
        Release with the priors of their categories.
    options : EstimateOptions, optional
        Method, level, other evidence, and whether to leave out each class in turn.
    context : ResultContext, optional
        Vertical, problems, digests and durations of the scene, which the result repeats.

    Returns
    -------
    ScaleResult
        The scale in metres per scene unit.

    Examples
    --------
    >>> import metric_tree, numpy as np
    >>> from estimator import MeasuredObject, scale_of_objects
    >>> sizes, sigma = np.array([1.8, 0.9, 0.75]), np.full(3, 0.03)
    >>> desk = MeasuredObject("1", "desk", sizes / 2, sigma)
    >>> lamp = MeasuredObject("2", "chair", np.array([0.5, 0.5, 0.9]) / 2, sigma)
    >>> result = scale_of_objects([desk, lamp], metric_tree.open())
    >>> 1.6 < result.modes[0].scale < 2.4
    True
    """
    options, context = options or EstimateOptions(), context or ResultContext()
    dims = HEIGHT if options.method == "height" else None
    matches = resolve_categories(tree, {item.category for item in objects}, dims, options.where)
    objects = truncate_hidden_heights(objects, matches)
    seconds = dict(context.seconds)
    with stopwatch(seconds, "posterior"):
        evidence = object_evidence(objects, matches, options.evidence)
        has_evidence = bool(evidence.objects) or len(evidence.gaussians) > 0
        estimate = posterior(evidence.objects, evidence.gaussians, options.level) if has_evidence else None
        conflict = None if estimate is None else known_length_conflict(estimate, evidence.objects, options)
        status, reason = ("unresolved", None) if estimate is None else (estimate.status, estimate.reason)
        if conflict is not None and conflict.is_decisive:
            status, reason = "unresolved", None
        elif estimate is not None and not len(evidence.gaussians):
            single = single_category_reason(estimate, evidence.objects)
            status, reason = (status, reason) if single is None else ("unresolved", single)
            modes, doubt = disagreement(estimate)
            if status != "unresolved" and doubt is not None:
                status, reason = "uncertain", doubt if reason is None else reason
            estimate = replace(estimate, modes=modes)
    reports = _evidence_reports(options.evidence, estimate, conflict)
    # Categories whose priors do not depend on region or year.
    plain = sorted(name for name, match in matches.items() if match.prior is not None and not match.prior.contexts)
    no_context = f"where: {options.where}: no sizes by region or year; plain priors are used for: {', '.join(plain)}"
    has_contexts = any(match.prior is not None and match.prior.contexts for match in matches.values())
    places = {item.place for item in options.evidence if item.place is not None and options.where is None}
    notes = [
        *([no_context] if options.where is not None and plain else []),
        *(
            f"where: the positions of the cameras are in {place}: --where {place} applies its sizes"
            for place in sorted(places)
            if has_contexts
        ),
        *(
            f"{row.kind} {row.id}: {'contradicts the rest' if row.verdict == 'outlier' else 'skipped'}: {row.reason}"
            for row in reports
            if row.verdict != "used"
        ),
        *([] if conflict is None else [conflict.message]),
    ]
    is_open = status != "resolved" and conflict is None and (objects or options.evidence)
    advice = suggest_measurements(evidence, tree, estimate, options.level) if is_open else ()
    without_support, without_each, curves = None, None, {}
    if estimate is not None and evidence.objects:
        without_support = _without_support(evidence, options)
        without_each = _without_each_class(estimate, evidence) if options.leave_one_class_out else None
        drawn = estimate.components.of(np.arange(min(len(evidence.objects), MAX_CURVES)))
        rows = object_curves(drawn, estimate.curve.log_scale)
        curves = {objects[index].id: row for index, row in zip(evidence.indices, rows, strict=False)}
    return build_result(
        evidence,
        estimate,
        tree,
        options,
        context,
        status=status,
        reason=reason,
        notes=notes,
        reports=reports,
        would_help=advice,
        without_support=without_support,
        leave_one_class_out=without_each,
        object_curves=curves,
        seconds=seconds,
    )


def known_length_conflict(
    estimate: Posterior, evidence: Sequence[ObjectEvidence], options: EstimateOptions
) -> LengthConflict | None:
    """Compare known lengths, which are certain evidence (doubt 0), with the objects.

    Parameters
    ----------
    estimate : Posterior
        Posterior of all evidence.
    evidence : sequence of ObjectEvidence
    options : EstimateOptions
        The other evidence, and whether known lengths are trusted.

    Returns
    -------
    LengthConflict or None
        None if a known length is inside the interval by the objects. The conflict is decisive, unless known
        lengths are trusted, if the objects lose most of their weight or leave the length a probability below
        `MIN_TAIL_MASS`.
    """
    certain = [item.scale for item in options.evidence if item.doubt == 0 and item.scale is not None]
    if not evidence or not certain:
        return None
    alone = posterior(evidence, level=estimate.level)
    low, high = alone.interval
    if all(low <= scale <= high for scale in certain):
        return None
    kept = float(estimate.weight.sum()) / max(float(alone.weight.sum()), 1e-9)
    # Smallest probability, by the objects, of a scale at least as extreme as a known one, on its side.
    curve = alone.curve
    mass = curve.density / curve.density.sum() * (1 - curve.below - curve.above)
    below = [curve.below + float(mass[curve.log_scale <= math.log(scale)].sum()) for scale in certain]
    tail = min(min(value, 1 - value + 1e-12) for value in below)

    trusted = options.trust_known_length
    scales = f"{estimate.modes[0].scale:.4g} m per unit, {low:.4g} to {high:.4g} by the objects"
    centre = math.sqrt(low * high)
    farthest = max(certain, key=lambda scale: abs(math.log(scale / centre)))
    check = f"check the points, the metres and the labels{unit_error(farthest / centre)}"
    if kept >= MIN_KEPT_WEIGHT and tail >= MIN_TAIL_MASS:
        message = f"the known lengths are outside the objects' own interval: {scales}; {check}"
        return LengthConflict(low, high, message, is_decisive=False)
    outliers = sum(verdict(float(weight)) == "outlier" for weight in estimate.weight)
    finding = f"{outliers} of {len(evidence)} objects would be outliers"
    if kept >= MIN_KEPT_WEIGHT:
        finding = f"their probability by the objects is less than {MIN_TAIL_MASS:g}"
    message = f"the known lengths contradict the objects: {scales}, and {finding}; {check}"
    if trusted:
        return LengthConflict(low, high, message, is_decisive=False)
    return LengthConflict(low, high, f"unresolved: {message} (--trust-known-length overrides)", is_decisive=True)


def unit_error(ratio: float) -> str:
    """Return the likely unit error of a value that is `ratio` times the one expected, as words, or an empty text."""
    log_ratio = abs(math.log(ratio))
    factor = min(UNIT_FACTORS, key=lambda factor: abs(log_ratio - math.log(factor)))
    if abs(log_ratio - math.log(factor)) > MAX_UNIT_DEVIATION:
        return ""
    size = "large" if ratio > 1 else "small"
    return f"; it is about {factor:.3g} times too {size}: a unit error ({UNIT_FACTORS[factor]})?"


def single_category_reason(estimate: Posterior, evidence: Sequence[ObjectEvidence]) -> str | None:
    """Return the reason why objects of a single category state no scale, or None if they do.

    If all objects have one category, no other category can show that their labels are wrong, and a few objects of any
    sizes agree by chance. Outliers among them are the only sign.
    """
    names = {item.object.category for item in evidence}
    outliers = sum(verdict(float(weight)) == "outlier" for weight in estimate.weight)
    if len(names) != 1 or outliers < max(MIN_WRONG_LABELS, MIN_WRONG_LABEL_FRACTION * len(evidence)):
        return None
    category = f"all have the category {next(iter(names))!r}"
    return f"{outliers} of {len(evidence)} objects are outliers, and {category}: their labels are wrong"


def disagreement(estimate: Posterior) -> tuple[tuple[Mode, ...], str | None]:
    """Return the modes, with the scale on which a group of objects agrees instead, and the reason for a doubt.

    Objects under exchanged labels have sizes that contradict each other. The objects of a model railway, or toys in a
    room, agree with each other, so that either group may be at the true size: both scales are stated.
    """
    best, n = estimate.modes[0].scale, len(estimate.own_scale)
    log_ratio = np.sort(np.log(estimate.own_scale / best))
    if n < MIN_JUDGED_OBJECTS:
        return estimate.modes, None
    models = log_ratio[np.abs(log_ratio) > math.log(MIN_MODEL_RATIO)]
    # Number of objects from each one up to `MAX_AGREEING_RATIO` above it.
    agreeing = np.searchsorted(models, models + math.log(MAX_AGREEING_RATIO), side="right") - np.arange(len(models))
    if len(models) and agreeing.max() >= max(MIN_AGREEING_OBJECTS, MIN_AGREEING_FRACTION * n):
        first, count = int(agreeing.argmax()), int(agreeing.max())
        second = Mode(best * math.exp(float(np.median(models[first : first + count]))), 0.0)
        reason = f"{count} of {n} objects agree on another scale, {second.scale:.4g} m per unit: toys or models?"
        is_stated = any(abs(math.log(mode.scale / second.scale)) < math.log(MAX_OWN_RATIO) for mode in estimate.modes)
        return estimate.modes if is_stated else (*estimate.modes, second), reason
    distant = int(np.count_nonzero(np.abs(log_ratio) > math.log(MAX_OWN_RATIO)))
    if distant <= MAX_DISTANT_FRACTION * n:
        return estimate.modes, None
    finding = f"{distant} of {n} objects have scales over {MAX_OWN_RATIO} times from the result"
    return estimate.modes, f"{finding}: their labels may be wrong"


def _evidence_reports(
    others: Sequence[ScaleEvidence], estimate: Posterior | None, conflict: LengthConflict | None
) -> tuple[EvidenceReport, ...]:
    """Return the report on each piece of evidence other than objects, in the given order."""
    reports = []
    weights = iter([] if estimate is None else estimate.evidence_weight.tolist())
    for item in others:
        if item.scale is None or estimate is None:
            reports.append(EvidenceReport(item.kind, item.id, None, None, 0.0, "skipped", item.reason))
            continue
        weight, reason = next(weights), None if len(estimate.weight) else item.assumption
        if item.doubt == 0 and conflict is not None and not conflict.low <= item.scale <= conflict.high:
            reason = f"the scale by the objects is {conflict.low:.4g} to {conflict.high:.4g}"
        outcome: Verdict = "used"
        if weight < MIN_EVIDENCE_WEIGHT:
            rest = estimate.modes[0].scale
            outcome, reason = "outlier", f"the scale by all other evidence is {rest:.4g}{unit_error(item.scale / rest)}"
        reports.append(EvidenceReport(item.kind, item.id, item.scale, item.sd_log, weight, outcome, reason))
    return tuple(reports)


def _without_support(evidence: EvidenceSet, options: EstimateOptions) -> Alternative | None:
    """Return the scale if objects were not extended down to their support planes; None if none was."""
    if all(item.unsupported_height is None for item in evidence.measured):
        return None
    bare = [
        item
        if item.unsupported_height is None
        else replace(item, extents=np.append(item.extents[:2], item.unsupported_height))
        for item in evidence.measured
    ]
    objects = object_evidence(bare, evidence.matches).objects
    estimate = posterior(objects, evidence.gaussians, options.level)
    return Alternative("without_support", estimate.modes[0].scale, *estimate.interval, len(objects))


def _without_each_class(estimate: Posterior, evidence: EvidenceSet) -> tuple[Alternative, ...]:
    """Return the scale without each class in turn, the class with the largest influence first."""
    if len(estimate.classes) + len(evidence.gaussians) < 2:
        return ()
    alternatives = []
    for node_id in estimate.classes:
        _, modes, (low, high) = estimate.without(node_id)
        count = sum(item.prior.node_id == node_id for item in evidence.objects)
        alternatives.append(Alternative(node_id, modes[0].scale, low, high, count))
    best = estimate.modes[0].scale
    return tuple(sorted(alternatives, key=lambda row: -abs(math.log(row.scale / best))))
