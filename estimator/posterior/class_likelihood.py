"""Log likelihoods of classes over log scale: one object in closed form, several over their shared error."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from estimator.posterior.class_error import Lines, SharedError, convolution, lines
from estimator.posterior.components import Rows
from estimator.posterior.symmetric import dot, product
from metric_base.arrays import FloatArray, IntArray

__all__ = ["ClassTerms", "joint_classes", "line_density", "single_classes"]


#: Points of a class's own grid over u' = u less the part of its error along 1. The product of many objects is narrow:
#: the class's own grid spans where it matters and no more.
OWN_POINTS, MOST_OWN_POINTS = 64, 512

#: Step of the own grid in standard deviations of the kernel at most: the sum is then exact to 1e-4.
KERNEL_STEPS = 1.5

#: A product this far under its peak (natural log) has no part in the answer, even where nothing else speaks.
DEEP = 25.0


@dataclass(frozen=True, slots=True, eq=False)
class ClassTerms:
    """Some classes' log likelihoods (c, g), and what the weights of their n objects need.

    outlier : (n, j, h) probability of being an outlier at each node and point of the own grid (j = 1 and h = g for
    lone objects); class_of : (n,) row of its class. Of classes with a shared error: log_node : (c, j, h) log mass of
    each node at u'; kernel : (c, g, h) density of u under u' over its peak.
    """

    classes: IntArray
    log_likelihood: FloatArray
    outlier: FloatArray
    class_of: IntArray
    log_node: FloatArray | None = None
    kernel: NDArray[np.float32] | None = None

    def weights(self, mass: FloatArray) -> FloatArray:
        """(n,) probability that each object is not an outlier under the posterior `mass` (g,)."""
        if self.log_node is None or self.kernel is None:
            return np.asarray(1 - self.outlier[:, 0] @ mass)
        # the posterior less this class, seen from u'; where there is no mass the quotient means nothing
        relative = np.maximum(self.log_likelihood - self.log_likelihood.max(axis=1, keepdims=True), -600)
        others = np.where(mass > 1e-12 * mass.max(), mass / np.exp(relative), 0.0)  # (c, g)
        others /= others.max(axis=1, keepdims=True)
        at_own = (others.astype(np.float32)[:, None, :] @ self.kernel)[:, 0]  # (c, h)
        joint = np.exp(self.log_node - self.log_node.max(axis=(1, 2), keepdims=True)) * at_own[:, None, :]
        total = joint.sum(axis=(1, 2), keepdims=True)
        seen = total > 0  # a known length so far off that no node sees it: all of the class are outliers
        joint /= np.where(seen, total, 1.0)
        joint = joint.astype(np.float32)[self.class_of]
        weight = 1 - (self.outlier * joint).sum(axis=(1, 2))
        return np.asarray(np.where(seen[self.class_of, 0, 0], weight, 0.0), dtype=float)


def single_classes(components: Rows, group: IntArray, u: FloatArray) -> ClassTerms:
    """Classes of one object each; `components` hold the class error in their covariances, group (n,) is the class."""
    floor = np.exp(components.log_floor)[:, None]
    density = line_density(components, u) + floor  # (n, g)
    return ClassTerms(group, np.log(density), (floor / density)[:, None, :], np.arange(len(group)))


def joint_classes(components: Rows, group: IntArray, errors: Sequence[SharedError], u: FloatArray) -> ClassTerms:
    """Classes of several objects, integrated over their shared errors: group (n,) is the class, errors its B.

    With v = u' a - b on the line of a node, each component is the exponential of a quadratic in u'. The middle node
    on the common grid u (g,) shows where each class's product matters; there all nodes are evaluated.
    """
    classes, first, class_of = np.unique(group, return_index=True, return_inverse=True)
    nodes = lines(components, class_of[components.object], np.array([errors[i].across for i in first]))
    middle_node = Lines(nodes.direction, nodes.offset[:, :1], nodes.log_weight[:, :1])
    log_first, _ = _log_products(components, middle_node, class_of, np.broadcast_to(u, (len(classes), len(u))))
    middle, half = _spans(log_first[:, 0], u)  # (c,)
    along_sd = np.array([errors[i].along_sd for i in first])
    needed = math.ceil(float((2 * half / (KERNEL_STEPS * along_sd)).max()))
    own = middle[:, None] + half[:, None] * _unit_powers(min(max(OWN_POINTS, needed), MOST_OWN_POINTS))[1]  # (c, h)
    log_node, outlier = _log_products(components, nodes, class_of, own)
    top = log_node.max(axis=(1, 2))[:, None]  # (c, 1)
    value = np.exp(log_node - top[:, None]).sum(axis=1)  # (c, h)
    smooth, kernel = convolution(value, own, u, along_sd)
    return ClassTerms(classes, np.log(np.maximum(smooth, 1e-300)) + top, outlier, class_of, log_node, kernel)


def _log_products(
    components: Rows, nodes: Lines, class_of: IntArray, grids: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Log of weight and product of each class at its nodes, (c, j, h), and outlier probabilities, (n, j, h).

    grids : (c, h) uniform. Each is brought to t in [-1, 1], so that all share the powers of t.
    """
    nodes = nodes.along(0.5 * (grids[:, 0] + grids[:, -1]), 0.5 * (grids[:, -1] - grids[:, 0]))
    powers = _unit_powers(grids.shape[1])
    floor = np.exp(components.log_floor).astype(np.float32)[:, None, None]
    density = _summed(_quadratics(components, nodes, class_of[components.object]), powers, components) + floor
    n, j, h = density.shape
    indicator = (class_of == np.arange(len(grids))[:, None]).astype(np.float32)  # (c, n)
    log_product = (indicator @ np.log(density).reshape(n, j * h)).reshape(-1, j, h)
    return log_product + nodes.log_weight.T @ powers, floor / density


