"""Icicle chart of the tree: one column per level; the height is the fraction of the items, the colour is the tier."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from html import escape

from explorer.charts.axis import svg
from explorer.urls import page_of
from metric_tree.node import Node

WIDTH, HEIGHT, LEVELS = 1000, 1400, 5

#: Minimum height of a node in pixels; smaller nodes are listed in the outline only.
MIN_NODE_HEIGHT_PX = 2.2

#: Minimum height of a node with its name, and width of a letter, in pixels.
MIN_NAMED_HEIGHT_PX, LETTER_WIDTH_PX = 11, 6.3


def icicle(root: Node, tier: Callable[[Node], str]) -> str:
    """Return the SVG of a tree; each area is a link to its node."""
    title = "The tree: five columns for five levels; a node's height is its share of the items, its colour the tier"
    drawing = svg(WIDTH, HEIGHT, title, "".join(_areas(root, 0.0, HEIGHT, tier)), "icicle")
    return drawing.replace('role="img"', 'role="group"', 1)  # its links are read one by one


def _areas(node: Node, top: float, bottom: float, tier: Callable[[Node], str]) -> Iterator[str]:
    height = bottom - top
    if height < MIN_NODE_HEIGHT_PX:
        return
    column = WIDTH / LEVELS
    x, kind = (node.level - 1) * column, tier(node)
    said = f"{node.name}, {kind}, {node.n_items:,} items"
    shown = node.name
    if len(node.name) * LETTER_WIDTH_PX >= column - 10:
        shown = f"{node.name[: int(column / LETTER_WIDTH_PX) - 3]}…"
    text = f'<text x="{x + 5:.0f}" y="{top + min(height / 2 + 4, 14):.1f}">{escape(shown)}</text>'
    yield (
        f'<a href="{escape(page_of(node.node_id))}"><rect class="tier-{kind}" x="{x:.0f}" y="{top:.1f}" '
        f'width="{column - 1:.0f}" height="{max(height - 0.7, 0.5):.1f}"/><title>{escape(said)}</title>'
        f"{text if height >= MIN_NAMED_HEIGHT_PX else ''}</a>"
    )
    children = sorted(node.children, key=lambda one: -one.n_items)
    total = sum(child.n_items for child in children)
    for child in children:
        share = height * child.n_items / total if total else 0
        yield from _areas(child, top, top + share, tier)
        top += share
