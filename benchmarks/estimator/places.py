"""Types of place, learned from rooms that do not name them, and what they are worth in rooms that took no part.

`python -m benchmarks.estimator.places --raw RAW --cache DIR [--write]`. Rooms are those of ScanNet's
boxes, judged by a tree without ScanNet (`benchmarks.accuracy.unseen`). Each half is judged with what the other says;
--write learns from the even rooms, which no report on unseen rooms has, and writes `estimator/results/places.json`.
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
#: Numbers of places that are compared; the one in use; starts of each fit and its steps.
COUNTS, IN_USE, STARTS, STEPS = (1, 6, 8), 8, 8, 80
#: No class is rarer in a place than this: one odd object shall not settle what the place is.
LEAST_RATE = 0.005
#: Standard deviation of a tilt before rooms are seen; rooms of a class that can say one.
TILT_SD, LEAST_OBJECTS = 2.0, 20

Room = Sequence[tuple[str, list[float]]]


def main() -> None:
    parser = options_parser(__doc__)
    parser.add_argument("--raw", type=Path, required=True, help="folder of raw items")
    parser.add_argument("--cache", type=Path, required=True, help="what is built of them")
    parser.add_argument("--write", action="store_true", help="learn from the even rooms and write the shipped table")
    arguments = parser.parse_args()
    tree, _ = unseen_tree(arguments.raw, arguments.cache)
    rooms = [room for _, room in sorted(rooms_of(BOXES).items())]
    by_name = resolve_categories(tree, {label for room in rooms for label, _ in room})
    if arguments.write:
        with whole_file(OUT) as target:
            target.write_text(json.dumps(_record(learned(rooms[::2], by_name, IN_USE))) + "\n", encoding="utf-8")
        return
    plain = _judged(rooms, by_name, None)
    print("| places | error | difference, 95 % | CRPS | difference, 95 % | coverage |\n|---|---|---|---|---|---|")
    print(f"| none | {plain[:, 0].mean():.1%} | | {plain[:, 1].mean():.4f} | | {plain[:, 2].mean():.2f} |")
    for count in COUNTS:
        own = np.zeros_like(plain)
        for half in (0, 1):
            own[half::2] = _judged(rooms[half::2], by_name, learned(rooms[1 - half :: 2], by_name, count))
        error, crps = (_difference(own[:, column] - plain[:, column]) for column in (0, 1))
        print(
            f"| {count} | {own[:, 0].mean():.1%} | {error} | {own[:, 1].mean():.4f} | {crps} | {own[:, 2].mean():.2f} |"
        )


def learned(rooms: Sequence[Room], by_name: Mapping[str, CategoryMatch], count: int) -> SceneTypes:
    """So many places: a mixture of Poisson rates of the classes, then the tilts that the sizes there ask for."""
    labels = sorted(name for name, one in by_name.items() if one.node is not None)
    counts = np.array([[Counter(label for label, _ in room)[name] for name in labels] for room in rooms], dtype=float)
    share, rates, belongs = _mixture(np.minimum(counts, MAX_COUNT_PER_CLASS), count)
    tilts = {}
    for column, label in enumerate(labels):
        node, prior = by_name[label].node, by_name[label].prior
        objects = [(row, sizes) for row, room in enumerate(rooms) for name, sizes in room if name == label]
        if node is None or prior is None or is_sorted(prior) or len(prior.weights) < 2 or len(objects) < LEAST_OBJECTS:
            continue
        axes, rows = prior_axes(prior), [row for row, _ in objects]
        x = np.log([sorted_extents(sizes)[axes] for _, sizes in objects])
        noise = np.diag(np.array(SIGMA)[axes] ** 2)
        likelihood = np.array([_densities(x, m, s + prior.disagreement() + noise)
                               for m, s in zip(prior.means, prior.covariances, strict=True)]).T  # fmt: skip
        # objects of one room are not independent: each has a part
        weight = belongs[rows] / np.sqrt(counts[rows, column])[:, None]
        features = prior.means - prior.weights @ prior.means
        own = np.array([_tilt(likelihood, weight[:, place], prior.weights, features) for place in range(count)])
        part = share * rates[:, column]
        tilts[node.node_id] = np.zeros((count, 3))
        tilts[node.node_id][:, axes] = own - part @ own / part.sum() if count > 1 else own
    nodes = tuple(node.node_id for name in labels if (node := by_name[name].node) is not None)
    return SceneTypes(nodes, share, np.maximum(rates, LEAST_RATE), tilts)


def _mixture(counts: FloatArray, count: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Shares (k,), rates (k, c) and the rooms' probabilities (n, k) of a mixture of Poisson rates, the best of some."""
    generator, best, mean = np.random.default_rng(0), -np.inf, counts.mean(axis=0)
    for _ in range(STARTS):
        rates = mean * np.exp(generator.normal(0, 0.7, (count, counts.shape[1]))) + 0.02
        share = np.full(count, 1 / count)
        for _ in range(STEPS):
            log_part = np.log(share) + counts @ np.log(rates).T - rates.sum(axis=1)
            top = log_part.max(axis=1, keepdims=True)
            part = np.exp(log_part - top)
            total = float((top[:, 0] + np.log(part.sum(axis=1))).sum())
            part /= part.sum(axis=1, keepdims=True)
            share = (part.sum(axis=0) + 1) / (len(counts) + count)
            rates = (part.T @ counts + 0.5 * mean) / (part.sum(axis=0)[:, None] + 0.5)
        if total > best:
            best, answer = total, (share, rates, part)
    return answer


