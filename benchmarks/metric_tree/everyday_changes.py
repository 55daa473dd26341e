"""Everyday classes whose median changed by more than 1.2 between two releases, as lines for the changelog.

Everyday are the hundred things of `everyday_things.csv` and COCO's 80.

    python -m benchmarks.metric_tree.everyday_changes BEFORE NOW
"""

from __future__ import annotations

import argparse

from benchmarks.metric_tree.everyday import things
from metric_tree.prior import Prior
from metric_tree.tree import Node, Tree, UnknownName, open_tree
from taxonomy.label_lists import vocabulary

CHANGE = 1.2


def main() -> None:
    """Print one line for each changed class: axes before and now in mm, kinds of evidence before and now."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("before")
    parser.add_argument("now")
    arguments = parser.parse_args()
    before, now = open_tree(arguments.before), open_tree(arguments.now)
    done: set[str] = set()
    for name in [*things(), *(label.label for label in vocabulary("coco_80"))]:
        node = _found(now, name)
        if node is None or node.node_id in done:
            continue
        done.add(node.node_id)
        old = _found(before, node.node_id) or _found(before, name)
        if line := _line(name, old, node) if old else None:
            print(line)


def _found(tree: Tree, name: str) -> Node | None:
    try:
        return tree.find(name)
    except UnknownName:
        return None


def _line(name: str, old: Node, node: Node) -> str | None:
    parts = []
    for axis in ("length", "width", "height", "extent1", "extent2", "extent3"):
        pair = [_prior(one, axis) for one in (old, node)]
        if pair[0] is not None and pair[1] is not None:
            then, new = (float(prior.quantile(0.5)[0]) for prior in pair if prior)
            if max(then / new, new / then) > CHANGE:
                parts.append(f"{axis} {then:.0f} to {new:.0f}")
    return f"- {name}: {', '.join(parts)} (was {_kinds(old)}; is {_kinds(node)})" if parts else None


def _prior(node: Node, axis: str) -> Prior | None:
    having = [dims for dims in node.prior_dims if axis in dims]
    return node.prior((axis,)) if having else None


def _kinds(node: Node) -> str:
    shares = node.prior().share_by_kind
    return ", ".join(f"{kind} {share:.2f}" for kind, share in sorted(shares.items(), key=lambda pair: -pair[1])[:3])


if __name__ == "__main__":
    main()
