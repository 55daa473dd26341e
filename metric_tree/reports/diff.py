"""What differs between two releases: nodes, tiers, priors that moved, with the items that moved them, and licences.

What differs between two releases: nodes, items of each source, coverage of label lists, priors.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from metric_base.arrays import FloatArray
from metric_tree.node import Node, NoPrior, UnknownName
from metric_tree.prior import INTERVAL_QUANTILES
from metric_tree.tree import Tree

#: A prior has moved if a median moves by this share: less than sources of one class differ by.
MEDIAN_MOVED = 0.05
#: Or if an interval, as a ratio of its ends on the log axis, widens or narrows by this share.
SPREAD_MOVED = 0.2
#: Points at which the distribution of changes is reported: of sizes, most of which stay, the far end; of spreads both.
SIZE_QUANTILES = (0.5, 0.75, 0.95, 0.99)
SPREAD_QUANTILES = INTERVAL_QUANTILES
#: Change of ln size that is rounding: a tenth of a per mille, far below what any source states.
ROUNDING = 1e-4


@dataclass(frozen=True, slots=True)
class MovedPrior:
    """A node whose prior moved: medians in mm, the shares by which median and log interval changed, and the blame.

    blame : shipped items by source that the node gained (+) or lost (-), the most first.
    """

    node: str
    dim: str
    before_mm: float
    after_mm: float
    median: float
    spread: float
    blame: dict[str, int]


@dataclass(frozen=True, slots=True)
class ReleaseDiff:
    """What changed from the release `before` to `after`; nodes are ids.

    merged : old id to its successor, else to the node that its items went to; moved, renamed, tiers : id to what it was
    and is.
    """

    before: str
    after: str
    nodes_before: int
    nodes_after: int
    added: list[str]
    removed: list[str]
    merged: dict[str, str]
    moved: dict[str, tuple[str | None, str | None]]
    renamed: dict[str, tuple[str, str]]
    tiers: dict[str, tuple[str, str]]
    priors: list[MovedPrior]
    items: dict[str, tuple[int, int]]
    licences: dict[str, tuple[int, int]]

    @property
    def share_moved(self) -> float:
        """Share of the nodes of both releases whose prior moved."""
        both = self.nodes_before - len(self.removed)
        return len(self.priors) / both if both else 0.0

    def of_leaves(self, after: Tree, factor: float) -> ReleaseDiff:
        """The diff with the priors of leaves alone whose median moved by more than `factor`."""
        moved = [one for one in self.priors if abs(math.log1p(one.median)) > math.log(factor)]
        return replace(self, priors=[one for one in moved if not after.node(one.node).children])

    def record(self) -> dict[str, Any]:
        """The diff as a JSON object (`metric-tree/diff/1`)."""
        fields = {name: getattr(self, name) for name in self.__dataclass_fields__ if name != "priors"}
        priors = [{name: getattr(one, name) for name in one.__dataclass_fields__} for one in self.priors]
        return {"schema": "metric-tree/diff/1", **fields, "priors": priors, "share_moved": round(self.share_moved, 5)}


def release_diff(before: Tree, after: Tree) -> ReleaseDiff:
    """What changed between two releases."""
    old, new = ({node.node_id: node for node in tree} for tree in (before, after))
    both = [node_id for node_id in old if node_id in new]
    homes = tuple(_homes(tree) for tree in (before, after))
    pairs = [(old[node_id], new[node_id]) for node_id in both]
    removed = [node_id for node_id in old if node_id not in new]
    gains = _gains(*homes)
    return ReleaseDiff(
        before=before.version,
        after=after.version,
        nodes_before=len(old),
        nodes_after=len(new),
        added=[node_id for node_id in new if node_id not in old],
        removed=removed,
        merged=_homes_of_removed(removed, *homes) | _named_successors(removed, after),
        moved={a.node_id: (a.parent_id, b.parent_id) for a, b in pairs if a.parent_id != b.parent_id},
        renamed={a.node_id: (a.name, b.name) for a, b in pairs if a.name != b.name},
        tiers=dict(_tiers(pairs)),
        priors=sorted(_moved_priors(pairs, gains), key=lambda one: (-abs(np.log1p(one.median)), one.node)),
        items=_counts(before, after, "source"),
        licences=_counts(before, after, "licence"),
    )


def _homes(tree: Tree) -> dict[str, tuple[str, str]]:
    """Node and source of each shipped item."""
    table = tree.release.table("items").select(["item_id", "node_id", "source"]).to_pydict()
    return dict(zip(table["item_id"], zip(table["node_id"], table["source"], strict=True), strict=True))


def _homes_of_removed(
    removed: list[str], then: dict[str, tuple[str, str]], now: dict[str, tuple[str, str]]
) -> dict[str, str]:
    """Where most items of each removed node are now."""
    gone = set(removed)
    went: dict[str, Counter[str]] = {}
    for item, (node_id, _) in then.items():
        if node_id in gone and item in now:
            went.setdefault(node_id, Counter())[now[item][0]] += 1
    return {node_id: counts.most_common(1)[0][0] for node_id, counts in went.items()}


def _named_successors(removed: list[str], after: Tree) -> dict[str, str]:
    """What the later release itself says that removed nodes lead to (its table `successors`)."""
    named = {}
    for node_id in removed:
        with suppress(UnknownName):
            named[node_id] = after.node(node_id).node_id
    return named


def _gains(then: dict[str, tuple[str, str]], now: dict[str, tuple[str, str]]) -> dict[str, Counter[str]]:
    """Items by source that each leaf gained or lost."""
    gains: dict[str, Counter[str]] = {}
    for sign, homes, others in ((1, now, then), (-1, then, now)):
        for item, (node_id, source) in homes.items():
            if others.get(item, ("", ""))[0] != node_id:
                gains.setdefault(node_id, Counter())[source] += sign
    return gains


def _tiers(pairs: list[tuple[Node, Node]]) -> Iterator[tuple[str, tuple[str, str]]]:
    for a, b in pairs:
        then, now = (getattr(node, "tier", None) for node in (a, b))
        if then and now and then != now:
            yield a.node_id, (str(then), str(now))


def _moved_priors(pairs: list[tuple[Node, Node]], gains: dict[str, Counter[str]]) -> Iterator[MovedPrior]:
    """Of each node of both releases whose prior moved, the dimension whose median did most, else whose interval did."""
    for a, b in pairs:
        dims = tuple(dim for dim in b.dims if dim in a.dims)
        try:
            then, now = (node.prior(dims) for node in (a, b))
        except NoPrior:
            continue
        old, new = (prior.quantiles(INTERVAL_QUANTILES) for prior in (then, now))  # (3, d)
        median = new[1] / old[1] - 1
        spread = np.log(new[2] / new[0]) / np.log(old[2] / old[0]) - 1
        by_median = bool((np.abs(median) >= MEDIAN_MOVED).any())
        if by_median or (np.abs(spread) >= SPREAD_MOVED).any():
            k = int(np.argmax(np.abs(np.log1p(median) if by_median else spread)))
            then_mm, now_mm, by, wider = (float(f"{v:.4g}") for v in (old[1, k], new[1, k], median[k], spread[k]))
            yield MovedPrior(b.node_id, dims[k], then_mm, now_mm, by, wider, _blame(b, gains))


def _blame(node: Node, gains: dict[str, Counter[str]]) -> dict[str, int]:
    total: Counter[str] = Counter()
    for one in node.descendants():
        total.update(gains.get(one.node_id, {}))
    return {source: n for source, n in sorted(total.items(), key=lambda pair: -abs(pair[1])) if n}


def _counts(before: Tree, after: Tree, column: str) -> dict[str, tuple[int, int]]:
    """Shipped items by a column, before and after, where they differ."""
    then, now = (
        Counter(value or "unstated" for value in tree.release.table("items")[column].to_pylist())
        for tree in (before, after)
    )
    return {name: (then[name], now[name]) for name in sorted({*then, *now}) if then[name] != now[name]}


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
