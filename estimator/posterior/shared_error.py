"""The error that the objects of one class share: e ~ N(0, B), integrated out of their product.

Catalogues are not streets: the sizes of a class differ between sources by more than chance, alike for every object of
one scene. With f(v) = prod_i p_i(v) the class says

    L_c(u) = E_e[ f(u 1 - e) ]                                              (docs/explanation/posterior.md)

B splits without remainder into the part along 1, a shift of u with variance s^2 = 1 / (1' B^-1 1), and the rest,
q = U z with z ~ N(0, I) and U U' = B - s^2 1 1', an error of the proportions (two numbers). Hence

    L_c(u) = integral of N(u - u'; 0, s^2) E_z[ f(u' 1 - U z) ] du'

The integral over u' is a sum on the class's own grid; the expectation over z is a cubature of seven nodes
(degree 5), centred and scaled for every u' where Gaussian stand-ins of the objects put the mass. A class with a
single object needs none of this: B is added to its components' covariances.

Against the plain sum of `definition` (`tests/estimator/posterior/test_posterior.py`) the mean of L_c is off by less
than 0.04 of its standard deviation and that by less than 3 %; with a wrong object among three or six, by 0.15, 12 %.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from estimator.posterior.axis_assignments import prior_axes
from estimator.posterior.symmetric_matrices import dot, product, total
from metric_base.arrays import BoolArray, FloatArray, IntArray
from metric_tree.prior import Prior

#: Radon's seven-point rule for the standard Gaussian in the plane: exact for polynomials of degree 5.
_ANGLES = np.arange(6) * np.pi / 3
NODES: FloatArray = np.concatenate([np.zeros((1, 2)), 2.0 * np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=1)])
NODE_WEIGHTS: FloatArray = np.array([1 / 2] + [1 / 12] * 6)
_LOG_NODE: FloatArray = np.log(NODE_WEIGHTS) + 0.5 * (NODES**2).sum(axis=1)
#: The stand-ins' precision is trusted by this part when nodes are placed. They overstate it where an object is an
#: outlier or of another component; nodes too wide cost little, nodes too narrow miss mass.
NODE_PRECISION_SHARE = 0.5
#: Exponentials of less are nothing beside an outlier's floor or a tail. Under -87 single precision has numbers
#: without a leading one, with which sums and products take eight times as long.
LEAST_EXPONENT = np.float32(-60.0)


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


@dataclass(frozen=True, slots=True, eq=False)
class SharedError:
    """B of one class on the three axes (zero on axes without a prior) and its split.

    covariance : (3, 3); along_sd : s; across : (3, 2) U.
    """

    covariance: FloatArray
    along_sd: float
    across: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Lines:
    """Where the nodes of c classes run through v-space as u' moves: v = u' direction - offset.

    direction : (3, c); offset : (3, j, c); log_weight : (3, j, c) coefficients of u'^2, u', 1.
    """

    direction: FloatArray
    offset: FloatArray
    log_weight: FloatArray

    def middle(self) -> Lines:
        """The middle node's alone."""
        return Lines(self.direction, self.offset[:, :1], self.log_weight[:, :1])

    def of(self, kept: BoolArray) -> Lines:
        """The lines of the classes of a mask (c,)."""
        return Lines(self.direction[:, kept], self.offset[:, :, kept], self.log_weight[:, :, kept])

    def along(self, middle: FloatArray, half: FloatArray) -> Lines:
        """The same lines as functions of t, u' = middle + half t; middle, half : (c,)."""
        a, b, c = self.log_weight
        log_weight = np.array([a * half**2, (2 * a * middle + b) * half, (a * middle + b) * middle + c])
        offset = self.offset - (middle * self.direction)[:, None]
        return Lines(half * self.direction, offset, log_weight)


@lru_cache(maxsize=4096)
def shared_error(prior: Prior) -> SharedError:
    """The shared error of a prior's class, floored, on the axes of `rows`."""
    return split_error(prior.disagreement(), prior_axes(prior))


def split_error(b: FloatArray, axes: IntArray) -> SharedError:
    """The shared error of covariance b (d, d) on the places `axes` (d,), split along 1 and across it."""
    d = len(axes)
    along = 1.0 / np.linalg.inv(b).sum()
    values, vectors = np.linalg.eigh(b - along)
    across = (vectors * np.sqrt(np.maximum(values, 0)))[:, ::-1][:, : min(d - 1, 2)]  # (d, d - 1)
    covariance, padded = np.zeros((3, 3)), np.zeros((3, 2))
    covariance[axes[:, None], axes] = b
    padded[axes, : across.shape[1]] = across
    return SharedError(covariance, float(np.sqrt(along)), padded)