def _densities(x: FloatArray, mean: FloatArray, covariance: FloatArray) -> FloatArray:
    """(n,) Gaussian densities of x (n, d)."""
    off = x - mean
    distance = np.einsum("ij,ij->i", off @ np.linalg.inv(covariance), off)
    return np.asarray(np.exp(-0.5 * distance) / np.sqrt(np.linalg.det(2 * np.pi * covariance)))


def _tilt(likelihood: FloatArray, part: FloatArray, weights: FloatArray, features: FloatArray) -> FloatArray:
    """(d,) the tilt of one place: likelihood (n, k) of objects under the components, part (n,) of each in the place."""
    flat = OUTLIER_PROBABILITY * np.exp(-LOG_BOX) ** features.shape[1]
    log_weight = np.log(np.maximum(weights, 1e-9))

    def loss(tilt: FloatArray) -> float:
        tilted = np.exp(log_weight + features @ tilt)
        density = (1 - OUTLIER_PROBABILITY) * likelihood @ (tilted / tilted.sum()) + flat
        return float(-part @ np.log(density) + 0.5 * tilt @ tilt / TILT_SD**2)

    return np.asarray(minimize(loss, np.zeros(features.shape[1]), method="BFGS").x)


def _judged(rooms: Sequence[Room], by_name: Mapping[str, CategoryMatch], own: SceneTypes | None) -> FloatArray:
    """(n, 3) error of the highest mode, CRPS, whether the interval holds the truth, of each room with these places."""
    probabilities, tilted = object_priors.scene_type_probabilities, object_priors.prior_for_scene_type
    replaced: dict[str, Any] = {
        "scene_type_probabilities": lambda nodes: None if own is None else probabilities(nodes, own),
        "prior_for_scene_type": lambda prior, probability: tilted(prior, probability, own),
    }
    with patch.multiple(object_priors, **replaced):
        return _outcomes(rooms, by_name)


def _outcomes(rooms: Sequence[Room], by_name: Mapping[str, CategoryMatch]) -> FloatArray:
    """Return error, CRPS and coverage (n, 3) of the rooms."""
    rows = []
    for room in rooms:
        objects = [
            MeasuredObject(str(row), label, sorted_extents(sizes) / 1000, np.array(SIGMA))
            for row, (label, sizes) in enumerate(room)
        ]
        one = posterior(object_evidence(objects, by_name).objects)
        held = one.interval[0] <= 1 <= one.interval[1]
        rows.append((abs(one.modes[0].scale - 1), crps_of(one.curve, 0.0), float(held)))
    return np.array(rows)


def _difference(apart: FloatArray) -> str:
    drawn = np.random.default_rng(0).choice(apart, (2000, len(apart))).mean(axis=1)
    low, high = np.quantile(drawn, [0.025, 0.975])
    return f"{apart.mean():+.4f} ({low:+.4f} to {high:+.4f})"


def _record(own: SceneTypes) -> dict[str, object]:
    return {
        "schema": "metric-tree/places/1",
        "nodes": own.nodes,
        "share": own.probability.round(3).tolist(),
        "rates": own.rates.round(3).tolist(),
        "tilts": {node: rows.round(2).tolist() for node, rows in own.tilts.items()},
    }


if __name__ == "__main__":
    main()
