"""Log likelihoods of classes over log scale: one object in closed form, several over their shared error."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from estimator.posterior.class_hypotheses import READINGS, Hypothesis
from estimator.posterior.shared_error import DimensionRows, Lines, convolution, exponentials, lines
from estimator.posterior.symmetric_matrices import dot, product
from metric_base.arrays import BoolArray, FloatArray, IntArray

#: The objects of one class speak as this many at most. A prior is an approximation, and what n objects say of it grows
#: with n, right or wrong: beyond this the product is taken to the power EFFECTIVE_OBJECTS / n (the coarsened posterior
#: of Miller and Dunson 2019, with a bound).
EFFECTIVE_OBJECTS = 25

#: A hypothesis with this much less evidence (natural log) than the likeliest of its class is left out.
MAX_EVIDENCE_LOSS_LOG = 10.0

#: Which of the sorted extents is the vertical one is not learned from more objects than this.
READING_OBJECTS = 3


#: Points of a class's own grid over u' = u less the part of its error along 1. The product of many objects is narrow:
#: the class's own grid spans where it matters and no more. Sixteen are .6 of a Gaussian's standard deviation apart.
OWN_POINTS, MOST_OWN_POINTS = 16, 512

#: Step of the own grid in standard deviations of the kernel at most: the sum is then exact to 1e-4.
KERNEL_STEPS = 1.5

#: A product this far under its peak (natural log) has no part in the answer; beyond, it goes on as it is there.
MAX_DEPTH_UNDER_PEAK_LOG = 12.0

#: The first look at where a product matters takes every so many points of the common grid.
FIRST_LOOK = 3

#: Numbers in a row from which `reduceat` over the rows takes longer than a loop, thrice as long at five hundred.
WIDE = 128


@dataclass(frozen=True, slots=True, eq=False)
class LoneTerms:
    """Classes of one object each: log_likelihood (c, g) and the probability of an outlier at each scale (c, g)."""

    log_likelihood: FloatArray
    outlier: FloatArray

    def weights(self, mass: FloatArray) -> FloatArray:
        """(c,) probability that each object is not an outlier under the posterior `mass` (g,)."""
        return np.asarray(1 - self.outlier @ mass)


def lone_classes(components: DimensionRows, u: FloatArray) -> LoneTerms:
    """Classes of one object each at log scales u (g,); `components` hold the class error in their covariances."""
    floor = np.exp(components.log_floor)[:, None]
    density = line_density(components, u) + floor  # (n, g)
    return LoneTerms(np.log(density), floor / density)


@dataclass(frozen=True, slots=True, eq=False)
class Ways:
    """The w hypotheses of several classes, and the e entries that the classes' objects make under them.

    group : (w,) row of the class, rising; count : (w,) objects of that class; entry : (e,) hypothesis of each entry;
    start : (n,) first entry of each object. The entries of an object are its class's hypotheses in order.
    """

    hypotheses: Sequence[Hypothesis]
    group: IntArray
    count: IntArray
    entry: IntArray
    start: IntArray

    @property
    def power(self) -> FloatArray:
        """(w,) exponent of the product of a class's objects: what many objects say saturates."""
        return np.minimum(1.0, EFFECTIVE_OBJECTS / self.count)

    @property
    def along_sd(self) -> FloatArray:
        """(w,) standard deviation of the shared error along 1."""
        return np.array([way.error.along_sd for way in self.hypotheses])

    @property
    def readings(self) -> IntArray:
        """(w,) the reading of each, -1 without."""
        return np.array([way.reading for way in self.hypotheses])

    def of(self, kept: BoolArray) -> Ways:
        """Those of a mask (w,) that leaves every class one."""
        chosen = kept[self.entry]
        numbers = np.cumsum(kept) - 1
        before = np.append(0, np.cumsum(chosen))
        rest = [way for way, keep in zip(self.hypotheses, kept.tolist(), strict=True) if keep]
        return Ways(rest, self.group[kept], self.count[kept], numbers[self.entry[chosen]], before[self.start])


