"""Log likelihoods of classes over log scale: one object in closed form, several over their shared error."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.class_error import Lines, SharedError, convolved, lines
from estimator.likelihood import Rows
from estimator.scene import FloatArray, IntArray

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
        joint /= joint.sum(axis=(1, 2), keepdims=True)
        joint = joint.astype(np.float32)[self.class_of]
        return np.asarray(1 - (self.outlier * joint).sum(axis=(1, 2)), dtype=float)


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
    of_row = class_of[components.object]  # (m,)
    nodes = lines(components, of_row, np.array([errors[i].across for i in first]))
    quadratics = _quadratics(components, nodes, of_row)  # (m, j, 3)
    log_first, _ = _log_products(quadratics[:, :1], nodes.log_weight[:, :1], components, class_of, u[None])
    middle, half = _spans(log_first[:, 0], u)  # (c,)
    along_sd = np.array([errors[i].along_sd for i in first])
    needed = math.ceil(float((2 * half / (KERNEL_STEPS * along_sd)).max()))
    own = middle[:, None] + half[:, None] * np.linspace(-1, 1, min(max(OWN_POINTS, needed), MOST_OWN_POINTS))  # (c, h)
    log_node, outlier = _log_products(quadratics, nodes.log_weight, components, class_of, own)
    top = log_node.max(axis=(1, 2))[:, None]  # (c, 1)
    value = np.exp(log_node - top[:, None]).sum(axis=1)  # (c, h)
    smooth, kernel = convolved(value, own, u, along_sd)
    return ClassTerms(classes, np.log(np.maximum(smooth, 1e-300)) + top, outlier, class_of, log_node, kernel)


def _quadratics(components: Rows, nodes: Lines, of_row: IntArray) -> FloatArray:
    """Coefficients of u'^2, u', 1 in the log of each component along each node's line, (m, j, 3)."""
    a = nodes.direction[of_row]  # (m, 3)
    off = nodes.offset[of_row] + components.residual[:, None, :]  # (m, j, 3)
    turned = (components.precision @ a[:, :, None])[:, :, 0]  # (m, 3)
    square = np.broadcast_to((a * turned).sum(axis=1)[:, None], off.shape[:2])
    linear = (off @ turned[:, :, None])[:, :, 0]
    constant = ((off @ components.precision) * off).sum(axis=2)
    return np.stack([-0.5 * square, linear, components.log_weight[:, None] - 0.5 * constant], axis=2)


def _log_products(
    quadratics: FloatArray, node_quadratics: FloatArray, components: Rows, class_of: IntArray, grids: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Log of weight and product of each class at its nodes, (c, j, h), and outlier probabilities, (n, j, h).

    grids : (c, h) uniform, or (1, h) for all. Each is brought to t in [-1, 1], so that all share the powers of t.
    """
    t = np.linspace(-1, 1, grids.shape[1])
    middle = np.broadcast_to(0.5 * (grids[:, 0] + grids[:, -1]), len(node_quadratics))
    half = np.broadcast_to(0.5 * (grids[:, -1] - grids[:, 0]), len(node_quadratics))
    of_row = class_of[components.object]
    brought = _brought(quadratics, middle[of_row], half[of_row])
    floor = np.exp(components.log_floor).astype(np.float32)[:, None, None]
    density = _summed(brought, _powers(t), components) + floor  # (n, j, h)
    n, j, h = density.shape
    indicator = (class_of == np.arange(len(node_quadratics))[:, None]).astype(np.float32)  # (c, n)
    log_product = (indicator @ np.log(density).reshape(n, j * h)).reshape(-1, j, h)
    return log_product + _brought(node_quadratics, middle, half) @ _powers(t), floor / density


def _brought(quadratics: FloatArray, middle: FloatArray, half: FloatArray) -> FloatArray:
    """Quadratics (m, j, 3) in u' as quadratics in t, u' = middle + half t; middle, half : (m,)."""
    a, b, c = quadratics[..., 0], quadratics[..., 1], quadratics[..., 2]
    middle, half = middle[:, None], half[:, None]
    return np.stack([a * half**2, (2 * a * middle + b) * half, (a * middle + b) * middle + c], axis=-1)


def _spans(log_product: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Middle and half width of where each class's product (c, g) on the common grid matters, a step to spare."""
    matters = log_product > log_product.max(axis=1, keepdims=True) - DEEP
    low = u[np.maximum(matters.argmax(axis=1) - 1, 0)]
    high = u[np.minimum(len(u) - matters[:, ::-1].argmax(axis=1), len(u) - 1)]
    return 0.5 * (low + high), 0.5 * (high - low)


def line_density(components: Rows, u: FloatArray) -> FloatArray:
    """Each object's mixture on the line v = u 1, (n, g), without the outlier."""
    lam, middle = components.line_precision, 0.5 * (u[0] + u[-1])
    centre = components.line_centre - middle
    coefficients = np.stack([-0.5 * lam, lam * centre, components.line_log_peak - 0.5 * lam * centre**2], axis=1)
    return _summed(coefficients[:, None, :], _powers(u - middle), components)[:, 0]


def _powers(t: FloatArray) -> FloatArray:
    """t^2, t, 1 as rows, (3, g)."""
    return np.stack([t * t, t, np.ones_like(t)])


def _summed(coefficients: FloatArray, powers: FloatArray, components: Rows) -> FloatArray:
    """The exponentials of quadratics in u, (m, j, 3) coefficients, summed over each object's rows: (n, j, g) float32.

    Objects are taken by falling number of rows, so that the k-th rows of all objects that have one are one block and
    the sum is a few whole-array additions. Single precision: exponents of a thousand are off by 1e-4, a tenth of what
    the nodes are, for a third of the time.
    """
    n, (m, j, _) = len(components.log_floor), coefficients.shape
    counts = np.diff(np.append(components.start, m))
    place = np.empty(n, dtype=np.int64)
    place[np.argsort(-counts, kind="stable")] = np.arange(n)
    rank = np.arange(m) - components.start[components.object]
    order = np.argsort(rank * n + place[components.object])
    values = (coefficients[order].reshape(m * j, 3).astype(np.float32) @ powers.astype(np.float32)).reshape(m, -1)
    np.exp(values, out=values)
    sizes = np.bincount(rank).tolist()
    total = values[:n]  # every object has a first row
    start = n
    for size in sizes[1:]:
        total[:size] += values[start : start + size]
        start += size
    return np.asarray(total[place].reshape(n, j, -1))
