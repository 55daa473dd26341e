"""Sizes in everyday terms: the axes as people name them, and all axes of a category in one phrase."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from explorer.charts.axis import length_text
from metric_tree.node import Node
from metric_tree.reports.stated_axes import has_front, is_round

_WORDS = {"length": "long", "width": "wide", "height": "high"}
_WORDS |= {"extent1": "longest side", "extent2": "middle side", "extent3": "shortest side"}
_FRONT_WORDS = _WORDS | {"length": "wide", "width": "deep"}
_ROUND_WORDS = _WORDS | {"length": "in diameter", "width": "in the smaller diameter"}


def axis_words(node: Node) -> Mapping[str, str]:
    """Return the words of each dimension of a node: `wide` for the length of a sofa, `in diameter` for a jar's."""
    return _ROUND_WORDS if is_round(node) else _FRONT_WORDS if has_front(node) else _WORDS


def shape_letter(node: Node) -> str:
    """Return the letter of `axis_words` in scripts of the pages: `o` for round objects, `f` for those with a front."""
    return "o" if is_round(node) else "f" if has_front(node) else ""


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
    is not known which side is the height. The smaller diameter of round objects is omitted.
    """
    if "extent1" in medians_mm:
        return f"about {product_text(list(medians_mm.values()))}, the longest side first"
    words = axis_words(node)
    omitted = "width" if words is _ROUND_WORDS and "length" in medians_mm else ""
    sizes = [f"{length_text(mm)} {words[dim]}" for dim, mm in medians_mm.items() if dim != omitted]
    return f"about {', '.join(sizes[:-1])} and {sizes[-1]}" if len(sizes) > 1 else f"about {sizes[0]}"
