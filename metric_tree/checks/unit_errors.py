"""Sizes that differ from their class by the factor of a unit, compared with the class itself or with its siblings.

Such a row is reported and excluded from the release, never corrected: a correction requires the source.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from metric_base.arrays import FloatArray
from metric_base.statistics import MAD_TO_SIGMA
from metric_tree.axes import axis_assignments

#: Factors between units that are mistaken for each other and multiply every size of a row: mm, cm, dm, m, inch, foot,
#: and inch for cm. An inch for a foot, 12, cannot be distinguished from 10.
FACTORS = (10.0, 100.0, 1000.0, 25.4, 2.54, 304.8)

#: Factors of a misplaced decimal point, which multiplies one size of a row.
DECIMALS = (10.0, 100.0, 1000.0)

#: Minimum deviation of every size of a row in another unit, in robust standard deviations. That all sizes deviate and
#: fit one factor distinguishes an error from a small or large object of the class.
MIN_DEVIATIONS = 3.0

#: Minimum factor between such a size and its class.
MIN_ERROR_FACTOR = 2.2

#: Minimum deviation of a single wrong size, in robust standard deviations.
MIN_SINGLE_DEVIATIONS = 5.0

#: Maximum deviation of the other sizes of its row, in robust standard deviations.
MAX_OTHER_DEVIATIONS = 2.0

#: Maximum deviation of a size after division by the factor, in robust standard deviations.
MAX_CORRECTED_DEVIATIONS = 1.5

#: Deviation of ln size after division by the factor that is always accepted.
CORRECTED_LOG_TOLERANCE = 0.1

#: Minimum deviation of a size that no unit explains, in robust standard deviations: it cannot be of the class.
FAR_DEVIATIONS = 8.0

#: Minimum factor between such a size and its class.
FAR_FACTOR = 4.0

#: Minimum number of rows of a class that is its own reference.
MIN_REFERENCE_ROWS = 8

#: Minimum number of siblings of a class that has too few rows.
MIN_REFERENCE_SIBLINGS = 4

#: Minimum robust standard deviation of ln size of a class, so that a class of repeated sizes accepts similar ones.
MIN_LOG_SD = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """Location and scale of the sizes of a class, NaN for axes without data."""

    centre: FloatArray  #: (d,) median of ln mm.
    deviation: FloatArray  #: (d,) robust standard deviation of ln mm.


def class_reference(extents: FloatArray) -> Reference | None:
    """Return median and scaled median absolute deviation of ln extents (n, 3) mm; None below `MIN_REFERENCE_ROWS`.

    The axes of rows with fewer than three extents are unknown, so that such rows are used only if few rows are
    complete.
    """
    complete = ~np.isnan(extents).any(axis=1)
    logs = np.log(extents[complete] if complete.sum() >= MIN_REFERENCE_ROWS else extents)
    return _reference(logs, MIN_REFERENCE_ROWS, MIN_LOG_SD)


def sibling_reference(medians: FloatArray) -> Reference | None:
    """Return the reference of a class from the medians (c, d) of ln mm of its siblings; None if there are too few."""
    return _reference(medians, MIN_REFERENCE_SIBLINGS, float(np.log(MIN_ERROR_FACTOR)))


def _reference(logs: FloatArray, min_rows: int, min_sd: float) -> Reference | None:
    """Return median and robust standard deviation of ln mm (n, d), NaN for axes that fewer than `min_rows` state."""
    if len(logs) < min_rows:
        return None
    enough = (~np.isnan(logs)).sum(axis=0) >= min_rows
    centre, deviation = np.full(logs.shape[1], np.nan), np.full(logs.shape[1], np.nan)
    centre[enough] = np.nanmedian(logs[:, enough], axis=0)
    deviation[enough] = MAD_TO_SIGMA * np.nanmedian(np.abs(logs[:, enough] - centre[enough]), axis=0)
    return Reference(centre, np.maximum(deviation, min_sd))


def unit_error_factors(extents: FloatArray, reference: Reference) -> FloatArray:
    """Return the factor by which a size of each row is wrong.

    Parameters
    ----------
    extents : (n, 3) float
        Extents in mm, longest first, NaN beyond the last. The axes of a row with fewer than three are unknown; the
        assignment with the smallest deviation is used.
    reference : Reference
        Location and scale of the class.

    Returns
    -------
    (n,) float
        Factor of a unit, above 1 if the size is too large and below 1 if it is too small; inf if a size is far from the
        class and no unit explains it; 1 otherwise.
    """
    x, owner = axis_assignments(np.full_like(extents, np.nan), extents, "any")  # (m, 3), (m,)
    logs = np.log(x)
    known = ~np.isnan(logs) & ~np.isnan(reference.centre)  # (m, 3)
    offset = np.where(known, logs - reference.centre, 0.0)
    deviation = np.nan_to_num(reference.deviation, nan=1.0)
    deviations = np.abs(offset) / deviation
    units = np.log(np.array([*FACTORS, *(1 / factor for factor in FACTORS)]))  # (f,)
    tolerance = np.maximum(MAX_CORRECTED_DEVIATIONS * deviation, CORRECTED_LOG_TOLERANCE)[:, None]
    fits = np.abs(offset[:, :, None] - units) <= tolerance  # (m, 3, f)
    misfit = (np.abs(offset[:, :, None] - units) * known[:, :, None]).sum(axis=1)  # (m, f)

    # All sizes are in another unit; of a single size only a decimal factor is plausible.
    suspect = (deviations > MIN_DEVIATIONS) & (np.abs(offset) > np.log(MIN_ERROR_FACTOR))
    all_wrong = ((fits & suspect[:, :, None]) | ~known[:, :, None]).all(axis=1)  # (m, f)
    several = known.sum(axis=1, keepdims=True) >= 2
    decimal = np.array([round(float(np.exp(abs(unit))), 6) in DECIMALS for unit in units])  # (f,)
    all_wrong &= several | (decimal & (deviations.max(axis=1, keepdims=True) > MIN_SINGLE_DEVIATIONS))
    all_wrong &= known.any(axis=1, keepdims=True)

    # One of several sizes has a misplaced decimal point; axes without data have a deviation of 0.
    within = (deviations <= MAX_OTHER_DEVIATIONS).sum(axis=1, keepdims=True)
    single: NDArray[np.bool_] = np.asarray((deviations > MIN_SINGLE_DEVIATIONS) & (within == 2) & several)
    one_wrong = (fits & single[:, :, None]).any(axis=1) & decimal  # (m, f)

    explained = np.where(all_wrong | one_wrong, misfit, np.inf)
    far = (np.abs(offset) > np.maximum(FAR_DEVIATIONS * deviation, np.log(FAR_FACTOR))).any(axis=1)
    factor = np.exp(units)[explained.argmin(axis=1)]
    factor = np.where(np.isfinite(explained.min(axis=1)), factor, np.where(far, np.inf, 1.0))
    # An assignment to an axis without data of the class explains nothing.
    is_idle = (~np.isnan(logs) & np.isnan(reference.centre)).any(axis=1)
    suspicion = np.where(is_idle, np.inf, deviations.max(axis=1))
    best = np.lexsort((suspicion, owner))  # the least suspicious assignment of each row is first
    return factor[best][np.searchsorted(owner[best], np.arange(len(extents)))]
