"""The scale from measured objects: names to priors, posterior, verdicts, one result.

What contradicts itself: known lengths and objects, or objects that all have one name. No scale is then better.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from estimator.posterior.object_likelihood import ObjectEvidence, usable
from estimator.posterior.posterior import Posterior, object_curves, posterior
from estimator.records.objects import MeasuredObject
from estimator.records.options import EstimateOptions
from estimator.records.result import Alternative, EvidenceReport, ScaleEvidence, ScaleResult, UpReport
from estimator.results.advice import helps
from estimator.results.object_priors import LabelMeaning, evidence_of, meanings, with_unseen_undersides
from estimator.results.scale_report import ScaleAnswer, names_of, result_of, verdict
from metric_base.arrays import FloatArray
from metric_tree.tree import Tree

#: Known lengths contradict the objects altogether when these keep less than this share of the weight (the summed
#: probability of being what their labels say) that they have among themselves: most of them are then disbelieved.
MIN_KEPT_WEIGHT = 0.5
#: They also do where the objects alone leave this little of their posterior at the length's scale or further out.
MIN_TAIL_MASS = 1e-4
#: Objects of one name contradict each other where this share of them are outliers, and so many. In synthetic rooms
#: whose masks are all called "person" it is .31 to 1; among the objects that do have one name, at most .2.
LEAST_ALIKE_OUTLIERS, MIN_ALIKE_OUTLIERS = 0.3, 2
#: The dimensions of `--method height`.
HEIGHT = ("height",)


@dataclass(frozen=True, slots=True)
class Contradiction:
    """Known lengths outside the interval of the objects alone.

    with_known : metres per unit of all evidence; low, high : the objects' own interval; outliers : how many of the
    `objects` are outliers at the first; kept : the share of their weight that is left; chance : what the objects
    alone leave of their posterior at the length's scale or further out.
    """

    with_known: float
    low: float
    high: float
    outliers: int
    objects: int
    kept: float
    chance: float

    @property
    def most(self) -> bool:
        """Whether most objects, or all a little, would have to be wrong: unresolved unless the length is trusted."""
        return self.kept < MIN_KEPT_WEIGHT or self.chance < MIN_TAIL_MASS

    def line(self, trusted: bool) -> str:
        """The warning; `trusted` : the length is believed all the same."""
        scales = f"{self.with_known:.4g} m per unit, {self.low:.4g} to {self.high:.4g} by the objects alone"
        check = "check the points, the metres and the labels"
        if not self.most:
            return f"the known lengths are outside the objects' own interval: {scales}; {check}"
        count = f"{self.outliers} of {self.objects} objects would be outliers"
        if self.kept >= MIN_KEPT_WEIGHT:
            count = f"the objects leave it a chance of less than {MIN_TAIL_MASS:g}"
        start = "" if trusted else "unresolved: "
        override = "" if trusted else " (--trust-known-length overrides)"
        return f"{start}the known lengths contradict the objects: {scales}, and {count}; {check}{override}"


def contradiction_of(
    estimate: Posterior, evidence: Sequence[ObjectEvidence], lines: Sequence[ScaleEvidence]
) -> Contradiction | None:
    """How certain lines (without doubt) contradict the n objects of the posterior; None where they do not."""
    certain = [item.scale for item in lines if item.doubt == 0 and item.scale is not None]
    if not evidence or not certain:
        return None
    alone = posterior(evidence, level=estimate.level)
    low, high = alone.interval
    if all(low <= scale <= high for scale in certain):
        return None
    kept = float(estimate.weight.sum()) / max(float(alone.weight.sum()), 1e-9)
    outliers = sum(verdict(float(weight)) == "outlier" for weight in estimate.weight)
    chance = min(_tail(alone, math.log(scale)) for scale in certain)
    return Contradiction(estimate.modes[0].scale, low, high, outliers, len(evidence), kept, chance)


def doubt_of_one_name(estimate: Posterior, evidence: Sequence[ObjectEvidence]) -> str | None:
    """Why no scale follows where all objects have one name and many do not have its sizes; None where they do.

    A few of any sizes agree by chance, and no other name says that they are not what they are called.
    """
    names = {item.object.category for item in evidence}
    outliers = sum(verdict(float(weight)) == "outlier" for weight in estimate.weight)
    if len(names) != 1 or outliers < max(MIN_ALIKE_OUTLIERS, LEAST_ALIKE_OUTLIERS * len(evidence)):
        return None
    name = next(iter(names))
    return f"{outliers} of {len(evidence)} objects are outliers, and all are called {name!r}: their labels are wrong"


def _tail(alone: Posterior, u: float) -> float:
    """The mass of a posterior at log scale u and beyond, on the side of u that is further out."""
    curve = alone.curve
    mass = curve.density / curve.density.sum() * (1 - curve.below - curve.above)
    below = curve.below + float(mass[curve.log_scale <= u].sum())
    return min(below, 1 - below + 1e-12)


def scale_of_objects(
    objects: Sequence[MeasuredObject],
    tree: Tree,
    options: EstimateOptions | None = None,
    up: UpReport | None = None,
    warnings: Sequence[str] = (),
    seconds: Mapping[str, float] | None = None,
) -> ScaleResult:
    """The scale by our posterior (methods `default` and `height`), in metres per scene unit.

    Parameters
    ----------
    objects : measured objects in scene units
    tree : where their categories' priors are
    options : method, level, evidence beside the objects, and whether to leave each class out in turn
    up, warnings, seconds : what the geometry found, handed on

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
    options = options or EstimateOptions()
    dims = HEIGHT if options.method == "height" else None
    by_name = meanings(tree, {item.category for item in objects}, dims, options.where)
    objects = with_unseen_undersides(objects, by_name)
    started = time.perf_counter()
    stated, reasons = evidence_of(objects, by_name)
    evidence, places = list(stated.values()), list(stated)
    lines = [item for item in options.evidence if item.scale is not None]
    estimate = posterior(evidence, _table(lines), options.level) if evidence or lines else None
    clash = contradiction_of(estimate, evidence, lines) if estimate is not None else None
    if estimate is not None and clash is not None and clash.most and not options.trust_known_length:
        estimate = replace(estimate, status="unresolved", doubt=None)
    if estimate is not None and not lines:
        doubt = doubt_of_one_name(estimate, evidence)
        estimate = estimate if doubt is None else replace(estimate, status="unresolved", doubt=doubt)
    elapsed = {**(seconds or {}), "posterior": time.perf_counter() - started}
    rows = _evidence_rows(options, estimate, lines, clash)
    answer = ScaleAnswer(estimate, places, _used_dimensions(evidence), reasons, rows)
    warnings = (*warnings, *_context_warnings(by_name, options))
    all_warnings = (
        *warnings,
        *_evidence_warnings(rows),
        *([] if clash is None else [clash.line(options.trust_known_length)]),
    )
    result = result_of(objects, tree, by_name, answer, options, up, all_warnings, elapsed)
    if result.status != "resolved" and (objects or options.evidence) and clash is None:
        advice = helps(objects, stated, by_name, tree, _table(lines), estimate, options.level)
        result = replace(result, would_help=advice)
    if estimate is None or not places:
        return result
    curves = object_curves(evidence, estimate.curve.log_scale)
    return replace(
        result,
        without_support=_without_support(objects, by_name, _table(lines), options.level),
        leave_one_class_out=_without_each_class(estimate, evidence) if options.leave_one_class_out else None,
        object_curves={objects[place].id: row for place, row in zip(places, curves, strict=True)},
    )


