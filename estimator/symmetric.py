"""Many symmetric 3 x 3 matrices as six arrays (xx, xy, xz, yy, yz, zz), so that arithmetic runs over whole arrays.

NumPy's routines for stacks of small matrices take ten times as long on the thousands that a scene has.
"""

from __future__ import annotations

import numpy as np

from estimator.scene import FloatArray

__all__ = ["COLUMN", "DIAGONAL", "ROW", "inverse", "packed", "product", "row_sums", "unpacked"]

#: Row and column of each of the six, and which of them lie on the diagonal.
ROW, COLUMN = (0, 0, 0, 1, 1, 2), (0, 1, 2, 1, 2, 2)
DIAGONAL = [0, 3, 5]

_PLACES = (0, 1, 2, 1, 3, 4, 2, 4, 5)


def packed(matrices: FloatArray) -> FloatArray:
    """(6, m) of symmetric matrices (m, 3, 3)."""
    return np.ascontiguousarray(matrices[:, ROW, COLUMN].T)


def unpacked(six: FloatArray) -> FloatArray:
    """(m, 3, 3) of packed matrices (6, m)."""
    return six[_PLACES, :].T.reshape(-1, 3, 3)


def row_sums(six: FloatArray) -> FloatArray:
    """(3, m) sums of the rows of packed matrices (6, m)."""
    xx, xy, xz, yy, yz, zz = six
    return np.stack([xx + xy + xz, xy + yy + yz, xz + yz + zz])


def product(six: FloatArray, vectors: FloatArray) -> FloatArray:
    """(3, ..., m) packed matrices (6, m) times vectors (3, ..., m)."""
    xx, xy, xz, yy, yz, zz = six
    x, y, z = vectors
    return np.stack([xx * x + xy * y + xz * z, xy * x + yy * y + yz * z, xz * x + yz * y + zz * z])


def inverse(six: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Inverses (6, m) and log determinants (m,) of packed positive matrices (6, m), by cofactors."""
    a, b, c, d, e, f = six
    first = np.stack([d * f - e * e, c * e - b * f, b * e - c * d])
    det = a * first[0] + b * first[1] + c * first[2]
    rest = np.stack([a * f - c * c, b * c - a * e, a * d - b * b])
    return np.concatenate([first, rest]) / det, np.log(det)
