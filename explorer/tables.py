"""Flat tables: a node's items as CSV and Parquet, a vocabulary as CSV, quantiles of all nodes as columns."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from typing import Any

import pyarrow.parquet as pq

from explorer.content.answers import vocabulary_answer
from explorer.content.release_catalogue import ReleaseCatalogue
from metric_tree.prior import INTERVAL_QUANTILES
from metric_tree.tree import Node

__all__ = ["csv_text", "items_csv", "items_parquet", "vocabulary_csv"]


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
    for row in vocabulary_answer(catalogue, name).labels:
        sizes = row.quantiles_mm or {}
        figures = [sizes.get(dim, {}).get(f"{q:g}") for dim in dims for q in INTERVAL_QUANTILES]
        rows.append([row.label, row.node, row.name, row.tier, row.n_items, *figures])
    return csv_text(["label", "node_id", "name", "tier", "n_items", *columns], rows)


def csv_text(head: Sequence[str], rows: Iterable[Iterable[Any]]) -> bytes:
    """A table as CSV in UTF-8; a text that a spreadsheet would run as a formula begins with an apostrophe."""
    sink = io.StringIO()
    writer = csv.writer(sink, lineterminator="\n")
    writer.writerow(head)
    writer.writerows([_cell(value) for value in row] for row in rows)
    return sink.getvalue().encode()


def _cell(value: Any) -> Any:
    if isinstance(value, list):
        return " ".join(map(str, value))
    return f"'{value}" if isinstance(value, str) and value[:1] in "=+-@\t" else value
