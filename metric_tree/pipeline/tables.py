"""From fitted leaves to the tables and the manifest of a release."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np
import pyarrow as pa

from crawler.imports.sources import Source
from metric_tree.axes import AXES, EXTENTS
from metric_tree.fit.evidence import EVIDENCE
from metric_tree.fit.inner_priors import belief_of, inner_priors
from metric_tree.fit.intraclass_correlation import Sameness, shrunk_sameness
from metric_tree.fit.mixture import Belief
from metric_tree.fit.moments import VAGUE, Moments
from metric_tree.fit.plain_names import REAL_WITNESS, WITNESS, commonness, is_called, plain_weights, presence
from metric_tree.pipeline.clean import NodeClass
from metric_tree.prior import Prior
from metric_tree.release.schema import NODES, PRIORS
from metric_tree.tiers import TIERS
from taxonomy.categories import Category

__all__ = [
    "JUDGED_SOURCE",
    "NORM_SOURCE",
    "Hierarchy",
    "evidence_counts",
    "kept_categories",
    "node_counts",
    "node_table",
    "prior_table",
    "source_records",
    "tier_counts",
]


#: The project's own tables as sources: written for it by a language model, under its licence.
JUDGED_SOURCE = Source(
    id="judged",
    title="Ranges that a language model judged (data/curated/ranges.csv)",
    url="data/curated/ranges.csv",
    licence="Apache-2.0",
    licence_basis="written for this project",
    kind="judged",
    ship=True,
    attribution="Metric-Tree",
    reader="metric_tree.curated.sizes",
)
NORM_SOURCE = Source(
    id="norms",
    title="Sizes that standards fix, each with document and clause (data/curated/norms.csv)",
    url="data/curated/norms.csv",
    licence="Apache-2.0",
    licence_basis="written for this project; sizes are facts",
    kind="norm",
    ship=True,
    attribution="Metric-Tree",
    reader="metric_tree.curated.sizes",
)
_OWN = {source.id: source for source in (JUDGED_SOURCE, NORM_SOURCE)}


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


def node_table(
    hierarchy: Hierarchy, classes: Mapping[str, NodeClass], priors: Mapping[str, Sequence[Prior]]
) -> pa.Table:
    """The nodes of the release (`metric_tree.release.schema.NODES`)."""
    own = {node_id: sum(one.n_by_source.values()) for node_id, one in classes.items()}
    total = Counter(own)
    for category in reversed(hierarchy.categories):
        if category.parent_id is not None:
            total[category.parent_id] += total[category.node_id]
    rows = []
    for category in hierarchy.categories:
        row = {field.name: getattr(category, field.name, None) for field in NODES}
        own_priors = priors.get(category.node_id, ())
        row |= {"dims": _dims(category, own_priors), "tier": own_priors[0].tier if own_priors else None}
        rows.append(row | {"n_items": total[category.node_id], "n_own": own.get(category.node_id, 0)})
    return pa.Table.from_pylist(rows, schema=NODES)


def node_counts(nodes: pa.Table) -> dict[str, int]:
    """Nodes, leaves and levels of a nodes table, and leaves with at least 1, 10 and 30 items of the fit."""
    parents = set(nodes["parent_id"].to_pylist())
    pairs = zip(nodes["node_id"].to_pylist(), nodes["n_items"].to_pylist(), strict=True)
    leaves = [n_items for node_id, n_items in pairs if node_id not in parents]
    levels = max(nodes["level"].to_pylist(), default=0)
    several = {f"leaves_{least}": sum(n >= least for n in leaves) for least in (1, 10, 30)}
    return {"nodes": nodes.num_rows, "leaves": len(leaves), "levels": levels} | several


def tier_counts(nodes: pa.Table) -> dict[str, dict[str, int]]:
    """Nodes of each level by tier, the best tier first; those without a size under `none`."""
    counts = Counter(zip(nodes["level"].to_pylist(), nodes["tier"].to_pylist(), strict=True))
    levels = sorted(set(nodes["level"].to_pylist()))
    return {
        str(level): {tier or "none": n for tier in (*TIERS, None) if (n := counts[level, tier])} for level in levels
    }


def evidence_counts(classes: Iterable[NodeClass]) -> dict[str, dict[str, int]]:
    """Items of each set of kinds (`EVIDENCE`), and leaves with at least 1, 10 and 30 of them, repeats left out."""
    by_kind = [one.n_by_kind for one in classes]
    evidence = {}
    for name, kinds in EVIDENCE.items():
        items = [sum(n for kind, n in counts.items() if kind in kinds) for counts in by_kind]
        leaves = {f"leaves_{least}": sum(n >= least for n in items) for least in (1, 10, 30)}
        evidence[name] = {"items": sum(items)} | leaves
    return evidence


def prior_table(hierarchy: Hierarchy, priors: Mapping[str, Sequence[Prior]]) -> pa.Table:
    """The priors of the release, in the order of its nodes (`metric_tree.release.schema.PRIORS`)."""
    rows = [prior.row() for category in hierarchy.categories for prior in priors.get(category.node_id, ())]
    return pa.Table.from_pylist(rows, schema=PRIORS)


def source_records(
    declared: Mapping[str, Source], n_fit: Mapping[str, int], n_rows: Mapping[str, int], used: Iterable[str]
) -> list[dict[str, Any]]:
    """The manifest's sources: those that the build used."""
    records = []
    for name in sorted(used):
        source = declared.get(name, _OWN.get(name))
        record = {
            "id": name,
            "title": source.title if source else name,
            "url": source.url if source else "",
            "licence": source.licence if source else "none",
            "attribution": source.attribution if source else "",
            "kind": source.kind if source else "product",
            "n_fit": n_fit.get(name, 0),
            "n_rows": n_rows.get(name, 0),
            "withheld": not (source and source.ship),
        }
        records.append(record | ({"noncommercial": True} if source and source.noncommercial else {}))
    return records


def _dims(category: Category, priors: Sequence[Prior]) -> list[str]:
    """What to use by default: the reviewer's choice where a prior has it, else all that the main prior has."""
    chosen = any(set(category.dims) <= set(prior.dims) for prior in priors)
    return list(category.dims if chosen or not priors else priors[0].dims)


def _summary(node_id: str, axes: tuple[str, ...], below: Sequence[Moments]) -> Moments:
    belief = belief_of(below)
    known = (sum(child.known > 0 for child in below) > 0).astype(float)  # type: ignore[union-attr]
    return Moments(node_id, axes, belief.mean, belief.covariance, known, None)
