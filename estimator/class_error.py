"""The error that the objects of one class share: e ~ N(0, B), integrated out of their product.

Catalogues are not streets: the sizes of a class differ between sources by more than chance, alike for every object of
one scene. With f(v) = prod_i p_i(v) the class says

    L_c(u) = E_e[ f(u 1 - e) ]                                              (methods.md, "The posterior")

B splits without remainder into the part along 1, a shift of u with variance s^2 = 1 / (1' B^-1 1), and the rest,
q = U z with z ~ N(0, I) and U U' = B - s^2 1 1', an error of the proportions (two numbers). Hence

    L_c(u) = integral of N(u - u'; 0, s^2) E_z[ f(u' 1 - U z) ] du'

The integral over u' is a sum on the class's own grid; the expectation over z is a cubature of seven nodes
(degree 5), centred and scaled for every u' where Gaussian stand-ins of the objects put the mass. A class with a
single object needs none of this: B is added to its components' covariances.

Against a tensor rule of 16^3 nodes (`tests/estimator/test_posterior.py`) the mean of L_c is off by less than 0.03 of
its standard deviation and that by less than 1 %; with an outlier among the objects, by 0.06 and 3 %.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from estimator.components import Rows
from estimator.likelihood import prior_axes
from estimator.scene import FloatArray, IntArray
from estimator.symmetric import product, row_sums, unpacked
from metric_tree.prior import Prior

__all__ = ["NODES", "NODE_WEIGHTS", "Lines", "SharedError", "convolved", "lines", "shared_error"]

#: Smallest standard deviation of the shared error in any direction, natural log. A class whose sources agree by
#: chance, or that has one source only, may still be 3 % off in a scene: the floor that the fit puts on spreads too.
FLOOR_SD = 0.03

#: Where the release says nothing of how a class's sources disagree (its B is under the floor in every direction): an
#: error of 8 % common to all dimensions and of 5 % in each, what cars of one continent are off on another's streets.
LONE_COMMON_SD = 0.08
LONE_OWN_SD = 0.05

#: Radon's seven-point rule for the standard Gaussian in the plane: exact for polynomials of degree 5.
_ANGLES = np.arange(6) * np.pi / 3
NODES: FloatArray = np.concatenate([np.zeros((1, 2)), 2.0 * np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=1)])
NODE_WEIGHTS: FloatArray = np.array([1 / 2] + [1 / 12] * 6)

#: The stand-ins' precision is trusted by this part when nodes are placed. They overstate it where an object is an
#: outlier or of another component; nodes too wide cost little, nodes too narrow miss mass.
TRUST = 0.5


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

    direction : (c, 3); offset : (c, j, 3); log_weight : (c, j, 3) coefficients of u'^2, u', 1.
    """

    direction: FloatArray
    offset: FloatArray
    log_weight: FloatArray


@lru_cache(maxsize=4096)
def shared_error(prior: Prior) -> SharedError:
    """The shared error of a prior's class, floored, on the axes of `rows`."""
    axes = prior_axes(prior)
    d = len(axes)
    values, vectors = np.linalg.eigh(prior.shared_covariance)
    if values.max() < FLOOR_SD**2:
        values, vectors = np.linalg.eigh(LONE_COMMON_SD**2 + LONE_OWN_SD**2 * np.eye(d))
    b = (vectors * np.maximum(values, FLOOR_SD**2)) @ vectors.T  # (d, d)
    along = 1.0 / np.linalg.inv(b).sum()
    values, vectors = np.linalg.eigh(b - along)
    across = (vectors * np.sqrt(np.maximum(values, 0)))[:, ::-1][:, : min(d - 1, 2)]  # (d, d - 1)
    covariance, padded = np.zeros((3, 3)), np.zeros((3, 2))
    covariance[axes[:, None], axes] = b
    padded[axes, : across.shape[1]] = across
    return SharedError(covariance, float(np.sqrt(along)), padded)