@dataclass(frozen=True, slots=True, eq=False)
class JointTerms:
    """Classes of several objects: log_likelihood (c, g), and what the weights of their n objects need.

    log_node : (w, j, h) log mass of each node at u' on the hypothesis's own grid; kernel : (w, g, h) density of u
    under u' over its peak; outlier : (e, j, h) probability of each entry's being one.
    """

    log_likelihood: FloatArray
    ways: Ways
    log_node: FloatArray
    kernel: NDArray[np.float32]
    outlier: NDArray[np.float32]

    def weights(self, mass: FloatArray) -> FloatArray:
        """(n,) probability that each object is what its label says, under the posterior `mass` (g,)."""
        group, entry = self.ways.group, self.ways.entry
        foreign = np.array([way.foreign for way in self.ways.hypotheses])
        # the posterior less the class, seen from u'; where there is no mass the quotient means nothing
        relative = np.maximum(self.log_likelihood - self.log_likelihood.max(axis=1, keepdims=True), -600)
        others = np.where(mass > 1e-12 * mass.max(), mass / np.exp(relative), 0.0)  # (c, g)
        others /= others.max(axis=1, keepdims=True)
        at_own = (others.astype(np.float32)[group][:, None, :] @ self.kernel)[:, 0]  # (w, h)
        first = np.flatnonzero(np.diff(group, prepend=-1))
        top = np.maximum.reduceat(self.log_node.max(axis=(1, 2)), first)[group]
        joint = np.exp(self.log_node - top[:, None, None]) * at_own[:, None, :]
        total = np.add.reduceat(joint.sum(axis=(1, 2)), first)[group]
        seen = total > 0  # a known length so far off that no node sees it: all of the class are outliers
        joint = (joint / np.where(seen, total, 1.0)[:, None, None]).astype(np.float32)
        believed = (joint.sum(axis=(1, 2)) * ~foreign)[entry]
        doubted = (self.outlier * joint[entry]).sum(axis=(1, 2)) * ~foreign[entry]
        return np.asarray(np.add.reduceat(believed - doubted, self.ways.start), dtype=float).clip(0.0, 1.0)


