"""Sizes that stand a unit's factor away from their class: found against the class itself and against its siblings.

A slip is flagged and kept out of the release, never mended: whoever mends it must look at the source.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from metric_tree.prior import FloatArray

__all__ = ["FACTORS", "Reference", "reference", "sibling_reference", "slipped"]

#: Units mistaken for each other: mm, cm, dm, m, inch, foot, and inch for centimetre.
FACTORS = (10.0, 100.0, 1000.0, 25.4, 2.54, 304.8, 12.0)

#: Robust deviations beyond which a size is suspect, and the least factor that is: among a hundred rows of a class one
#: lies four deviations out only if the class is mixed, and sizes of one kind of thing double now and then.
DEVIATIONS, LEAST_FACTOR = 4.0, 2.2

#: A mended slip lies this close to its class, in robust deviations and (as ln) in any case.
MENDED_DEVIATIONS, MENDED = 1.5, 0.1

#: What no unit explains is kept out only where it cannot be of the class: eight deviations and a factor of four.
FAR_DEVIATIONS, FAR_FACTOR = 8.0, 4.0

#: Rows from which a class is its own reference.
ENOUGH = 8

#: Least robust deviation of ln size: a tenth, so that a class of one repeated figure does not refuse its neighbours.
LEAST_SD = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """Where the sizes of a class lie: centre (d,) and robust deviation (d,) of ln mm; NaN where nothing is known."""

    centre: FloatArray
    deviation: FloatArray


def reference(logs: FloatArray) -> Reference | None:
    """Median and scaled median absolute deviation of ln sizes (n, d); None of fewer than `ENOUGH` rows."""
    if len(logs) < ENOUGH:
        return None
    enough = (~np.isnan(logs)).sum(axis=0) >= ENOUGH
    centre, deviation = np.full(logs.shape[1], np.nan), np.full(logs.shape[1], np.nan)
    centre[enough] = np.nanmedian(logs[:, enough], axis=0)
    deviation[enough] = 1.4826 * np.nanmedian(np.abs(logs[:, enough] - centre[enough]), axis=0)
    return Reference(centre, np.maximum(deviation, LEAST_SD))


def sibling_reference(medians: FloatArray) -> Reference | None:
    """The reference of a thin class from its siblings' medians (c, d) of ln mm; None of fewer than four."""
    if len(medians) < ENOUGH // 2:
        return None
    known = (~np.isnan(medians)).sum(axis=0) >= ENOUGH // 2
    centre, deviation = np.full(medians.shape[1], np.nan), np.full(medians.shape[1], np.nan)
    centre[known] = np.nanmedian(medians[:, known], axis=0)
    deviation[known] = 1.4826 * np.nanmedian(np.abs(medians[:, known] - centre[known]), axis=0)
    return Reference(centre, np.maximum(deviation, np.log(LEAST_FACTOR)))


def slipped(logs: FloatArray, against: Reference) -> NDArray[np.float64]:
    """Of each row the factor by which a size is off: a unit's, inf where far out unexplained, 1 where all is well.

    Parameters
    ----------
    logs : (n, d) ln mm, NaN where missing

    Returns
    -------
    (n,) float, over 1 for too large, under 1 for too small
    """
    offset = np.nan_to_num(logs - against.centre)  # (n, d); what is unknown is not suspect
    deviation = np.nan_to_num(against.deviation, nan=np.inf)
    suspect = np.abs(offset) > np.maximum(DEVIATIONS * deviation, np.log(LEAST_FACTOR))
    units = np.log(np.array([*FACTORS, *(1 / factor for factor in FACTORS)]))
    apart = np.abs(offset[:, :, None] - units)  # (n, d, f)
    close = apart.min(axis=2) <= np.maximum(MENDED_DEVIATIONS * deviation, MENDED)
    far = np.abs(offset) > np.maximum(FAR_DEVIATIONS * deviation, np.log(FAR_FACTOR))
    factor = np.where(suspect & close, np.exp(units)[apart.argmin(axis=2)], np.where(suspect & far, np.inf, 1.0))
    worst = np.argmax(np.abs(np.where(factor == 1.0, 0.0, offset)), axis=1)
    found: NDArray[np.float64] = factor[np.arange(len(logs)), worst]
    return found
