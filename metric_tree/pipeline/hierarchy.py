"""Priors of the categories, from the leaves up to the root."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from metric_base.arrays import grouped
from metric_tree.axes import AXES, EXTENTS
from metric_tree.fit.inner_priors import (
    REAL_WITNESS,
    WITNESS,
    child_belief,
    child_frequencies,
    inner_priors,
    plain_name_weights,
    present_fraction,
    shares_plain_name,
)
from metric_tree.fit.intraclass_correlation import IntraclassCorrelation, shrunk_correlations
from metric_tree.fit.mixture import NormalInverseWishart
from metric_tree.fit.moments import VAGUE, Moments
from metric_tree.pipeline.clean import NodeClass
from metric_tree.prior import Prior
from taxonomy.categories import Category


def categories_with_items(categories: Sequence[Category], classes: Mapping[str, NodeClass]) -> list[Category]:
    """Return the categories with items, norms or ranges at or below them, parents first."""
    parents = {category.node_id: category.parent_id for category in categories}
    with_items: set[str] = set()
    for node_id in classes:
        ancestor: str | None = node_id
        while ancestor is not None and ancestor not in with_items:
            with_items.add(ancestor)
            ancestor = parents[ancestor]
    return [category for category in categories if category.node_id in with_items]


@dataclass(frozen=True, slots=True, eq=False)
class Hierarchy:
    """Categories, parents first, and the ids of their children."""

    categories: Sequence[Category]
    children: Mapping[str, Sequence[str]]

    @classmethod
    def of(cls, categories: Sequence[Category]) -> Hierarchy:
        """Return the hierarchy of categories, parents first."""
        return cls(categories, grouped((one.parent_id, one.node_id) for one in categories if one.parent_id is not None))

    def families(self) -> dict[str, str]:
        """Return the node of level 2 at or above each node; the root for the root."""
        families: dict[str, str] = {}
        for category in self.categories:
            parent = category.parent_id
            families[category.node_id] = category.node_id if category.level <= 2 or parent is None else families[parent]
        return families

    def beliefs(self, moments: Iterable[Moments]) -> dict[tuple[str, tuple[str, ...]], NormalInverseWishart]:
        """Estimate the prior of the children of each inner node, by node and frame of axes.

        Moments go up the tree first: the moments of an inner node are the prior of its children. Priors then go down,
        so that a node without other children inherits from its parent.
        """
        known = {(m.node_id, m.axes): m for m in moments}

        def below(node_id: str, axes: tuple[str, ...]) -> list[Moments]:
            return [known[child, axes] for child in self.children.get(node_id, ()) if (child, axes) in known]

        for category in reversed(self.categories):
            for axes in (AXES, EXTENTS):
                if children := below(category.node_id, axes):
                    belief = child_belief(children)
                    n_known = np.sum([child.known > 0 for child in children], axis=0)
                    stated = (n_known > 0).astype(float)
                    key = category.node_id, axes
                    known[key] = Moments(*key, belief.mean, belief.covariance, stated, None)
        beliefs: dict[tuple[str, tuple[str, ...]], NormalInverseWishart] = {}
        for category in self.categories:
            for axes in (AXES, EXTENTS):
                above = beliefs.get((category.parent_id or "", axes), VAGUE)
                beliefs[category.node_id, axes] = child_belief(below(category.node_id, axes), above)
        return beliefs

    def priors(
        self,
        leaves: Mapping[str, Prior],
        classes: Mapping[str, NodeClass],
        frequencies: Mapping[str, Mapping[str, float]] = MappingProxyType({}),
    ) -> dict[str, list[Prior]]:
        """Compute the priors of all nodes from the leaves up; the joint prior of a node is first.

        Parameters
        ----------
        leaves, classes : mapping
            Prior and class of each leaf.
        frequencies : mapping
            Weights of the children of a node that a reviewer stated.
        """
        priors = {node_id: [prior] for node_id, prior in leaves.items()}
        items = {node_id: Counter(one.n_by_source) for node_id, one in classes.items()}
        by_id = {category.node_id: category for category in self.categories}
        trust = {source: WITNESS[kind] for one in classes.values() for source, kind in one.kinds.items()}
        for category in reversed(self.categories):
            node_id = category.node_id
            if node_id in leaves:
                continue
            children = [child for child in self.children.get(node_id, ()) if child in priors]
            items[node_id] = sum((items[child] for child in children), Counter())
            below = [priors[child] for child in children]
            common = child_frequencies([items[child] for child in children], trust, present_fraction(below))
            has_name = [shares_plain_name(by_id[child], category) for child in children]
            weights = plain_name_weights(node_id, children, common, frequencies.get(node_id), has_name)
            upright = sum(float(weight) for weight, own in zip(weights, below, strict=True) if own[0].dims[0] in AXES)
            axes, plain = AXES if upright >= 0.5 else EXTENTS, priors.get(f"{node_id}/other", ())
            sources = items[node_id]
            n_real = sum(trust[source] >= REAL_WITNESS for source in sources)
            priors[node_id] = []
            for one in inner_priors(node_id, below, weights, axes, plain):
                evidence = one.evidence and one.evidence._replace(sources=max(n_real, one.evidence.sources))
                priors[node_id].append(replace(one, n_sources=len(sources) or one.n_sources, evidence=evidence))
        return priors

    def with_correlations(
        self, priors: Mapping[str, list[Prior]], classes: Mapping[str, NodeClass]
    ) -> dict[str, list[Prior]]:
        """Add the intraclass correlations: of a class, or the mean over the classes below an inner node.

        The mean is weighted by items, and its variance includes the differences between the classes. Nodes without a
        known class have the prior of any class.
        """
        fitted = {node_id: one.correlation for node_id, one in classes.items() if one.correlation is not None}
        known, default = shrunk_correlations(fitted)
        below: dict[str, list[tuple[int, IntraclassCorrelation]]] = {}
        for category in reversed(self.categories):
            node_id, parent = category.node_id, category.parent_id
            if node_id in known:
                below[node_id] = [(sum(classes[node_id].n_by_source.values()), known[node_id])]
            if parent is not None:
                below.setdefault(parent, []).extend(below.get(node_id, ()))
        correlations: dict[str, IntraclassCorrelation] = {}
        for node_id, pairs in below.items():
            if pairs:
                weights = np.array([max(n, 1) for n, _ in pairs], dtype=float) / sum(max(n, 1) for n, _ in pairs)
                values, variances = np.array([one.value for _, one in pairs]), np.array([one.sd**2 for _, one in pairs])
                mean = float(weights @ values)
                sd = float(np.sqrt(weights @ (variances + (values - mean) ** 2)))
                correlations[node_id] = IntraclassCorrelation(mean, sd)
        of = {node_id: correlations.get(node_id, default) for node_id in priors}
        return {
            node_id: [replace(one, sameness=of[node_id].value, sameness_sd=of[node_id].sd) for one in rows]
            for node_id, rows in priors.items()
        }
