"""Learn scene types from unlabelled rooms, and evaluate them on other rooms.

    python -m benchmarks.estimator.places --raw RAW --cache DIR [--write]

The rooms are boxes of ScanNet, evaluated with a tree without ScanNet (`benchmarks.accuracy.unseen`). Each half of the
rooms is evaluated with scene types learned from the other half. `--write` learns from the rooms with even numbers,
which the report on unseen rooms does not use, and writes `estimator/results/places.json`.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from scipy.optimize import minimize

from benchmarks.accuracy.outcomes import crps_of
from benchmarks.accuracy.unseen import SIGMA, rooms_of, sorted_extents, unseen_tree
from benchmarks.common import ROOT, SHARED, options_parser
from estimator.posterior.axis_assignments import LOG_BOX, is_sorted, prior_axes
from estimator.posterior.object_likelihood import OUTLIER_PROBABILITY
from estimator.posterior.posterior import posterior
from estimator.records.objects import MeasuredObject
from estimator.results import object_priors
from estimator.results.object_priors import (
    MAX_COUNT_PER_CLASS,
    CategoryMatch,
    SceneTypes,
    object_evidence,
    resolve_categories,
)
from metric_base.arrays import FloatArray
from metric_base.files import whole_file

BOXES = SHARED / "sizes" / "scannet18_boxes" / "scannet18_boxes.csv"
OUT = ROOT / "estimator" / "results" / "places.json"
#: Numbers of scene types to compare.
COUNTS = (1, 6, 8)
#: Number of scene types in the shipped table.
SHIPPED_COUNT = 8
#: Random initialisations of the EM algorithm.
N_STARTS = 8
#: Iterations of the EM algorithm.
N_ITERATIONS = 80
#: Minimum rate of a class in a scene type, so that one unusual object does not determine the type.
MIN_RATE = 0.005
#: Prior standard deviation of a tilt.
TILT_SD = 2.0
#: Minimum number of objects of a class to fit its tilts.
MIN_OBJECTS = 20

Room = Sequence[tuple[str, list[float]]]


def main() -> None:
    parser = options_parser(__doc__)
    parser.add_argument("--raw", type=Path, required=True, help="folder of raw items")
    parser.add_argument("--cache", type=Path, required=True, help="folder of the built tree")
    parser.add_argument("--write", action="store_true", help="learn from the even rooms and write the shipped table")
    arguments = parser.parse_args()
    tree, _ = unseen_tree(arguments.raw, arguments.cache)
    rooms = [room for _, room in sorted(rooms_of(BOXES).items())]
    by_name = resolve_categories(tree, {label for room in rooms for label, _ in room})
    if arguments.write:
        with whole_file(OUT) as target:
            target.write_text(json.dumps(_record(learned(rooms[::2], by_name, SHIPPED_COUNT))) + "\n", encoding="utf-8")
        return
    plain = _outcomes(rooms, by_name, None)
    print("| places | error | difference, 95 % | CRPS | difference, 95 % | coverage |\n|---|---|---|---|---|---|")
    print(f"| none | {plain[:, 0].mean():.1%} | | {plain[:, 1].mean():.4f} | | {plain[:, 2].mean():.2f} |")
    for count in COUNTS:
        typed = np.zeros_like(plain)
        for half in (0, 1):
            typed[half::2] = _outcomes(rooms[half::2], by_name, learned(rooms[1 - half :: 2], by_name, count))
        error, crps = (_difference(typed[:, column] - plain[:, column]) for column in (0, 1))
        means = f"{typed[:, 0].mean():.1%} | {error} | {typed[:, 1].mean():.4f} | {crps} | {typed[:, 2].mean():.2f}"
        print(f"| {count} | {means} |")


def learned(rooms: Sequence[Room], by_name: Mapping[str, CategoryMatch], count: int) -> SceneTypes:
    """Learn `count` scene types: a mixture of Poisson rates of the classes, then the tilts of their priors."""
    labels = sorted(name for name, match in by_name.items() if match.node is not None)
    counts = np.array([[Counter(label for label, _ in room)[name] for name in labels] for room in rooms], dtype=float)
    weights, rates, responsibilities = _mixture(np.minimum(counts, MAX_COUNT_PER_CLASS), count)
    tilts = {}
    for column, label in enumerate(labels):
        node, prior = by_name[label].node, by_name[label].prior
        objects = [(row, sizes) for row, room in enumerate(rooms) for name, sizes in room if name == label]
        if node is None or prior is None or is_sorted(prior) or len(prior.weights) < 2 or len(objects) < MIN_OBJECTS:
            continue
        axes, rows = prior_axes(prior), [row for row, _ in objects]
        x = np.log([sorted_extents(sizes)[axes] for _, sizes in objects])
        noise = np.diag(np.array(SIGMA)[axes] ** 2)
        likelihood = np.array([_densities(x, m, s + prior.disagreement() + noise)
                               for m, s in zip(prior.means, prior.covariances, strict=True)]).T  # fmt: skip
        # objects of a room are not independent, so their total weight is the square root of their number
        weight = responsibilities[rows] / np.sqrt(counts[rows, column])[:, None]
        features = prior.means - prior.weights @ prior.means
        fitted = np.array([_tilt(likelihood, weight[:, k], prior.weights, features) for k in range(count)])
        part = weights * rates[:, column]
        tilts[node.node_id] = np.zeros((count, 3))
        tilts[node.node_id][:, axes] = fitted - part @ fitted / part.sum() if count > 1 else fitted
    nodes = tuple(node.node_id for name in labels if (node := by_name[name].node) is not None)
    return SceneTypes(nodes, weights, np.maximum(rates, MIN_RATE), tilts)


def _mixture(counts: FloatArray, count: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Fit a mixture of k products of Poisson distributions to counts (n, c) by EM from several starts.

    Returns
    -------
    weights, rates, responsibilities : (k,), (k, c) and (n, k) ndarrays of float
    """
    generator, best, mean = np.random.default_rng(0), -np.inf, counts.mean(axis=0)
    for _ in range(N_STARTS):
        rates = mean * np.exp(generator.normal(0, 0.7, (count, counts.shape[1]))) + 0.02
        weights = np.full(count, 1 / count)
        for _ in range(N_ITERATIONS):
            log_part = np.log(weights) + counts @ np.log(rates).T - rates.sum(axis=1)
            top = log_part.max(axis=1, keepdims=True)
            part = np.exp(log_part - top)
            total = float((top[:, 0] + np.log(part.sum(axis=1))).sum())
            part /= part.sum(axis=1, keepdims=True)
            weights = (part.sum(axis=0) + 1) / (len(counts) + count)
            rates = (part.T @ counts + 0.5 * mean) / (part.sum(axis=0)[:, None] + 0.5)
        if total > best:
            best, result = total, (weights, rates, part)
    return result


