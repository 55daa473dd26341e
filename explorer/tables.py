"""Flat tables: a node's items as CSV and Parquet, a vocabulary as CSV, quantiles of all nodes as columns."""

from __future__ import annotations

import io
from typing import Any

import pyarrow.parquet as pq

from explorer.catalogue import ReleaseCatalogue
from explorer.responses import vocabulary_response
from metric_base.records import csv_text
from metric_tree.node import Node
from metric_tree.prior import INTERVAL_QUANTILES


def items_csv(catalogue: ReleaseCatalogue, node: Node) -> bytes:
    """The shipped items at or below a node; lists are joined by spaces."""
    table = catalogue.items.take(catalogue.rows(node))
    return csv_text(table.column_names, (row.values() for row in table.to_pylist()))


def items_parquet(catalogue: ReleaseCatalogue, node: Node) -> bytes:
    """The same as Parquet, with the units in the columns' metadata."""
    sink = io.BytesIO()
    pq.write_table(catalogue.items.take(catalogue.rows(node)), sink, compression="zstd", store_schema=False)
    return sink.getvalue()


def vocabulary_csv(catalogue: ReleaseCatalogue, name: str) -> bytes:
    """A label list: label, node, tier, items, and for each dimension the 5 %, 50 % and 95 % quantile in mm."""
    dims = ("length", "width", "height", "extent1", "extent2", "extent3")
    columns = [f"{dim}_q{round(100 * q):02d}_mm" for dim in dims for q in INTERVAL_QUANTILES]
    rows: list[list[Any]] = []
    for row in vocabulary_response(catalogue, name).labels:
        sizes = row.quantiles_mm or {}
        figures = [sizes.get(dim, {}).get(f"{q:g}") for dim in dims for q in INTERVAL_QUANTILES]
        rows.append([row.label, row.node, row.name, row.tier, row.n_items, *figures])
    return csv_text(["label", "node_id", "name", "tier", "n_items", *columns], rows)
