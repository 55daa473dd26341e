"""Compute the posterior of u = log scale from all evidence (paper 4.3), and its status: one mode or competing modes.

    log p(u | y) = log p(u) + sum over classes of log L_c(u) + other evidence      (docs/explanation/posterior.md)

A class with one object is a mixture of Gaussians in u; a class with several objects is integrated over their shared
error (`shared_error`). All terms are evaluated on one grid, whose range follows from the evidence.

The status of a posterior:

- `unresolved`: less than 35 % of the posterior mass is close to the highest mode (`MIN_PEAK_MASS`), a competing mode
  has at least 35 % (`MAX_COMPETING_MASS`), or more than 25 % is beyond one end of the scales for which objects have
  evidence (`MAX_EDGE_MASS`).
- `uncertain`: none of these, but the interval is wide, a mode competes with the highest one, or most objects are
  outliers.
- `resolved`: none of these.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.posterior import log_scale_grid as grid
from estimator.posterior.class_hypotheses import hypotheses
from estimator.posterior.class_likelihood import (
    ClassHypotheses,
    MultiObjectClasses,
    SingleObjectClasses,
    line_density,
    multi_object_classes,
    single_object_classes,
)
from estimator.posterior.object_likelihood import (
    MeasuredArrays,
    ObjectEvidence,
    has_open_vertical,
    hypothesis_rows,
    measurement_arrays,
    rows,
)
from estimator.posterior.shared_error import N_ROW_ARRAYS, ObjectComponents
from estimator.records.result import Curve, Mode, Status
from metric_base.arrays import FloatArray, IntArray

#: Maximum ratio of the ends of the interval of a resolved scale.
MAX_INTERVAL_RATIO = 1.8
#: Minimum ratio between the scales of the highest mode and of a competing one.
COMPETING_MODE_RATIO = 1.25
#: Minimum mass of a competing mode that makes a scale uncertain.
MIN_COMPETING_MASS = 0.1
#: Maximum mass of a competing mode; above it, the two modes contradict each other and the scale is unresolved.
MAX_COMPETING_MASS = 0.35
#: Ratio to the highest mode within which a scale is close to it.
PEAK_WIDTH_RATIO = 1.15
#: Minimum mass within this ratio; below it, a scale is unresolved. Chosen on simulated scenes and one half of the rooms
#: of ScanNet, so that 70 % of the refused scales are off by more than the ratio (docs/evidence/calibration.md).
MIN_PEAK_MASS = 0.35
#: Minimum mean probability of the objects not to be outliers. Below it, the objects contradict the model: the logarithm
#: of the posterior is multiplied by `TEMPERING_EXPONENT`, which widens it, and the scale is never resolved. Chosen on
#: the even rooms of ScanNet and half of the simulated scenes, so that the interval of such scenes covers 90 %, and 70 %
#: of the scales that lose the status `resolved` are off by more than `PEAK_WIDTH_RATIO` (docs/evidence/calibration.md).
MIN_MEAN_WEIGHT = 0.4
#: Minimum number of objects for this rule.
MIN_JUDGED_OBJECTS = 3
#: Exponent of the posterior if most objects are outliers.
TEMPERING_EXPONENT = 0.7
#: Maximum mass beyond one end of the grid, where no object has evidence and all objects are outliers.
MAX_EDGE_MASS = 0.25
#: Minimum standard deviation of other evidence: the reconstruction itself is not more accurate than 0.1 %.
MIN_EVIDENCE_LOG_SD = 1e-3
#: Maximum number of objects of a class that are integrated over; larger classes are subsampled evenly by size rank.
#: They have the weight of `EFFECTIVE_OBJECTS` in any case, and the limit bounds time and memory.
MAX_OBJECTS_PER_CLASS = 100
#: Minimum probability that other evidence is right. Above it, that evidence determines the scale, and the rule for
#: outliers (`MIN_MEAN_WEIGHT`) does not apply.
MIN_EVIDENCE_PROBABILITY = 0.5

#: Indices (k,) of objects of a scene, and the likelihood terms of their classes.
ClassTerms = tuple[IntArray, SingleObjectClasses | MultiObjectClasses]


def mostly_outliers(weight: FloatArray) -> bool:
    """Return True if most of several objects are outliers; `weight` (n,) is their probability not to be."""
    return len(weight) >= MIN_JUDGED_OBJECTS and float(weight.mean()) < MIN_MEAN_WEIGHT


def peak_mass(curve: Curve, scale: float) -> float:
    """Return the mass of a posterior within the ratio `PEAK_WIDTH_RATIO` of a scale in metres per unit."""
    is_close = np.abs(curve.log_scale - math.log(scale)) <= math.log(PEAK_WIDTH_RATIO)
    inside = 1 - curve.below - curve.above
    return float(inside * curve.density[is_close].sum() / curve.density.sum())


def status_reason(
    modes: Sequence[Mode], bounds: tuple[float, float], curve: Curve, weight: FloatArray | None = None
) -> tuple[Status, str | None]:
    """Return the status of a posterior, and the reason why it is not resolved.

    Parameters
    ----------
    modes : sequence of Mode
        The highest mode first.
    bounds : (low, high)
        Interval in metres per unit.
    curve : Curve
    weight : (n,) ndarray of float, optional
        Probability of each object not to be an outlier, if only the objects determine the scale.
    """
    best, ratio = modes[0].scale, bounds[1] / bounds[0]
    edge, peak = max(curve.below, curve.above), peak_mass(curve, best)
    is_competing = [max(mode.scale / best, best / mode.scale) > COMPETING_MODE_RATIO for mode in modes]
    competing = max((mode.mass for mode, competes in zip(modes, is_competing, strict=True) if competes), default=0.0)
    percent = f"{COMPETING_MODE_RATIO - 1:.0%}"
    n_outliers, n_objects = (0, 0) if weight is None else (int((weight < 0.5).sum()), len(weight))
    without_evidence = f"{edge:.0%} of the posterior is at scales without evidence of any object"
    concentration = f"{peak:.0%} of the posterior is within {PEAK_WIDTH_RATIO - 1:.0%} of its highest mode"
    contradiction = f"modes over {percent} apart contradict each other, one with mass {competing:.2g}"
    outliers = f"{n_outliers} of {n_objects} objects are outliers: their labels or masks may be wrong"
    lesser = f"modes over {percent} apart, the lesser with mass over {MIN_COMPETING_MASS}"
    problems: list[tuple[bool, Status, str]] = [
        (edge > MAX_EDGE_MASS, "unresolved", without_evidence),
        (peak < MIN_PEAK_MASS, "unresolved", f"only {concentration}"),
        (competing >= MAX_COMPETING_MASS, "unresolved", contradiction),
        (weight is not None and mostly_outliers(weight), "uncertain", outliers),
        (ratio > MAX_INTERVAL_RATIO, "uncertain", f"the interval's high/low is {ratio:.3g}, over {MAX_INTERVAL_RATIO}"),
        (competing >= MIN_COMPETING_MASS, "uncertain", lesser),
    ]
    return next(((status, message) for holds, status, message in problems if holds), ("resolved", None))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Estimate:
    """Scale estimated by any method from n objects."""

    curve: Curve
    #: The highest mode first.
    modes: tuple[Mode, ...]
    #: (low, high) in metres per unit.
    interval: tuple[float, float]
    status: Status
    #: Reason why the scale is not resolved.
    reason: str | None
    #: (n,) probability of each object not to be an outlier.
    weight: FloatArray
    #: (n,) highest peak of the likelihood of each object, in metres per unit.
    own_scale: FloatArray


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Posterior(Estimate):
    """Posterior of the scale, with the terms of each class."""

    #: Likelihood components of each object alone.
    components: ObjectComponents
    #: (c,) node ids.
    classes: tuple[str, ...]
    #: (g,) grid of log scale.
    coarse: FloatArray
    #: (c, g) log likelihood of each class.
    class_log_likelihood: FloatArray
    #: (k, 3) other evidence, as for `posterior`.
    gaussians: FloatArray
    #: (k,) probability that each item of other evidence is right.
    evidence_weight: FloatArray
    level: float

    def without(self, node_id: str) -> tuple[Curve, tuple[Mode, ...], tuple[float, float]]:
        """Return curve, modes and interval of the scene without the objects of one class."""
        keep = np.array([name != node_id for name in self.classes])
        curve = grid.curve(self.coarse, self.class_log_likelihood[keep].sum(axis=0), self.gaussians)
        return curve, grid.modes(curve), grid.interval(curve, self.level)

    def with_length(self, scale: float, sd_log: float) -> tuple[float, float]:
        """Return the interval with one more certain scale in metres per unit, with this standard deviation."""
        gaussians = np.vstack([self.gaussians, [math.log(scale), sd_log, 0.0]])
        total = self.class_log_likelihood.sum(axis=0)
        return grid.interval(grid.curve(self.coarse, total, gaussians), self.level)

    def with_class(self, evidence: Sequence[ObjectEvidence]) -> tuple[float, float]:
        """Return the interval with other objects of one class, instead of those of its node, on the same grid."""
        name = evidence[0].prior.node_id
        keep = np.array([other != name for other in self.classes], dtype=bool)
        objects = measurement_arrays(evidence, has_others=bool(keep.any()))
        log_likelihood, _ = _class_terms(objects, rows(objects), [name], self.coarse)
        total = self.class_log_likelihood[keep].sum(axis=0) + log_likelihood[0]
        curve = grid.curve(self.coarse, total, self.gaussians)
        if not (self.evidence_weight > MIN_EVIDENCE_PROBABILITY).any() and mostly_outliers(self.weight):
            curve = grid.tempered_posterior(curve, TEMPERING_EXPONENT)
        return grid.interval(curve, self.level)


def posterior(evidence: Sequence[ObjectEvidence], gaussians: FloatArray | None = None, level: float = 0.9) -> Posterior:
    """Compute the posterior of n objects and of other evidence.

    Parameters
    ----------
    evidence : sequence of ObjectEvidence
        Objects with their priors; may be empty if there is other evidence.
    gaussians : (k, 3) ndarray of float, optional
        Other evidence: mean and standard deviation of log(metres per unit), and the probability that it is wrong.
    level : float, default 0.9
        Probability of the equal-tailed interval.

    Raises
    ------
    ValueError
        There is neither an object nor other evidence.
    """
    gaussians = np.zeros((0, 3)) if gaussians is None else np.maximum(gaussians, [-np.inf, MIN_EVIDENCE_LOG_SD, 0.0])
    if not evidence and not len(gaussians):
        raise ValueError("posterior: expected an object or other evidence; found neither")
    names = sorted({item.prior.node_id for item in evidence})
    if evidence:
        objects = measurement_arrays(evidence)
        components = rows(objects)
        u = _grid(components, gaussians)
        log_likelihood, terms = _class_terms(objects, components, names, u)
    else:
        components = ObjectComponents.of_objects([np.zeros(0)] * N_ROW_ARRAYS, np.zeros(0, dtype=np.int64), np.zeros(0))
        u = _grid(components, gaussians)
        log_likelihood, terms = np.zeros((0, len(u))), []
    total = log_likelihood.sum(axis=0)
    curve = grid.curve(u, total, gaussians)

    # The probability of each object follows from the posterior mass on the coarse grid, on which a sharp Gaussian has
    # at least the width of a step. Beyond the grid, every object is an outlier.
    wide = np.column_stack([gaussians[:, 0], np.maximum(gaussians[:, 1], u[1] - u[0]), gaussians[:, 2]])
    log_mass = total + grid.log_evidence_density(u, wide).sum(axis=0)
    mass = np.exp(log_mass - log_mass.max())
    mass = mass / mass.sum()
    weight = np.zeros(len(evidence))
    for part, classes in terms:
        weight[part] = classes.weights(mass)
    weight = weight * (1 - curve.below - curve.above)

    # Log scale of the highest peak of the likelihood of each object.
    height, owner = components.line_log_peak, components.object
    peak = np.zeros(len(evidence))
    if len(height):
        highest = np.flatnonzero(height == np.maximum.reduceat(height, components.start)[owner])
        peak[owner[highest]] = components.line_centre[highest]

    evidence_weight = grid.evidence_probabilities(curve, gaussians)
    objects_decide = not (evidence_weight > MIN_EVIDENCE_PROBABILITY).any()
    if objects_decide and mostly_outliers(weight):
        curve = grid.tempered_posterior(curve, TEMPERING_EXPONENT)
    modes, bounds = grid.modes(curve), grid.interval(curve, level)
    status, reason = status_reason(modes, bounds, curve, weight if objects_decide else None)
    return Posterior(
        curve=curve,
        modes=modes,
        interval=bounds,
        status=status,
        reason=reason,
        weight=weight,
        own_scale=np.exp(peak),
        components=components,
        classes=tuple(names),
        coarse=u,
        class_log_likelihood=log_likelihood,
        gaussians=gaussians,
        evidence_weight=evidence_weight,
        level=level,
    )


def object_curves(components: ObjectComponents, log_scale: FloatArray) -> FloatArray:
    """Return the likelihood (n, g) of each single object, relative to the outlier density, for figures."""
    density = line_density(components, log_scale)
    return np.asarray(density + np.exp(components.log_floor)[:, None])


def _grid(components: ObjectComponents, gaussians: FloatArray) -> FloatArray:
    """Return a grid (g,) over the scales for which objects or other evidence (k, 3) have evidence."""
    centre, sd = gaussians[:, 0], np.maximum(gaussians[:, 1], grid.MIN_STEP)
    component_sd = np.sqrt(1 / components.line_precision)
    # A component ends at the point at which it is negligible compared with the outlier density of its object.
    log_ratio = components.line_log_peak - components.log_floor[components.object]
    reach = (
        np.minimum(np.sqrt(2 * np.maximum(log_ratio + math.log(1 / grid.MIN_OUTLIER_RATIO), 0.0)), grid.SUPPORT_SIGMAS)
        * component_sd
    )
    is_visible = reach > 0
    return grid.evidence_grid(
        np.concatenate([centre, components.line_centre[is_visible]]),
        np.concatenate([sd, component_sd[is_visible]]),
        np.concatenate([grid.SUPPORT_SIGMAS * sd, reach[is_visible]]),
    )


def _class_terms(
    objects: MeasuredArrays, components: ObjectComponents, names: Sequence[str], u: FloatArray
) -> tuple[FloatArray, list[ClassTerms]]:
    """Compute the likelihoods of all classes.

    Parameters
    ----------
    objects : MeasuredArrays
    components : ObjectComponents
        Likelihood components of each object alone.
    names : sequence of str
        Node ids of the c classes.
    u : (g,) ndarray of float
        Grid of log scale.

    Returns
    -------
    log_likelihood : (c, g) ndarray of float
    terms : list of ClassTerms
        Every object is in one of them.
    """
    n = len(objects.evidence)
    row_of = {name: row for row, name in enumerate(names)}
    group = np.array([row_of[item.prior.node_id] for item in objects.evidence])
    count = np.bincount(group)
    # All objects are integrated over, but classes over the limit are subsampled.
    integrated = np.arange(n)
    if count.max() > MAX_OBJECTS_PER_CLASS:
        size = objects.y.sum(axis=1)
        selected = []
        for row in range(len(count)):
            members = np.flatnonzero(group == row)
            by_size = members[np.argsort(size[members], kind="stable")]
            n_selected = min(MAX_OBJECTS_PER_CLASS, len(by_size))
            selected.append(by_size[np.unique(np.linspace(0, len(by_size) - 1, n_selected).astype(int))])
        integrated = np.sort(np.concatenate(selected))
    single = np.flatnonzero(count[group] == 1)
    several = integrated[count[group[integrated]] > 1]
    terms: list[ClassTerms] = []
    log_likelihood = np.zeros((len(names), len(u)))
    if len(single):
        single_classes = single_object_classes(components.of(single), u)
        terms.append((single, single_classes))
        log_likelihood[group[single]] = single_classes.log_likelihood
    if len(several):
        rows_of_classes, classes = _multi_object_terms(objects, several, group, count, u)
        terms.append((several, classes))
        log_likelihood[rows_of_classes] = classes.log_likelihood
    if len(integrated) < n:  # weights of the other objects of large classes, one by one
        others = np.setdiff1d(np.arange(n), integrated)
        terms.append((others, single_object_classes(components.of(others), u)))
    return log_likelihood, terms


def _multi_object_terms(
    objects: MeasuredArrays, selected: IntArray, group: IntArray, count: IntArray, u: FloatArray
) -> tuple[IntArray, MultiObjectClasses]:
    """Return the class rows (c,) of the objects `selected` (n,), and their terms; each class has several objects."""
    classes, first, class_of = np.unique(group[selected], return_index=True, return_inverse=True)
    is_open = np.zeros(len(classes), dtype=bool)
    for i, row in zip(selected.tolist(), class_of.tolist(), strict=True):
        is_open[row] |= has_open_vertical(objects.evidence[i])
    priors = [objects.evidence[i].prior for i in selected[first]]
    by_class = [hypotheses(prior, is_open_class) for prior, is_open_class in zip(priors, is_open.tolist(), strict=True)]
    size = np.array([len(of_class) for of_class in by_class])
    group_of_hypothesis = np.repeat(np.arange(len(classes)), size)
    first_hypothesis = np.cumsum(size) - size
    # Each object has one entry for each hypothesis of its class.
    n_entries = size[class_of]
    start = np.cumsum(n_entries) - n_entries
    entry = np.arange(n_entries.sum()) + np.repeat(first_hypothesis[class_of] - start, n_entries)
    all_hypotheses = [hypothesis for of_class in by_class for hypothesis in of_class]
    table = ClassHypotheses(all_hypotheses, group_of_hypothesis, count[classes][group_of_hypothesis], entry, start)
    components = hypothesis_rows(objects, selected, [by_class[row] for row in class_of])
    return classes, multi_object_classes(components, table, u)
