"""Flat tables: items of a node, quantiles of a node or of all nodes, and a label list; as CSV or Parquet."""

from __future__ import annotations

import io
from functools import lru_cache
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from explorer.catalogue import ReleaseCatalogue
from explorer.responses import quantile_table, vocabulary_response
from explorer.urls import MIN_PARQUET_ROWS
from metric_base.records import csv_text
from metric_tree.axes import DIMENSIONS
from metric_tree.node import Node
from metric_tree.prior import INTERVAL_QUANTILES, QUANTILES
from metric_tree.reports.stated_axes import axis_names


def csv_bytes(table: pa.Table) -> bytes:
    """Return a table as CSV; lists are joined by spaces."""
    return csv_text(table.column_names, (row.values() for row in table.to_pylist()))


def parquet_bytes(table: pa.Table) -> bytes:
    """Return a table as Parquet, with the units of published items in the metadata of the columns."""
    sink = io.BytesIO()
    pq.write_table(table, sink, compression="zstd", store_schema=False)
    return sink.getvalue()


def items_csv(catalogue: ReleaseCatalogue, node: Node) -> bytes | None:
    """Return the published items at or below a node as CSV, None without items."""
    rows = catalogue.rows(node)
    return csv_bytes(catalogue.published(rows)) if len(rows) else None


def items_parquet(catalogue: ReleaseCatalogue, node: Node) -> bytes | None:
    """Return the published items at or below a node as Parquet, None with fewer than `MIN_PARQUET_ROWS`."""
    rows = catalogue.rows(node)
    return parquet_bytes(catalogue.published(rows)) if len(rows) >= MIN_PARQUET_ROWS else None


def node_sizes_csv(catalogue: ReleaseCatalogue, node: Node) -> bytes | None:
    """Return the quantiles of a node in mm as CSV, a row for each dimension with its name in everyday use.

    None without a prior.
    """
    if not catalogue.dims(node):
        return None
    sizes, names = quantile_table(catalogue.dims(node), catalogue.quantiles(node)), axis_names(node)
    head = ["dimension", "everyday_name", *(f"q{round(100 * q):02d}_mm" for q in QUANTILES)]
    return csv_text(head, ([dim, names.get(dim, dim), *row.values()] for dim, row in sizes.items()))


@lru_cache(maxsize=1)  # for CSV and Parquet
def sizes_table(catalogue: ReleaseCatalogue) -> pa.Table:
    """Return all categories with a prior: name, level, tier, items, and the quantiles of all dimensions in mm."""
    rows = []
    for node in catalogue.nodes.values():
        if dims := catalogue.dims(node):
            row = {"node_id": node.node_id, "name": node.name, "level": node.level}
            row |= {"tier": catalogue.tier(node), "n_items": node.n_items}
            sizes = quantile_table(dims, catalogue.quantiles(node))
            for dim in DIMENSIONS:
                row |= {f"{dim}_q{round(100 * q):02d}_mm": sizes.get(dim, {}).get(f"{q:g}") for q in QUANTILES}
            rows.append(row)
    return pa.Table.from_pylist(rows)


def vocabulary_csv(catalogue: ReleaseCatalogue, name: str) -> bytes:
    """Return a label list as CSV: label, node, tier, items, and the 5, 50 and 95 % quantiles of all dimensions, mm."""
    columns = [f"{dim}_q{round(100 * q):02d}_mm" for dim in DIMENSIONS for q in INTERVAL_QUANTILES]
    rows: list[list[Any]] = []
    for row in vocabulary_response(catalogue, name).labels:
        sizes = row.quantiles_mm or {}
        figures = [sizes.get(dim, {}).get(f"{q:g}") for dim in DIMENSIONS for q in INTERVAL_QUANTILES]
        rows.append([row.label, row.node, row.name, row.tier, row.n_items, *figures])
    return csv_text(["label", "node_id", "name", "tier", "n_items", *columns], rows)
