"""Many symmetric 3 x 3 matrices as six arrays (xx, xy, xz, yy, yz, zz), so that arithmetic runs over whole arrays.

NumPy's routines for stacks of small matrices take ten times as long on the thousands that a scene has. Vectors are
three arrays (x, y, z) that broadcast against the six.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from metric_base.arrays import FloatArray

#: Which of the six lie on the diagonal.
DIAGONAL = [0, 3, 5]
#: Row and column of the others.
OFF_DIAGONAL = {1: (0, 1), 2: (0, 2), 4: (1, 2)}

#: Six arrays or three: the rows of one array, or as many of their own.
Arrays = FloatArray | Sequence[FloatArray]


def pack(matrices: FloatArray) -> FloatArray:
    """(6, m) of symmetric matrices (m, 3, 3)."""
    return np.ascontiguousarray(matrices[:, (0, 0, 0, 1, 1, 2), (0, 1, 2, 1, 2, 2)].T)


def row_sums(six: Arrays) -> Sequence[FloatArray]:
    """Sums of the rows of each matrix: its product with (1, 1, 1)."""
    xx, xy, xz, yy, yz, zz = six
    return xx + xy + xz, xy + yy + yz, xz + yz + zz


def product(six: Arrays, vector: Arrays) -> Sequence[FloatArray]:
    """Each of m matrices (six arrays (m,)) times its vector (three arrays (m,))."""
    xx, xy, xz, yy, yz, zz = six
    x, y, z = vector
    return xx * x + xy * y + xz * z, xy * x + yy * y + yz * z, xz * x + yz * y + zz * z


def dot(one: Arrays, other: Arrays) -> FloatArray:
    """Inner products (m,) of m vectors, three arrays (m,) each."""
    return np.asarray(one[0] * other[0] + one[1] * other[1] + one[2] * other[2])


def total(vector: Arrays) -> FloatArray:
    """Sums (m,) of the components of m vectors, three arrays (m,)."""
    return np.asarray(vector[0] + vector[1] + vector[2])


def inverse(six: Arrays) -> tuple[Sequence[FloatArray], FloatArray]:
    """Inverses (six arrays (m,)) and log determinants (m,) of m positive matrices, by cofactors."""
    a, b, c, d, e, f = six
    first, second, third = d * f - e * e, c * e - b * f, b * e - c * d
    det = a * first + b * second + c * third
    cofactors = (first, second, third, a * f - c * c, b * c - a * e, a * d - b * b)
    return [cofactor / det for cofactor in cofactors], np.log(det)
