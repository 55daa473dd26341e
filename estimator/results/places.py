"""The type of place that a scene's classes suggest, and how common the kinds of a plain name are there.

A plain name is a mixture of kinds whose weights differ between bedrooms, offices, kitchens and bathrooms. `places.json`
holds places that were learned, without names, from rooms whose classes and sizes are known
(`benchmarks.estimator.places`): each has a share, a rate of every class, and for each class a tilt a, under which the
weight of a component with mean m is proportional to w exp(a' (m - mean)). Over all places a class's tilts have the mean
zero: what the rooms of one source have in common is no type of place. The classes of a scene are a draw from the rates
of its place, so that a class without a mask says nothing; one place more is unknown and leaves all as it is.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from metric_base.arrays import FloatArray
from metric_tree.node import Node
from metric_tree.prior import Prior

__all__ = ["MOST_OF_A_CLASS", "Places", "place_shares", "prior_in_place", "shipped_places"]

#: Further objects of a class say no more of the place: ten chairs are one decision.
MOST_OF_A_CLASS = 3

#: Probability that a scene is none of the places, before its classes are seen.
UNKNOWN_SHARE = 0.1

#: Probabilities of places are rounded to this, so that scenes alike share one prior and its tables.
STEP = 0.02

#: Classes of the table that a scene must have: one class alone says too little of its place.
LEAST_CLASSES = 2


@dataclass(frozen=True, slots=True, eq=False)
class Places:
    """The k places.

    share : (k,) sum one; rates : (k, c) of the c nodes; tilts : (k, 3) by node, for length, width, height.
    """

    nodes: tuple[str, ...]
    share: FloatArray
    rates: FloatArray
    tilts: dict[str, FloatArray]

    def shares_of(self, counts: Sequence[int]) -> FloatArray:
        """(k + 1,) probability of each place, and of none, given how many objects of each node there are, (c,)."""
        rates = np.vstack([self.rates, self.share @ self.rates])
        rates /= rates.sum(axis=1, keepdims=True)
        before = np.append((1 - UNKNOWN_SHARE) * self.share, UNKNOWN_SHARE)
        log_share = np.log(before) + np.log(rates) @ np.minimum(counts, MOST_OF_A_CLASS)
        share = np.exp(log_share - log_share.max())
        return np.asarray(share / share.sum())


@lru_cache(maxsize=1)
def shipped_places() -> Places:
    """The places of `places.json`."""
    table = json.loads(Path(__file__).with_name("places.json").read_text(encoding="utf-8"))
    tilts = {node: np.array(rows, dtype=float) for node, rows in table["tilts"].items()}
    return Places(tuple(table["nodes"]), np.array(table["share"]), np.array(table["rates"]), tilts)


def place_shares(nodes: Sequence[Node], places: Places | None = None) -> tuple[float, ...] | None:
    """The probability of each place, the last of none, given the objects' nodes; None where they say too little."""
    places = places or shipped_places()
    count = Counter(name for node in nodes if (name := _counted_as(node, places)) is not None)
    if len(count) < LEAST_CLASSES:
        return None
    share = places.shares_of([count[name] for name in places.nodes])
    return tuple((np.round(share / STEP) * STEP).tolist())


def _counted_as(own: Node, places: Places) -> str | None:
    """The id of the node, or of the one above it that the places know."""
    node: Node | None = own
    while node is not None:
        if node.node_id in places.nodes:
            return node.node_id
        node = node.parent
    return None


@lru_cache(maxsize=2048)
def prior_in_place(prior: Prior, share: tuple[float, ...], places: Places | None = None) -> Prior:
    """The prior with its components' weights as they are in places of these probabilities, as `place_shares` says."""
    places = places or shipped_places()
    tilts = places.tilts.get(prior.node_id)
    axes = [("length", "width", "height").index(dim) for dim in prior.dims if dim in ("length", "width", "height")]
    if tilts is None or len(axes) < len(prior.dims) or len(prior.weights) < 2:
        return prior
    features = prior.means - prior.weights @ prior.means  # (k, d)
    log_weight = np.log(np.maximum(prior.weights, 1e-300)) + np.vstack([tilts, np.zeros(3)])[:, axes] @ features.T
    by_place = np.exp(log_weight - log_weight.max(axis=1, keepdims=True))
    by_place /= by_place.sum(axis=1, keepdims=True)
    weights = np.array(share) @ by_place
    return replace(prior, weights=weights / weights.sum())
