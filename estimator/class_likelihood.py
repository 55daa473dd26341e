"""Log likelihoods of classes over log scale: one object in closed form, several over their shared error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.class_error import SharedError, convolved, lines
from estimator.likelihood import Rows
from estimator.scene import FloatArray, IntArray

__all__ = ["ClassTerms", "joint_classes", "line_density", "single_classes"]


@dataclass(frozen=True, slots=True, eq=False)
class ClassTerms:
    """Some classes' log likelihoods (c, g), and what the weights of their n objects need.

    outlier : (n, j, g) probability of being an outlier at each node and grid point, class_of : (n,) row of its class.
    Of classes with a shared error: log_node : (c, j, g) log mass of each node at u', before the spread `along_sd`.
    """

    classes: IntArray
    log_likelihood: FloatArray
    outlier: FloatArray
    class_of: IntArray
    log_node: FloatArray | None = None
    along_sd: FloatArray | None = None
    step: float = 0.0

    def weights(self, mass: FloatArray) -> FloatArray:
        """(n,) probability that each object is not an outlier under the posterior `mass` (g,)."""
        if self.log_node is None or self.along_sd is None:
            return np.asarray(1 - self.outlier[:, 0] @ mass)
        safe = np.maximum(self.log_likelihood - self.log_likelihood.max(axis=1, keepdims=True), -600)
        others = mass / np.exp(safe)  # (c, g) posterior less this class
        others = np.where(mass > 1e-12 * mass.max(), others, 0.0)
        others /= others.max(axis=1, keepdims=True)
        at_nodes = convolved(others, self.step, self.along_sd)  # (c, g) over u'
        joint = np.exp(self.log_node - self.log_node.max(axis=(1, 2), keepdims=True)) * at_nodes[:, None, :]
        joint /= joint.sum(axis=(1, 2), keepdims=True)
        return np.asarray(1 - np.einsum("njg,njg->n", self.outlier, joint[self.class_of]))


def single_classes(components: Rows, group: IntArray, u: FloatArray) -> ClassTerms:
    """Classes of one object each; `components` hold the class error in their covariances, group (n,) is the class."""
    floor = np.exp(components.log_floor)[:, None]
    density = line_density(components, u) + floor  # (n, g)
    return ClassTerms(group, np.log(density), (floor / density)[:, None, :], np.arange(len(group)))


def joint_classes(components: Rows, group: IntArray, errors: Sequence[SharedError], u: FloatArray) -> ClassTerms:
    """Classes of several objects, integrated over their shared errors: group (n,) is the class, errors its B.

    With v = u' a - b on the line of a node, each component is the exponential of a quadratic in u'.
    """
    classes, first, class_of = np.unique(group, return_index=True, return_inverse=True)
    across = np.array([errors[i].across for i in first])  # (c, 3, 2)
    along_sd = np.array([errors[i].along_sd for i in first])
    of_row = class_of[components.object]  # (m,)
    nodes = lines(components, of_row, across)
    a = nodes.direction[of_row]  # (m, 3)
    off = nodes.offset[of_row] + components.residual[:, None, :]  # (m, j, 3)
    turned = (components.precision @ a[:, :, None])[:, :, 0]  # (m, 3)
    square = np.broadcast_to((a * turned).sum(axis=1)[:, None], off.shape[:2])
    linear = (off @ turned[:, :, None])[:, :, 0]
    constant = ((off @ components.precision) * off).sum(axis=2)
    middle = 0.5 * (u[0] + u[-1])
    lean = square * middle - linear  # the coefficients of u about the grid's middle
    rest = (square * middle - 2 * linear) * middle + constant
    coefficients = np.stack([-0.5 * square, -lean, components.log_weight[:, None] - 0.5 * rest], axis=2)  # (m, j, 3)
    floor = np.exp(components.log_floor).astype(np.float32)[:, None, None]
    density = _summed(coefficients, _powers(u - middle), components) + floor  # (n, j, g)
    indicator = (class_of == np.arange(len(classes))[:, None]).astype(np.float32)  # (c, n)
    log_product = (indicator @ np.log(density).reshape(len(group), -1)).reshape(len(classes), -1, len(u))
    log_node = log_product + nodes.log_weight @ _powers(u)
    top = log_node.max(axis=(1, 2))[:, None]
    value = np.exp(log_node - top[:, None]).sum(axis=1)  # (c, g)
    step = float(u[1] - u[0])
    smooth = convolved(value, step, along_sd)
    log_likelihood = np.log(np.maximum(smooth, 1e-300)) + top
    return ClassTerms(classes, log_likelihood, floor / density, class_of, log_node, along_sd, step)


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
