"""Simulated scenes: the paper's two figures (section 5), and objects of a class that are alike.

Objects have true sizes drawn from the priors of a release, with an error that all objects of a class in a scene share.
Each scene has a random true scale. Knobs: number of objects, size noise (uniform within +-R, as in the paper), share of
objects with cut sides, share with a wrong label, share of dimensions grossly off (neither cut nor flagged). What the
estimators are given: sigma R / sqrt 3 (2 % at least); a cut side is flagged in nine of ten cases; eta is under 0.7 for
six of ten cut sides and one of ten whole ones (the paper's figure of bottles is no better).
`python -m benchmarks.accuracy --parts sameness structured errors` runs them.
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

__all__ = ["SAMENESS_NOISE", "SAMENESS_SCENES", "SAMENESS_SHARES", "Knobs", "World", "estimates", "simulated", "world"]

#: Objects and classes of the scenes whose objects share a part of their spread, and the parts; None: as modelled.
SAMENESS_SCENES = tuple((n, c) for n in (1, 3, 5, 10, 20, 50) for c in (1, 2, 3, 5, 10) if c <= n)
SAMENESS_SHARES = (None, 0.0, 0.3, 0.6, 0.9)
SAMENESS_NOISE = 0.05

#: One more object of a class: (3,) length, width, height in mm, in the prior's order.
Draw = Callable[[], FloatArray]

#: A class enters the pool with this many items of the fit and at most this spread of log height: what a detector's
#: list of useful classes looks like.
LEAST_ITEMS, WIDEST = 30, 0.35

#: A scene shows at most so many classes: rooms repeat their chairs.
CLASSES = 8

LEVEL = 0.9
FLAGGED, ETA_SEES, ETA_CRIES = 0.9, 0.6, 0.1
MOST_ITEMS = 150

#: A grossly wrong dimension is off by up to this, natural log: a third less to a half more, as the widths of bottles.
OFF = 0.45


@dataclass(frozen=True, slots=True)
class Knobs:
    """One setting of the simulation; noise, cut, wrong and off are shares from 0 to 1.

    shared : the share of the spread within a source that the objects of a class in a scene have in common, and the
    probability that they are of one component; None: drawn as the posterior assumes, its outliers and gross errors
    included. classes : that a scene draws from, each at least once if it can; None: up to `CLASSES`, at random.
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
    """Classes that scenes draw from: nodes, priors over length, width, height, the paper's mixtures."""

    nodes: tuple[Node, ...]
    priors: tuple[Prior, ...]
    mixtures: tuple[PaperMixture, ...]


def world(tree: Tree, baselines: bool = True, seed: int = 0) -> World:
    """The pool of classes."""
    nodes, priors = [], []
    for node in tree.leaves():
        try:
            prior = node.prior(AXES)
        except metric_tree.NoPrior:
            continue
        spread = float(np.log(prior.quantile(0.84)[2] / prior.quantile(0.16)[2]) / 2)
        if prior.n >= LEAST_ITEMS and spread <= WIDEST:
            nodes.append(node)
            priors.append(prior)
    mixtures = [fit_mixture(AXES, prior.sample(MOST_ITEMS, seed)) for prior in priors] if baselines else []
    return World(tuple(nodes), tuple(priors), tuple(mixtures))


def simulated(
    world: World, knobs: Knobs, generator: np.random.Generator
) -> tuple[float, list[tuple[int, MeasuredObject]]]:
    """A scene: its true scale (metres per unit), and its objects with the class that each is said to be."""
    scale = float(np.exp(generator.uniform(-3, 3)))
    pool = generator.choice(len(world.nodes), size=min(knobs.classes or CLASSES, len(world.nodes)), replace=False)
    least = [] if knobs.classes is None else pool[: knobs.objects].tolist()
    true = [*least, *generator.choice(pool, knobs.objects - len(least)).tolist()]
    draws = {number: _class_draw(world, number, knobs.shared, true.count(number) > 1, generator) for number in pool}
    objects = []
    for number, true_class in enumerate(true):
        size = draws[true_class]()
        said = true_class
        if generator.random() < knobs.wrong:
            said = int(generator.choice([c for c in range(len(world.nodes)) if c != true_class]))
        objects.append((said, _measured(str(number), world.nodes[said].node_id, size / 1000 / scale, knobs, generator)))
    return scale, objects


