"""The Gaussian components of a scene's objects as flat columns, and what each is on the line of one common scale."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from metric_base.arrays import FloatArray, IntArray

__all__ = ["DimensionRows"]


@dataclass(frozen=True, slots=True, eq=False)
class DimensionRows:
    """The components of n objects as m flat rows, grouped by object.

    columns : (16, m), see the properties; object : (m,) row of the object; start : (n,) first row of each object;
    log_floor : (n,) log weight of the outlier. On the line v = u 1 a row is
    exp(line_log_peak) exp(-line_precision (u - line_centre)^2 / 2).
    """

    columns: FloatArray
    object: IntArray
    start: IntArray
    log_floor: FloatArray

    @property
    def precision(self) -> FloatArray:
        """Lam, (6, m) packed (`symmetric`), zero on axes that do not count."""
        return self.columns[:6]

    @property
    def residual(self) -> FloatArray:
        """r, (3, m)."""
        return self.columns[6:9]

    @property
    def pull(self) -> FloatArray:
        """Lam r, (3, m)."""
        return self.columns[9:12]

    @property
    def log_weight(self) -> FloatArray:
        """(m,), the Gaussian's own constant included."""
        return np.asarray(self.columns[12])

    @property
    def line_precision(self) -> FloatArray:
        """Lam = 1' Lam 1, (m,)."""
        return np.asarray(self.columns[13])

    @property
    def line_centre(self) -> FloatArray:
        """u_hat = 1' Lam r / lam, (m,)."""
        return np.asarray(self.columns[14])

    @property
    def line_log_peak(self) -> FloatArray:
        """(m,), the evidence of the proportions included."""
        return np.asarray(self.columns[15])

    def of(self, objects: IntArray) -> DimensionRows:
        """The rows of some objects (k,), given in rising order and numbered anew."""
        place = np.full(len(self.log_floor), -1)
        place[objects] = np.arange(len(objects))
        owner = place[self.object]
        rows = np.flatnonzero(owner >= 0)
        return DimensionRows.of_objects(self.columns.take(rows, axis=1), owner[rows], self.log_floor[objects])

    @classmethod
    def of_objects(cls, columns: FloatArray, owner: IntArray, log_floor: FloatArray) -> DimensionRows:
        """Columns (16, m) whose owners (m,) do not fall and leave no object out."""
        return cls(columns, owner, np.searchsorted(owner, np.arange(len(log_floor))), log_floor)
