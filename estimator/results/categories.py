"""What a category name means in the tree, read as detectors mean it: a `mouse` is a device."""

from __future__ import annotations

from dataclasses import dataclass

from metric_base.faults import InputFault
from metric_tree.context import Where
from metric_tree.prior import Prior
from metric_tree.tree import DETECTORS, Node, Tree

__all__ = ["Meaning", "meanings"]


@dataclass(frozen=True, slots=True, eq=False)
class Meaning:
    """The node of a category name and its prior, or the reason why there is none."""

    node: Node | None
    prior: Prior | None
    reason: str | None = None


def meanings(
    tree: Tree, names: set[str], dims: tuple[str, ...] | None = None, where: Where | None = None
) -> dict[str, Meaning]:
    """What each name means. With `dims` the prior is over these alone, else over the node's own.

    With `where` it is that of a region and a year. A name that means no node, or several alike, or a node without
    such a prior, has a reason instead: it is listed, not fatal.
    """
    return {name: _meaning(tree, name, dims, where) for name in sorted(names)}


def _meaning(tree: Tree, name: str, dims: tuple[str, ...] | None, where: Where | None) -> Meaning:
    try:
        node = tree.find(name, DETECTORS)
    except InputFault as fault:
        return Meaning(None, None, str(fault))
    try:
        return Meaning(node, node.prior(dims, where))
    except InputFault as fault:
        return Meaning(node, None, str(fault))
