"""What a report counts: pure functions of a tree."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import exp

import numpy as np
import pyarrow as pa

from crawler.items import STATED_KINDS
from metric_tree.node import Node, UnknownName
from metric_tree.prior import MIN_COMPONENT_SHARE, has_distinct_components
from metric_tree.tree import Tree
from taxonomy.label_lists import Label, vocabulary

#: Fewer items than this say little about a distribution.
MIN_ITEMS = 10

#: Categories of the figure, as in the paper's figure of size distributions, with others of everyday rooms and streets;
#: those that the release lacks are left out.
TYPICAL = (
    "chair.n.01",
    "sofa.n.01",
    "bed.n.01",
    "desk.n.01",
    "television_receiver.n.01",
    "laptop.n.01",
    "cellular_telephone.n.01",
    "computer_keyboard.n.01",
    "bottle.n.01",
    "book.n.02",
    "refrigerator.n.01",
    "person.n.01",
    "car.n.01",
    "bicycle.n.01",
    "oak.n.02",
)


@dataclass(frozen=True, slots=True)
class Coverage:
    """Labels of a list that need a prior, and how many have one from `MIN_ITEMS` real items, any, or at all."""

    name: str
    labels: int
    enough: int
    real: int
    any: int


def level_counts(tree: Tree) -> list[tuple[int, ...]]:
    """Level, nodes, nodes with 1, 10, 30 real items at or below them."""
    rows = []
    for level in sorted({node.level for node in tree}):
        items = [node.n_items for node in tree if node.level == level]
        rows.append((level, len(items), *(sum(count >= least for count in items) for least in (1, 10, 30))))
    return rows


def source_counts(tree: Tree) -> list[tuple[str, str, str, int, int]]:
    """Source, kind, licence, rows of the fit, rows shipped; most rows first."""
    rows = [
        (s["title"], s.get("kind", ""), s.get("licence") or "none", int(s.get("n_fit", 0)), int(s.get("n_rows", 0)))
        for s in tree.release.manifest["sources"]
    ]
    return sorted(rows, key=lambda row: (-row[3], row[0]))


def covered_items(tree: Tree, label: Label) -> int | None:
    """Real items of the label's node; None where it has no prior at all."""
    if label.node_id is None:
        return None
    try:
        node = tree.node(label.node_id)
    except UnknownName:
        return None
    return node.n_items if node.prior_dims else None


def coverage(tree: Tree, name: str, labels: Iterable[Label] | None = None) -> Coverage:
    """How much of a label list has a prior; walls, floors, skies and void labels need none."""
    needing = [label for label in (vocabulary(name) if labels is None else labels) if label.needs_prior]
    counts = [count for label in needing if (count := covered_items(tree, label)) is not None]
    return Coverage(name, len(needing), sum(n >= MIN_ITEMS for n in counts), sum(n > 0 for n in counts), len(counts))


def typical_nodes(tree: Tree) -> list[Node]:
    """Those of the typical categories that the release has a prior for."""
    known = {node.node_id: node for node in tree}
    return [known[node_id] for node_id in TYPICAL if node_id in known and known[node_id].prior_dims]


def disagreements(tree: Tree) -> list[tuple[str, int, int, float]]:
    """Node, sources, items, and how far sources differ (per cent, one standard deviation); worst first.

    Leaves and kinds with items from at least three sources; the number is of the axis on which they differ most.
    """
    rows = []
    for node in tree:
        if node.level >= 4 and node.n_items >= MIN_ITEMS:
            for dims in node.prior_dims[-1:]:
                prior = node.prior(dims)
                if prior.n_sources >= 3:
                    spread = float(np.sqrt(np.diag(prior.shared_covariance).max()))
                    rows.append((" > ".join(node.path[1:]), prior.n_sources, prior.n, 100 * (exp(spread) - 1)))
    return sorted(rows, key=lambda row: -row[3])


def mixed_leaves(tree: Tree) -> list[tuple[str, int, str]]:
    """Leaves that look like two kinds of object under one name: path, items, medians of the parts; most items first.

    The part sizes are geometric means over the dimensions, in mm.
    """
    rows = []
    for node in tree:
        if not node.children and node.n_items >= MIN_ITEMS and node.prior_dims:
            prior = node.prior(max(node.prior_dims, key=len))
            if has_distinct_components(prior):
                parts = sorted(zip(np.exp(prior.means.mean(axis=1)), prior.weights, strict=True))
                text = ", ".join(
                    f"{size:.0f} mm ({weight:.0%})" for size, weight in parts if weight >= MIN_COMPONENT_SHARE
                )
                rows.append((" > ".join(node.path[1:]), node.n_items, text))
    return sorted(rows, key=lambda row: (-row[1], row[0]))


def known_shares(tree: Tree) -> tuple[int, float, float]:
    """Shipped items that are no norms or ranges, and the shares of them with a year and with a region."""
    items = tree.release.table("items").select(["kind", "year", "region"])
    real = items.filter(pa.array([kind not in STATED_KINDS for kind in items["kind"].to_pylist()], pa.bool_()))
    n = real.num_rows
    year, region = ((n - real[name].null_count) / max(n, 1) for name in ("year", "region"))
    return n, year, region
