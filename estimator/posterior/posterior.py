"""The posterior over u = log scale of all objects together (paper 4.3, in log space; docs/explanation/posterior.md).

    log p(u | y) = log p(u) + sum over classes of log L_c(u) + known lengths

A class of one object is a mixture of Gaussians in u; a class of several is integrated over its shared error
(`class_error`). Everything is evaluated on one grid that the evidence places.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from estimator.posterior import grid
from estimator.posterior.class_error import shared_error
from estimator.posterior.class_likelihood import ClassTerms, joint_classes, line_density, single_classes
from estimator.posterior.components import Rows
from estimator.posterior.likelihood import Evidence, rows
from estimator.records.curve import Curve, Mode
from metric_base.arrays import FloatArray, IntArray

__all__ = [
    "FAR_MASS",
    "FAR_MODE",
    "RATIO_LIMIT",
    "Estimate",
    "Posterior",
    "Status",
    "object_curves",
    "posterior",
    "status_of",
]

Status = Literal["resolved", "unresolved"]

#: The contract's rule: unresolved when the interval's high/low exceeds this, ...
RATIO_LIMIT = 1.8

#: ... or a mode further away than this ratio has at least this mass.
FAR_MODE, FAR_MASS = 1.25, 0.1

#: Two known-length observations of no stated error cannot be better than the reconstruction: 0.1 % at least.
LEAST_KNOWN_SD = 1e-3


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Estimate:
    """What any method finds over log scale, for n objects.

    modes : highest first; interval : (low, high) metres per unit; weight : (n,) probability that each object is not
    an outlier; own_scale : (n,) metres per unit, each object's own highest peak.
    """

    curve: Curve
    modes: tuple[Mode, ...]
    interval: tuple[float, float]
    status: Status
    weight: FloatArray
    own_scale: FloatArray


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Posterior(Estimate):
    """Our estimate, with what leaving a class out needs.

    classes : node ids of the rows of `class_log_likelihood` (c, g) on the grid `coarse` (g,); known : as given.
    """

    classes: tuple[str, ...]
    coarse: FloatArray
    class_log_likelihood: FloatArray
    known: FloatArray
    level: float

    def without(self, node_id: str) -> tuple[Curve, tuple[Mode, ...], tuple[float, float]]:
        """The curve, modes and interval as if the class `node_id` had no object in the scene."""
        keep = np.array([name != node_id for name in self.classes])
        left = grid.curve(self.coarse, self.class_log_likelihood[keep].sum(axis=0), self.known)
        return left, grid.modes(left), grid.interval(left, self.level)


def posterior(evidence: Sequence[Evidence], known: FloatArray | None = None, level: float = 0.9) -> Posterior:
    """The posterior of n objects and of known lengths.

    Parameters
    ----------
    evidence : n objects with their priors; n may be 0 if there are known lengths
    known : (k, 2) mean and standard deviation in log(metres per unit) of each known length
    level : mass of the equal-tailed interval

    Raises
    ------
    ValueError
        There is neither an object nor a known length.
    """
    known = np.zeros((0, 2)) if known is None else np.maximum(known, [-np.inf, LEAST_KNOWN_SD])
    if not evidence and not len(known):
        raise ValueError("posterior: expected an object or a known length; found neither")
    classes = _classes(evidence, known)
    total = classes.log_likelihood.sum(axis=0)
    answer = grid.curve(classes.grid, total, known)
    mass = _mass(classes.grid, total, known)
    weights = np.zeros(len(evidence))
    for part, terms in classes.terms:
        weights[part] = terms.weights(mass)
    found = grid.modes(answer)
    bounds = grid.interval(answer, level)
    return Posterior(
        curve=answer,
        modes=found,
        interval=bounds,
        status=status_of(found, bounds),
        weight=weights,
        own_scale=classes.own_scale,
        classes=classes.names,
        coarse=classes.grid,
        class_log_likelihood=classes.log_likelihood,
        known=known,
        level=level,
    )


def status_of(found: Sequence[Mode], bounds: tuple[float, float]) -> Status:
    """The contract's rule for an answer that is none: too wide, or modes that contradict each other."""
    best = found[0].scale
    far = any(max(mode.scale / best, best / mode.scale) > FAR_MODE and mode.mass >= FAR_MASS for mode in found[1:])
    return "unresolved" if far or bounds[1] / bounds[0] > RATIO_LIMIT else "resolved"


