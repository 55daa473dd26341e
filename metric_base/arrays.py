"""Array types of all packages; docstrings state the shapes."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

Scalar = TypeVar("Scalar", bound=np.generic)


def evenly_spaced(rows: NDArray[Scalar], maximum: int) -> NDArray[Scalar]:
    """Return at most `maximum` rows of an array (n, ...), at equal steps.

    >>> evenly_spaced(np.arange(10), 4)
    array([0, 3, 6, 9])
    """
    return rows[:: max(1, -(-len(rows) // maximum))]
