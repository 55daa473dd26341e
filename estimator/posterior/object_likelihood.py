"""Likelihood of one object: a mixture of Gaussians over v = u 1 - e, in log size.

With the log extents y of an object, the log u of the scale in metres per unit, the error e that the objects of a class
share, and sizes of the tree in millimetres,

    y + v ~ sum_k w_k N(m_k - ln 1000, S_k + R),    v = u 1 - e                         (docs/explanation/posterior.md)

so that each component is N(v; r, S + R) with r = m - ln 1000 - y. On the line v = u 1 it is the Gaussian
N(u; u_hat, 1 / lam) times the evidence of the proportions. All densities are relative to the flat outlier density,
whose weight is therefore eps. The axes follow the prior: length, width, height, or the extents in decreasing order.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import permutations

import numpy as np

from estimator.posterior.axis_assignments import (
    GROSS_ERROR_SD_LOG,
    TRUNCATION_MIXTURE,
    Layout,
    Variants,
    is_sorted,
    prior_axes,
    variants,
)
from estimator.posterior.class_hypotheses import (
    MAX_KINDS,
    Hypothesis,
    bias_probability,
    biased_error,
    mislabel_probability,
    mislabelled_error,
)
from estimator.posterior.shared_error import N_ROW_ARRAYS, ObjectComponents, split_error
from estimator.records.objects import MeasuredObject
from metric_base.arrays import BoolArray, FloatArray, IntArray
from metric_tree.axes import AXES, EXTENTS
from metric_tree.fit.mixture import Mixture, reduce_mixture
from metric_tree.prior import Prior

#: Probability that an object does not match its label, or is not measured within its sigma. On simulated scenes, the
#: medians for 0.02 to 0.1 agree within 0.4 %; with 20 % wrong labels, the coverage of the interval is best at 0.1.
OUTLIER_PROBABILITY = 0.1
#: Minimum score that affects the probability of an outlier.
MIN_SCORE = 0.01
#: Minimum ratio of a component to the highest peak of its object. Smaller ones change the posterior less than the grid.
MIN_PEAK_RATIO = 1e-4
#: The same for components with a gross error, which matter only if the others fit badly.
MIN_GROSS_PEAK_RATIO = 0.1
#: Logarithms of these ratios for a component without a gross error and with one on each axis, and the axis of each.
LOG_MIN_RATIOS: FloatArray = np.log([MIN_PEAK_RATIO, *[MIN_GROSS_PEAK_RATIO] * 3])
VARIANT_AXES = [0, 0, 1, 2]
#: Maximum difference of horizontal sides whose order is uncertain, in standard deviations of the difference.
MAX_ORDER_SIGMAS = 3.0
#: Orders (6, 3) of three extents; the index of an order (i, j, k) is 2 i + (j > k).
ORDERS: IntArray = np.array(list(permutations(range(3))))
#: Rows and columns of the six elements of a packed symmetric matrix.
ROWS, COLUMNS = (0, 0, 0, 1, 1, 2), (0, 1, 2, 1, 2, 2)
#: Variance of an inactive axis in log size, whose precision is negligible.
INACTIVE_VARIANCE = 1e12
LOG_MM_PER_M = math.log(1000.0)
#: Number of objects whose components are computed at once; those of an object with an unknown vertical take 70 kB.
BLOCK_OBJECTS = 1024


@dataclass(frozen=True, slots=True, eq=False)
class ObjectEvidence:
    """An object with the prior of its class."""

    object: MeasuredObject
    #: Its `dims` are the axes that are used.
    prior: Prior
    #: Usual pose of the category.
    pose: str
    #: Factor (0 to 1) of the score of the object.
    score_factor: float = 1.0


def usable(evidence: Sequence[ObjectEvidence]) -> BoolArray:
    """Return a mask (n, 3) of the measured extents that the priors can judge, in the order of each object."""
    is_measured = np.isfinite([item.object.extents for item in evidence]).reshape(-1, 3)
    is_modelled = [
        (True, True, True)
        if is_sorted(item.prior) or not item.object.vertical_known
        else tuple(axis in item.prior.dims for axis in AXES)
        for item in evidence
    ]
    return np.asarray(is_measured & np.array(is_modelled, dtype=bool).reshape(-1, 3))


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredArrays:
    """Measurements of n objects, with extents in decreasing order if the prior is over sorted extents."""

    evidence: Sequence[ObjectEvidence]
    #: (n, 3) log extents, 0 if missing.
    y: FloatArray
    #: (9, 6 n) -y and the packed covariance of y, 0 if missing, in the six orders of the extents of each object.
    in_orders: FloatArray
    #: n bit fields: three for missing, three for truncated, one for similar sides, one for an unknown vertical.
    code: Sequence[int]
    #: (n,) prior probability to be an outlier.
    outlier: FloatArray
    #: (n,) prior probability that the label means another object, for the only object of a class; 0 if the scene has
    #: no other class, without which no label could be checked.
    mislabelled: FloatArray


def measurement_arrays(evidence: Sequence[ObjectEvidence], has_others: bool | None = None) -> MeasuredArrays:
    """Return the measurements of n objects with at least one usable extent each.

    `has_others` states whether the scene has other classes; by default, whether these objects have several.
    """
    y = np.log([item.object.extents for item in evidence])  # (n, 3)
    sigma = np.array([item.object.sigma for item in evidence])  # (n, 3)
    truncated = np.array([item.object.truncated for item in evidence], dtype=bool)  # (n, 3)
    unknown = np.zeros((3, 3))
    covariance = np.array(
        [unknown if item.object.covariance is None else item.object.covariance for item in evidence]
    )  # (n, 3, 3)
    is_close = y[:, 0] - y[:, 1] < MAX_ORDER_SIGMAS * np.hypot(sigma[:, 0], sigma[:, 1])  # (n,)
    missing = np.isnan(y)
    is_free = [not item.object.vertical_known for item in evidence]
    covariance[:, range(3), range(3)] = sigma**2
    y, covariance = np.where(missing, 0.0, y), np.nan_to_num(covariance)
    for i in np.flatnonzero([is_sorted(item.prior) for item in evidence]):
        order = np.argsort(-np.where(missing[i], -np.inf, y[i]), kind="stable")
        y[i], truncated[i], missing[i] = y[i, order], truncated[i, order], missing[i, order]
        covariance[i] = covariance[i][np.ix_(order, order)]
    flags = np.column_stack([missing, truncated, is_close, is_free])
    codes = np.packbits(flags, axis=1, bitorder="little")[:, 0].tolist()
    score = np.clip([item.object.score * item.score_factor for item in evidence], MIN_SCORE, 1.0)  # (n,)
    if has_others is None:
        has_others = len({item.prior.node_id for item in evidence}) > 1
    mislabelled = has_others * np.array([mislabel_probability(item.prior) for item in evidence])
    in_orders = np.concatenate([-y[:, ORDERS], covariance[:, ORDERS[:, ROWS], ORDERS[:, COLUMNS]]], axis=2)  # (n, 6, 9)
    return MeasuredArrays(
        evidence=evidence,
        y=y,
        in_orders=np.ascontiguousarray(in_orders.reshape(-1, 9).T),
        code=codes,
        outlier=1 - (1 - OUTLIER_PROBABILITY) * score,
        mislabelled=mislabelled,
    )


def rows(objects: MeasuredArrays) -> ObjectComponents:
    """Return the components of single objects: the covariance of each includes the error of its class."""
    tables = [
        layout_table(item.prior, item.pose, code, -1, True)
        for item, code in zip(objects.evidence, objects.code, strict=True)
    ]
    counts = [table.shape[1] for table in tables]
    parts = []
    for first in range(0, max(len(tables), 1), BLOCK_OBJECTS):
        block = slice(first, min(first + BLOCK_OBJECTS, len(tables)))
        parts.append(_components(tables[block], counts[block], np.arange(block.start, block.stop), objects))
    return ObjectComponents.of_objects(
        [np.concatenate(arrays, axis=-1) for arrays in zip(*(part[:N_ROW_ARRAYS] for part in parts), strict=True)],
        np.concatenate([part.object + BLOCK_OBJECTS * index for index, part in enumerate(parts)]),
        np.concatenate([part.log_floor for part in parts]),
    )


def hypothesis_rows(
    objects: MeasuredArrays, selected: IntArray, by_object: Sequence[Sequence[Hypothesis]]
) -> ObjectComponents:
    """Return the components of objects under each hypothesis of their class, without its shared error.

    Parameters
    ----------
    objects : MeasuredArrays
    selected : (m,) ndarray of int
        Indices of the objects.
    by_object : sequence of sequence of Hypothesis
        Hypotheses of each object. The entries of the result are those of the first object, of the second, ...
    """
    tables, counts = [], []
    for i, of_object in zip(selected.tolist(), by_object, strict=True):
        table, counts_of_object = _joined_table(tuple(of_object), objects.evidence[i].pose, objects.code[i])
        tables.append(table)
        counts += counts_of_object
    objects = replace(objects, mislabelled=np.zeros(len(objects.evidence)))  # a hypothesis of its own
    return _components(tables, counts, np.repeat(selected, [len(of_object) for of_object in by_object]), objects)


def has_open_vertical(item: ObjectEvidence) -> bool:
    """Return True if it is unknown which extent of the object is the vertical one of its prior."""
    return not item.object.vertical_known and not is_sorted(item.prior)


@lru_cache(maxsize=16384)
def layout_table(
    prior: Prior, pose: str, code: int, vertical_extent: int, is_single: bool, is_mislabelled: bool = False
) -> FloatArray:
    """Return the part of the r components of an object that does not depend on its sizes: the prior in all variants.

    Parameters
    ----------
    prior : Prior
    pose : str
    code : int
        Bit field of `MeasuredArrays.code`.
    vertical_extent : int
        Measured extent that is vertical, or -1 for all variants.
    is_single : bool
        Include the error of the class in the covariance.
    is_mislabelled : bool, default False
        The label means another object, about which a truncated side has no information.

    Returns
    -------
    (15, r) ndarray of float
        Mean ln m minus the shift of a truncation (3); packed covariance, `INACTIVE_VARIANCE` on inactive axes (6); log
        weight; log weight of a gross error of each axis relative to it (3); index of the order of the extents in
        `ORDERS`; 1 for mislabelled objects.
    """
    flags = [bool(code >> bit & 1) for bit in range(8)]
    by_extent = is_sorted(prior)
    names = EXTENTS if by_extent else AXES
    layout = Layout(
        pose=pose,
        vertical_known=not flags[7],
        sorted_prior=by_extent,
        missing=(flags[0], flags[1], flags[2]),
        truncated=(flags[3], flags[4], flags[5]),
        modelled=(names[0] in prior.dims, names[1] in prior.dims, names[2] in prior.dims),
        horizontal_close=flags[6],
    )
    assignments: Variants = variants(layout)
    if vertical_extent >= 0 and not layout.vertical_known:
        assignments = assignments.with_vertical(vertical_extent)
    if is_mislabelled:
        assignments = _with_wide_errors(assignments)
    if not is_single:
        return _columns(prior, assignments, None)
    biased = bias_probability(prior)
    # Gross errors have no effect on wide components.
    plain = replace(assignments, log_gross=np.full_like(assignments.log_gross, -np.inf))
    parts = [(prior, assignments, prior.disagreement(), 1 - biased, False)]
    if biased:
        parts.append((_merged(prior, MAX_KINDS), plain, biased_error(prior), biased, False))
    parts.append((_merged(prior, 1), _with_wide_errors(plain), mislabelled_error(prior), 1.0, True))
    tables = []
    for components, cases, error, probability, is_wrong in parts:
        columns = _columns(components, cases, split_error(error, prior_axes(prior)).covariance, is_wrong)
        columns[9] += math.log(probability)
        tables.append(columns)
    return np.concatenate(tables, axis=1)


def _with_wide_errors(assignments: Variants) -> Variants:
    """Return the variants in which each truncated side has the wide error, as those of a mislabelled object."""
    is_narrow = assignments.variance == TRUNCATION_MIXTURE[0][2] ** 2
    return assignments.of(~is_narrow.any(axis=1))


def _merged(prior: Prior, components: int) -> Prior:
    """Return a prior with at most this number of components."""
    mixture = reduce_mixture(Mixture(prior.weights, prior.means, prior.covariances), components)
    weights = mixture.weights / mixture.weights.sum()
    return replace(prior, weights=weights, means=mixture.means, covariances=mixture.covariances, contexts=())


@lru_cache(maxsize=4096)
def _joined_table(of_object: tuple[Hypothesis, ...], pose: str, code: int) -> tuple[FloatArray, list[int]]:
    """Return the table (15, r) of an object under several hypotheses, and the number of components of each."""
    tables = [layout_table(row.prior, pose, code, row.vertical_extent, False, row.is_mislabelled) for row in of_object]
    return np.concatenate(tables, axis=1), [table.shape[1] for table in tables]


def _columns(
    prior: Prior, assignments: Variants, shared: FloatArray | None, is_mislabelled: bool = False
) -> FloatArray:
    """Return the columns (15, k v) of the k components of a prior under v variants; `shared` (3, 3) is the error."""
    axes = prior_axes(prior)
    k, v = len(prior.weights), len(assignments.log_weight)
    mean = np.zeros((k, 3))
    mean[:, axes] = prior.means - LOG_MM_PER_M
    covariance = np.zeros((k, 3, 3))
    covariance[:, axes[:, None], axes] = prior.covariances
    active = assignments.active.astype(float)  # (v, 3)
    both = active[:, :, None] * active[:, None, :]  # (v, 3, 3)
    diagonal = np.where(assignments.active, assignments.variance, INACTIVE_VARIANCE)  # (v, 3)
    total = covariance[:, None] * both + diagonal[None, :, :, None] * np.eye(3)  # (k, v, 3, 3)
    if shared is not None:
        total += shared * both
    shifted = (mean[:, None, :] - assignments.shift) * active  # (k, v, 3)
    n_active = active.sum(axis=1)
    log_norm = 0.5 * ((3 - n_active) * math.log(INACTIVE_VARIANCE) - n_active * math.log(2 * math.pi))
    log_weight = np.log(np.maximum(prior.weights, 1e-300))[:, None] + assignments.log_weight + log_norm  # (k, v)
    first, second, third = assignments.measured.T
    columns = [
        shifted.reshape(k * v, 3).T,
        total.reshape(k * v, 3, 3)[:, ROWS, COLUMNS].T,
        log_weight.reshape(1, k * v),
        np.tile([*assignments.log_gross.T, 2 * first + (second > third)], k),
        np.full((1, k * v), float(is_mislabelled)),
    ]
    return np.concatenate(columns)


def _components(
    tables: Sequence[FloatArray], counts: Sequence[int], selected: IntArray, objects: MeasuredArrays
) -> ObjectComponents:
    """Return the components of e entries.

    Parameters
    ----------
    tables : sequence of (15, r) ndarray of float
    counts : (e,) sequence of int
        Number of components of each entry in `tables`.
    selected : (e,) ndarray of int
        Object of each entry.
    objects : MeasuredArrays
    """
    owner = np.repeat(np.arange(len(counts)), counts)  # (m,) entry
    object_index = selected[owner]  # (m,)
    columns = np.concatenate(tables, axis=1)  # (15, m)
    # The covariance of a measurement on an inactive axis is negligible compared with `INACTIVE_VARIANCE`.
    columns[:9] += objects.in_orders.take(6 * object_index + columns[13].astype(np.int64), axis=1)
    residual, log_weight, log_gross, is_mislabelled = columns[:3], columns[9], columns[10:13], columns[14] > 0
    precision, log_det = inverse(columns[3:9])  # (3, 3, m)
    pull = np.einsum("abm,bm->am", precision, residual)
    along = precision.sum(axis=0)  # (3, m) Lam 1
    of_label = np.log(np.maximum([1 - objects.mislabelled, objects.mislabelled], 1e-300)) + np.log1p(-objects.outlier)
    of_object = of_label.take(object_index + len(objects.outlier) * is_mislabelled)
    constant = log_weight + of_object - 0.5 * (log_det + np.einsum("am,am->m", residual, pull))
    # A gross error adds a variance to an axis a: its precision is Lam - gain Lam_a Lam_a' (Sherman and Morrison). The
    # first of the four variants (4, m) has none.
    gain = np.zeros((4, len(owner)))
    gain[1:] = 1 / (precision[range(3), range(3)] + GROSS_ERROR_SD_LOG**-2)
    along_axis, pull_axis = along[VARIANT_AXES], pull[VARIANT_AXES]
    lam = along.sum(axis=0) - gain * along_axis**2
    slope = pull.sum(axis=0) - gain * along_axis * pull_axis
    constant = constant + 0.5 * gain * pull_axis**2
    constant[1:] += log_gross + 0.5 * np.log(gain[1:] / GROSS_ERROR_SD_LOG**2)
    centre = slope / lam
    peak = constant + 0.5 * slope * centre
    start = np.searchsorted(owner, np.arange(len(counts)))
    lowest = np.maximum.reduceat(peak.max(axis=0), start)[owner] + LOG_MIN_RATIOS[:, None]
    row, variant = np.divmod(np.flatnonzero((peak >= lowest).T), 4)
    chosen = variant * len(owner) + row
    axis = precision.reshape(3, -1).take(np.array(VARIANT_AXES)[variant] * len(owner) + row, axis=1)  # Lam_a
    gain = gain.take(chosen)
    values = [
        precision.take(row, axis=2) - gain * axis[:, None] * axis,
        pull.take(row, axis=1) - gain * pull_axis.take(chosen) * axis,
        *(values.take(chosen) for values in (constant, lam, centre, peak)),
        is_mislabelled.take(row),
    ]
    return ObjectComponents.of_objects(values, owner.take(row), np.log(objects.outlier[selected]))


def inverse(six: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the inverses (3, 3, m) and log determinants (m,) of packed positive definite matrices (6, m).

    By cofactors, ten times faster than the function of NumPy for the thousands of matrices of a scene.
    """
    a, b, c, d, e, f = six
    first, second, third = d * f - e * e, c * e - b * f, b * e - c * d
    det = a * first + b * second + c * third
    fourth, fifth, sixth = a * f - c * c, b * c - a * e, a * d - b * b
    cofactors = np.array([[first, second, third], [second, fourth, fifth], [third, fifth, sixth]])
    return cofactors / det, np.log(det)