def _quadratics(components: Rows, nodes: Lines, of_row: IntArray) -> NDArray[np.float32]:
    """Coefficients of t^2, t, 1 in the log of each component along each node's line, (m, j, 3); of_row : (m,) class."""
    a = nodes.direction.take(of_row, axis=1)  # (3, m)
    off = nodes.offset.take(of_row, axis=2) + components.residual[:, None]  # (3, j, m)
    turned = product(components.precision, off)
    found = np.empty((len(of_row), off.shape[1], 3), dtype=np.float32)
    found[:, :, 0] = -0.5 * dot(a, product(components.precision, a))[:, None]
    found[:, :, 1] = dot(a, turned).T
    found[:, :, 2] = (components.log_weight - 0.5 * dot(off, turned)).T
    return found


def _spans(log_product: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Middle and half width of where each class's product (c, g) on the common grid matters, a step to spare."""
    matters = log_product > log_product.max(axis=1, keepdims=True) - DEEP
    low = u[np.maximum(matters.argmax(axis=1) - 1, 0)]
    high = u[np.minimum(len(u) - matters[:, ::-1].argmax(axis=1), len(u) - 1)]
    return 0.5 * (low + high), 0.5 * (high - low)


def line_density(components: Rows, u: FloatArray) -> NDArray[np.float32]:
    """Each object's mixture on the line v = u 1, (n, g), without the outlier."""
    lam, middle = components.line_precision, 0.5 * (u[0] + u[-1])
    centre = components.line_centre - middle
    coefficients = np.array([-0.5 * lam, lam * centre, components.line_log_peak - 0.5 * lam * centre**2], np.float32)
    return _summed(coefficients.T[:, None], _powers(u - middle), components)[:, 0]


def _powers(t: FloatArray) -> FloatArray:
    """t^2, t, 1 as rows, (3, g)."""
    return np.array([t * t, t, np.ones_like(t)])


@lru_cache(maxsize=64)
def _unit_powers(points: int) -> FloatArray:
    return _powers(np.linspace(-1, 1, points))


def _summed(coefficients: NDArray[np.float32], powers: FloatArray, components: Rows) -> NDArray[np.float32]:
    """The exponentials of quadratics, (m, j, 3) coefficients, summed over each object's rows: (n, j, g).

    Single precision: exponents of a thousand are off by 1e-4, a tenth of what the nodes are, for a third of the time.
    """
    (m, j, _), g = coefficients.shape, powers.shape[1]
    values = (coefficients.reshape(m * j, 3) @ powers.astype(np.float32)).reshape(m, j * g)
    np.exp(values, out=values)
    total = np.empty((len(components.start), j * g), dtype=np.float32)
    ends = [*components.start[1:].tolist(), m]
    for own, start, end in zip(total, components.start.tolist(), ends, strict=True):
        np.add.reduce(values[start:end], axis=0, out=own)
    return total.reshape(-1, j, g)
