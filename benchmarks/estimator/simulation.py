"""Scale error on simulated scenes: the paper's two figures (section 5), with coverage and refusals.

Objects have true sizes of classes of a release: drawn from its priors with an error that all objects of a class in a
scene share (`--sizes priors`), or from items of one fold of another release that the priors did not see (`--sizes
items --items REF --fold K`). Each scene has a random true scale. Knobs: number of objects, size noise (uniform within
+-R, as in the paper), share of objects with cut sides, share with a wrong label, share of
dimensions grossly off (neither cut nor flagged), copies (all objects of a class are
one model). What the estimators are told: sigma R / sqrt 3 (2 % at least); a cut side is flagged in nine of ten cases;
eta is under 0.7 for six of ten cut sides and one of ten whole ones (the paper's figure of bottles is no better).

    python -m benchmarks.estimator.simulation --tree data/release/X --scenes 300

prints, for each setting and method, |s / s_true - 1|: median, mean, 90th percentile, over all scenes by the highest
mode; coverage of the stated 90 % interval; and the share of scenes that are refused.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import metric_tree
from benchmarks.estimator.class_draws import Draw, modelled_class, sharing_class
from benchmarks.estimator.proper_scores import crps_of
from estimator.baselines.candidates import candidate_scales, estimate_on
from estimator.baselines.paper import Mixture, fit_mixture
from estimator.posterior.likelihood import ObjectEvidence
from estimator.posterior.posterior import Estimate, posterior
from estimator.records.measured_object import ETA_THRESHOLD, MeasuredObject
from metric_base.arrays import FloatArray
from metric_tree.axes import AXES
from metric_tree.prior import Prior
from metric_tree.tree import Node, Tree

__all__ = [
    "SAMENESS_NOISE",
    "SAMENESS_SCENES",
    "SAMENESS_SHARES",
    "Knobs",
    "World",
    "estimates",
    "main",
    "scores",
    "simulated",
    "world",
]

#: The paper's axes (section 5, simulation).
COUNTS = (1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 20, 50)
NOISES = (0.0, 0.03, 0.06, 0.09, 0.12, 0.15)
SHARES = (0.0, 0.1, 0.2, 0.4)

#: Objects and classes of the scenes whose objects share a part of their spread, and the parts; None: as modelled.
SAMENESS_SCENES = tuple((n, c) for n in (1, 3, 5, 10, 20, 50) for c in (1, 2, 3, 5, 10) if c <= n)
SAMENESS_SHARES = (None, 0.0, 0.3, 0.6, 0.9)
SAMENESS_NOISE = 0.05

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

METHODS = ("default", "height", "paper", "boxes")
HEADER = (
    "objects classes shared  noise   cut  wrong   off copies  method    median    mean     p90  cover refused  width"
    "  score   crps"
)


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
    copies: bool = False
    shared: float | None = 0.0
    classes: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """Classes that scenes draw from: nodes, priors over length, width, height, and true sizes (n, 3) mm or None."""

    nodes: tuple[Node, ...]
    priors: tuple[Prior, ...]
    heights: tuple[Prior, ...]
    mixtures: tuple[Mixture, ...]
    sizes: tuple[FloatArray, ...] | None


def world(tree: Tree, items: Tree | None, fold: int, baselines: bool = True, seed: int = 0) -> World:
    """The pool of classes; with `items` their true sizes are that tree's rows of one fold (hash of the item id)."""
    nodes, priors, sizes = [], [], []
    for node in tree.leaves():
        try:
            prior = node.prior(AXES)
        except metric_tree.NoPrior:
            continue
        spread = float(np.log(prior.quantile(0.84)[2] / prior.quantile(0.16)[2]) / 2)
        if prior.n < LEAST_ITEMS or spread > WIDEST:
            continue
        rows = _rows(items, node.node_id, fold) if items is not None else np.ones((1, 3))
        if len(rows):
            nodes.append(node)
            priors.append(prior)
            sizes.append(rows)
    print(f"pool: {len(nodes)} classes: {', '.join(node.name for node in nodes)}", file=sys.stderr)
    mixtures = [fit_mixture(AXES, prior.sample(MOST_ITEMS, seed)) for prior in priors] if baselines else []
    heights = [prior.marginal(("height",)) for prior in priors]
    return World(tuple(nodes), tuple(priors), tuple(heights), tuple(mixtures), tuple(sizes) if items else None)


