"""Sizes in everyday terms: the axes as people name them, and all axes of a category in one phrase."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from explorer.charts.axis import length_text
from metric_tree.node import Node

#: Nodes whose objects have a front: people call their length the width, and their width the depth (a sofa is 2 m wide
#: and 0.9 m deep). Objects of all other nodes are long, wide and high.
WITH_FRONT = frozenset(
    (
        "seat.n.03", "mt:storage_furniture", "mt:other_furniture", "desk.n.01", "stand.n.04", "counter.n.01",
        "appliance.n.02", "mt:audio_video", "sink.n.01", "toilet.n.02", "shower.n.01", "door.n.01", "window.n.01",
        "barrier.n.01",
    )
)  # fmt: skip
_WORDS = {"length": "long", "width": "wide", "height": "high"}
_WORDS |= {"extent1": "longest side", "extent2": "middle side", "extent3": "shortest side"}
_FRONT_WORDS = _WORDS | {"length": "wide", "width": "deep"}


def has_front(node: Node) -> bool:
    """Return whether the objects of a node have a front, so that they are wide, deep and high."""
    return any(one.node_id in WITH_FRONT for one in (node, *node.ancestors()))


def axis_words(node: Node) -> Mapping[str, str]:
    """Return the adjective of each dimension of a node: `wide` for the length of a sofa, `long` for that of a car."""
    return _FRONT_WORDS if has_front(node) else _WORDS


def product_text(sizes_mm: Sequence[float]) -> str:
    """Return the sides of a box in the unit of the longest one.

    >>> product_text([2000, 876, 97])
    '2.00 × 0.88 × 0.10 m'
    """
    numbers = [length_text(mm, max(sizes_mm)).split(" ") for mm in sizes_mm]
    return f"{' × '.join(number for number, _ in numbers)} {numbers[0][1]}"


def all_axes_text(node: Node, medians_mm: Mapping[str, float]) -> str:
    """Return the medians of all dimensions of a node in words.

    For example `about 199 cm wide, 93 cm deep and 84 cm high`, or `about 30 × 20 × 10 cm, the longest side first` if it
    is not known which side is the height.
    """
    if "extent1" in medians_mm:
        return f"about {product_text(list(medians_mm.values()))}, the longest side first"
    words = axis_words(node)
    sizes = [f"{length_text(mm)} {words[dim]}" for dim, mm in medians_mm.items()]
    return f"about {', '.join(sizes[:-1])} and {sizes[-1]}" if len(sizes) > 1 else f"about {sizes[0]}"
