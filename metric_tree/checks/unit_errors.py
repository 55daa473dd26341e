"""Sizes that stand a unit's factor away from their class: found against the class itself and against its siblings.

A slip is flagged and kept out of the release, never mended: whoever mends it must look at the source.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from metric_base.arrays import FloatArray
from metric_base.statistics import MAD_TO_SIGMA
from metric_tree.axes import axis_assignments

#: Units mistaken for each other, which puts every size of a row off by one factor: mm, cm, dm, m, inch, foot, and inch
#: for centimetre. An inch for a foot, 12, could not be told from 10.
FACTORS = (10.0, 100.0, 1000.0, 25.4, 2.54, 304.8)

#: A point set wrong puts one size of a row off by one of these, the others being right.
DECIMALS = (10.0, 100.0, 1000.0)

#: Robust deviations, and the least factor, beyond which every size of a row in another unit lies. That all of them do
#: and fit one factor is what separates a slip from a small or large object of the class.
DEVIATIONS, LEAST_FACTOR = 3.0, 2.2

#: A single size that is off lies this far out, the others of its row within two deviations.
ALONE_DEVIATIONS, OTHERS_DEVIATIONS = 5.0, 2.0

#: A mended slip lies this close to its class, in robust deviations and (as ln) in any case.
MENDED_DEVIATIONS, MENDED = 1.5, 0.1

#: What no unit explains is kept out only where it cannot be of the class: eight deviations and a factor of four.
FAR_DEVIATIONS, FAR_FACTOR = 8.0, 4.0

#: Rows from which a class is its own reference.
MIN_REFERENCE_ROWS = 8

#: Least robust deviation of ln size: a tenth, so that a class of one repeated figure does not refuse its neighbours.
LEAST_SD = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """Where the sizes of a class lie: centre (d,) and robust deviation (d,) of ln mm; NaN where nothing is known."""

    centre: FloatArray
    deviation: FloatArray


def reference(extents: FloatArray) -> Reference | None:
    """Median and scaled median absolute deviation of ln extents (n, 3) mm; None below `MIN_REFERENCE_ROWS`.

    Rows that state fewer than three extents do not say which, and only count where few state all.
    """
    complete = ~np.isnan(extents).any(axis=1)
    logs = np.log(extents[complete] if complete.sum() >= MIN_REFERENCE_ROWS else extents)
    if len(logs) < MIN_REFERENCE_ROWS:
        return None
    return _reference(logs, MIN_REFERENCE_ROWS, LEAST_SD)


def sibling_reference(medians: FloatArray) -> Reference | None:
    """The reference of a thin class from its siblings' medians (c, d) of ln mm; None of fewer than four."""
    if len(medians) < MIN_REFERENCE_ROWS // 2:
        return None
    return _reference(medians, MIN_REFERENCE_ROWS // 2, float(np.log(LEAST_FACTOR)))


def _reference(logs: FloatArray, least: int, least_sd: float) -> Reference:
    """Median and spread of ln mm (n, d), axis by axis, NaN where fewer than `least` rows state it."""
    enough = (~np.isnan(logs)).sum(axis=0) >= least
    centre, deviation = np.full(logs.shape[1], np.nan), np.full(logs.shape[1], np.nan)
    centre[enough] = np.nanmedian(logs[:, enough], axis=0)
    deviation[enough] = MAD_TO_SIGMA * np.nanmedian(np.abs(logs[:, enough] - centre[enough]), axis=0)
    return Reference(centre, np.maximum(deviation, least_sd))


def slip_factors(extents: FloatArray, against: Reference) -> FloatArray:
    """Of each row the factor by which a size is off: a unit's, inf where far out unexplained, 1 where all is well.

    Parameters
    ----------
    extents : (n, 3) mm, longest first, NaN beyond the last. Of a row that states fewer than three, each may be any of
        the class's: the least suspicious reading counts.

    Returns
    -------
    (n,) float, over 1 for too large, under 1 for too small
    """
    x, owner = axis_assignments(np.full_like(extents, np.nan), extents, "any")
    factor, suspicion = _factors(np.log(x), against)
    best = np.lexsort((suspicion, owner))  # of each row's readings the least suspicious first
    return factor[best][np.searchsorted(owner[best], np.arange(len(extents)))]


def _factors(logs: FloatArray, against: Reference) -> tuple[FloatArray, FloatArray]:
    """Of each reading (m, 3) in ln mm its factor (m,) and how far out it lies (m,), in robust deviations."""
    known = ~np.isnan(logs) & ~np.isnan(against.centre)  # (m, 3); what the class does not state is not suspect
    offset = np.where(known, logs - against.centre, 0.0)
    deviation = np.nan_to_num(against.deviation, nan=1.0)
    out = np.abs(offset) / deviation
    units = np.log(np.array([*FACTORS, *(1 / factor for factor in FACTORS)]))
    mended = np.maximum(MENDED_DEVIATIONS * deviation, MENDED)[:, None]
    fits = np.abs(offset[:, :, None] - units) <= mended  # (m, 3, f)
    misfit = (np.abs(offset[:, :, None] - units) * known[:, :, None]).sum(axis=1)  # (m, f)

    suspect = (out > DEVIATIONS) & (np.abs(offset) > np.log(LEAST_FACTOR))
    whole = ((fits & suspect[:, :, None]) | ~known[:, :, None]).all(axis=1)  # (m, f)
    several = known.sum(axis=1, keepdims=True) >= 2
    decimal = np.array([round(float(np.exp(abs(unit))), 6) in DECIMALS for unit in units])  # (f,)
    whole &= several | (decimal & (out.max(axis=1, keepdims=True) > ALONE_DEVIATIONS))
    whole &= known.any(axis=1, keepdims=True)

    within = (out <= OTHERS_DEVIATIONS).sum(axis=1, keepdims=True)  # an axis that is not stated lies at 0
    alone: NDArray[np.bool_] = np.asarray((out > ALONE_DEVIATIONS) & (within == 2) & several)
    single = (fits & alone[:, :, None]).any(axis=1) & decimal  # (m, f)

    explained = np.where(whole | single, misfit, np.inf)
    far = (np.abs(offset) > np.maximum(FAR_DEVIATIONS * deviation, np.log(FAR_FACTOR))).any(axis=1)
    factor = np.exp(units)[explained.argmin(axis=1)]
    factor = np.where(np.isfinite(explained.min(axis=1)), factor, np.where(far, np.inf, 1.0))
    # a reading that puts a size where the class states none explains nothing
    idle = (~np.isnan(logs) & np.isnan(against.centre)).any(axis=1)
    return factor, np.where(idle, np.inf, out.max(axis=1))
