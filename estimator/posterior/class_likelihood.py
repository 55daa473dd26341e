"""Log likelihoods of classes over log scale: single objects in closed form, several objects over their shared error."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.posterior.class_hypotheses import VERTICAL_EXTENTS, Hypothesis
from estimator.posterior.shared_error import (
    CONSTANT,
    LINEAR,
    LOG_NODE,
    NODES,
    NodeLines,
    ObjectComponents,
    convolution,
    exponentials,
    monomials,
    node_lines,
    on_interval,
    quadratic_coefficients,
)
from metric_base.arrays import BoolArray, FloatArray, IntArray

#: Maximum effective number of objects of a class. A prior is an approximation, and the evidence of n objects increases
#: with n whether it is right or wrong. For more objects, the product has the exponent EFFECTIVE_OBJECTS / n (the
#: coarsened posterior of Miller and Dunson 2019, with a bound).
EFFECTIVE_OBJECTS = 25
#: Maximum loss of log evidence of a hypothesis compared with the best one of its class.
MAX_EVIDENCE_LOSS_LOG = 10.0
#: Maximum number of objects from which the vertical extent of a class is learned.
MAX_ORIENTATION_OBJECTS = 3
#: Minimum and maximum number of points of the grid of a hypothesis over u', which is u minus the part of its error
#: along 1. The product of many objects is narrow, and its grid covers only the range in which it matters. With 16
#: points, the step is 0.6 standard deviations of a Gaussian.
MIN_CLASS_POINTS, MAX_CLASS_POINTS = 16, 512
#: Maximum step of this grid in standard deviations of the kernel, for an error of the sum of less than 1e-4.
MAX_KERNEL_STEP_SIGMAS = 1.5
#: Maximum depth of a product below its peak (natural log) within its grid; farther out, it is constant.
MAX_DEPTH_UNDER_PEAK_LOG = 12.0
#: Stride in the common grid at which the range of a product is searched.
SEARCH_STRIDE = 3
#: Maximum number of columns for `reduceat`; above it, a loop over the objects is faster, three times at 500 columns.
MAX_REDUCEAT_COLUMNS = 128


@dataclass(frozen=True, slots=True, eq=False)
class SingleObjectClasses:
    """Likelihoods of c classes with a single object each."""

    #: (c, g)
    log_likelihood: FloatArray
    #: (c, g) probability of an outlier or a mislabelled object at each scale.
    outlier: FloatArray

    def weights(self, mass: FloatArray) -> FloatArray:
        """Return the probability (c,) of each object not to be an outlier, for the posterior `mass` (g,)."""
        return np.asarray(1 - self.outlier @ mass)


def single_object_classes(components: ObjectComponents, u: FloatArray) -> SingleObjectClasses:
    """Compute the likelihoods of single-object classes at log scales u (g,); components include the class error."""
    values = _line_values(components, u)
    density = _object_sums(values, components) + np.exp(components.log_floor)[:, None]  # (n, g)
    values[components.is_mislabelled] = 0
    return SingleObjectClasses(np.log(density), np.asarray(1 - _object_sums(values, components) / density, dtype=float))


@dataclass(frozen=True, slots=True, eq=False)
class ClassHypotheses:
    """The w hypotheses of several classes, and the e entries of their n objects, one per object and hypothesis.

    The entries of an object are in the order of the hypotheses of its class.
    """

    hypotheses: Sequence[Hypothesis]
    #: (w,) row of the class, increasing.
    group: IntArray
    #: (w,) number of objects of the class.
    count: IntArray
    #: (e,) hypothesis of each entry.
    entry: IntArray
    #: (n,) first entry of each object.
    start: IntArray

    @property
    def power(self) -> FloatArray:
        """(w,) exponent of the product over the objects, which limits the evidence of many objects."""
        return np.minimum(1.0, EFFECTIVE_OBJECTS / self.count)

    @property
    def exponent(self) -> NDArray[np.float32]:
        """(w, e) exponent of each entry in the product of each hypothesis."""
        exponent = np.zeros((len(self.count), len(self.entry)), dtype=np.float32)
        exponent[self.entry, np.arange(len(self.entry))] = self.power[self.entry]
        return exponent

    @property
    def first(self) -> IntArray:
        """(c,) first hypothesis of each class."""
        return np.searchsorted(self.group, np.arange(self.group[-1] + 1))

    def of(self, keep: BoolArray) -> ClassHypotheses:
        """Return the hypotheses of a mask (w,), which contains at least one of each class."""
        keep_entry = keep[self.entry]
        new_index = np.cumsum(keep) - 1
        entries_before = np.append(0, np.cumsum(keep_entry))
        kept = [hypothesis for hypothesis, is_kept in zip(self.hypotheses, keep.tolist(), strict=True) if is_kept]
        return ClassHypotheses(
            kept, self.group[keep], self.count[keep], new_index[self.entry[keep_entry]], entries_before[self.start]
        )


@dataclass(frozen=True, slots=True, eq=False)
class MultiObjectClasses:
    """Likelihoods of c classes of several objects, and the terms for the weights of their n objects."""

    #: (c, g)
    log_likelihood: FloatArray
    hypotheses: ClassHypotheses
    #: (w, j, h) log mass of each node at u' on the grid of the hypothesis.
    log_node: FloatArray
    #: (w, g, h) density of u given u', relative to its maximum.
    kernel: NDArray[np.float32]
    #: (e, j, h) probability of each entry to be an outlier.
    outlier: NDArray[np.float32]

    def weights(self, mass: FloatArray) -> FloatArray:
        """Return the probability (n,) that each object matches its label, for the posterior `mass` (g,)."""
        group, entry = self.hypotheses.group, self.hypotheses.entry
        is_mislabelled = np.array([hypothesis.is_mislabelled for hypothesis in self.hypotheses.hypotheses])
        # The posterior of the other classes as a function of u'; undefined where the posterior has no mass.
        relative = np.maximum(self.log_likelihood - self.log_likelihood.max(axis=1, keepdims=True), -600)
        others = np.where(mass > 1e-12 * mass.max(), mass / np.exp(relative), 0.0)  # (c, g)
        others /= others.max(axis=1, keepdims=True)
        at_nodes = (others.astype(np.float32)[group][:, None, :] @ self.kernel)[:, 0]  # (w, h)
        first = self.hypotheses.first
        top = np.maximum.reduceat(self.log_node.max(axis=(1, 2)), first)[group]
        joint = np.exp(self.log_node - top[:, None, None]) * at_nodes[:, None, :]
        total = np.add.reduceat(joint.sum(axis=(1, 2)), first)[group]
        # If other evidence is far from all nodes, all objects of the class are outliers.
        is_reached = total > 0
        joint = (joint / np.where(is_reached, total, 1.0)[:, None, None]).astype(np.float32)
        right = (joint.sum(axis=(1, 2)) * ~is_mislabelled)[entry]
        outlying = (self.outlier * joint[entry]).sum(axis=(1, 2)) * ~is_mislabelled[entry]
        return np.asarray(np.add.reduceat(right - outlying, self.hypotheses.start), dtype=float).clip(0.0, 1.0)


def multi_object_classes(
    components: ObjectComponents, hypotheses: ClassHypotheses, u: FloatArray
) -> MultiObjectClasses:
    """Compute the likelihoods of classes of several objects, integrated over their shared error.

    Parameters
    ----------
    components : ObjectComponents
        Of each entry of `hypotheses`.
    hypotheses : ClassHypotheses
    u : (g,) ndarray of float
        Grid of log scale.

    Notes
    -----
    With v = u' a - b on the line of a node, each component is the exponential of a quadratic in u'. The central node,
    evaluated on the common grid, determines the range of the product of each hypothesis, and which hypotheses matter.
    All nodes are then evaluated in this range.
    """
    across = np.array([hypothesis.error.across for hypothesis in hypotheses.hypotheses]).transpose(1, 2, 0)
    nodes = node_lines(components, hypotheses.entry, across, hypotheses.exponent)
    # Coefficients (10, m) of the log of each component on the nodes of its hypothesis.
    vectors = nodes.vectors.take(hypotheses.entry[components.object], axis=2)  # (3, 4, m)
    rows = quadratic_coefficients(vectors, np.einsum("abm,bkm->akm", components.precision, vectors))
    rows[LINEAR] += np.einsum("am,akm->km", components.pull, vectors)
    rows[CONSTANT] += components.log_constant
    search = np.linspace(u[0], u[-1], max(len(u) // SEARCH_STRIDE, MIN_CLASS_POINTS))
    everywhere = np.repeat([[0.5 * (u[0] + u[-1])], [0.5 * (u[-1] - u[0])]], len(hypotheses.hypotheses), axis=1)
    log_central = _log_products(rows, nodes, components, hypotheses, everywhere, (1, len(search)))[0][:, 0]  # (w, f)

    centre, half, peak_height = _ranges(log_central, search)  # (w,)
    # Only hypotheses matter whose evidence is close to the best one with the same vertical extent. The shared error
    # widens a narrow product, which lowers its peak by about the ratio of the widths.
    along_sd, extent, log_weight = np.array(
        [(one.error.along_sd, one.vertical_extent, one.log_weight) for one in hypotheses.hypotheses]
    ).T  # (w,) each
    extent = extent.astype(np.int64)
    evidence = peak_height + log_weight + np.log(np.minimum(1.0, half / (3 * along_sd)))
    orientation = hypotheses.group * (len(VERTICAL_EXTENTS) + 1) + extent + 1
    best = np.full(int(orientation.max()) + 1, -np.inf)
    np.maximum.at(best, orientation, evidence)
    keep = np.asarray(evidence > best[orientation] - MAX_EVIDENCE_LOSS_LOG)
    if not keep.all():
        rows = rows.take(np.flatnonzero(keep[hypotheses.entry[components.object]]), axis=1)
        components = components.of(np.flatnonzero(keep[hypotheses.entry]))
        hypotheses, nodes, centre, half = hypotheses.of(keep), nodes.of(keep), centre[keep], half[keep]
        along_sd, extent, log_weight = along_sd[keep], extent[keep], log_weight[keep]
    needed = math.ceil(float((2 * half / (MAX_KERNEL_STEP_SIGMAS * along_sd)).max()))
    n_points = min(max(MIN_CLASS_POINTS, needed), MAX_CLASS_POINTS)
    class_grids = centre[:, None] + half[:, None] * np.linspace(-1, 1, n_points)  # (w, h)
    step = class_grids[:, 1] - class_grids[:, 0]
    # Kernels that are narrower than the largest grids resolve (the tolerance of a norm) are widened to them: without
    # this, the likelihood has a ripple with the step of the grid, and the posterior a mode on each crest.
    along_sd = np.maximum(along_sd, step / MAX_KERNEL_STEP_SIGMAS)
    interval = np.array([centre, half])
    log_node, outlier = _log_products(rows, nodes, components, hypotheses, interval, (len(NODES), n_points))
    log_node += log_weight[:, None, None]
    top = log_node.max(axis=(1, 2))[:, None]  # (w, 1)
    value = np.exp(log_node - top[:, None]).sum(axis=1)  # (w, h)
    smooth, kernel = convolution(value, class_grids, u, along_sd)
    log_likelihood = np.log(np.maximum(smooth, 1e-300)) + top  # (w, g)
    # The height of the likelihood of a vertical extent is the evidence of n objects for it. The priors do not describe
    # the variation of sizes in a place well enough for the power n, so it is limited to the evidence of a few objects.
    group = hypotheses.group * len(VERTICAL_EXTENTS) + np.maximum(extent, 0)
    height = np.full(int(group.max()) + 1, -np.inf)
    np.maximum.at(height, group, log_likelihood.max(axis=1))
    fraction = np.minimum(1.0, MAX_ORIENTATION_OBJECTS / np.minimum(hypotheses.count, EFFECTIVE_OBJECTS))
    correction = np.asarray(np.where(extent >= 0, -(1 - fraction) * height[group], 0.0))
    # The weight of a node in the convolution: its mass, its step, and the height of its kernel.
    log_node += (correction + np.log(step / along_sd))[:, None, None]
    # Log of the sum over the hypotheses of each class.
    log_values = log_likelihood + correction[:, None]
    highest = np.maximum.reduceat(log_values, hypotheses.first, axis=0)
    sums = np.add.reduceat(np.exp(log_values - highest[hypotheses.group]), hypotheses.first, axis=0)
    return MultiObjectClasses(np.asarray(np.log(sums) + highest), hypotheses, log_node, kernel, outlier)


def _ranges(log_product: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the range in which each product (w, f) at u (f,) matters, with a margin of a step, and its height.

    The result is the centre and half width of the range and the height of the parabola through the maximum and its two
    neighbours, (w,) each. The product of a hundred objects is narrow: between grid points, it increases by more than
    hypotheses differ.
    """
    matters = log_product > log_product.max(axis=1, keepdims=True) - MAX_DEPTH_UNDER_PEAK_LOG
    low = u[np.maximum(matters.argmax(axis=1) - 1, 0)]
    high = u[np.minimum(len(u) - matters[:, ::-1].argmax(axis=1), len(u) - 1)]
    row, at = np.arange(len(low)), np.clip(log_product.argmax(axis=1), 1, len(u) - 2)
    before, peak, after = (log_product[row, at + step] for step in (-1, 0, 1))
    bend = np.minimum(before - 2 * peak + after, -1e-9)
    height = np.maximum(log_product.max(axis=1), peak - (after - before) ** 2 / (8 * bend))
    return 0.5 * (low + high), 0.5 * (high - low), height