def lines(rows: DimensionRows, group: IntArray, across: FloatArray, power: FloatArray) -> Lines:
    """The nodes' lines of c classes.

    Parameters
    ----------
    rows : components of the objects
    group : (n,) class of each object
    across : (c, 3, 2) U of each class
    power : (c,) exponent of each class's objects in the product

    Returns
    -------
    Lines, from the stand-in f(v) = exp(-(v' L v) / 2 + h' v), L and h the sums of the objects' expected precision:
    given u', z has precision P = I + U' L U and mean P^-1 U' (L 1 u' - h).
    """
    columns = across.transpose(1, 2, 0)  # (3, 2, c)
    share = _shares(rows, columns.take(group[rows.object], axis=2))  # (m,)
    weighted = rows.columns[[*range(6), *range(9, 12)]] * share  # (9, m) Lam and Lam r
    belongs = (group[:, None] == np.arange(len(across))) * (power * NODE_PRECISION_SHARE)  # (n, c)
    sums = np.add.reduceat(weighted, rows.start, axis=1) @ belongs  # (9, c) L and h
    turned = product(sums[:6], columns)  # L U
    p00, p11 = 1 + dot(columns, turned)  # (c,)
    p01 = dot(columns[:, 0], [column[1] for column in turned])
    det = p00 * p11 - p01 * p01
    inverse = np.array([[p11, -p01], [-p01, p00]]) / det  # (2, 2, c)
    slope = (inverse * total(turned)).sum(axis=1)  # (2, c)
    start = -(inverse * dot(columns, sums[6:])).sum(axis=1)
    # the nodes are spread by the Cholesky factor of P^-1
    spread = np.sqrt(p11 / det)
    placed = [NODES[:, :1] * spread, NODES[:, 1:] / np.sqrt(p11) - NODES[:, :1] * (p01 / det / spread)]
    fixed = start[:, None] + placed  # (2, j, c)
    square = np.broadcast_to((slope**2).sum(axis=0), fixed.shape[1:])
    constant = _LOG_NODE[:, None] - 0.5 * ((fixed**2).sum(axis=0) + np.log(det))
    log_weight = np.array([-0.5 * square, -(fixed * slope[:, None]).sum(axis=0), constant])
    return Lines(1.0 - (columns * slope).sum(axis=1), (columns[:, :, None] * fixed).sum(axis=1), log_weight)


def convolution(
    values: FloatArray, own: FloatArray, u: FloatArray, along_sd: FloatArray
) -> tuple[FloatArray, NDArray[np.float32]]:
    """Functions of u' on uniform grids under a Gaussian each, as functions of u, and the kernels.

    Parameters
    ----------
    values, own : (c, h) function values and their points u'
    u : (g,) points of the result
    along_sd : (c,) standard deviation of u about u'

    Returns
    -------
    (c, g) and (c, g, h) of peak one, in single precision: 1e-38 of a peak is nothing. Beyond its ends a
    function goes on as its end values, which is what the outliers' floor does.
    """
    inverse = 1 / along_sd[:, None]
    shrunk, middle = inverse / math.sqrt(2), own.mean(axis=1, keepdims=True)
    far, near = (u - middle) * shrunk, (own - middle) * shrunk  # (c, g) and (c, h)
    # -(far - near)^2 as a product of three: half the time of squares on the whole
    left = np.array([-far * far, 2 * far, np.ones_like(far)], dtype=np.float32).transpose(1, 2, 0)
    kernel = left @ np.array([np.ones_like(near), near, -near * near], dtype=np.float32).transpose(1, 0, 2)
    exponentials(kernel)
    step = (own[:, 1] - own[:, 0])[:, None]
    weighted = values * (step * inverse / math.sqrt(2 * math.pi))
    weighted[:, 0] *= 0.5  # trapezoids: the ends' other halves belong to the tails
    weighted[:, -1] *= 0.5
    inside = (kernel @ weighted.astype(np.float32)[:, :, None])[:, :, 0]
    before, after = _below(np.array([own[:, :1] - u, u - own[:, -1:]]) * inverse)
    return inside + before * values[:, :1] + after * values[:, -1:], kernel


def exponentials(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """The exponentials of an array of any shape, in its place; those under `LEAST_EXPONENT` are of that."""
    np.maximum(values, LEAST_EXPONENT, out=values)
    return np.exp(values, out=values)


def _below(z: FloatArray) -> FloatArray:
    """Normal distribution function, of any shape, to 3e-4 by a tanh (Page 1977): enough for tails, without SciPy."""
    return np.asarray(0.5 * (1 + np.tanh(math.sqrt(2 / math.pi) * (z + 0.044715 * (z * z * z)))))


def _shares(rows: DimensionRows, across: FloatArray) -> FloatArray:
    """Each row's share of its object by the evidence of its proportions, the outlier having one too, (m,).

    With M = Lam - Lam 1 1' Lam / lam the precision across the line and q = U z integrated out, the log evidence is
    that of the line, plus b' P^-1 b / 2 - ln|P| / 2, b = U' M r, P = I + U' M U; across : (3, 2, m) U of each row.
    """
    turned = product(rows.precision, across)  # Lam U
    along = total(turned)  # (2, m) 1' Lam U
    b0, b1 = dot(rows.pull, across) - along * rows.line_centre
    p00, p11 = 1 + dot(across, turned) - along**2 / rows.line_precision
    p01 = dot(across[:, 0], [column[1] for column in turned]) - along[0] * along[1] / rows.line_precision
    det = p00 * p11 - p01 * p01
    evidence = rows.line_log_peak + 0.5 * ((p11 * b0 * b0 - 2 * p01 * b0 * b1 + p00 * b1 * b1) / det - np.log(det))
    top = np.maximum(np.maximum.reduceat(evidence, rows.start), rows.log_floor)
    raw = np.exp(evidence - top[rows.object])
    whole = np.add.reduceat(raw, rows.start) + np.exp(rows.log_floor - top)
    return np.asarray(raw / whole[rows.object])
