"""Combine measured objects with the priors of their categories (`object_evidence`).

Categories. A category name is resolved to a node of the tree as detectors use it: a `mouse` is a device.

Scene types. The prior of a general name is a mixture of kinds, whose weights differ between bedrooms, offices, kitchens
and bathrooms. `places.json` contains unnamed scene types that were learned from rooms with known classes and sizes
(`benchmarks.estimator.places`). Each has a probability, a rate of every class, and a tilt a for each class, under which
the weight of a component with mean m is proportional to w exp(a' (m - mean)). The mean of the tilts of a class over all
scene types is zero, because a property that all rooms of a source have in common is no scene type. The classes of a
scene are a sample from the rates of its type; a class without a mask has no influence. One more type is unknown and
leaves the weights unchanged.

States. A bed has a headboard or none, a chair is folded or not. The prior of a node with stated states (`Node.states`)
is a mixture of its plain prior and of the states that this prior does not describe; the likelihood decides.

Hidden undersides. The height of a built-in object (a sink, a counter) is truncated, because no image shows its
underside.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from estimator.posterior.object_likelihood import ObjectEvidence, usable
from estimator.records.objects import BY_OUTLINES, MeasuredObject
from estimator.records.result import ScaleEvidence
from metric_base.arrays import BoolArray, FloatArray
from metric_base.errors import InputError
from metric_base.spelling import ADVICE
from metric_tree.axes import AXES, EXTENTS
from metric_tree.context import Where
from metric_tree.node import WITH_HEAD, Node
from metric_tree.prior import Prior
from metric_tree.tree import DETECTORS, Tree

#: Factor of the score of an object whose label is more specific than its node: the size of a foosball table may not be
#: that of a table, and its outlier probability is 0.25 instead of 0.1.
BROADER_SCORE = 0.83
#: Minimum number of points in the score of an object that is measured by its outlines.
MIN_SCORED_POINTS = 2
#: Maximum number of unknown names for which similar names are suggested; each search takes some milliseconds.
MAX_ADVISED_NAMES = 50
#: Note of an object whose height is truncated only because its underside is hidden.
HIDDEN_UNDERSIDE = "its underside is hidden"
#: Maximum count of a class in the probability of a scene type: ten chairs result from one decision.
MAX_COUNT_PER_CLASS = 3
#: Prior probability that the type of a scene is unknown.
UNKNOWN_TYPE_PROBABILITY = 0.1
#: Resolution of the probabilities of scene types. Rounding lets similar scenes share a cached prior.
PROBABILITY_STEP = 0.02
#: Minimum number of classes in the table that a scene must have; one class does not indicate a scene type.
MIN_CLASSES = 2
#: Probability that an object is in one of the states that its prior does not describe: an assumption, because boxes of
#: rooms show too few states to choose it.
STATE_PROBABILITY = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class CategoryMatch:
    """Node and prior of a category name, or the reason for their absence."""

    node: Node | None
    prior: Prior | None
    reason: str | None = None
    is_broader: bool = False  #: The name is more specific than the node, as `foosball table` than `table`.

    @property
    def error(self) -> str | None:
        """The reason without suggested names, which only a warning lists."""
        return None if self.reason is None else self.reason.partition(ADVICE)[0]

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes of every object with this name."""
        return (
            (f"treated as the broader category {self.node.name}",) if self.is_broader and self.node is not None else ()
        )


@dataclass(frozen=True, slots=True, eq=False)
class EvidenceSet:
    """All evidence for the scale of a scene."""

    measured: tuple[MeasuredObject, ...]  #: All objects, used or not.
    matches: Mapping[str, CategoryMatch]  #: Match of each category.
    reasons: tuple[str | None, ...]  #: Reason why a measured object is not used, or None.
    objects: tuple[ObjectEvidence, ...]  #: The n objects that are used, with their priors; empty for the baselines.
    indices: tuple[int, ...]  #: (n,) their indices in `measured`.
    used: tuple[tuple[str, ...], ...]  #: (n,) names of the dimensions that are used.
    gaussians: FloatArray  #: (k, 3) mean and standard deviation of log scale, and doubt, of the other evidence.


def resolve_categories(
    tree: Tree, names: set[str], dims: tuple[str, ...] | None = None, where: Where | None = None
) -> dict[str, CategoryMatch]:
    """Find the node and the prior of each category name.

    Parameters
    ----------
    tree : Tree
    names : set of str
    dims : tuple of str, optional
        Dimensions of the priors; by default the dimensions of each node.
    where : Where, optional
        Region and year of the priors.

    Returns
    -------
    dict
        `CategoryMatch` of each name. A name without a node, with several equally good nodes, or whose node has no such
        prior has a reason.
    """
    matches: dict[str, CategoryMatch] = {}
    unknown = 0
    for name in sorted(names):
        try:
            node = tree.find(name, DETECTORS, advice=unknown < MAX_ADVISED_NAMES)
        except InputError as error:
            matches[name] = CategoryMatch(None, None, str(error))
            unknown += 1
            continue
        words, node_words = _words(name), _words(node.name)
        is_broader = words != node_words and not any(words == _words(alias) for alias in node.aliases)
        if is_broader:
            rules = {"label list", "broader kind"} if words[-len(node_words) :] == node_words else {"broader kind"}
            is_broader = tree.resolve(name, DETECTORS).how in rules
        try:
            matches[name] = CategoryMatch(node, node.prior(dims, where), is_broader=is_broader)
        except InputError as error:
            matches[name] = CategoryMatch(node, None, str(error))
    return matches


