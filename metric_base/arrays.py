"""Array types of all packages, whose docstrings state the shapes; selection and groups of rows."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

Scalar = TypeVar("Scalar", bound=np.generic)
Key = TypeVar("Key")
Value = TypeVar("Value")


def evenly_spaced(rows: NDArray[Scalar], maximum: int) -> NDArray[Scalar]:
    """Return at most `maximum` rows of an array (n, ...), at equal steps.

    >>> evenly_spaced(np.arange(10), 4)
    array([0, 3, 6, 9])
    """
    return rows[:: max(1, -(-len(rows) // maximum))]


def grouped(pairs: Iterable[tuple[Key, Value]]) -> dict[Key, list[Value]]:
    """Return the values of each key, in order.

    >>> grouped([("a", 1), ("b", 2), ("a", 3)])["a"]
    [1, 3]
    """
    groups: defaultdict[Key, list[Value]] = defaultdict(list)
    for key, value in pairs:
        groups[key].append(value)
    return groups
