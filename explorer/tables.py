"""Flat tables: the items of a node as CSV and Parquet, and a label list as CSV."""

from __future__ import annotations

import io
from typing import Any

import pyarrow.parquet as pq

from explorer.catalogue import AXES, ReleaseCatalogue
from explorer.responses import vocabulary_response
from metric_base.records import csv_text
from metric_tree.node import Node
from metric_tree.prior import INTERVAL_QUANTILES


def items_csv(catalogue: ReleaseCatalogue, node: Node) -> bytes:
    """Return the published items at or below a node as CSV; lists are joined by spaces."""
    table = catalogue.items.take(catalogue.rows(node))
    return csv_text(table.column_names, (row.values() for row in table.to_pylist()))


def items_parquet(catalogue: ReleaseCatalogue, node: Node) -> bytes:
    """Return the published items at or below a node as Parquet, with the units in the metadata of the columns."""
    sink = io.BytesIO()
    pq.write_table(catalogue.items.take(catalogue.rows(node)), sink, compression="zstd", store_schema=False)
    return sink.getvalue()


def vocabulary_csv(catalogue: ReleaseCatalogue, name: str) -> bytes:
    """Return a label list as CSV: label, node, tier, items, and the 5, 50 and 95 % quantiles of all dimensions, mm."""
    columns = [f"{dim}_q{round(100 * q):02d}_mm" for dim in AXES for q in INTERVAL_QUANTILES]
    rows: list[list[Any]] = []
    for row in vocabulary_response(catalogue, name).labels:
        sizes = row.quantiles_mm or {}
        figures = [sizes.get(dim, {}).get(f"{q:g}") for dim in AXES for q in INTERVAL_QUANTILES]
        rows.append([row.label, row.node, row.name, row.tier, row.n_items, *figures])
    return csv_text(["label", "node_id", "name", "tier", "n_items", *columns], rows)
