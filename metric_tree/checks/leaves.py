"""Checks on the sizes of leaves beside ranges, siblings and sources (codes W411 to W415)."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pyarrow as pa

from metric_base.arrays import FloatArray
from metric_tree.axes import AXES, EXTENTS
from metric_tree.build.leaf_findings import CODES, LeafSize, leaf_findings, titles
from metric_tree.checks.finding import Finding
from metric_tree.curated.sizes import settled_findings
from metric_tree.fit.evidence import JUDGED, NORM
from metric_tree.pipeline.clean import extents_of
from metric_tree.prior import Prior

__all__ = ["CODES", "findings"]

#: The release whose findings `data/curated/settled.csv` settles.
SHIPPED = "metric-tree"


def findings(nodes: pa.Table, items: pa.Table, priors: pa.Table, manifest: Mapping[str, Any]) -> Iterator[Finding]:
    """Findings on the leaves, from the rows that ship; those of the shipped release that are settled are left out."""
    accepted = settled_findings() if manifest["name"] == SHIPPED else frozenset()
    for one in leaf_findings(list(_leaf_sizes(nodes, items, priors)), accepted):
        yield Finding(one.code, one.node_id, one.message)


def _leaf_sizes(nodes: pa.Table, items: pa.Table, priors: pa.Table) -> Iterator[LeafSize]:
    means = _source_means(items)
    fitted: dict[str, Mapping[str, Any]] = {}
    for row in priors.to_pylist():
        fitted.setdefault(row["node_id"], row)
    above = dict(zip(nodes["node_id"].to_pylist(), nodes["parent_id"].to_pylist(), strict=True))
    inner, named = set(above.values()), titles(items)
    for node in nodes.to_pylist():
        node_id = node["node_id"]
        if node_id in inner or node_id not in fitted:
            continue
        prior = Prior.of_row(fitted[node_id])
        frame = int(prior.dims[0] in EXTENTS)
        said = {key: mean[frame] for key, mean in means.get(node_id, {}).items()}
        typical = next((mean for (_, kind), mean in said.items() if kind == JUDGED), None)
        sources = {name: mean for (name, kind), mean in said.items() if kind not in {JUDGED, NORM}}
        yield LeafSize(
            node_id,
            node["parent_id"] or "",
            node["pose"],
            prior.dims,
            prior.quantile(0.5),
            typical,
            sources,
            _family(node_id, above),
            named.get(node_id, ()),
        )


def _family(node_id: str, above: Mapping[str, str | None]) -> str:
    """The node of level 2 that a node is in, below the root."""
    path = [node_id]
    while (parent := above.get(path[-1])) is not None and parent not in path:
        path.append(parent)
    return path[-2] if len(path) > 1 else node_id


def _source_means(items: pa.Table) -> dict[str, dict[tuple[str, str], tuple[FloatArray, FloatArray]]]:
    """By leaf and (source, kind): geometric mean (3,) of the axes, and (3,) of the extents, mm, NaN unstated."""
    axes = np.column_stack([items[f"{axis}_mm"].to_numpy(zero_copy_only=False) for axis in AXES])
    sizes = np.log(np.stack([axes.astype(float), extents_of(items)], axis=1))  # (n, 2, 3)
    groups: defaultdict[tuple[str, str, str], list[int]] = defaultdict(list)
    columns = (items[name].to_pylist() for name in ("node_id", "source", "kind"))
    for row, key in enumerate(zip(*columns, strict=True)):
        groups[key].append(row)
    means: defaultdict[str, dict[tuple[str, str], tuple[FloatArray, FloatArray]]] = defaultdict(dict)
    for (node_id, source, kind), rows in groups.items():
        stated = ~np.isnan(sizes[rows])
        total, count = np.where(stated, sizes[rows], 0.0).sum(axis=0), stated.sum(axis=0)
        mean = np.exp(np.where(count > 0, total / np.maximum(count, 1), np.nan))
        means[node_id][source, kind] = (mean[0], mean[1])
    return means