def object_curves(evidence: Sequence[Evidence], log_scale: FloatArray) -> FloatArray:
    """Each object's own likelihood over log scale relative to the outlier's, (n, g); for figures."""
    components = rows(evidence, np.ones(len(evidence), dtype=bool))
    density = line_density(components, log_scale)
    return np.asarray(density + np.exp(components.log_floor)[:, None])


@dataclass(frozen=True, slots=True, eq=False)
class _Classes:
    """The classes of a scene on one grid: log_likelihood (c, g), grid (g,); terms : objects' places and their terms."""

    names: tuple[str, ...]
    grid: FloatArray
    log_likelihood: FloatArray
    terms: tuple[tuple[IntArray, ClassTerms], ...]
    own_scale: FloatArray


def _classes(evidence: Sequence[Evidence], known: FloatArray) -> _Classes:
    centre, sd = known[:, 0], np.maximum(known[:, 1], grid.FINEST_STEP)
    if not evidence:
        u = grid.evidence_grid(centre, sd, grid.SUPPORT_SD * sd)
        return _Classes((), u, np.zeros((0, len(u))), (), np.zeros(0))
    names = sorted({item.prior.node_id for item in evidence})
    place = {name: number for number, name in enumerate(names)}
    group = np.array([place[item.prior.node_id] for item in evidence])
    alone = np.bincount(group)[group] == 1  # (n,)
    errors = [shared_error(item.prior) for item in evidence]
    joint_sd = np.where(alone, 0.0, [error.along_sd for error in errors])
    components = rows(evidence, alone)
    spread = np.sqrt(1 / components.line_precision + joint_sd[components.object] ** 2)
    over = components.line_log_peak - components.log_floor[components.object]  # ln of peak over the outlier's floor
    reach = np.minimum(np.sqrt(2 * np.maximum(over + math.log(1 / grid.UNSEEN), 0.0)), grid.SUPPORT_SD) * spread
    seen = reach > 0
    u = grid.evidence_grid(
        np.concatenate([centre, components.line_centre[seen]]),
        np.concatenate([sd, spread[seen]]),
        np.concatenate([grid.SUPPORT_SD * sd, reach[seen]]),
    )
    terms = []
    if alone.any():
        part = np.flatnonzero(alone)
        terms.append((part, single_classes(components.of(part), group[part], u)))
    if not alone.all():
        part = np.flatnonzero(~alone)
        terms.append((part, joint_classes(components.of(part), group[part], [errors[i] for i in part], u)))
    log_likelihood = np.zeros((len(names), len(u)))
    for _, solved in terms:
        log_likelihood[solved.classes] = solved.log_likelihood
    own = np.exp(_own_centres(components))
    return _Classes(tuple(names), u, log_likelihood, tuple(terms), own)


def _own_centres(components: Rows) -> FloatArray:
    """Log scale of each object's own highest peak, (n,)."""
    peak, owner = components.line_log_peak, components.object
    highest = np.flatnonzero(peak == np.maximum.reduceat(peak, components.start)[owner])
    own = np.empty(len(components.start))
    own[owner[highest]] = components.line_centre[highest]
    return own


def _mass(u: FloatArray, total: FloatArray, known: FloatArray) -> FloatArray:
    """Posterior mass at the points of the first grid, (g,), sum 1."""
    log_density = total.copy()
    for mean, sd in known:
        log_density -= 0.5 * ((u - mean) / max(sd, u[1] - u[0])) ** 2
    mass = np.exp(log_density - log_density.max())
    return np.asarray(mass / mass.sum())