def lines(rows: Rows, group: IntArray, across: FloatArray) -> Lines:
    """The nodes' lines of c classes.

    Parameters
    ----------
    rows : components of the objects
    group : (m,) class of each row
    across : (c, 3, 2) U of each class

    Returns
    -------
    Lines, from the stand-in f(v) = exp(-(v' L v) / 2 + h' v), L and h the sums of the objects' expected precision:
    given u', z has precision P = I + U' L U and mean P^-1 U' (L 1 u' - h).
    """
    share = _shares(rows, across.T[:, :, group])  # (m,)
    weighted = rows.columns[[*range(6), *range(9, 12)]] * (share * TRUST)  # (9, m) Lam and Lam r
    sums = weighted @ (group[:, None] == np.arange(len(across)))  # (9, c)
    information, pull = unpacked(sums[:6]), sums[6:].T
    turned = across.transpose(0, 2, 1)  # (c, 2, 3)
    precision = np.eye(2) + turned @ information @ across  # (c, 2, 2)
    covariance = np.linalg.inv(precision)
    slope = (covariance @ turned @ information.sum(axis=2)[:, :, None])[:, :, 0]  # (c, 2)
    start = -(covariance @ turned @ pull[:, :, None])[:, :, 0]  # (c, 2)
    spread = NODES @ np.linalg.cholesky(covariance).transpose(0, 2, 1)  # (c, j, 2)
    fixed = start[:, None, :] + spread  # (c, j, 2)
    log_ratio = np.stack(
        [
            np.broadcast_to(-0.5 * (slope**2).sum(axis=1)[:, None], fixed.shape[:2]),
            -(fixed @ slope[:, :, None])[:, :, 0],
            -0.5 * (fixed**2).sum(axis=2)
            + 0.5 * (NODES**2).sum(axis=1)
            + np.log(NODE_WEIGHTS)
            + 0.5 * np.log(np.linalg.det(covariance))[:, None],
        ],
        axis=2,
    )
    return Lines(1.0 - (across @ slope[:, :, None])[:, :, 0], fixed @ turned, log_ratio)


def convolved(
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
    shrunk = inverse / math.sqrt(2)
    kernel = (u * shrunk).astype(np.float32)[:, :, None] - (own * shrunk).astype(np.float32)[:, None, :]
    np.square(kernel, out=kernel)
    np.negative(kernel, out=kernel)
    np.exp(kernel, out=kernel)
    step = (own[:, 1] - own[:, 0])[:, None]
    weighted = values * (step * inverse / math.sqrt(2 * math.pi))
    weighted[:, [0, -1]] *= 0.5  # trapezoids: the ends' other halves belong to the tails
    inside = (kernel @ weighted.astype(np.float32)[:, :, None])[:, :, 0]
    left, right = _below((own[:, :1] - u) * inverse), _below((u - own[:, -1:]) * inverse)
    return inside + left * values[:, :1] + right * values[:, -1:], kernel


def _below(z: FloatArray) -> FloatArray:
    """Normal distribution function to 3e-4 by a tanh (Page 1977): enough for tails, without SciPy's import."""
    z = np.clip(z, -8, 8)
    return np.asarray(0.5 * (1 + np.tanh(math.sqrt(2 / math.pi) * (z + 0.044715 * (z * z * z)))))


def _shares(rows: Rows, across: FloatArray) -> FloatArray:
    """Each row's share of its object by the evidence of its proportions, the outlier having one too, (m,).

    With M = Lam - Lam 1 1' Lam / lam the precision across the line and q = U z integrated out, the log evidence is
    that of the line, plus b' P^-1 b / 2 - ln|P| / 2, b = U' M r, P = I + U' M U; across : (2, 3, m) U of each row.
    """
    one, other = across
    along = row_sums(rows.precision)  # (3, m) Lam 1
    along_one, along_other = (along * one).sum(axis=0), (along * other).sum(axis=0)  # (m,)
    b0 = (rows.pull * one).sum(axis=0) - along_one * rows.line_centre
    b1 = (rows.pull * other).sum(axis=0) - along_other * rows.line_centre
    turned_one, turned_other = product(rows.precision, one), product(rows.precision, other)  # (3, m) Lam U
    p00 = 1 + (one * turned_one).sum(axis=0) - along_one**2 / rows.line_precision
    p01 = (one * turned_other).sum(axis=0) - along_one * along_other / rows.line_precision
    p11 = 1 + (other * turned_other).sum(axis=0) - along_other**2 / rows.line_precision
    det = p00 * p11 - p01 * p01
    evidence = rows.line_log_peak + 0.5 * ((p11 * b0 * b0 - 2 * p01 * b0 * b1 + p00 * b1 * b1) / det - np.log(det))
    top = np.maximum(np.maximum.reduceat(evidence, rows.start), rows.log_floor)
    raw = np.exp(evidence - top[rows.object])
    total = np.add.reduceat(raw, rows.start) + np.exp(rows.log_floor - top)
    return np.asarray(raw / total[rows.object])