def joint_classes(components: DimensionRows, ways: Ways, u: FloatArray) -> JointTerms:
    """Classes of several objects under their hypotheses, integrated over what their objects share.

    Parameters
    ----------
    components : of every entry of `ways`
    u : (g,) grid

    With v = u' a - b on the line of a node, each component is the exponential of a quadratic in u'. The middle node
    on the common grid shows where each hypothesis's product matters, and which hypotheses do; there all nodes are
    evaluated.
    """
    nodes = lines(components, ways.entry, np.array([way.error.across for way in ways.hypotheses]), ways.power)
    seen = np.linspace(u[0], u[-1], max(len(u) // FIRST_LOOK, OWN_POINTS))
    common = np.broadcast_to(seen, (len(ways.hypotheses), len(seen)))
    log_first = _log_products(components, nodes.middle(), ways, common)[0][:, 0]  # (w, f)
    middle, half = _spans(log_first, seen)  # (w,)
    kept = _plausible(ways, _peaks(log_first), half)
    if not kept.all():
        components, ways, nodes = components.of(np.flatnonzero(kept[ways.entry])), ways.of(kept), nodes.of(kept)
        middle, half = middle[kept], half[kept]
    along_sd = ways.along_sd
    needed = math.ceil(float((2 * half / (KERNEL_STEPS * along_sd)).max()))
    own = middle[:, None] + half[:, None] * _unit_powers(min(max(OWN_POINTS, needed), MOST_OWN_POINTS))[1]  # (w, h)
    log_node, outlier = _log_products(components, nodes, ways, own)
    log_node += np.array([way.log_weight for way in ways.hypotheses])[:, None, None]
    top = log_node.max(axis=(1, 2))[:, None]  # (w, 1)
    value = np.exp(log_node - top[:, None]).sum(axis=1)  # (w, h)
    smooth, kernel = convolution(value, own, u, along_sd)
    log_way = np.log(np.maximum(smooth, 1e-300)) + top  # (w, g)
    correction = _reading_correction(ways, log_way)
    # what a node weighs in the convolution: its mass, its step, the height of its kernel
    log_node += (correction + np.log((own[:, 1] - own[:, 0]) / along_sd))[:, None, None]
    return JointTerms(_log_sums(log_way + correction[:, None], ways.group), ways, log_node, kernel, outlier)


def _peaks(log_values: FloatArray) -> FloatArray:
    """(w,) height of the parabola through the highest point of each row (w, g) and its two neighbours.

    A product of a hundred objects is narrow: between the points it rises by far more than it differs from others.
    """
    at = np.clip(log_values.argmax(axis=1), 1, log_values.shape[1] - 2)
    row = np.arange(len(at))
    before, top, after = (log_values[row, at + step] for step in (-1, 0, 1))
    bend = np.minimum(before - 2 * top + after, -1e-9)
    return np.asarray(np.maximum(log_values.max(axis=1), top - (after - before) ** 2 / (8 * bend)))


def _plausible(ways: Ways, top: FloatArray, half: FloatArray) -> BoolArray:
    """(w,) hypotheses that are not far less likely than the likeliest of their class and reading.

    top : (w,) log of the product's peak at the middle node; half : (w,) half width of where it matters. The shared
    error spreads a narrow product out, which lowers its peak by about the ratio of their widths.
    """
    weight = np.array([way.log_weight for way in ways.hypotheses])
    evidence = top + weight + np.log(np.minimum(1.0, half / (3 * ways.along_sd)))
    group = ways.group * (len(READINGS) + 1) + ways.readings + 1
    best = np.full(int(group.max()) + 1, -np.inf)
    np.maximum.at(best, group, evidence)
    return np.asarray(evidence > best[group] - MAX_EVIDENCE_LOSS_LOG)


def _log_sums(log_values: FloatArray, group: IntArray) -> FloatArray:
    """(c, g) log of the sums of exponentials of (w, g) over each group; group (w,) rises from 0."""
    first = np.flatnonzero(np.diff(group, prepend=-1))
    top = np.maximum.reduceat(log_values, first, axis=0)
    return np.asarray(np.log(np.add.reduceat(np.exp(log_values - top[group]), first, axis=0)) + top)


def _reading_correction(ways: Ways, log_way: FloatArray) -> FloatArray:
    """(w,) what is added to each hypothesis so that its reading of the axes counts as `READING_OBJECTS` would.

    The height of a reading's likelihood is what n objects say of it; the priors know too little of how sizes vary in
    one place to believe a preference to the power n.
    """
    reading = ways.readings
    group = ways.group * len(READINGS) + np.maximum(reading, 0)
    height = np.full(int(group.max()) + 1, -np.inf)
    np.maximum.at(height, group, log_way.max(axis=1))
    kept = np.minimum(1.0, READING_OBJECTS / np.minimum(ways.count, EFFECTIVE_OBJECTS))
    return np.asarray(np.where(reading >= 0, -(1 - kept) * height[group], 0.0))


def _log_products(
    components: DimensionRows, nodes: Lines, ways: Ways, grids: FloatArray
) -> tuple[FloatArray, NDArray[np.float32]]:
    """Log of weight and product of each hypothesis at its nodes, (w, j, h), and outlier probabilities, (e, j, h).

    grids : (w, h) uniform. Each is brought to t in [-1, 1], so that all share the powers of t.
    """
    nodes = nodes.along(0.5 * (grids[:, 0] + grids[:, -1]), 0.5 * (grids[:, -1] - grids[:, 0]))
    powers = _unit_powers(grids.shape[1])
    floor = np.exp(components.log_floor).astype(np.float32)[:, None, None]
    density = (
        _sum_exponentials(_quadratics(components, nodes, ways.entry[components.object]), powers, components) + floor
    )
    n, j, h = density.shape
    indicator = ((ways.entry == np.arange(len(grids))[:, None]) * ways.power[:, None]).astype(np.float32)  # (w, e)
    log_product = (indicator @ np.log(density).reshape(n, j * h)).reshape(-1, j, h)
    return log_product + nodes.log_weight.T @ powers, floor / density


def _quadratics(components: DimensionRows, nodes: Lines, of_row: IntArray) -> NDArray[np.float32]:
    """Coefficients of t^2, t, 1 in the log of each component along each node's line, (m, j, 3); of_row : (m,) class."""
    a = nodes.direction.take(of_row, axis=1)  # (3, m)
    off = nodes.offset.take(of_row, axis=2) + components.residual[:, None]  # (3, j, m)
    turned = product(components.precision, off)
    coefficients = np.empty((len(of_row), off.shape[1], 3), dtype=np.float32)
    coefficients[:, :, 0] = -0.5 * dot(a, product(components.precision, a))[:, None]
    coefficients[:, :, 1] = dot(a, turned).T
    coefficients[:, :, 2] = (components.log_weight - 0.5 * dot(off, turned)).T
    return coefficients


def _spans(log_product: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Middle and half width of where each class's product (c, g) on the common grid matters, a step to spare."""
    matters = log_product > log_product.max(axis=1, keepdims=True) - MAX_DEPTH_UNDER_PEAK_LOG
    low = u[np.maximum(matters.argmax(axis=1) - 1, 0)]
    high = u[np.minimum(len(u) - matters[:, ::-1].argmax(axis=1), len(u) - 1)]
    return 0.5 * (low + high), 0.5 * (high - low)


def line_density(components: DimensionRows, u: FloatArray) -> NDArray[np.float32]:
    """Each object's mixture on the line v = u 1, (n, g), without the outlier."""
    lam, middle = components.line_precision, 0.5 * (u[0] + u[-1])
    centre = components.line_centre - middle
    coefficients = np.array([-0.5 * lam, lam * centre, components.line_log_peak - 0.5 * lam * centre**2], np.float32)
    return _sum_exponentials(coefficients.T[:, None], _powers(u - middle), components)[:, 0]


def _powers(t: FloatArray) -> FloatArray:
    """t^2, t, 1 as rows, (3, g)."""
    return np.array([t * t, t, np.ones_like(t)])


@lru_cache(maxsize=64)
def _unit_powers(points: int) -> FloatArray:
    """t^2, t, 1 as rows, (3, g), at g = `points` even steps of t from -1 to 1."""
    return _powers(np.linspace(-1, 1, points))


def _sum_exponentials(
    coefficients: NDArray[np.float32], powers: FloatArray, components: DimensionRows
) -> NDArray[np.float32]:
    """The exponentials of quadratics, (m, j, 3) coefficients, summed over each object's rows: (n, j, g).

    Single precision: exponents of a thousand are off by 1e-4, a tenth of what the nodes are, for a third of the time.
    """
    (m, j, _), g = coefficients.shape, powers.shape[1]
    values = exponentials(coefficients.reshape(m * j, 3) @ powers.astype(np.float32)).reshape(m, j * g)
    if j * g < WIDE:
        return np.add.reduceat(values, components.start, axis=0).reshape(-1, j, g)
    first = components.start.tolist()
    total = np.empty((len(first), j * g), dtype=np.float32)
    for number, (begin, end) in enumerate(zip(first, [*first[1:], m], strict=True)):
        np.add.reduce(values[begin:end], axis=0, out=total[number])
    return total.reshape(-1, j, g)
