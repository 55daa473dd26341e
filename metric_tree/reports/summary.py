"""Counts of a release for its report, as pure functions of a tree."""

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

#: Minimum number of items for statements about a distribution.
MIN_ITEMS = 10

#: Categories of the figure of size distributions: the categories of the paper, and others of everyday rooms and
#: streets.
TYPICAL = (
    "chair.n.01", "sofa.n.01", "bed.n.01", "desk.n.01", "television_receiver.n.01", "laptop.n.01",
    "cellular_telephone.n.01", "computer_keyboard.n.01", "bottle.n.01", "book.n.02", "refrigerator.n.01",
    "person.n.01", "car.n.01", "bicycle.n.01", "oak.n.02",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Coverage:
    """Coverage of a label list by priors."""

    name: str
    labels: int  #: Number of labels that need a prior.
    enough: int  #: Number of labels with a prior from `MIN_ITEMS` real items or more.
    real: int  #: Number of labels with a prior from real items.
    any: int  #: Number of labels with a prior.


def level_counts(tree: Tree) -> list[tuple[int, ...]]:
    """Return level, number of nodes, and number of nodes with at least 1, 10 and 30 real items at or below."""
    rows = []
    for level in sorted({node.level for node in tree}):
        items = [node.n_items for node in tree if node.level == level]
        rows.append((level, len(items), *(sum(count >= minimum for count in items) for minimum in (1, 10, 30))))
    return rows


def source_counts(tree: Tree) -> list[tuple[str, str, str, int, int]]:
    """Return source, kind, licence, rows of the fit and shipped rows, the most rows first."""
    rows = [
        (s["title"], s.get("kind", ""), s.get("licence") or "none", int(s.get("n_fit", 0)), int(s.get("n_rows", 0)))
        for s in tree.release.manifest["sources"]
    ]
    return sorted(rows, key=lambda row: (-row[3], row[0]))


def covered_items(tree: Tree, label: Label) -> int | None:
    """Return the number of real items of the node of a label; None if it has no prior."""
    if label.node_id is None:
        return None
    try:
        node = tree.node(label.node_id)
    except UnknownName:
        return None
    return node.n_items if node.prior_dims else None


def coverage(tree: Tree, name: str, labels: Iterable[Label] | None = None) -> Coverage:
    """Return the coverage of a label list; walls, floors, skies and void labels need no prior."""
    needing = [label for label in (vocabulary(name) if labels is None else labels) if label.needs_prior]
    counts = [count for label in needing if (count := covered_items(tree, label)) is not None]
    return Coverage(name, len(needing), sum(n >= MIN_ITEMS for n in counts), sum(n > 0 for n in counts), len(counts))


def typical_nodes(tree: Tree) -> list[Node]:
    """Return the nodes of `TYPICAL` that have a prior."""
    known = {node.node_id: node for node in tree}
    return [known[node_id] for node_id in TYPICAL if node_id in known and known[node_id].prior_dims]


def disagreements(tree: Tree) -> list[tuple[str, int, int, float]]:
    """Return node, sources, items and disagreement of the sources (one standard deviation in %), the largest first.

    Nodes of levels 4 and 5 with at least three sources are included, with the axis of the largest disagreement.
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
    """Return path, items and component sizes of leaves with distinct components, the most items first.

    The sizes are geometric means over the dimensions, in mm.
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
    """Return the number of shipped items without norms and ranges, and the fractions with a year and with a region."""
    items = tree.release.table("items").select(["kind", "year", "region"])
    real = items.filter(pa.array([kind not in STATED_KINDS for kind in items["kind"].to_pylist()], pa.bool_()))
    n = real.num_rows
    year, region = ((n - real[name].null_count) / max(n, 1) for name in ("year", "region"))
    return n, year, region