def _context_warnings(by_name: Mapping[str, LabelMeaning], options: EstimateOptions) -> list[str]:
    """A line for classes of which the release does not know how they differ by region or year."""
    if options.where is None:
        return []
    plain = sorted(name for name, one in by_name.items() if one.prior is not None and not one.prior.contexts)
    names = ", ".join(plain)
    return [f"where: {options.where}: no size by region or year, so that plain priors hold: {names}"] if plain else []


def _table(lines: Sequence[ScaleEvidence]) -> FloatArray:
    """(k, 3) mean and standard deviation of log scale, and doubt, of evidence that speaks."""
    rows = [(math.log(item.scale or 1.0), item.sd_log, item.doubt) for item in lines]
    return np.array(rows, dtype=float).reshape(-1, 3)


def _evidence_rows(
    options: EstimateOptions, estimate: Posterior | None, lines: Sequence[ScaleEvidence], clash: Contradiction | None
) -> tuple[EvidenceReport, ...]:
    """The rows of all evidence, in the order given."""
    weights = dict(zip(map(id, lines), [] if estimate is None else estimate.line_weight.tolist(), strict=True))
    return tuple(_evidence_row(item, weights.get(id(item), 0.0), estimate, clash) for item in options.evidence)


def _evidence_row(
    item: ScaleEvidence, weight: float, estimate: Posterior | None, clash: Contradiction | None
) -> EvidenceReport:
    if item.scale is None or estimate is None:
        return EvidenceReport(item.kind, item.id, None, None, 0.0, "skipped", item.reason)
    reason = None
    if item.doubt == 0 and clash is not None and not clash.low <= item.scale <= clash.high:
        reason = f"the objects alone say {clash.low:.4g} to {clash.high:.4g}"
    wrong = weight < 0.5
    if wrong:
        reason = f"all else says {estimate.modes[0].scale:.4g}"
    return EvidenceReport(item.kind, item.id, item.scale, item.sd_log, weight, "outlier" if wrong else "used", reason)


