"""The sizes of a release as one flat table: a row for each node or label, a column for each dimension and quantile."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pyarrow as pa

from metric_tree.prior import QUANTILES, Prior

__all__ = ["DIMS", "quantile_columns", "quantile_table"]

#: Dimensions of the columns.
DIMS = ("length", "width", "height", "extent1", "extent2", "extent3")


def quantile_columns() -> list[str]:
    """Names of the columns of sizes: `height_q50_mm`."""
    return [f"{dim}_q{round(100 * q):02d}_mm" for dim in DIMS for q in QUANTILES]


def quantile_table(entries: Iterable[tuple[dict[str, Any], Prior | None]], labelled: bool = False) -> pa.Table:
    """A table of facts and sizes in mm; null where a dimension is not known.

    Parameters
    ----------
    entries : of each row `node_id`, `name`, `level`, `tier`, `n_items`, as far as they are known, and its prior
    labelled : whether each row begins with a `label`
    """
    kinds = {"node_id": pa.string(), "name": pa.string(), "level": pa.int8(), "tier": pa.string()}
    kinds |= {"n_items": pa.int64(), "n_sources": pa.int64()}
    facts = [pa.field(name, kind) for name, kind in kinds.items()]
    sizes = [pa.field(name, pa.float64(), metadata={"unit": "mm"}) for name in quantile_columns()]
    label = [pa.field("label", pa.string())] if labelled else []
    rows = [{**known, **_sizes(prior)} for known, prior in entries]
    return pa.Table.from_pylist(rows, schema=pa.schema([*label, *facts, *sizes]))


def _sizes(prior: Prior | None) -> dict[str, Any]:
    if prior is None:
        return {}
    row: dict[str, Any] = {"n_sources": prior.n_sources}
    for q, sizes in zip(QUANTILES, prior.quantiles(QUANTILES), strict=True):
        for dim, mm in zip(prior.dims, sizes, strict=True):
            row[f"{dim}_q{round(100 * q):02d}_mm"] = float(f"{mm:.5g}")
    return row