def estimates(
    world: World, knobs: Knobs, scenes: int, seed: int, methods: Sequence[str]
) -> Iterator[tuple[int, str, float, Estimate]]:
    """Number of the scene, method, log of the true scale and estimate, for each scene and method."""
    for number in range(scenes):
        scale, objects = simulated(world, knobs, np.random.default_rng([seed, number]))
        for name in methods:
            yield number, name, float(np.log(scale)), _estimate(world, objects, name)


def _class_draw(world: World, number: int, shared: float | None, several: bool, generator: np.random.Generator) -> Draw:
    """How the objects of a class of this scene come by their sizes."""
    prior = world.priors[number]
    return _modelled_class(prior, several, generator) if shared is None else _sharing_class(prior, shared, generator)


def _sharing_class(prior: Prior, shared: float, generator: np.random.Generator) -> Draw:
    """Objects that share an error between sources and `shared` of the spread within a source.

    `shared` is also the probability that an object is of the scene's component.
    """
    error = generator.multivariate_normal(np.zeros(3), shared_error(prior).covariance)
    usual, place = _component(prior, generator), generator.standard_normal(3)

    def draw() -> FloatArray:
        component = usual if generator.random() < shared else _component(prior, generator)
        own = math.sqrt(shared) * place + math.sqrt(1 - shared) * generator.standard_normal(3)
        lower = np.linalg.cholesky(prior.covariances[component])
        return np.asarray(np.exp(prior.means[component] + lower @ own + error))

    return draw


def _modelled_class(prior: Prior, several: bool, generator: np.random.Generator) -> Draw:
    """Objects as the posterior takes them to be: a hypothesis of sameness, outliers and gross errors included.

    An outlier has any proportions, and a size for which the scale stays within the prior's reach.
    several : the scene has more than one object of the class; of one alone the first hypothesis says all.
    """
    ways = hypotheses(prior) if several else hypotheses(prior)[:1]
    odds = np.exp([way.log_weight for way in ways])
    way = ways[generator.choice(len(ways), p=odds / odds.sum())]
    error = generator.multivariate_normal(np.zeros(3), way.error.covariance)
    middle = prior.weights @ prior.means

    def draw() -> FloatArray:
        if generator.random() < OUTLIER_PROBABILITY:
            anything = LOG_BOX * generator.uniform(-0.5, 0.5, 3)
            return np.asarray(np.exp(middle + anything - anything.mean() + PRIOR_MARGIN_LOG * generator.uniform(-1, 1)))
        component = _component(way.prior, generator)
        size = generator.multivariate_normal(way.prior.means[component], way.prior.covariances[component]) + error
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
    extents = np.where(off, extents * np.exp(generator.uniform(-OFF, OFF, 3)), extents)
    eta = np.where(generator.random(3) < np.where(cut, ETA_SEES, ETA_CRIES), 0.5, 1.0)
    flagged = cut & (generator.random(3) < FLAGGED)
    order = np.array([0, 1, 2]) if extents[0] >= extents[1] else np.array([1, 0, 2])
    sigma = np.full(3, max(knobs.noise / np.sqrt(3), 0.02))
    return MeasuredObject(name, node_id, extents[order], sigma, eta[order], flagged[order])


def _estimate(world: World, objects: Sequence[tuple[int, MeasuredObject]], method: str) -> Estimate:
    if method == "default":
        rows = [ObjectEvidence(item, world.priors[said], world.nodes[said].pose) for said, item in objects]
        return posterior(rows, level=LEVEL)
    seen = [np.flatnonzero(item.confidence >= ETA_THRESHOLD).tolist() for _, item in objects]
    if not any(seen):  # every dimension distrusted: the paper has nothing to say; take the boxes
        seen = [[0, 1, 2] for _ in objects]
    terms = [
        (world.mixtures[said], axes, item.extents[axes] * 1000)
        for (said, item), axes in zip(objects, seen, strict=True)
        if axes
    ]
    proposed = [v for mixture, axes, mm in terms for v in (mixture.weights @ mixture.means)[axes] / mm]
    scales = candidate_scales(np.array(proposed))
    return estimate_on(scales, np.stack([m.log_density(scales[:, None] * mm, axes) for m, axes, mm in terms]), LEVEL)
