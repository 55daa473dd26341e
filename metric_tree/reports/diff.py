"""Differences between two releases: nodes, tiers, licences, items of each source, and priors with their new items."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from metric_tree.node import Node, NoPrior, UnknownName
from metric_tree.prior import INTERVAL_QUANTILES
from metric_tree.tree import Tree

#: Minimum relative change of a median of a moved prior, less than the disagreement between sources of a class.
MIN_MEDIAN_CHANGE = 0.05
#: Minimum relative change of the length of the 90 % interval of ln size of a moved prior.
MIN_SPREAD_CHANGE = 0.2


@dataclass(frozen=True, slots=True)
class MovedPrior:
    """A node whose prior moved."""

    node: str
    dim: str
    before_mm: float  #: Median before.
    after_mm: float  #: Median after.
    median: float  #: Relative change of the median.
    spread: float  #: Relative change of the length of the 90 % interval of ln size.
    blame: dict[str, int]  #: Shipped items by source that the node gained (+) or lost (-), the most first.


@dataclass(frozen=True, slots=True)
class ReleaseDiff:
    """Changes from the release `before` to `after`; nodes are ids, pairs are (before, after)."""

    before: str
    after: str
    nodes_before: int
    nodes_after: int
    added: list[str]
    removed: list[str]
    merged: dict[str, str]  #: Successor of a removed node, or the node that has most of its items.
    moved: dict[str, tuple[str | None, str | None]]  #: Parents.
    renamed: dict[str, tuple[str, str]]
    tiers: dict[str, tuple[str, str]]
    priors: list[MovedPrior]
    items: dict[str, tuple[int, int]]  #: Shipped items by source.
    licences: dict[str, tuple[int, int]]  #: Shipped items by licence.

    @property
    def share_moved(self) -> float:
        """Fraction of the nodes of both releases whose prior moved, 0 to 1."""
        both = self.nodes_before - len(self.removed)
        return len(self.priors) / both if both else 0.0

    def of_leaves(self, after: Tree, factor: float) -> ReleaseDiff:
        """Return the diff with only the priors of leaves whose median moved by more than `factor`."""
        moved = [one for one in self.priors if abs(math.log1p(one.median)) > math.log(factor)]
        return replace(self, priors=[one for one in moved if not after.node(one.node).children])

    def record(self) -> dict[str, Any]:
        """Return the diff as a JSON object (`metric-tree/diff/1`)."""
        fields = {name: getattr(self, name) for name in self.__dataclass_fields__ if name != "priors"}
        priors = [{name: getattr(one, name) for name in one.__dataclass_fields__} for one in self.priors]
        return {"schema": "metric-tree/diff/1", **fields, "priors": priors, "share_moved": round(self.share_moved, 5)}


def release_diff(before: Tree, after: Tree) -> ReleaseDiff:
    """Compare two releases."""
    old, new = ({node.node_id: node for node in tree} for tree in (before, after))
    pairs = [(node, new[node_id]) for node_id, node in old.items() if node_id in new]
    removed = [node_id for node_id in old if node_id not in new]
    # Shipped items of both releases, joined by id, with their row, node and source in each.
    tables = []
    for tree in (before, after):
        table = tree.release.table("items").select(["item_id", "node_id", "source"])
        tables.append(table.append_column("row", pa.array(range(table.num_rows))))
    items = tables[0].join(tables[1], "item_id", join_type="full outer", right_suffix="_after")
    # Node that has most items of each removed node; the first in the table if several have as many.
    is_removed = pc.is_in(items["node_id"], value_set=pa.array(removed, pa.string()))
    went = items.filter(pc.and_(is_removed, pc.is_valid(items["node_id_after"]))).sort_by("row")
    counts = went.group_by(["node_id", "node_id_after"], use_threads=False).aggregate([([], "count_all")])
    most: dict[str, tuple[int, str]] = {}
    for row in counts.to_pylist():
        if row["count_all"] > most.get(row["node_id"], (0, ""))[0]:
            most[row["node_id"]] = row["count_all"], row["node_id_after"]
    merged = {node_id: destination for node_id, (_, destination) in most.items()}
    for node_id in removed:
        with suppress(UnknownName):
            merged[node_id] = after.node(node_id).node_id  # the successor that the release states
    tiers = ((a.node_id, a.tier, b.tier) for a, b in pairs)
    # Number of items by source that each leaf gained (+) or lost (-).
    gains: dict[str, Counter[str]] = {}
    is_same = pc.fill_null(pc.equal(items["node_id"], items["node_id_after"]), False)
    changed = items.filter(pc.invert(is_same))
    for sign, suffix in ((1, "_after"), (-1, "")):
        keys = [f"node_id{suffix}", f"source{suffix}"]
        rows = changed.filter(pc.is_valid(changed[keys[0]])).sort_by(f"row{suffix}")
        for row in rows.group_by(keys, use_threads=False).aggregate([([], "count_all")]).to_pylist():
            gains.setdefault(row[keys[0]], Counter())[row[keys[1]]] += sign * row["count_all"]
    return ReleaseDiff(
        before=before.version,
        after=after.version,
        nodes_before=len(old),
        nodes_after=len(new),
        added=[node_id for node_id in new if node_id not in old],
        removed=removed,
        merged=merged,
        moved={a.node_id: (a.parent_id, b.parent_id) for a, b in pairs if a.parent_id != b.parent_id},
        renamed={a.node_id: (a.name, b.name) for a, b in pairs if a.name != b.name},
        tiers={node_id: (then, now) for node_id, then, now in tiers if then and now and then != now},
        priors=sorted(_moved_priors(pairs, gains), key=lambda one: (-abs(np.log1p(one.median)), one.node)),
        items=_changed_counts(before, after, "source"),
        licences=_changed_counts(before, after, "licence"),
    )


def _moved_priors(pairs: list[tuple[Node, Node]], gains: dict[str, Counter[str]]) -> Iterator[MovedPrior]:
    """Yield the moved priors of nodes of both releases, with the dimension whose median or interval changed most."""
    for a, b in pairs:
        dims = tuple(dim for dim in b.dims if dim in a.dims)
        try:
            then, now = (node.prior(dims) for node in (a, b))
        except NoPrior:
            continue
        old, new = (prior.quantiles(INTERVAL_QUANTILES) for prior in (then, now))  # (3, d)
        median = new[1] / old[1] - 1
        spread = np.log(new[2] / new[0]) / np.log(old[2] / old[0]) - 1
        by_median = bool((np.abs(median) >= MIN_MEDIAN_CHANGE).any())
        if by_median or (np.abs(spread) >= MIN_SPREAD_CHANGE).any():
            k = int(np.argmax(np.abs(np.log1p(median) if by_median else spread)))
            then_mm, now_mm, by, wider = (float(f"{v:.4g}") for v in (old[1, k], new[1, k], median[k], spread[k]))
            total: Counter[str] = Counter()
            for node in b.descendants():
                total.update(gains.get(node.node_id, {}))
            blame = {source: n for source, n in sorted(total.items(), key=lambda pair: -abs(pair[1])) if n}
            yield MovedPrior(b.node_id, dims[k], then_mm, now_mm, by, wider, blame)


def _changed_counts(before: Tree, after: Tree, column: str) -> dict[str, tuple[int, int]]:
    """Return the number of shipped items before and after by the value of a column, if they differ."""
    then, now = (
        Counter(value or "unstated" for value in tree.release.table("items")[column].to_pylist())
        for tree in (before, after)
    )
    return {value: (then[value], now[value]) for value in sorted({*then, *now}) if then[value] != now[value]}


def label(tree: Tree) -> str:
    """Return the name of a release on a page: its version, and a note if it omits sources."""
    note = "" if tree.release.manifest.get("noncommercial", True) else " without non-commercial sources"
    return f"{tree.version}{note}"