def _densities(x: FloatArray, mean: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the Gaussian densities (n,) of x (n, d)."""
    off = x - mean
    distance = np.einsum("ij,ij->i", off @ np.linalg.inv(covariance), off)
    return np.asarray(np.exp(-0.5 * distance) / np.sqrt(np.linalg.det(2 * np.pi * covariance)))


def _tilt(likelihood: FloatArray, part: FloatArray, weights: FloatArray, features: FloatArray) -> FloatArray:
    """Return the tilt (d,) of a scene type.

    likelihood : (n, k) densities of the objects under the components.
    part : (n,) weights of the objects in the scene type.
    """
    flat = OUTLIER_PROBABILITY * np.exp(-LOG_BOX) ** features.shape[1]
    log_weight = np.log(np.maximum(weights, 1e-9))

    def loss(tilt: FloatArray) -> float:
        tilted = np.exp(log_weight + features @ tilt)
        density = (1 - OUTLIER_PROBABILITY) * likelihood @ (tilted / tilted.sum()) + flat
        return float(-part @ np.log(density) + 0.5 * tilt @ tilt / TILT_SD**2)

    return np.asarray(minimize(loss, np.zeros(features.shape[1]), method="BFGS").x)


def _outcomes(rooms: Sequence[Room], by_name: Mapping[str, CategoryMatch], types: SceneTypes | None) -> FloatArray:
    """Return the error of the highest mode, the CRPS and the coverage (n, 3) of the rooms with given scene types."""
    probabilities, tilted = object_priors.scene_type_probabilities, object_priors.prior_for_scene_type
    replaced: dict[str, Any] = {
        "scene_type_probabilities": lambda nodes: None if types is None else probabilities(nodes, types),
        "prior_for_scene_type": lambda prior, probability: tilted(prior, probability, types),
    }
    rows = []
    with patch.multiple(object_priors, **replaced):
        for room in rooms:
            objects = [
                MeasuredObject(str(row), label, sorted_extents(sizes) / 1000, np.array(SIGMA))
                for row, (label, sizes) in enumerate(room)
            ]
            estimate = posterior(object_evidence(objects, by_name).objects)
            covered = estimate.interval[0] <= 1 <= estimate.interval[1]
            rows.append((abs(estimate.modes[0].scale - 1), crps_of(estimate.curve, 0.0), float(covered)))
    return np.array(rows)


def _difference(differences: FloatArray) -> str:
    """Return the mean with its 95 % bootstrap interval as text."""
    resampled = np.random.default_rng(0).choice(differences, (2000, len(differences))).mean(axis=1)
    low, high = np.quantile(resampled, [0.025, 0.975])
    return f"{differences.mean():+.4f} ({low:+.4f} to {high:+.4f})"


def _record(types: SceneTypes) -> dict[str, object]:
    return {
        "schema": "metric-tree/places/1",
        "nodes": types.nodes,
        "share": types.probability.round(3).tolist(),
        "rates": types.rates.round(3).tolist(),
        "tilts": {node: rows.round(2).tolist() for node, rows in types.tilts.items()},
    }


if __name__ == "__main__":
    main()
