"""What two releases rest on, and what moved between them: `python -m benchmarks.metric_tree.tiers 2.0.0 3.0.0`.

Tiers by level and by label list, leaves whose median moved by more than a factor, norms and their medians. A release
without tiers is read by the shares of its rows (docs/reference/tiers.md).
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterable

import numpy as np

from metric_cli.terminal import print_table
from metric_tree.tiers import TIERS
from metric_tree.tree import Node, Tree, UnknownName, open_tree
from taxonomy.label_lists import vocabulary

#: Sets that a release has and the one before it had not.
NEW_SETS = {
    "3.0.0": (
        "abo_3dmodels", "amazon_dextract", "au_energy_rating", "energy_star_2025", "faa_aircraft_2025",
        "gadgets360_in", "eloshapes_mice",
    )
}  # fmt: skip

LISTS = ("coco_80", "lvis_v1", "ade20k_150", "objects365_v2", "scannet200")


def labelled(tree: Tree, name: str) -> Iterable[Node]:
    """The nodes of a label list's labels, those that the tree has a size of."""
    for label in vocabulary(name):
        if not label.needs_prior:
            continue
        try:
            node = tree.find(label.label, name, advice=False)
        except (UnknownName, KeyError):
            continue
        if node.prior_dims:
            yield node


def reason(before: Tree, after: Tree, node: Node) -> str:
    """Why a leaf's median moved: a norm, rows of sets that are new, a range that is new, or the model of the kinds."""
    if node.tier == "norm":
        return "a norm"
    new = NEW_SETS.get(after.version, ())
    rows = Counter(source for source in node.items()["source"].to_pylist() if source in new)
    if rows:
        return ", ".join(f"{n} rows of {source}" for source, n in rows.most_common(2))
    now, old = (one.prior(one.prior_dims[0]) for one in (node, before.node(node.node_id)))
    stated = [sum(one.share_by_kind.get(kind, 0.0) for kind in ("judged", "curated")) for one in (old, now)]
    if stated[1] > 0 and not stated[0]:
        return "a judged range"
    return "other rows or names" if now.n != old.n else "the model of the kinds"


def moved(before: Tree, after: Tree, factor: float) -> list[tuple[str, ...]]:
    """Leaves with a median of both releases off by more than `factor` on some axis, the farthest first."""
    rows = []
    for node in after.leaves():
        if not before.has_node(node.node_id) or not before.node(node.node_id).prior_dims or not node.prior_dims:
            continue
        own, its = node.prior(node.prior_dims[0]), before.node(node.node_id)
        dims = [dim for dim in own.dims if any(dim in known for known in its.prior_dims)]
        if not dims:
            continue
        old = np.array([its.prior((dim,)).quantile(0.5)[0] for dim in dims])
        new = own.marginal(dims).quantile(0.5)
        most = float(np.abs(np.log(new / old)).max())
        if most > np.log(factor):
            sizes = (" x ".join(f"{value:.0f}" for value in one) for one in (old, new))
            why = reason(before, after, node)
            rows.append((most, (node.node_id, *sizes, its.tier or "none", node.tier or "none", why)))
    return [row for _, row in sorted(rows, reverse=True)]


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("before")
    parser.add_argument("after")
    parser.add_argument("--factor", type=float, default=1.4, help="list leaves that moved by more (%(default)s)")
    parser.add_argument("--most", type=int, default=400, help="leaves that are listed (%(default)s)")
    arguments = parser.parse_args()
    trees = open_tree(arguments.before), open_tree(arguments.after)
    rows: list[tuple[object, ...]] = []
    for tree in trees:
        for level in (3, 4, 5):
            counts = Counter(node.tier for node in tree if node.level == level)
            rows.append((tree.version, f"level {level}", *(counts[tier] for tier in TIERS)))
        for name in LISTS:
            counts = Counter(node.tier for node in labelled(tree, name))
            rows.append((tree.version, name, *(counts[tier] for tier in TIERS)))
    print_table(["release", "of", *TIERS], rows)
    norms = [node for node in trees[1].leaves() if node.tier == "norm"]
    print_table(
        ["norm", "median mm", "before", "document"],
        [(node.node_id, _median(node), _median_before(trees[0], node), node.prior().norm) for node in norms],
    )
    changed = moved(*trees, arguments.factor)
    tiers = Counter((before, after, _kind(why)) for *_, before, after, why in changed)
    print_table(
        ["tier before", "tier after", "why", f"leaves moved by {arguments.factor}"],
        [(*key, n) for key, n in tiers.most_common()],
    )
    print_table(["leaf", "before mm", "after mm", "tier before", "tier after", "why"], changed[: arguments.most])


def _kind(why: str) -> str:
    return "rows of new sets" if " rows of " in why else why


def _median(node: Node) -> str:
    return " x ".join(f"{value:.4g}" for value in node.prior(node.prior_dims[0]).quantile(0.5))


def _median_before(tree: Tree, node: Node) -> str:
    return _median(tree.node(node.node_id)) if tree.has_node(node.node_id) else "none"


if __name__ == "__main__":
    main()
