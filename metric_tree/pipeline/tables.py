"""Tables and manifest of a release from its classes and priors."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa

from crawler.imports.declaration import Source, sources
from metric_tree.fit.rows import EVIDENCE
from metric_tree.pipeline.clean import NodeClass
from metric_tree.pipeline.hierarchy import Hierarchy
from metric_tree.prior import Prior
from metric_tree.release.schema import NODES, PRIORS
from metric_tree.tiers import TIERS

#: Tables of the project as sources by id; a language model wrote them, under the licence of the project.
PROJECT_SOURCES = {source.id: source for source in sources(Path(__file__).with_name("sources"))}


def node_table(
    hierarchy: Hierarchy, classes: Mapping[str, NodeClass], priors: Mapping[str, Sequence[Prior]]
) -> pa.Table:
    """Return the nodes of the release (`metric_tree.release.schema.NODES`)."""
    n_own = {node_id: sum(one.n_by_source.values()) for node_id, one in classes.items()}
    total = Counter(n_own)
    sources = {node_id: set(one.kinds) for node_id, one in classes.items()}
    for category in reversed(hierarchy.categories):
        if category.parent_id is not None:
            sources.setdefault(category.parent_id, set()).update(sources[category.node_id])
            total[category.parent_id] += total[category.node_id]
    rows = []
    for category in hierarchy.categories:
        node_id, node_priors = category.node_id, priors.get(category.node_id, ())
        # The default dimensions are the reviewer's choice if a prior has them, otherwise those of the first prior.
        has_dims = any(set(category.dims) <= set(prior.dims) for prior in node_priors)
        dims = list(category.dims if has_dims or not node_priors else node_priors[0].dims)
        row = {field.name: getattr(category, field.name, None) for field in NODES}
        row |= {"dims": dims, "sources": sorted(sources[node_id])}
        row |= {"tier": node_priors[0].tier if node_priors else None}
        rows.append(row | {"n_items": total[node_id], "n_own": n_own.get(node_id, 0)})
    return pa.Table.from_pylist(rows, schema=NODES)


def prior_table(hierarchy: Hierarchy, priors: Mapping[str, Sequence[Prior]]) -> pa.Table:
    """Return the priors of the release, in the order of its nodes (`metric_tree.release.schema.PRIORS`)."""
    rows = [prior.row() for category in hierarchy.categories for prior in priors.get(category.node_id, ())]
    return pa.Table.from_pylist(rows, schema=PRIORS)


def node_counts(nodes: pa.Table) -> dict[str, int]:
    """Return the numbers of nodes, leaves and levels, and of leaves with at least 1, 10 and 30 items of the fit."""
    parents = set(nodes["parent_id"].to_pylist())
    pairs = zip(nodes["node_id"].to_pylist(), nodes["n_items"].to_pylist(), strict=True)
    leaves = [n_items for node_id, n_items in pairs if node_id not in parents]
    levels = max(nodes["level"].to_pylist(), default=0)
    return {"nodes": nodes.num_rows, "leaves": len(leaves), "levels": levels} | _counts_from(leaves)


def tier_counts(nodes: pa.Table) -> dict[str, dict[str, int]]:
    """Return the number of nodes of each level by tier, the best tier first; `none` for nodes without a size."""
    counts = Counter(zip(nodes["level"].to_pylist(), nodes["tier"].to_pylist(), strict=True))
    levels = sorted(set(nodes["level"].to_pylist()))
    return {
        str(level): {tier or "none": n for tier in (*TIERS, None) if (n := counts[level, tier])} for level in levels
    }


def evidence_counts(classes: Iterable[NodeClass]) -> dict[str, dict[str, int]]:
    """Return the number of items of each set of kinds (`EVIDENCE`), and of leaves with at least 1, 10 and 30."""
    by_kind = [one.n_by_kind for one in classes]
    evidence = {}
    for name, kinds in EVIDENCE.items():
        items = [sum(n for kind, n in counts.items() if kind in kinds) for counts in by_kind]
        evidence[name] = {"items": sum(items)} | _counts_from(items)
    return evidence


def source_records(
    declared: Mapping[str, Source], n_fit: Mapping[str, int], n_rows: Mapping[str, int], used: Iterable[str]
) -> list[dict[str, Any]]:
    """Return the sources of the manifest: the sources that the build used."""
    records = []
    for name in sorted(used):
        source = declared.get(name, PROJECT_SOURCES.get(name))
        stated: dict[str, Any] = {"title": name, "url": "", "licence": "none", "attribution": "", "kind": "product"}
        stated = {field: getattr(source, field) for field in stated} if source else stated
        counts = {"n_fit": n_fit.get(name, 0), "n_rows": n_rows.get(name, 0)}
        terms = {"withheld": not (source and source.ship)}
        terms |= {"noncommercial": True} if source and source.noncommercial else {}
        records.append({"id": name, **stated, **counts, **terms})
    return records


def _counts_from(n_items: Sequence[int]) -> dict[str, int]:
    return {f"leaves_{minimum}": sum(n >= minimum for n in n_items) for minimum in (1, 10, 30)}