def simulated(
    world: World, knobs: Knobs, generator: np.random.Generator
) -> tuple[float, list[tuple[int, MeasuredObject]]]:
    """A scene: its true scale (metres per unit), and its objects with the class that each is said to be."""
    scale = float(np.exp(generator.uniform(-3, 3)))
    pool = generator.choice(len(world.nodes), size=min(knobs.classes or CLASSES, len(world.nodes)), replace=False)
    least = [] if knobs.classes is None else pool[: knobs.objects].tolist()
    true = [*least, *generator.choice(pool, knobs.objects - len(least)).tolist()]
    draws = {number: _class_draw(world, number, knobs.shared, true.count(number) > 1, generator) for number in pool}
    model: dict[int, FloatArray] = {}
    objects = []
    for number, true_class in enumerate(true):
        size = draws[true_class]()
        if knobs.copies:
            size = model.setdefault(true_class, size)
        said = true_class
        if generator.random() < knobs.wrong:
            said = int(generator.choice([c for c in range(len(world.nodes)) if c != true_class]))
        objects.append((said, _measured(str(number), world.nodes[said].node_id, size / 1000 / scale, knobs, generator)))
    return scale, objects


def estimates(
    world: World, knobs: Knobs, scenes: int, seed: int, methods: Sequence[str] = METHODS
) -> Iterator[tuple[int, str, float, Estimate]]:
    """Number of the scene, method, log of the true scale and estimate, for each scene and method."""
    for number in range(scenes):
        scale, objects = simulated(world, knobs, np.random.default_rng([seed, number]))
        for name in methods:
            yield number, name, float(np.log(scale)), _estimate(world, objects, name)


def scores(
    world: World, knobs: Knobs, scenes: int, seed: int, methods: Sequence[str] = METHODS
) -> list[dict[str, object]]:
    """One row per method: error median, mean and 90th percentile, coverage, share refused."""
    rows: dict[str, list[tuple[float, ...]]] = {name: [] for name in methods}
    for _, name, truth, estimate in estimates(world, knobs, scenes, seed, methods):
        low, high = np.log(estimate.interval)
        error = abs(np.expm1(np.log(estimate.modes[0].scale) - truth))
        covered, refused = low <= truth <= high, estimate.status == "unresolved"
        rows[name].append((error, covered, refused, *_proper_scores(estimate, truth)))
    return [_row(knobs, name, np.array(values, dtype=float)) for name, values in rows.items()]


def main(argv: Sequence[str] | None = None) -> int:
    """Run the settings of both figures and print them."""
    parser = argparse.ArgumentParser(description="Scale error on simulated scenes.")
    parser.add_argument("--tree", help="release with the priors")
    parser.add_argument("--items", help="release whose items are the true sizes (default: draws from the priors)")
    parser.add_argument("--fold", type=int, default=0, help="fold of the items, 0 to 4")
    parser.add_argument("--scenes", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--part", choices=("counts", "noise", "errors", "copies", "sameness", "all"), default="all")
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=list(METHODS))
    parser.add_argument("--output", type=Path, help="write the rows as JSON")
    options = parser.parse_args(argv)
    items = metric_tree.open(options.items) if options.items else None
    baselines = bool({"paper", "boxes"} & set(options.methods))
    classes = world(metric_tree.open(options.tree), items, options.fold, baselines)
    rows: list[dict[str, object]] = []
    print(HEADER)
    for knobs in _settings(options.part):
        for row in scores(classes, knobs, options.scenes, options.seed, options.methods):
            rows.append(row)
            print(_line(row), flush=True)
    if options.output is not None:
        options.output.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    return 0


def _settings(part: str) -> list[Knobs]:
    base = Knobs()
    settings: dict[str, list[Knobs]] = {
        "counts": [replace(base, objects=n) for n in COUNTS],
        "noise": [
            replace(base, noise=noise, objects=n, cut=0.0, wrong=0.0, off=0.0) for n in (3, 10, 20) for noise in NOISES
        ],
        "errors": [replace(base, cut=c, wrong=0.0) for c in SHARES]
        + [replace(base, cut=0.0, wrong=w) for w in SHARES]
        + [replace(base, off=o) for o in SHARES],
        "sameness": [
            replace(base, objects=n, classes=c, shared=share, noise=SAMENESS_NOISE, cut=0.0, wrong=0.0, off=0.0)
            for n, c in SAMENESS_SCENES
            for share in SAMENESS_SHARES
        ],
        "copies": [replace(base, objects=n, copies=True) for n in (4, 10, 20)],
    }
    return [knobs for name, group in settings.items() if part in {name, "all"} for knobs in group]