def _evidence_warnings(rows: Sequence[EvidenceReport]) -> list[str]:
    """A line for evidence that was asked for and does not count."""
    return [
        f"{row.kind} {row.id}: {'contradicts the rest' if row.verdict == 'outlier' else 'skipped'}: {row.reason}"
        for row in rows
        if row.verdict != "used"
    ]


def _used_dimensions(evidence: Sequence[ObjectEvidence]) -> list[tuple[str, ...]]:
    """The dimensions of each object that count in full: there, known to the prior, not cut."""
    return [
        names_of(item.object, there & ~np.asarray(item.object.truncated, dtype=bool))
        for item, there in zip(evidence, usable(evidence), strict=True)
    ]


def _without_support(
    objects: Sequence[MeasuredObject], by_name: Mapping[str, LabelMeaning], lines: FloatArray, level: float
) -> Alternative | None:
    """The scale if no object reached down to the plane it stands on; None where none does.

    lines : (k, 3) mean and standard deviation of log scale, and doubt, of other evidence; scale in metres per unit.
    """
    if all(item.unsupported_height is None for item in objects):
        return None
    bare = [
        item
        if item.unsupported_height is None
        else replace(item, extents=np.append(item.extents[:2], item.unsupported_height))
        for item in objects
    ]
    evidence, _ = evidence_of(bare, by_name)
    estimate = posterior(list(evidence.values()), lines, level)
    return Alternative("without_support", estimate.modes[0].scale, *estimate.interval, len(evidence))


def _without_each_class(estimate: Posterior, evidence: Sequence[ObjectEvidence]) -> tuple[Alternative, ...]:
    """The scale without each class in turn, the most influential first."""
    if len(estimate.classes) + len(estimate.lines) < 2:
        return ()
    rows = []
    for node_id in estimate.classes:
        _, modes, (low, high) = estimate.without(node_id)
        count = sum(item.prior.node_id == node_id for item in evidence)
        rows.append(Alternative(node_id, modes[0].scale, low, high, count))
    best = estimate.modes[0].scale
    return tuple(sorted(rows, key=lambda row: -abs(math.log(row.scale / best))))
