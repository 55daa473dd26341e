"""What one object says about the scale: a mixture of Gaussians over v = u 1 - e, in log size.

With y the log of an object's extents, u the log of the scale in metres per unit, e the error that the objects of a
class share, and tree sizes in millimetres,

    y + v ~ sum_k w_k N(m_k - ln 1000, S_k + R),    v = u 1 - e                         (docs/explanation/posterior.md)

so that each row below is N(v; r, S + R) with r = m - ln 1000 - y. On the line v = u 1 a row is the Gaussian
N(u; u_hat, 1 / lam) times the evidence of the proportions. Everything is relative to the flat outlier density, whose
own weight is therefore eps.

The axes that a prior speaks of: length, width, height, or the extents in falling order.

The Gaussian components of a scene's objects as flat columns, and what each is on the line of one common scale.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from estimator.posterior.axis_assignments import Layout, Variants, is_sorted, prior_axes, variants
from estimator.posterior.class_hypotheses import MOST_KINDS, Hypothesis, displaced_error, displaced_share
from estimator.posterior.shared_error import DimensionRows, shared_error
from estimator.posterior.symmetric_matrices import DIAGONAL, OFF_DIAGONAL, dot, inverse, pack, product, row_sums, total
from estimator.records.objects import MeasuredObject
from metric_base.arrays import BoolArray, FloatArray, IntArray
from metric_tree.axes import AXES, EXTENTS
from metric_tree.fit.inner_priors import reduce_mixture
from metric_tree.fit.mixture import Mixture
from metric_tree.prior import Prior

#: Probability that an object is not what its label says, or not measured as its sigma says. On
#: simulated scenes the medians for 0.02 to 0.1 agree within 0.4 %; with 20 % wrong
#: labels the
#: interval's coverage is best at 0.1.
OUTLIER_SHARE = 0.1
#: A detector's score is no probability, yet a label of low score is wrong more often: the outlier's share grows by
#: this part of (1 - score). At 0.5 a detection of score 0.4 has an outlier share of 0.37.
SCORE_SLOPE = 0.5
#: Rows under this part of their object's highest peak change the posterior by less than the grid does.
MIN_PEAK_SHARE = 1e-4
#: Rows of a gross error matter where the plain ones fit badly; under this part of the highest peak they are dropped.
GROSS_NEGLIGIBLE = 0.1
#: Horizontal sides nearer than this many standard deviations of their difference may have changed places.
ORDER_TOLERANCE_SD = 3.0
LOG_MM_PER_M = math.log(1000.0)


@dataclass(frozen=True, slots=True, eq=False)
class ObjectEvidence:
    """An object beside the prior of its class. `pose` is the node's; `prior.dims` the axes that count."""

    object: MeasuredObject
    prior: Prior
    pose: str


def usable(evidence: Sequence[ObjectEvidence]) -> BoolArray:
    """(n, 3) bool: the measured extents that the priors can judge, in each object's own order."""
    there = np.isfinite([item.object.extents for item in evidence]).reshape(-1, 3)
    judged = [_usable_axes(item.prior, item.object.vertical_known) for item in evidence]
    return np.asarray(there & np.array(judged, dtype=bool).reshape(-1, 3))


@lru_cache(maxsize=4096)
def _usable_axes(prior: Prior, vertical_known: bool) -> tuple[bool, ...]:
    if is_sorted(prior) or not vertical_known:
        return (True, True, True)
    return tuple(axis in prior.dims for axis in AXES)


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """The numbers of n objects, extents in falling order where the prior's are.

    evidence : the objects; y, sigma : (n, 3) log extents and their standard deviations, 0 where missing; together :
    (n, 3, 3) covariance of the log extents off its diagonal; code : (n,)
    what is missing, truncated, free or too close to order, eight bits; outlier : (n,) its probability before the
    sizes are seen.
    """

    evidence: Sequence[ObjectEvidence]
    y: FloatArray
    sigma: FloatArray
    together: FloatArray
    code: Sequence[int]
    outlier: FloatArray


