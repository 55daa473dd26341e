"""Beliefs and priors of the categories, from the leaves up to the root."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from metric_tree.axes import AXES, EXTENTS
from metric_tree.fit.inner_priors import (
    REAL_WITNESS,
    WITNESS,
    belief_of,
    commonness,
    inner_priors,
    is_called,
    plain_weights,
    presence,
)
from metric_tree.fit.intraclass_correlation import Sameness, shrunk_sameness
from metric_tree.fit.mixture import Belief
from metric_tree.fit.moments import VAGUE, Moments
from metric_tree.pipeline.clean import NodeClass
from metric_tree.prior import Prior
from taxonomy.categories import Category


def _summary(node_id: str, axes: tuple[str, ...], below: Sequence[Moments]) -> Moments:
    belief = belief_of(below)
    known = (sum(child.known > 0 for child in below) > 0).astype(float)  # type: ignore[union-attr]
    return Moments(node_id, axes, belief.mean, belief.covariance, known, None)


def kept_categories(categories: Sequence[Category], classes: Mapping[str, NodeClass]) -> list[Category]:
    """The categories that have items, norms or ranges at or below them, parents first."""
    parents = {category.node_id: category.parent_id for category in categories}
    kept: set[str] = set()
    for node_id in classes:
        above: str | None = node_id
        while above is not None and above not in kept:
            kept.add(above)
            above = parents[above]
    return [category for category in categories if category.node_id in kept]


@dataclass(frozen=True, slots=True, eq=False)
class Hierarchy:
    """The kept categories and their children."""

    categories: Sequence[Category]
    children: Mapping[str, Sequence[str]]

    @classmethod
    def of(cls, categories: Sequence[Category]) -> Hierarchy:
        """The hierarchy of categories, parents first."""
        children: dict[str, list[str]] = {}
        for category in categories:
            if category.parent_id is not None:
                children.setdefault(category.parent_id, []).append(category.node_id)
        return cls(categories, children)

    def families(self) -> dict[str, str]:
        """The node of level 2 at or above each node; the root's own is itself."""
        above: dict[str, str] = {}
        for category in self.categories:
            parent = category.parent_id
            above[category.node_id] = category.node_id if category.level <= 2 or parent is None else above[parent]
        return above

    def beliefs(self, moments: Iterable[Moments]) -> dict[tuple[str, tuple[str, ...]], Belief]:
        """What each inner node believes of its children, by node and frame of axes.

        Moments of an inner node are its belief's own, so that a node without other children inherits from above.
        """
        known = {(m.node_id, m.axes): m for m in moments}
        for category in reversed(self.categories):
            for axes in (AXES, EXTENTS):
                below = [
                    known[key] for child in self.children.get(category.node_id, ()) if (key := (child, axes)) in known
                ]
                if below:
                    known[category.node_id, axes] = _summary(category.node_id, axes, below)
        beliefs: dict[tuple[str, tuple[str, ...]], Belief] = {}
        for category in self.categories:
            for axes in (AXES, EXTENTS):
                below = [
                    known[key] for child in self.children.get(category.node_id, ()) if (key := (child, axes)) in known
                ]
                above = beliefs.get((category.parent_id or "", axes), VAGUE)
                beliefs[category.node_id, axes] = belief_of(below, above)
        return beliefs

    def priors(
        self,
        leaves: Mapping[str, Prior],
        classes: Mapping[str, NodeClass],
        frequencies: Mapping[str, Mapping[str, float]] = MappingProxyType({}),
    ) -> dict[str, list[Prior]]:
        """The priors of all nodes, the main one first: the leaves' and, from the leaves up, of the nodes above them.

        Parameters
        ----------
        frequencies : by node, weights of its children that a reviewer stated
        """
        priors = {node_id: [prior] for node_id, prior in leaves.items()}
        items = {node_id: Counter(one.n_by_source) for node_id, one in classes.items()}
        by_id = {category.node_id: category for category in self.categories}
        trust = {source: WITNESS[kind] for one in classes.values() for source, kind in one.kinds.items()}
        for category in reversed(self.categories):
            if category.node_id in leaves:
                continue
            having = [child for child in self.children.get(category.node_id, ()) if child in priors]
            items[category.node_id] = sum((items[child] for child in having), Counter())
            below = [priors[child] for child in having]
            common = commonness([items[child] for child in having], trust, presence(below))
            kinds = [is_called(by_id[child], category) for child in having]
            weights = plain_weights(category.node_id, having, common, frequencies.get(category.node_id), kinds)
            upright = sum(float(weight) for weight, own in zip(weights, below, strict=True) if own[0].dims[0] in AXES)
            axes, plain = AXES if upright >= 0.5 else EXTENTS, priors.get(f"{category.node_id}/other", ())
            fitted = inner_priors(category.node_id, below, weights, axes, plain)
            sources = items[category.node_id]
            real = sum(trust[source] >= REAL_WITNESS for source in sources)
            priors[category.node_id] = [
                replace(
                    one,
                    n_sources=len(sources) or one.n_sources,
                    evidence=one.evidence._replace(sources=max(real, one.evidence.sources)) if one.evidence else None,
                )
                for one in fitted
            ]
        return priors

    def with_sameness(
        self, priors: Mapping[str, list[Prior]], classes: Mapping[str, NodeClass]
    ) -> dict[str, list[Prior]]:
        """The priors with the sameness of each node: a class's own, an inner node's the mean of the known ones below.

        Nodes below which no room is known have what is believed of any class.
        """
        own = {node_id: one.sameness for node_id, one in classes.items() if one.sameness is not None}
        known, default = shrunk_sameness(own)
        below: dict[str, list[tuple[int, Sameness]]] = {}
        for category in reversed(self.categories):
            node_id, parent = category.node_id, category.parent_id
            if node_id in known:
                below[node_id] = [(sum(classes[node_id].n_by_source.values()), known[node_id])]
            if parent is not None:
                below.setdefault(parent, []).extend(below.get(node_id, ()))
        shares = {node_id: _mean_sameness(pairs) if pairs else default for node_id, pairs in below.items()}
        return {
            node_id: [
                replace(one, sameness=share.share, sameness_sd=share.sd)
                for share in [shares.get(node_id, default)]
                for one in rows
            ]
            for node_id, rows in priors.items()
        }


def _mean_sameness(pairs: Sequence[tuple[int, Sameness]]) -> Sameness:
    """Mean of several classes' by their items; its deviation holds how much they differ."""
    weights = np.array([max(n, 1) for n, _ in pairs], dtype=float) / sum(max(n, 1) for n, _ in pairs)
    shares, variances = np.array([one.share for _, one in pairs]), np.array([one.sd**2 for _, one in pairs])
    mean = float(weights @ shares)
    return Sameness(mean, float(np.sqrt(weights @ (variances + (shares - mean) ** 2))))