def _words(name: str) -> list[str]:
    return name.lower().replace("_", " ").replace("-", " ").split()


def truncate_hidden_heights(
    objects: Sequence[MeasuredObject], matches: Mapping[str, CategoryMatch]
) -> tuple[MeasuredObject, ...]:
    """Mark the heights of built-in objects as truncated: the images end above their undersides.

    An object that reaches down to its support plane is complete. If the prior contains no other complete side, the
    height is kept, because the object would be unusable without it.
    """
    result = []
    for item in objects:
        match, cut = matches[item.category], np.asarray(item.truncated, dtype=bool)
        dims = () if match.prior is None else match.prior.dims
        others = np.isfinite(item.extents[:2]) & ~cut[:2] & [axis in dims for axis in ("length", "width")]
        is_complete = not item.vertical_known or item.unsupported_height is not None
        if match.node is None or match.node.underside_seen or is_complete or cut[2] or not others.any():
            result.append(item)
        else:
            truncated, notes = np.array([*cut[:2], True]), (*item.notes, HIDDEN_UNDERSIDE)
            result.append(replace(item, truncated=truncated, notes=notes))
    return tuple(result)


def visible_truncations(item: MeasuredObject) -> BoolArray:
    """Return the truncated sides (3,) that another image may show."""
    cut = np.asarray(item.truncated, dtype=bool)
    return cut & [True, True, HIDDEN_UNDERSIDE not in item.notes]


@dataclass(frozen=True, slots=True, eq=False)
class SceneTypes:
    """The k scene types with the rates of c classes."""

    nodes: tuple[str, ...]  #: (c,) node of each class.
    probability: FloatArray  #: (k,) prior probabilities, with sum one.
    rates: FloatArray  #: (k, c) rate of each class.
    tilts: dict[str, FloatArray]  #: (k, 3) tilts along length, width and height, by node.

    def probabilities(self, counts: Sequence[int]) -> FloatArray:
        """Return the probability (k + 1,) of each type, and of an unknown one, given the counts (c,) of the classes."""
        rates = np.vstack([self.rates, self.probability @ self.rates])
        rates /= rates.sum(axis=1, keepdims=True)
        before = np.append((1 - UNKNOWN_TYPE_PROBABILITY) * self.probability, UNKNOWN_TYPE_PROBABILITY)
        log_probability = np.log(before) + np.log(rates) @ np.minimum(counts, MAX_COUNT_PER_CLASS)
        probability = np.exp(log_probability - log_probability.max())
        return np.asarray(probability / probability.sum())


@lru_cache(maxsize=1)
def shipped_scene_types() -> SceneTypes:
    """Return the scene types of `places.json`."""
    table = json.loads(Path(__file__).with_name("places.json").read_text(encoding="utf-8"))
    tilts = {node: np.array(rows, dtype=float) for node, rows in table["tilts"].items()}
    return SceneTypes(tuple(table["nodes"]), np.array(table["share"]), np.array(table["rates"]), tilts)


def scene_type_probabilities(nodes: Sequence[Node], types: SceneTypes | None = None) -> tuple[float, ...] | None:
    """Return the probability of each scene type, the last of an unknown one, given the nodes of the objects.

    An object is counted as the closest ancestor of its node that the types contain. None if the objects have fewer than
    `MIN_CLASSES` of these classes.
    """
    types = types or shipped_scene_types()
    count = Counter(name for node in nodes if (name := _class_of(node, types)) is not None)
    if len(count) < MIN_CLASSES:
        return None
    probability = types.probabilities([count[name] for name in types.nodes])
    return tuple((np.round(probability / PROBABILITY_STEP) * PROBABILITY_STEP).tolist())


@lru_cache(maxsize=4096)
def _class_of(node: Node, types: SceneTypes) -> str | None:
    """Return the id of the closest node at or above a node that the scene types contain, or None."""
    ancestors = (above.node_id for above in (node, *node.ancestors()))
    return next((name for name in ancestors if name in types.nodes), None)


@lru_cache(maxsize=2048)
def prior_for_scene_type(prior: Prior, probability: tuple[float, ...], types: SceneTypes | None = None) -> Prior:
    """Return the prior with the component weights for scenes of these types.

    Parameters
    ----------
    prior : Prior
    probability : tuple of float
        Probabilities from `scene_type_probabilities`.
    types : SceneTypes, optional
    """
    types = types or shipped_scene_types()
    tilts = types.tilts.get(prior.node_id)
    axes = [("length", "width", "height").index(dim) for dim in prior.dims if dim in ("length", "width", "height")]
    if tilts is None or len(axes) < len(prior.dims) or len(prior.weights) < 2:
        return prior
    features = prior.means - prior.weights @ prior.means  # (k, d)
    log_weight = np.log(np.maximum(prior.weights, 1e-300)) + np.vstack([tilts, np.zeros(3)])[:, axes] @ features.T
    by_type = np.exp(log_weight - log_weight.max(axis=1, keepdims=True))
    by_type /= by_type.sum(axis=1, keepdims=True)
    weights = np.array(probability) @ by_type
    return replace(prior, weights=weights / weights.sum())


