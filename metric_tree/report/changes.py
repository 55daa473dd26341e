"""What differs between two releases: nodes, items of each source, coverage of label lists, priors."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from metric_base.arrays import FloatArray
from metric_tree.prior import INTERVAL_QUANTILES
from metric_tree.tree import Node, Tree

__all__ = [
    "SIZE_QUANTILES",
    "SPREAD_QUANTILES",
    "Change",
    "changes",
    "label",
    "largest_changes",
    "removed_nodes",
    "size_and_spread",
    "source_changes",
]

#: Points at which the distribution of changes is reported: of sizes, most of which stay, the far end; of spreads both.
SIZE_QUANTILES = (0.5, 0.75, 0.95, 0.99)
SPREAD_QUANTILES = INTERVAL_QUANTILES

#: Change of ln size that is rounding: a tenth of a per mille, far below what any source states.
ROUNDING = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class Change:
    """Of one node of both releases, over the dimensions of its widest common prior.

    then_mm, now_mm : (d,) medians; size : mean over the dimensions of ln (now / then); spread : the same of the
    standard deviation of ln size.
    """

    node: Node
    before: Node
    dims: tuple[str, ...]
    then_mm: FloatArray
    now_mm: FloatArray
    size: float
    spread: float


def label(tree: Tree) -> str:
    """How a page calls a release: by its version, and by what it leaves out."""
    left_out = "" if tree.release.manifest.get("noncommercial", True) else " without non-commercial sources"
    return f"{tree.version}{left_out}"


def removed_nodes(tree: Tree, before: Tree) -> list[Node]:
    """Nodes of the release before that this one lacks, in their order."""
    known = {node.node_id for node in tree}
    return [node for node in before if node.node_id not in known]


def source_changes(tree: Tree, before: Tree) -> list[tuple[str, int, int]]:
    """Source, items of the fit before and now, where they differ; largest change first."""
    then, now = (_items_of_sources(one.release.manifest["sources"]) for one in (before, tree))
    rows = [(title, then.get(title, 0), now.get(title, 0)) for title in dict.fromkeys([*then, *now])]
    return sorted((row for row in rows if row[1] != row[2]), key=lambda row: (-abs(row[2] - row[1]), row[0]))


def changes(tree: Tree, before: Tree) -> list[Change]:
    """The change of every node of both releases that has a common prior, in the order of the tree."""
    known = {node.node_id: node for node in before}
    pairs = (_change(node, known[node.node_id]) for node in tree if node.node_id in known)
    return [change for change in pairs if change is not None]


def largest_changes(candidates: Iterable[Change], shown: int, least_items: int = 0) -> list[Change]:
    """The nodes whose size changed most, at most `shown`, among those with so many items in both releases."""
    able = [c for c in candidates if min(c.node.n_items, c.before.n_items) >= least_items and abs(c.size) > ROUNDING]
    return sorted(able, key=lambda c: (-abs(c.size), c.node.node_id))[:shown]


def size_and_spread(all_changes: Sequence[Change]) -> list[tuple[str, int, FloatArray, FloatArray]]:
    """Level, nodes, quantiles (q,) of |change of ln size| and of the change of ln spread; last, all levels."""
    numbers = sorted({c.node.level for c in all_changes})
    levels = [(str(level), [c for c in all_changes if c.node.level == level]) for level in numbers]
    return [
        (
            name,
            len(group),
            np.quantile(np.abs([c.size for c in group]), SIZE_QUANTILES),
            np.quantile([c.spread for c in group], SPREAD_QUANTILES),
        )
        for name, group in [*levels, ("all", list(all_changes))]
        if group
    ]


def _change(node: Node, before: Node) -> Change | None:
    common = [dims for dims in node.prior_dims if dims in before.prior_dims]
    if not common:
        return None
    dims = max(common, key=len)
    then, now = before.prior(dims), node.prior(dims)
    sizes = then.quantile(0.5), now.quantile(0.5)
    size = float(np.log(sizes[1] / sizes[0]).mean())
    spread = float(np.log(now.log_sd() / then.log_sd()).mean())
    return Change(node, before, dims, *sizes, size, spread)


def _items_of_sources(records: Iterable[dict[str, Any]]) -> dict[str, int]:
    return {str(record["title"]): int(record.get("n_fit", 0)) for record in records}