def _log_products(
    rows: FloatArray,
    nodes: NodeLines,
    components: ObjectComponents,
    hypotheses: ClassHypotheses,
    interval: FloatArray,
    shape: tuple[int, int],
) -> tuple[FloatArray, NDArray[np.float32]]:
    """Return log weight times product of each hypothesis at its nodes (w, j, h), and outlier probabilities (e, j, h).

    Parameters
    ----------
    rows : (10, m) ndarray of float
        Coefficients of `MONOMIALS` in the log of each component.
    nodes : NodeLines
    components : ObjectComponents
    hypotheses : ClassHypotheses
    interval : (2, w) ndarray of float
        Middle and half width of the uniform grid over u' of each hypothesis.
    shape : (j, h)
        Numbers of nodes and of grid points.

    Notes
    -----
    Single precision takes a third of the time. The error of an exponent of 1,000 is 1e-4, 10 % of the nodes' error.
    """
    basis = monomials(*shape)
    coefficients = on_interval(rows, *interval.take(hypotheses.entry[components.object], axis=1))
    values = exponentials(coefficients.astype(np.float32).T @ basis.astype(np.float32))  # (m, j h)
    floor = np.exp(components.log_floor).astype(np.float32)[:, None]
    density = _object_sums(values, components) + floor
    log_product = hypotheses.exponent @ np.log(density)
    log_product = log_product + on_interval(nodes.log_weight, *interval).T @ basis
    return log_product.reshape(-1, *shape) + LOG_NODE[: shape[0], None], (floor / density).reshape(-1, *shape)


