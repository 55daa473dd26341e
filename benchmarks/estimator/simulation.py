"""Simulate scenes for the paper's two figures (section 5) and for objects of a class with similar sizes.

The true sizes are drawn from the priors of a release, with an error that all objects of a class in a scene share. Each
scene has a random true scale. `Knobs` sets the number of objects, the size noise (uniform within +-R, as in the paper)
and the fractions of objects with truncated sides, of objects with a wrong label, and of dimensions with an undetected
gross error. The estimators receive a sigma of R / sqrt(3), at least 2 %. 90 % of the truncated sides are flagged; eta
is below 0.7 for 60 % of the truncated and 10 % of the complete sides, similar to the paper's figure of bottles.
`python -m benchmarks.accuracy --parts sameness structured errors` runs the simulations.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

import metric_tree
from estimator.baselines.candidate_search import candidate_scales, estimate_on
from estimator.baselines.paper import PaperMixture, fit_mixture
from estimator.posterior.axis_assignments import GROSS_ERROR_PROBABILITY, GROSS_ERROR_SD_LOG, LOG_BOX
from estimator.posterior.class_hypotheses import hypotheses
from estimator.posterior.log_scale_grid import PRIOR_MARGIN_LOG
from estimator.posterior.object_likelihood import OUTLIER_PROBABILITY, ObjectEvidence
from estimator.posterior.posterior import Estimate, posterior
from estimator.posterior.shared_error import shared_error
from estimator.records.objects import ETA_THRESHOLD, MeasuredObject
from metric_base.arrays import FloatArray
from metric_tree.axes import AXES
from metric_tree.node import Node
from metric_tree.prior import Prior
from metric_tree.tree import Tree

__all__ = [
    "SAMENESS_FRACTIONS",
    "SAMENESS_NOISE",
    "SAMENESS_SCENES",
    "Knobs",
    "World",
    "estimates",
    "simulated",
    "world",
]

#: Numbers of objects and classes of the scenes with similar objects.
SAMENESS_SCENES = tuple((n, c) for n in (1, 3, 5, 10, 20, 50) for c in (1, 2, 3, 5, 10) if c <= n)
#: Fractions of the variation that objects of a class have in common (`Knobs.shared`).
SAMENESS_FRACTIONS = (None, 0.0, 0.3, 0.6, 0.9)
SAMENESS_NOISE = 0.05

#: Function that draws another object of a class: length, width, height (3,) in mm, in the prior's order.
Draw = Callable[[], FloatArray]

#: Minimum number of fitted items of a class, and maximum standard deviation of its log height. The remaining classes
#: resemble a detector's list of useful classes.
MIN_ITEMS = 30
MAX_LOG_HEIGHT_SD = 0.35

#: Maximum number of classes of a scene, because rooms contain several objects of a class.
MAX_CLASSES = 8

LEVEL = 0.9
#: Fraction of the truncated sides that are flagged.
FLAGGED_FRACTION = 0.9
#: Fractions of truncated and of complete sides with a low confidence eta.
LOW_ETA_TRUNCATED = 0.6
LOW_ETA_COMPLETE = 0.1
#: Number of sizes that the paper's mixture of a class is fitted to.
MIXTURE_ITEMS = 150

#: Maximum gross error of a log dimension: a third less to half more, as for the widths of bottles.
MAX_GROSS_ERROR_LOG = 0.45


@dataclass(frozen=True, slots=True)
class Knobs:
    """One setting of the simulation.

    noise : maximum relative error of a size.
    cut, wrong, off : fractions (0 to 1) of truncated objects, of wrong labels and of gross errors.
    shared : fraction of the variation within a source that the objects of a class in a scene have in common, and
        probability that they belong to the same component; None: drawn from the model of the posterior, with its
        outliers and gross errors.
    classes : number of classes of a scene, each with at least one object if possible; None: up to `MAX_CLASSES`.
    """

    objects: int = 8
    noise: float = 0.06
    cut: float = 0.2
    wrong: float = 0.05
    off: float = 0.05
    shared: float | None = 0.0
    classes: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """Classes of the simulated objects: nodes, priors over length, width and height, and the paper's mixtures."""

    nodes: tuple[Node, ...]
    priors: tuple[Prior, ...]
    mixtures: tuple[PaperMixture, ...]


def world(tree: Tree, baselines: bool = True, seed: int = 0) -> World:
    """Return the classes of a release that scenes draw from."""
    nodes, priors = [], []
    for node in tree.leaves():
        try:
            prior = node.prior(AXES)
        except metric_tree.NoPrior:
            continue
        log_height_sd = float(np.log(prior.quantile(0.84)[2] / prior.quantile(0.16)[2]) / 2)
        if prior.n >= MIN_ITEMS and log_height_sd <= MAX_LOG_HEIGHT_SD:
            nodes.append(node)
            priors.append(prior)
    mixtures = [fit_mixture(AXES, prior.sample(MIXTURE_ITEMS, seed)) for prior in priors] if baselines else []
    return World(tuple(nodes), tuple(priors), tuple(mixtures))


def simulated(
    world: World, knobs: Knobs, generator: np.random.Generator
) -> tuple[float, list[tuple[int, MeasuredObject]]]:
    """Draw a scene: its true scale in metres per unit, and its objects, each with the index of its labelled class."""
    scale = float(np.exp(generator.uniform(-3, 3)))
    pool = generator.choice(len(world.nodes), size=min(knobs.classes or MAX_CLASSES, len(world.nodes)), replace=False)
    required = [] if knobs.classes is None else pool[: knobs.objects].tolist()
    true = [*required, *generator.choice(pool, knobs.objects - len(required)).tolist()]
    draws = {
        index: _modelled_class(world.priors[index], true.count(index) > 1, generator)
        if knobs.shared is None
        else _sharing_class(world.priors[index], knobs.shared, generator)
        for index in pool
    }
    objects = []
    for number, true_class in enumerate(true):
        size = draws[true_class]()
        label = true_class
        if generator.random() < knobs.wrong:
            label = int(generator.choice([c for c in range(len(world.nodes)) if c != true_class]))
        node_id = world.nodes[label].node_id
        objects.append((label, _measured(str(number), node_id, size / 1000 / scale, knobs, generator)))
    return scale, objects


