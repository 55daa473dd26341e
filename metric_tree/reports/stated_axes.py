"""Axes as people name them: width, depth and height of furniture, length, width and height of vehicles, diameters.

A release stores the longer horizontal side as `length` and the shorter one as `width`. Objects with a front are wide,
deep and high: the width of a sofa is its `length`, its depth the `width`. Round objects have a diameter.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from metric_base.text_tables import text_sections
from metric_tree.node import Node

#: Nodes whose objects have a front, and those whose objects are round from above.
WITH_FRONT, ROUND = (
    frozenset(ids.split()) for ids in text_sections(Path(__file__).with_name("stated_axes.txt")).values()
)
_FRONT_NAMES = {"length": "width", "width": "depth"}
_ROUND_NAMES = {"length": "diameter", "width": "smaller diameter"}


def has_front(node: Node) -> bool:
    """Return whether the objects of a node have a front, so that they are wide, deep and high."""
    return any(one.node_id in WITH_FRONT for one in (node, *node.ancestors()))


def is_round(node: Node) -> bool:
    """Return whether the objects of a node are round from above, so that they have a diameter."""
    return any(one.node_id in ROUND for one in (node, *node.ancestors()))


def axis_names(node: Node) -> Mapping[str, str]:
    """Return the noun that people use for each dimension of a node with another name than in storage.

    >>> import metric_tree
    >>> tree = metric_tree.open()
    >>> [axis_names(tree.find(name)).get("length") for name in ("sofa", "bottle", "car")]
    ['width', 'diameter', None]
    """
    if is_round(node):
        return _ROUND_NAMES
    return _FRONT_NAMES if has_front(node) else {}


def stated_size(node: Node, sizes: Mapping[str, str], unit: str) -> str:
    """Return the sizes of the dimensions of a node as people state them: `199 x 93 x 84 cm (width x depth x height)`.

    Parameters
    ----------
    node : Node
    sizes : mapping
        Number by dimension. The smaller diameter of round objects is omitted.
    unit : str
    """
    names = axis_names(node)
    named = {names.get(dim, dim): text for dim, text in sizes.items()}
    named.pop(_ROUND_NAMES["width"], None)
    sides = " x ".join(named).replace("extent1 x extent2 x extent3", "longest side first")
    return f"{' x '.join(named.values())} {unit} ({sides})"
