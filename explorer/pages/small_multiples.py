"""Categories on one axis: a bar from the 5 % to the 95 % quantile and a mark at the median."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from explorer.content.release_catalogue import ReleaseCatalogue
from explorer.drawings.axis import LogAxis
from explorer.pages.templating import main_dimension
from explorer.urls import page_of, slug
from metric_tree.tree import Node

__all__ = ["multiples"]

#: Rows of one table: a page stays light.
MOST_ROWS = 9


#: Share of the rows from which a dimension may be the axis, though another is known of more rows.
MOSTLY = 0.8


def multiples(catalogue: ReleaseCatalogue, nodes: Sequence[Node], beside: Node) -> dict[str, Any] | None:
    """The rows, the axis and how many nodes were left out; None where there is nothing to show.

    nodes : those with most items come first; beside : the node of the page, which is always among those shown, and
    whose main dimension is the axis's.
    """
    if not nodes:
        return None
    order = sorted(nodes, key=lambda node: (node is not beside, -node.n_items, node.name))
    shown = sorted(order[:MOST_ROWS], key=lambda node: (-node.n_items, node.name))
    dim = main_dimension(_common(catalogue, shown))
    spans: dict[str, tuple[float, float, float] | None] = {node.node_id: _span(catalogue, node, dim) for node in shown}
    known = [span for span in spans.values() if span is not None]
    if not known:
        return None
    axis = LogAxis(min(span[0] for span in known), max(span[2] for span in known) * 1.001, 0, 100)
    return {
        "dim": dim,
        "low": axis.low,
        "high": axis.high,
        "more": len(nodes) - len(shown),
        "href": page_of(beside.parent_id) if beside.parent_id else "",
        "rows": [_row(catalogue, node, spans[node.node_id], axis) for node in shown],
    }


def _common(catalogue: ReleaseCatalogue, nodes: Sequence[Node]) -> list[str]:
    """Dimensions by how many of the nodes have them, the height first among those of most."""
    counts: dict[str, int] = {}
    for node in nodes:
        for dim in catalogue.dims(node):
            counts[dim] = counts.get(dim, 0) + 1
    most = max(counts.values(), default=0)
    return [dim for dim, count in counts.items() if count >= MOSTLY * most]


def _span(catalogue: ReleaseCatalogue, node: Node, dim: str) -> tuple[float, float, float] | None:
    dims = catalogue.dims(node)
    if dim not in dims:
        return None
    table = catalogue.quantiles(node)
    low, middle, high = table[::2, dims.index(dim)]
    return float(low), float(middle), float(high)


def _row(
    catalogue: ReleaseCatalogue, node: Node, span: tuple[float, float, float] | None, axis: LogAxis
) -> dict[str, Any]:
    return {
        "node": node.node_id,
        "name": node.name,
        "href": f"{slug(node.node_id)}.html",
        "tier": catalogue.tier(node),
        "bar": None if span is None else [f"{axis.at(mm):.1f}" for mm in span],
        "median": None if span is None else span[1],
    }