def estimates(
    world: World, knobs: Knobs, scenes: int, seed: int, methods: Sequence[str]
) -> Iterator[tuple[int, str, float, Estimate]]:
    """Yield index of the scene, method, log of the true scale and estimate, for each scene and method."""
    for index in range(scenes):
        scale, objects = simulated(world, knobs, np.random.default_rng([seed, index]))
        for name in methods:
            yield index, name, float(np.log(scale)), _estimate(world, objects, name)


def _sharing_class(prior: Prior, shared: float, generator: np.random.Generator) -> Draw:
    """Draw objects with a common error between sources and a common fraction of the variation within a source.

    `shared` is this fraction, and the probability that an object belongs to the scene's component.
    """
    error = generator.multivariate_normal(np.zeros(3), shared_error(prior).covariance)
    scene_component, scene_normal = _component(prior, generator), generator.standard_normal(3)

    def draw() -> FloatArray:
        component = scene_component if generator.random() < shared else _component(prior, generator)
        normal = math.sqrt(shared) * scene_normal + math.sqrt(1 - shared) * generator.standard_normal(3)
        lower = np.linalg.cholesky(prior.covariances[component])
        return np.asarray(np.exp(prior.means[component] + lower @ normal + error))

    return draw


def _modelled_class(prior: Prior, several: bool, generator: np.random.Generator) -> Draw:
    """Draw objects from the model of the posterior: a hypothesis of similarity, with outliers and gross errors.

    An outlier has random proportions and a size that keeps the scale within the range of the prior.
    several : whether the scene has more than one object of the class; the hypotheses differ only then.
    """
    models = hypotheses(prior) if several else hypotheses(prior)[:1]
    odds = np.exp([model.log_weight for model in models])
    model = models[generator.choice(len(models), p=odds / odds.sum())]
    error = generator.multivariate_normal(np.zeros(3), model.error.covariance)
    centre = prior.weights @ prior.means

    def draw() -> FloatArray:
        if generator.random() < OUTLIER_PROBABILITY:
            shape = LOG_BOX * generator.uniform(-0.5, 0.5, 3)
            return np.asarray(np.exp(centre + shape - shape.mean() + PRIOR_MARGIN_LOG * generator.uniform(-1, 1)))
        component = _component(model.prior, generator)
        size = generator.multivariate_normal(model.prior.means[component], model.prior.covariances[component]) + error
        wrong = generator.random()
        if wrong < 3 * GROSS_ERROR_PROBABILITY:
            size[int(wrong / GROSS_ERROR_PROBABILITY)] += GROSS_ERROR_SD_LOG * generator.standard_normal()
        return np.asarray(np.exp(size))

    return draw


def _component(prior: Prior, generator: np.random.Generator) -> int:
    return int(generator.choice(len(prior.weights), p=prior.weights / prior.weights.sum()))


def _measured(
    name: str, node_id: str, true: FloatArray, knobs: Knobs, generator: np.random.Generator
) -> MeasuredObject:
    extents = true * (1 + generator.uniform(-knobs.noise, knobs.noise, 3))
    cut = np.zeros(3, dtype=bool)
    if generator.random() < knobs.cut:
        cut[generator.choice(3, size=generator.choice([1, 1, 2]), replace=False)] = True
        extents = np.where(cut, extents * generator.uniform(0.2, 0.95, 3), extents)
    off = generator.random(3) < knobs.off
    extents = np.where(off, extents * np.exp(generator.uniform(-MAX_GROSS_ERROR_LOG, MAX_GROSS_ERROR_LOG, 3)), extents)
    eta = np.where(generator.random(3) < np.where(cut, LOW_ETA_TRUNCATED, LOW_ETA_COMPLETE), 0.5, 1.0)
    flagged = cut & (generator.random(3) < FLAGGED_FRACTION)
    order = np.array([0, 1, 2]) if extents[0] >= extents[1] else np.array([1, 0, 2])
    sigma = np.full(3, max(knobs.noise / np.sqrt(3), 0.02))
    return MeasuredObject(name, node_id, extents[order], sigma, eta[order], flagged[order])


def _estimate(world: World, objects: Sequence[tuple[int, MeasuredObject]], method: str) -> Estimate:
    if method == "default":
        rows = [ObjectEvidence(item, world.priors[label], world.nodes[label].pose) for label, item in objects]
        return posterior(rows, level=LEVEL)
    used = [np.flatnonzero(item.confidence >= ETA_THRESHOLD).tolist() for _, item in objects]
    if not any(used):  # no dimension is confident: the paper's method has no estimate, so all dimensions are used
        used = [[0, 1, 2] for _ in objects]
    terms = [
        (world.mixtures[label], axes, item.extents[axes] * 1000)
        for (label, item), axes in zip(objects, used, strict=True)
        if axes
    ]
    proposed = [v for mixture, axes, mm in terms for v in (mixture.weights @ mixture.means)[axes] / mm]
    scales = candidate_scales(np.array(proposed))
    return estimate_on(scales, np.stack([m.log_density(scales[:, None] * mm, axes) for m, axes, mm in terms]), LEVEL)