def _rows(items: Tree, node_id: str, fold: int) -> FloatArray:
    """(n, 3) mm of the complete items of a fold."""
    try:
        table = items.node(node_id).items()
    except metric_tree.UnknownName:
        return np.zeros((0, 3))
    keep = [
        int(hashlib.sha256(name.encode()).hexdigest(), 16) % 5 == fold for name in table.column("item_id").to_pylist()
    ]
    sizes = np.column_stack([np.array(table.column(f"{name}_mm").to_pylist(), dtype=float) for name in AXES])
    return np.asarray(sizes[np.array(keep, dtype=bool) & np.isfinite(sizes).all(axis=1)])


def _class_draw(world: World, number: int, shared: float | None, several: bool, generator: np.random.Generator) -> Draw:
    """How the objects of a class of this scene come by their sizes: items of the fold, or draws from the priors."""
    if world.sizes is not None:
        sizes = world.sizes[number]
        return lambda: np.asarray(sizes[generator.integers(len(sizes))])
    prior = world.priors[number]
    return modelled_class(prior, several, generator) if shared is None else sharing_class(prior, shared, generator)


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
    if method in {"default", "height"}:
        priors = world.priors if method == "default" else world.heights
        return posterior(
            [ObjectEvidence(item, priors[said], world.nodes[said].pose) for said, item in objects], level=LEVEL
        )
    terms = []
    for said, item in objects:
        axes = np.flatnonzero(item.confidence >= ETA_THRESHOLD) if method == "paper" else np.arange(3)
        if len(axes):
            terms.append((world.mixtures[said], axes.tolist(), item.extents[axes] * 1000))
    if not terms:  # every dimension distrusted: the paper has nothing to say; take the boxes
        return _estimate(world, objects, "boxes")
    proposed = [v for mixture, axes, mm in terms for v in (mixture.weights @ mixture.means)[axes] / mm]
    scales = candidate_scales(np.array(proposed))
    return estimate_on(scales, np.stack([m.log_density(scales[:, None] * mm, axes) for m, axes, mm in terms]), LEVEL)


def _row(knobs: Knobs, name: str, values: FloatArray) -> dict[str, object]:
    error, covered, refused, width, interval_score, crps = values.T
    return {
        "objects": knobs.objects,
        "noise": knobs.noise,
        "cut": knobs.cut,
        "wrong": knobs.wrong,
        "off": knobs.off,
        "copies": knobs.copies,
        "shared": knobs.shared,
        "classes": knobs.classes or CLASSES,
        "method": name,
        "median": float(np.median(error)),
        "mean": float(error.mean()),
        "p90": float(np.quantile(error, 0.9)),
        "coverage": float(covered.mean()),
        "refused": float(refused.mean()),
        "width": float(width.mean()),
        "interval_score": float(interval_score.mean()),
        "crps": float(crps.mean()),
    }


def _proper_scores(estimate: Estimate, truth: float) -> tuple[float, float, float]:
    """Width of the interval, its score (Gneiting and Raftery 2007), and the CRPS, all in log scale.

    The score of a central interval of level L is its width plus 2 / (1 - L) times how far the truth lies outside.
    """
    low, high = np.log(estimate.interval)
    outside = max(low - truth, truth - high, 0.0)
    return float(high - low), float(high - low + 2 / (1 - LEVEL) * outside), crps_of(estimate.curve, truth)


def _shared_text(shared: object) -> str:
    return "model" if shared is None else f"{shared:.0%}"


def _line(row: dict[str, object]) -> str:
    return (
        f"{row['objects']:>7} {row['classes']:>7} {_shared_text(row['shared']):>6} "
        f"{row['noise']:>6.0%} {row['cut']:>5.0%} {row['wrong']:>6.0%} {row['off']:>5.0%} "
        f"{row['copies']!s:>6}  {row['method']:<8} {row['median']:>7.1%} {row['mean']:>7.1%} {row['p90']:>7.1%} "
        f"{row['coverage']:>6.0%} {row['refused']:>7.0%} {row['width']:>6.3f} {row['interval_score']:>6.3f} "
        f"{row['crps']:>6.4f}"
    )


if __name__ == "__main__":
    sys.exit(main())