def line_density(components: ObjectComponents, u: FloatArray) -> NDArray[np.float32]:
    """Return the mixture (n, g) of each object on the line v = u 1, without the outlier density."""
    return _object_sums(_line_values(components, u), components)


def _line_values(components: ObjectComponents, u: FloatArray) -> NDArray[np.float32]:
    """Return the components (m, g) on the line v = u 1."""
    lam, middle = components.line_precision, 0.5 * (u[0] + u[-1])
    centre = components.line_centre - middle
    coefficients = np.array([-0.5 * lam, lam * centre, components.line_log_peak - 0.5 * lam * centre**2], np.float32)
    return exponentials(coefficients.T @ np.vander(u - middle, 3).T.astype(np.float32))


def _object_sums(values: NDArray[np.float32], components: ObjectComponents) -> NDArray[np.float32]:
    """Return the sums (n, g) of the rows (m, g) of each object."""
    if values.shape[1] < MAX_REDUCEAT_COLUMNS:
        return np.add.reduceat(values, components.start, axis=0)
    first = components.start.tolist()
    total = np.empty((len(first), values.shape[1]), dtype=np.float32)
    for index, (begin, end) in enumerate(zip(first, [*first[1:], len(values)], strict=True)):
        np.add.reduce(values[begin:end], axis=0, out=total[index])
    return total
