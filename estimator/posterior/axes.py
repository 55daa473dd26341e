"""The axes that a prior speaks of: length, width, height, or the extents in falling order."""

from __future__ import annotations

import numpy as np

from metric_base.arrays import IntArray
from metric_tree.axes import AXES, EXTENTS
from metric_tree.prior import Prior

__all__ = ["is_sorted", "prior_axes"]


def is_sorted(prior: Prior) -> bool:
    """Whether the prior is over sorted extents, not over length, width, height."""
    return prior.dims[0] in EXTENTS


def prior_axes(prior: Prior) -> IntArray:
    """(d,) place of each of the prior's dimensions among length, width, height, or among the sorted extents."""
    names = EXTENTS if is_sorted(prior) else AXES
    return np.array([names.index(name) for name in prior.dims])
