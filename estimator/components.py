"""The Gaussian components of a scene's objects as flat columns, and what each is on the line of one common scale."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.scene import BoolArray, FloatArray, IntArray

__all__ = ["Rows"]


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
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

    def of(self, objects: IntArray) -> Rows:
        """The rows of some objects, given in rising order and numbered anew."""
        place = np.full(len(self.log_floor), -1)
        place[objects] = np.arange(len(objects))
        owner = place[self.object]
        return self._kept(owner >= 0, owner, self.log_floor[objects])

    def pruned(self, log_negligible: FloatArray) -> Rows:
        """Without the rows whose peak is under a part of their object's highest, (m,) natural log."""
        highest = np.maximum.reduceat(self.line_log_peak, self.start)  # (n,)
        keep = self.line_log_peak >= highest[self.object] + log_negligible
        return self._kept(keep, self.object, self.log_floor)

    def _kept(self, keep: BoolArray, owner: IntArray, log_floor: FloatArray) -> Rows:
        rows = np.flatnonzero(keep)
        owner = owner[rows]
        start = np.searchsorted(owner, np.arange(len(log_floor)))
        return Rows(self.columns.take(rows, axis=1), owner, start, log_floor)