def measurement_arrays(evidence: Sequence[ObjectEvidence]) -> Measured:
    """The numbers of n objects with at least one usable extent each."""
    extents = np.array([item.object.extents for item in evidence])  # (n, 3)
    sigma = np.array([item.object.sigma for item in evidence])  # (n, 3)
    cut = np.array([item.object.truncated for item in evidence], dtype=bool)  # (n, 3)
    y = np.log(extents)
    close = y[:, 0] - y[:, 1] < ORDER_TOLERANCE_SD * np.hypot(sigma[:, 0], sigma[:, 1])  # (n,)
    joint = np.zeros((len(evidence), 3, 3))
    for i, item in enumerate(evidence):
        if item.object.covariance is not None:
            joint[i] = item.object.covariance
    missing = np.isnan(y)
    free = np.array([not item.object.vertical_known for item in evidence])  # (n,)
    for i, item in enumerate(evidence):
        if is_sorted(item.prior):
            order = np.argsort(-np.where(missing[i], -np.inf, y[i]), kind="stable")
            y[i], sigma[i], cut[i], missing[i] = y[i, order], sigma[i, order], cut[i, order], missing[i, order]
            joint[i] = joint[i][np.ix_(order, order)]
    codes = np.packbits(np.column_stack([missing, cut, close, free]), axis=1, bitorder="little")[:, 0].tolist()
    score = np.array([item.object.score for item in evidence])
    outlier = OUTLIER_SHARE + (1 - OUTLIER_SHARE) * SCORE_SLOPE * (1 - np.clip(score, 0.0, 1.0))  # (n,)
    return Measured(evidence, np.nan_to_num(y), np.nan_to_num(sigma), np.nan_to_num(joint), codes, outlier)


def rows(objects: Measured) -> DimensionRows:
    """The components of every object by itself: its class error is in its covariance, which integrates it out."""
    tables = [
        _table(item.prior, item.pose, code, -1, True) for item, code in zip(objects.evidence, objects.code, strict=True)
    ]
    counts = [table.measured.shape[1] for table in tables]
    return _rows_of(tables, counts, np.arange(len(tables)), objects)


def hypothesis_rows(objects: Measured, chosen: IntArray, ways: Sequence[Sequence[Hypothesis]]) -> DimensionRows:
    """The components of objects under each hypothesis of their class, without its shared error.

    Parameters
    ----------
    chosen : (m,) places of the objects
    ways : the hypotheses of each; the entries of the result are these of the first object, those of the second, ...
    """
    tables, counts = [], []
    for i, own in zip(chosen.tolist(), ways, strict=True):
        table, rows_of_ways = _joined_table(tuple(own), objects.evidence[i].pose, objects.code[i])
        tables.append(table)
        counts += rows_of_ways
    return _rows_of(tables, counts, np.repeat(chosen, [len(own) for own in ways]), objects)


def has_readings(item: ObjectEvidence) -> bool:
    """Whether it is open which of the object's extents is its prior's vertical one."""
    return not item.object.vertical_known and not is_sorted(item.prior)


@dataclass(frozen=True, slots=True, eq=False)
class _Table:
    """What of an object's r rows does not depend on its sizes: the prior under every variant.

    columns : (14, r): the mean ln m less the shift of a cut; the packed covariance (of a lone object with its class
    error), unit on axes that do not count; active, 1 or 0, of each axis; log_weight; the log part of the highest peak
    under which a row is dropped.
    measured : (3, r) which extent stands on each axis.
    """

    columns: FloatArray
    measured: IntArray


def _layout(prior: Prior, pose: str, code: int) -> Layout:
    """The layout of eight packed flags: three missing, three cut, sides close, vertical unknown."""
    flags = [bool(code >> bit & 1) for bit in range(8)]
    by_extent = is_sorted(prior)
    names = EXTENTS if by_extent else AXES
    return Layout(
        pose=pose,
        vertical_known=not flags[7],
        sorted_prior=by_extent,
        missing=(flags[0], flags[1], flags[2]),
        truncated=(flags[3], flags[4], flags[5]),
        modelled=(names[0] in prior.dims, names[1] in prior.dims, names[2] in prior.dims),
        horizontal_close=flags[6],
    )


@lru_cache(maxsize=16384)
def _table(prior: Prior, pose: str, code: int, reading: int, alone: bool, foreign: bool = False) -> _Table:
    """The table of a layout; `reading` keeps the variants whose vertical is that extent, -1 all of them.

    foreign : the label is taken to mean another object, of which a cut side says nothing.
    """
    layout = _layout(prior, pose, code)
    ways: Variants = variants(layout)
    if reading >= 0 and not layout.vertical_known:
        ways = ways.of_reading(reading)
    if foreign:
        ways = ways.of_wide_cuts()
    columns = _columns(prior, ways, shared_error(prior).covariance if alone else None)
    measured = [np.tile(ways.measured, (len(prior.weights), 1)).T]
    if alone and (share := displaced_share(prior)):
        columns[12] += math.log(1 - share)
        # gross errors beside a displaced class change nothing that matters, and its many components are as good as few
        few, plain = _few_components(prior), ways.without_gross_errors()
        wide = np.zeros((3, 3))
        axes = prior_axes(prior)
        wide[axes[:, None], axes] = displaced_error(prior)
        more = _columns(few, plain, wide)
        more[12] += math.log(share)
        columns = np.concatenate([columns, more], axis=1)
        measured.append(np.tile(plain.measured, (len(few.weights), 1)).T)
    return _Table(columns, np.concatenate(measured, axis=1))


