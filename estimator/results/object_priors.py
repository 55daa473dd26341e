"""The type of place that a scene's classes suggest, and how common the kinds of a plain name are there.

A plain name is a mixture of kinds whose weights differ between bedrooms, offices, kitchens and bathrooms. `places.json`
holds places that were learned, without names, from rooms whose classes and sizes are known
(`benchmarks.estimator.places`): each has a share, a rate of every class, and for each class a tilt a, under which the
weight of a component with mean m is proportional to w exp(a' (m - mean)). Over all places a class's tilts have the mean
zero: what the rooms of one source have in common is no type of place. The classes of a scene are a draw from the rates
of its place, so that a class without a mask says nothing; one place more is unknown and leaves all as it is.

What a category name means in the tree, read as detectors mean it: a `mouse` is a device.

Heights of what is built in: nobody sees the underside of a sink, or what is under a counter as part of it.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from estimator.posterior.object_likelihood import ObjectEvidence, usable
from estimator.records.objects import MeasuredObject
from metric_base.arrays import BoolArray, FloatArray
from metric_base.errors import InputError
from metric_base.spelling import ADVICE
from metric_tree.context import Where
from metric_tree.node import Node
from metric_tree.prior import Prior
from metric_tree.tree import DETECTORS, Tree

#: What is left of the score of an object whose label is read as a broader kind: a foosball table is no usual table, and
#: its chance of being unlike the prior is one in four rather than one in ten.
BROADER_SCORE = 0.7
#: Unknown names for which others are offered: each takes some milliseconds, and nobody reads more of them.
MAX_ADVISED_NAMES = 50
#: The note of an object whose height is truncated for this reason alone.
UNSEEN_UNDERSIDE = "its underside is not seen"
#: Further objects of a class say no more of the place: ten chairs are one decision.
MOST_OF_A_CLASS = 3
#: Probability that a scene is none of the places, before its classes are seen.
UNKNOWN_SHARE = 0.1
#: Probabilities of places are rounded to this, so that scenes alike share one prior and its tables.
STEP = 0.02
#: Classes of the table that a scene must have: one class alone says too little of its place.
LEAST_CLASSES = 2


@dataclass(frozen=True, slots=True, eq=False)
class LabelMeaning:
    """The node of a category name and its prior, or the reason why there is none.

    broader : the name says more than the node does, as `foosball table` does of a table.
    """

    node: Node | None
    prior: Prior | None
    reason: str | None = None
    broader: bool = False

    @property
    def error(self) -> str | None:
        """The reason without the names that may be meant: a warning lists them, once."""
        return None if self.reason is None else self.reason.partition(ADVICE)[0]

    @property
    def notes(self) -> tuple[str, ...]:
        """What is said of every object of this name."""
        return (f"read as the broader kind {self.node.name}",) if self.broader and self.node is not None else ()


def meanings(
    tree: Tree, names: set[str], dims: tuple[str, ...] | None = None, where: Where | None = None
) -> dict[str, LabelMeaning]:
    """What each name means. With `dims` the prior is over these alone, else over the node's own.

    With `where` it is that of a region and a year. A name that means no node, or several alike, or a node without
    such a prior, has a reason instead: it is listed, not fatal.
    """
    known: dict[str, LabelMeaning] = {}
    unknown = 0
    for name in sorted(names):
        known[name] = _meaning(tree, name, dims, where, unknown < MAX_ADVISED_NAMES)
        unknown += known[name].node is None
    return known


def _meaning(tree: Tree, name: str, dims: tuple[str, ...] | None, where: Where | None, advice: bool) -> LabelMeaning:
    try:
        node = tree.find(name, DETECTORS, advice=advice)
    except InputError as error:
        return LabelMeaning(None, None, str(error))
    try:
        return LabelMeaning(node, node.prior(dims, where), broader=_is_broader(tree, name, node))
    except InputError as error:
        return LabelMeaning(node, None, str(error))


def _is_broader(tree: Tree, name: str, node: Node) -> bool:
    """Whether a name ends with the name of its node and says more, which is neither an adjective nor a known name."""
    words, own = _words(name), _words(node.name)
    if words == own or words[-len(own) :] != own or any(words == _words(alias) for alias in node.aliases):
        return False
    return tree.resolve(name, DETECTORS).how in {"label list", "broader kind"}


def _words(name: str) -> list[str]:
    return name.lower().replace("_", " ").replace("-", " ").split()


def with_unseen_undersides(
    objects: Sequence[MeasuredObject], by_name: Mapping[str, LabelMeaning]
) -> tuple[MeasuredObject, ...]:
    """The objects, the heights of what is built in truncated: what is seen ends above the underside.

    An object that reaches down to the plane that it stands on is whole. Where the prior judges no other whole side,
    the height stays: it is better than nothing.
    """
    return tuple(_with_unseen_underside(item, by_name[item.category]) for item in objects)


def cut_sides(item: MeasuredObject) -> BoolArray:
    """(3,) the truncated sides that another picture may show."""
    cut = np.asarray(item.truncated, dtype=bool)
    return cut & [True, True, UNSEEN_UNDERSIDE not in item.notes]


def _with_unseen_underside(item: MeasuredObject, meaning: LabelMeaning) -> MeasuredObject:
    cut = np.asarray(item.truncated, dtype=bool)
    judged = () if meaning.prior is None else meaning.prior.dims
    others = np.isfinite(item.extents[:2]) & ~cut[:2] & [axis in judged for axis in ("length", "width")]
    stands = not item.vertical_known or item.unsupported_height is not None
    if meaning.node is None or meaning.node.underside_seen or stands or cut[2] or not others.any():
        return item
    return replace(item, truncated=np.array([*cut[:2], True]), notes=(*item.notes, UNSEEN_UNDERSIDE))


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


def evidence_of(
    objects: Sequence[MeasuredObject], by_name: Mapping[str, LabelMeaning]
) -> tuple[dict[int, ObjectEvidence], list[str | None]]:
    """The objects that can speak, by place in the list, and per object the reason why it cannot, or None.

    Their priors are those of the type of place that the classes suggest (`places`).
    """
    reasons = [item.skipped or by_name[item.category].error for item in objects]
    stated: dict[int, ObjectEvidence] = {}
    share = place_shares([node for item in objects if (node := by_name[item.category].node) is not None])
    for place, item in enumerate(objects):
        meaning = by_name[item.category]
        if reasons[place] is None and meaning.node is not None and meaning.prior is not None:
            judged = replace(item, score=BROADER_SCORE * item.score) if meaning.broader else item
            prior = meaning.prior if share is None else prior_in_place(meaning.prior, share)
            stated[place] = ObjectEvidence(judged, prior, meaning.node.pose)
    for place, there in zip(list(stated), usable(list(stated.values())).tolist(), strict=True):
        if not any(there):
            reasons[place] = f"none of its extents is among {', '.join(stated.pop(place).prior.dims)}"
        elif not np.any(there & ~np.asarray(objects[place].truncated, dtype=bool)):
            reasons[place] = "every extent that its prior judges is truncated"
            del stated[place]
    return stated, reasons