@lru_cache(maxsize=2048)
def prior_with_states(prior: Prior, node: Node) -> Prior:
    """Return the mixture of a prior and of the states of its node that it does not describe, with equal weights.

    A state has the shared error of the class. The prior is that of the outer extents (`Node.outer`). There is no other
    change if the node has no other state over its dimensions, or if the name of the object stated a size.
    """
    prior = node.outer(prior)
    states = [
        state.marginal(prior.dims)
        for name, state in node.states.items()
        if name not in (node.plain_state, WITH_HEAD) and set(prior.dims) <= set(state.dims)
    ]
    if not states or node.stated is not None:
        return prior
    weights = np.full(len(states), STATE_PROBABILITY / len(states))
    return replace(
        prior,
        weights=np.concatenate([(1 - STATE_PROBABILITY) * prior.weights, weights]),
        means=np.concatenate([prior.means, *(state.means for state in states)]),
        covariances=np.concatenate([prior.covariances, *(state.covariances for state in states)]),
    )


def object_evidence(
    objects: Sequence[MeasuredObject], matches: Mapping[str, CategoryMatch], others: Sequence[ScaleEvidence] = ()
) -> EvidenceSet:
    """Combine measured objects with the priors of their categories, and with other evidence.

    An object is used if it was measured, its category has a prior, and at least one extent that the prior contains is
    finite and not truncated. The priors depend on the scene type that the categories indicate, and contain the states
    of the categories.
    """
    reasons = [item.skipped or matches[item.category].error for item in objects]
    probability = scene_type_probabilities(
        [node for item in objects if (node := matches[item.category].node) is not None]
    )
    candidates: dict[int, ObjectEvidence] = {}
    for index, item in enumerate(objects):
        match = matches[item.category]
        if reasons[index] is None and match.node is not None and match.prior is not None:
            prior = match.prior if probability is None else prior_for_scene_type(match.prior, probability)
            prior, factor = prior_with_states(prior, match.node), _score_factor(item, match)
            candidates[index] = ObjectEvidence(item, prior, match.node.pose, factor)
    used: dict[int, tuple[str, ...]] = {}
    in_prior = usable(list(candidates.values()))  # (n, 3)
    truncated = np.array([objects[index].truncated for index in candidates], dtype=bool).reshape(-1, 3)
    for index, judged, complete in zip(candidates, in_prior.tolist(), (in_prior & ~truncated).tolist(), strict=True):
        if not any(judged):
            reasons[index] = f"none of its extents is among {', '.join(candidates[index].prior.dims)}"
        elif not any(complete):
            reasons[index] = "every extent that its prior judges is truncated"
        else:
            used[index] = names_of(objects[index], complete)
    gaussians = [(math.log(item.scale), item.sd_log, item.doubt) for item in others if item.scale is not None]
    return EvidenceSet(
        measured=tuple(objects),
        matches=matches,
        reasons=tuple(reasons),
        objects=tuple(candidates[index] for index in used),
        indices=tuple(used),
        used=tuple(used.values()),
        gaussians=np.array(gaussians, dtype=float).reshape(-1, 3),
    )


def _score_factor(item: MeasuredObject, match: CategoryMatch) -> float:
    """Return the factor (0 to 1) of the score of an object due to its node and to the number of its points.

    The distance of an object that is measured by its outlines depends on its n points. They are of another surface with
    the probability 1 / sqrt(n), the relative standard deviation of a count.
    """
    factor = BROADER_SCORE if match.is_broader else 1.0
    if BY_OUTLINES in item.notes and item.points:
        factor *= 1 - 1 / math.sqrt(max(item.points, MIN_SCORED_POINTS))
    return factor


def selected_evidence(
    objects: Sequence[MeasuredObject],
    matches: Mapping[str, CategoryMatch],
    reasons: Sequence[str | None],
    used: Mapping[int, tuple[str, ...]],
) -> EvidenceSet:
    """Return the objects that a baseline uses, without priors: `used` has the dimensions of each by its index."""
    return EvidenceSet(tuple(objects), matches, tuple(reasons), (), tuple(used), tuple(used.values()), np.zeros((0, 3)))


def dimension_names(item: MeasuredObject) -> tuple[str, str, str]:
    """Return the names of the three extents; a box without a vertical has sorted extents."""
    return (AXES[0], AXES[1], AXES[2]) if item.vertical_known else EXTENTS


def names_of(item: MeasuredObject, chosen: Sequence[bool]) -> tuple[str, ...]:
    """Return the names of the three extents that are chosen."""
    return tuple(name for name, keep in zip(dimension_names(item), chosen, strict=True) if keep)
