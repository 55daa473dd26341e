"""The posterior over u = log scale of all objects together (paper 4.3, in log space; docs/explanation/posterior.md).

    log p(u | y) = log p(u) + sum over classes of log L_c(u) + other evidence

A class of one object is a mixture of Gaussians in u; a class of several is integrated over its shared error
(`class_error`). Everything is evaluated on one grid that the evidence places.

What a posterior allows one to say: a scale, a scale with a warning, or none.

`resolved`: the interval is narrow and no other mode competes. `uncertain`: it is wide, modes compete, or most objects
are outliers, yet the highest mode is more likely near the truth than not. `unresolved`: the posterior itself gives the
neighbourhood of its highest mode little of its mass, or most of it lies where no object says anything.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from estimator.posterior import log_scale_grid as grid
from estimator.posterior.class_hypotheses import hypotheses
from estimator.posterior.class_likelihood import JointTerms, LoneTerms, Ways, joint_classes, line_density, lone_classes
from estimator.posterior.object_likelihood import (
    Measured,
    ObjectEvidence,
    has_readings,
    hypothesis_rows,
    measurement_arrays,
    rows,
)
from estimator.posterior.shared_error import DimensionRows
from estimator.records.result import Curve, Mode, Status
from metric_base.arrays import FloatArray, IntArray
from metric_tree.prior import Prior

#: Uncertain when the interval's high/low exceeds this, ...
RATIO_LIMIT = 1.8
#: ... or a mode further away than this ratio has at least this mass.
FAR_MODE, FAR_MASS = 1.25, 0.1
#: Unresolved when such a mode has this mass: two answers contradict each other.
CONTRADICTING_MASS = 0.35
#: Unresolved when less than this mass is within this ratio of the highest mode. Chosen on simulated scenes and one half
#: of the rooms of ScanNet so that seven of ten refused scales are off by more than that ratio
#: (docs/evidence/results.md).
NEAR, LEAST_NEAR_MASS = 1.15, 0.35
#: Three objects or more that are what their labels say with less probability than this, on average, contradict the
#: model: the logarithm of the posterior is then multiplied by `CONTRADICTED_POWER`, which widens it, and the scale is
#: uncertain at best. Chosen on the even rooms of ScanNet and half of simulated scenes, so that the interval of such
#: scenes covers 90 % and seven of ten that become unresolved are off by more than `NEAR` (docs/evidence/results.md).
LEAST_MEAN_WEIGHT, LEAST_JUDGED_OBJECTS, CONTRADICTED_POWER = 0.4, 3, 0.7
#: Unresolved when more of the posterior than this is beyond one end of where the objects speak: all may be outliers.
EDGE_MASS = 0.25
#: No evidence can be better than the reconstruction: 0.1 % at least.
LEAST_LINE_SD = 1e-3
#: Of a class with more objects this many, evenly spaced by size, are integrated over: they count as
#: `EFFECTIVE_OBJECTS` anyhow, and time and memory stay linear in the number of classes.
MOST_OBJECTS = 100
#: Other evidence that is right with more probability than this carries the scale, whatever the objects say.
MIN_BELIEVED = 0.5


def contradicts(weight: FloatArray) -> bool:
    """Whether most of several objects are outliers; weight : (n,) probability that each is what its label says."""
    return len(weight) >= LEAST_JUDGED_OBJECTS and float(weight.mean()) < LEAST_MEAN_WEIGHT


def near_mass(curve: Curve, scale: float) -> float:
    """The mass of a posterior within the ratio `NEAR` of a scale, in metres per unit."""
    near = np.abs(curve.log_scale - math.log(scale)) <= math.log(NEAR)
    inside = 1 - curve.below - curve.above
    return float(inside * curve.density[near].sum() / curve.density.sum())


def status_of(
    modes: Sequence[Mode], bounds: tuple[float, float], curve: Curve, weight: FloatArray | None = None
) -> Status:
    """The status of a posterior by its modes, highest first, interval, curve and `weight` (n,), as `doubt_of`."""
    doubt = doubt_of(modes, bounds, curve, weight)
    return "resolved" if doubt is None else doubt[0]


def doubt_of(
    modes: Sequence[Mode], bounds: tuple[float, float], curve: Curve, weight: FloatArray | None = None
) -> tuple[Status, str] | None:
    """The status and its reason in words where the scale is not resolved.

    weight : (n,) probability of each object that it is what its label says, where the objects alone carry the scale
    """
    return next(_doubts(modes, bounds, curve, weight), None)


def _doubts(
    modes: Sequence[Mode], bounds: tuple[float, float], curve: Curve, weight: FloatArray | None
) -> Iterator[tuple[Status, str]]:
    """What stands against a resolved scale, the worst first; weight : (n,) as `doubt_of` takes it."""
    best, (low, high) = modes[0].scale, bounds
    edge, near = max(curve.below, curve.above), near_mass(curve, best)
    if edge > EDGE_MASS:
        yield "unresolved", f"{edge:.0%} of the posterior is at scales of which no object says anything"
    if near < LEAST_NEAR_MASS:
        yield "unresolved", f"only {near:.0%} of the posterior is within {NEAR - 1:.0%} of its highest mode"
    far = max((mode.mass for mode in modes[1:] if max(mode.scale / best, best / mode.scale) > FAR_MODE), default=0.0)
    if far >= CONTRADICTING_MASS:
        yield "unresolved", f"modes over {FAR_MODE - 1:.0%} apart contradict each other, one with mass {far:.2g}"
    if weight is not None and contradicts(weight):
        outliers = int((weight < 0.5).sum())
        yield "uncertain", f"{outliers} of {len(weight)} objects are outliers: their labels or masks may be wrong"
    if high / low > RATIO_LIMIT:
        yield "uncertain", f"the interval's high/low is {high / low:.3g}, over {RATIO_LIMIT}"
    if far >= FAR_MASS:
        yield "uncertain", f"modes over {FAR_MODE - 1:.0%} apart, the lesser with mass over {FAR_MASS}"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Estimate:
    """What any method finds over log scale, for n objects.

    modes : highest first; interval : (low, high) metres per unit; weight : (n,) probability that each object is not
    an outlier; own_scale : (n,) metres per unit, each object's own highest peak; doubt : why it is not resolved.
    """

    curve: Curve
    modes: tuple[Mode, ...]
    interval: tuple[float, float]
    status: Status
    doubt: str | None
    weight: FloatArray
    own_scale: FloatArray


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Posterior(Estimate):
    """Our estimate, with what leaving a class out needs.

    classes : node ids of the rows of `class_log_likelihood` (c, g) on the grid `coarse` (g,); lines : the other
    evidence (k, 3), line_weight : (k,) the probability that each is right.
    """

    classes: tuple[str, ...]
    coarse: FloatArray
    class_log_likelihood: FloatArray
    lines: FloatArray
    line_weight: FloatArray
    level: float

    def without(self, node_id: str) -> tuple[Curve, tuple[Mode, ...], tuple[float, float]]:
        """The curve, modes and interval as if the class `node_id` had no object in the scene."""
        keep = np.array([name != node_id for name in self.classes])
        left = grid.curve(self.coarse, self.class_log_likelihood[keep].sum(axis=0), self.lines)
        return left, grid.modes(left), grid.interval(left, self.level)


def posterior(evidence: Sequence[ObjectEvidence], lines: FloatArray | None = None, level: float = 0.9) -> Posterior:
    """The posterior of n objects and of other evidence.

    Parameters
    ----------
    evidence : n objects with their priors; n may be 0 if there is other evidence
    lines : (k, 3) mean and standard deviation in log(metres per unit), and doubt, of other evidence: the probability
        that it is wrong altogether
    level : mass of the equal-tailed interval

    Raises
    ------
    ValueError
        There is neither an object nor other evidence.
    """
    lines = np.zeros((0, 3)) if lines is None else np.maximum(lines, [-np.inf, LEAST_LINE_SD, 0.0])
    if not evidence and not len(lines):
        raise ValueError("posterior: expected an object or other evidence; found neither")
    classes = _classes(evidence, lines) if evidence else _no_classes(lines)
    total = classes.log_likelihood.sum(axis=0)
    answer = grid.curve(classes.grid, total, lines)
    # beyond the grid every object is an outlier
    weight = _weights(classes, _mass(classes.grid, total, lines), len(evidence)) * (1 - answer.below - answer.above)
    line_weight = grid.line_weights(answer, lines)
    alone = not (line_weight > MIN_BELIEVED).any()
    if alone and contradicts(weight):
        answer = grid.tempered_posterior(answer, CONTRADICTED_POWER)
    modes, bounds = grid.modes(answer), grid.interval(answer, level)
    doubt = doubt_of(modes, bounds, answer, weight if alone else None)
    return Posterior(
        curve=answer,
        modes=modes,
        interval=bounds,
        status="resolved" if doubt is None else doubt[0],
        doubt=None if doubt is None else doubt[1],
        weight=weight,
        own_scale=np.exp(_own_centres(classes.base)),
        classes=classes.names,
        coarse=classes.grid,
        class_log_likelihood=classes.log_likelihood,
        lines=lines,
        line_weight=line_weight,
        level=level,
    )


def object_curves(evidence: Sequence[ObjectEvidence], log_scale: FloatArray) -> FloatArray:
    """Each object's own likelihood over log scale relative to the outlier's, (n, g); for figures."""
    components = rows(measurement_arrays(evidence))
    density = line_density(components, log_scale)
    return np.asarray(density + np.exp(components.log_floor)[:, None])


@dataclass(frozen=True, slots=True, eq=False)
class _Classes:
    """The classes of a scene on one grid: log_likelihood (c, g), grid (g,); terms : objects' places and their terms.

    base : the objects one by one.
    """

    names: tuple[str, ...]
    grid: FloatArray
    log_likelihood: FloatArray
    terms: tuple[tuple[IntArray, LoneTerms | JointTerms], ...]
    base: DimensionRows


def _classes(evidence: Sequence[ObjectEvidence], lines: FloatArray) -> _Classes:
    """The classes of the objects on one grid; `lines` (k, 3) is the other evidence, as `posterior` takes it."""
    objects = measurement_arrays(evidence)
    base = rows(objects)
    u = _grid(base, lines)
    names = sorted({item.prior.node_id for item in evidence})
    place = {name: number for number, name in enumerate(names)}
    group = np.array([place[item.prior.node_id] for item in evidence])
    count = np.bincount(group)
    lone = np.flatnonzero(count[group] == 1)
    speaking = _speaking(objects, group, count)
    joint = speaking[count[group[speaking]] > 1]
    terms: list[tuple[IntArray, LoneTerms | JointTerms]] = []
    log_likelihood = np.zeros((len(names), len(u)))
    if len(lone):
        terms.append((lone, lone_classes(base.of(lone), u)))
        log_likelihood[group[lone]] = terms[-1][1].log_likelihood
    if len(joint):
        classes, solved = _joint(objects, joint, group, count, u)
        terms.append((joint, solved))
        log_likelihood[classes] = solved.log_likelihood
    if len(speaking) < len(evidence):  # of a large class only some speak; the others are judged one by one
        quiet = np.setdiff1d(np.arange(len(evidence)), speaking)
        terms.append((quiet, lone_classes(base.of(quiet), u)))
    return _Classes(tuple(names), u, log_likelihood, tuple(terms), base)


def _grid(base: DimensionRows, lines: FloatArray) -> FloatArray:
    """(g,) the common grid: where objects and other evidence, `lines` (k, 3), speak."""
    centre, sd = lines[:, 0], np.maximum(lines[:, 1], grid.FINEST_STEP)
    spread = np.sqrt(1 / base.line_precision)
    over = base.line_log_peak - base.log_floor[base.object]  # ln of peak over the outlier's floor
    reach = (
        np.minimum(np.sqrt(2 * np.maximum(over + math.log(1 / grid.MIN_SHARE_OF_OUTLIER), 0.0)), grid.SUPPORT_SD)
        * spread
    )
    seen = reach > 0
    return grid.evidence_grid(
        np.concatenate([centre, base.line_centre[seen]]),
        np.concatenate([sd, spread[seen]]),
        np.concatenate([grid.SUPPORT_SD * sd, reach[seen]]),
    )


def _speaking(objects: Measured, group: IntArray, count: IntArray) -> IntArray:
    """Places (k,) of the objects of a group (m,) that are integrated over: of very many, so many evenly by size."""
    if count.max() <= MOST_OBJECTS:
        return np.arange(len(group))
    size = objects.y.sum(axis=1)
    chosen = []
    for number in range(len(count)):
        of_class = np.flatnonzero(group == number)
        ordered = of_class[np.argsort(size[of_class], kind="stable")]
        chosen.append(ordered[np.unique(np.linspace(0, len(ordered) - 1, min(MOST_OBJECTS, len(ordered))).astype(int))])
    return np.sort(np.concatenate(chosen))


def _joint(
    objects: Measured, chosen: IntArray, group: IntArray, count: IntArray, u: FloatArray
) -> tuple[IntArray, JointTerms]:
    """The classes (c,) of the objects `chosen` (n,), each of several, and their terms."""
    classes, class_of = np.unique(group[chosen], return_inverse=True)
    free = np.zeros(len(classes), dtype=bool)
    priors: list[Prior] = [objects.evidence[i].prior for i in chosen[np.unique(class_of, return_index=True)[1]]]
    for i, number in zip(chosen.tolist(), class_of.tolist(), strict=True):
        free[number] |= has_readings(objects.evidence[i])
    by_class = [hypotheses(prior, is_free) for prior, is_free in zip(priors, free.tolist(), strict=True)]
    size = np.array([len(own) for own in by_class])
    group = np.repeat(np.arange(len(classes)), size)
    first_way = np.cumsum(size) - size
    entries = size[class_of]  # (n,) of each object
    start = np.cumsum(entries) - entries
    entry = np.arange(entries.sum()) + np.repeat(first_way[class_of] - start, entries)
    ways = Ways([way for own in by_class for way in own], group, count[classes][group], entry, start)
    components = hypothesis_rows(objects, chosen, [by_class[number] for number in class_of])
    return classes, joint_classes(components, ways, u)


def _no_classes(lines: FloatArray) -> _Classes:
    """The grid of other evidence alone, `lines` (k, 3)."""
    nothing, none = np.zeros(0), np.zeros(0, dtype=np.int64)
    u = _grid(DimensionRows.of_objects(np.zeros((16, 0)), none, nothing), lines)
    return _Classes((), u, np.zeros((0, len(u))), (), DimensionRows.of_objects(np.zeros((16, 0)), none, nothing))


def _weights(classes: _Classes, mass: FloatArray, count: int) -> FloatArray:
    """(n,) probability that each object is what its label says."""
    weights = np.zeros(count)
    for part, terms in classes.terms:
        weights[part] = terms.weights(mass)
    return weights


def _own_centres(components: DimensionRows) -> FloatArray:
    """Log scale of each object's own highest peak, (n,)."""
    peak, owner = components.line_log_peak, components.object
    if not len(peak):
        return np.zeros(0)
    highest = np.flatnonzero(peak == np.maximum.reduceat(peak, components.start)[owner])
    own = np.empty(len(components.start))
    own[owner[highest]] = components.line_centre[highest]
    return own


def _mass(u: FloatArray, total: FloatArray, lines: FloatArray) -> FloatArray:
    """Posterior mass at the points of the first grid, (g,), sum 1."""
    seen = np.column_stack([lines[:, 0], np.maximum(lines[:, 1], u[1] - u[0]), lines[:, 2]])
    log_density = total + grid.log_lines(u, seen).sum(axis=0)
    mass = np.exp(log_density - log_density.max())
    return np.asarray(mass / mass.sum())