@lru_cache(maxsize=4096)
def _joined_table(ways: tuple[Hypothesis, ...], pose: str, code: int) -> tuple[_Table, list[int]]:
    """The tables of an object under several hypotheses as one, and how many rows each has."""
    tables = [_table(way.prior, pose, code, way.reading, False, way.foreign) for way in ways]
    columns, measured = (
        np.concatenate(parts, axis=1) for parts in zip(*((one.columns, one.measured) for one in tables), strict=True)
    )
    return _Table(columns, measured), [one.measured.shape[1] for one in tables]


def _few_components(prior: Prior) -> Prior:
    """The prior with at most `MOST_KINDS` components, moments kept."""
    few = reduce_mixture(Mixture(prior.weights, prior.means, prior.covariances), MOST_KINDS)
    return replace(
        prior, weights=few.weights / few.weights.sum(), means=few.means, covariances=few.covariances, contexts=()
    )


def _columns(prior: Prior, ways: Variants, shared: FloatArray | None) -> FloatArray:
    """Columns (14, r) of a prior's components under v variants; shared : (3, 3) the class error, or None."""
    axes = prior_axes(prior)
    k, v = len(prior.weights), len(ways.log_weight)
    mean = np.zeros((k, 3))
    mean[:, axes] = prior.means - LOG_MM_PER_M
    covariance = np.zeros((k, 3, 3))
    covariance[:, axes[:, None], axes] = prior.covariances
    active = ways.active.astype(float)  # (v, 3)
    both = active[:, :, None] * active[:, None, :]  # (v, 3, 3)
    diagonal = ways.variance * active + (1 - active)  # (v, 3)
    spread = covariance[:, None] * both + diagonal[None, :, :, None] * np.eye(3)  # (k, v, 3, 3)
    if shared is not None:
        spread += shared * both
    shifted = (mean[:, None, :] - ways.shift) * active  # (k, v, 3)
    log_weight = np.log(np.maximum(prior.weights, 1e-300))[:, None] + ways.log_weight  # (k, v)
    log_weight = log_weight - 0.5 * math.log(2 * math.pi) * active.sum(axis=1)
    negligible = np.log(np.where(ways.gross, GROSS_NEGLIGIBLE, MIN_PEAK_SHARE))  # (v,)
    columns = [
        shifted.reshape(k * v, 3).T,
        pack(spread.reshape(k * v, 3, 3)),
        np.tile(active, (k, 1)).T,
        log_weight.reshape(1, k * v),
        np.tile(negligible, (1, k)),
    ]
    return np.concatenate(columns)


def _rows_of(tables: Sequence[_Table], counts: Sequence[int], chosen: IntArray, objects: Measured) -> DimensionRows:
    """The rows of e entries; counts : (e,) rows of each in `tables`; chosen : (e,) the object of each."""
    owner = np.repeat(np.arange(len(counts)), counts)  # (m,)
    of_row = chosen[owner]  # (m,) the object
    columns = np.concatenate([table.columns for table in tables], axis=1)  # (14, m)
    mean, covariance, active, log_weight = columns[:3], columns[3:9], columns[9:12], columns[12]
    measured = np.concatenate([table.measured for table in tables], axis=1)  # (3, m)
    extent = measured + 3 * of_row  # place in y and sigma
    residual = (mean - objects.y.take(extent)) * active
    covariance[DIAGONAL] += (objects.sigma**2).take(extent) * active
    if objects.together.any():
        for place, (one, two) in OFF_DIAGONAL.items():
            common = objects.together.ravel().take(9 * of_row + 3 * measured[one] + measured[two])
            covariance[place] += common * active[one] * active[two]
    precision, log_det = inverse(covariance)
    for place, counts_or_not in zip(DIAGONAL, active, strict=True):
        precision[place] *= counts_or_not  # off the diagonal it is zero already
    log_weight += np.log1p(-objects.outlier)[of_row] - 0.5 * log_det
    pull = product(precision, residual)
    lam = total(row_sums(precision))
    centre = total(pull) / lam
    peak = log_weight - 0.5 * (dot(residual, pull) - lam * centre**2)
    start = np.cumsum([0, *counts[:-1]])
    kept = np.flatnonzero(peak >= np.maximum.reduceat(peak, start)[owner] + columns[13])
    flat = np.array([row.take(kept) for row in (*precision, *residual, *pull, log_weight, lam, centre, peak)])
    return DimensionRows.of_objects(flat, owner.take(kept), np.log(objects.outlier[chosen]))
