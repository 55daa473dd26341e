"""The sizes of a release as one flat table: a row for each node or label, a column for each dimension and quantile."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import pyarrow as pa

from metric_base.errors import InputError

if TYPE_CHECKING:
    from metric_tree.tree import Node, Tree

__all__ = ["DIMS", "QUANTILES", "quantile_columns", "quantile_table"]

#: Dimensions of the columns.
DIMS = ("length", "width", "height", "extent1", "extent2", "extent3")

#: The ends of the 90 % interval, the quartiles and the median.
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)


def quantile_columns() -> list[str]:
    """Names of the columns of sizes: `height_q50_mm`."""
    return [f"{dim}_q{round(100 * q):02d}_mm" for dim in DIMS for q in QUANTILES]


def quantile_table(tree: Tree, vocabulary: str | None = None) -> pa.Table:
    """The quantiles of every node, or of every label of a list, in mm; null where a dimension is not known.

    Columns: with a vocabulary `label`; `node_id`, `name`, `level`, `tier`, `n_items`, `n_sources`, then those of
    `quantile_columns`, of the node's default prior.

    Raises
    ------
    taxonomy.label_lists.UnknownLabel
        There is no such list.
    """
    facts = [
        pa.field("node_id", pa.string()),
        pa.field("name", pa.string()),
        pa.field("level", pa.int8()),
        pa.field("tier", pa.string()),
        pa.field("n_items", pa.int64()),
        pa.field("n_sources", pa.int64()),
    ]
    sizes = [pa.field(name, pa.float64(), metadata={"unit": "mm"}) for name in quantile_columns()]
    if vocabulary is None:
        return pa.Table.from_pylist([_row(node) for node in tree], schema=pa.schema([*facts, *sizes]))
    rows = list(_labels(tree, vocabulary))
    return pa.Table.from_pylist(rows, schema=pa.schema([pa.field("label", pa.string()), *facts, *sizes]))


def _labels(tree: Tree, name: str) -> Iterator[dict[str, Any]]:
    from taxonomy.label_lists import vocabulary

    for label in vocabulary(name):
        known = label.node_id is not None and tree.has_node(label.node_id)
        yield {"label": label.label, **(_row(tree.node(str(label.node_id))) if known else {})}


def _row(node: Node) -> dict[str, Any]:
    row = {"node_id": node.node_id, "name": node.name, "level": node.level, "tier": node.tier, "n_items": node.n_items}
    try:
        prior = node.prior()
    except InputError:  # a node without a prior
        return row
    row["n_sources"] = prior.n_sources
    for q in QUANTILES:
        for dim, mm in zip(prior.dims, prior.quantile(q), strict=True):
            row[f"{dim}_q{round(100 * q):02d}_mm"] = float(f"{mm:.5g}")
    return row
