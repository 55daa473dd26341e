"""Arrow schemas of a release (`metric-tree/1`): the columns of `columns.csv`, each with its type, unit and meaning."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa

from metric_base.parsing import table_rows
from metric_tree.prior import SHARED_KINDS

SCHEMA = "metric-tree/1"

_VECTOR = pa.list_(pa.float64())
#: Source, country or region, mean year, offset (d,) of ln size and its sampling variance (d,).
_CONTEXT = {"source": pa.string(), "region": pa.string(), "year": pa.float64(), "offset": _VECTOR, "variance": _VECTOR}
#: Types by their name in `columns.csv`, except those of Arrow.
_TYPES = {
    "strings": pa.list_(pa.string()),
    "integers": pa.list_(pa.int32()),
    "vector": _VECTOR,
    "matrix": pa.list_(_VECTOR),
    "matrices": pa.list_(pa.list_(_VECTOR)),
    "contexts": pa.list_(pa.struct(_CONTEXT)),
    # share of each kind of evidence; releases before 3.0.0 have pairs of kind and share
    "shares": pa.struct(dict.fromkeys(SHARED_KINDS, pa.float64())),
    "evidence": pa.struct({"rows": pa.float64(), "sources": pa.int64(), "models": pa.int64(), "ranges": pa.int64()}),
}
_HEAD = ("table", "column", "type", "unit", "added", "meaning")
_COLUMNS = [row for _, row in table_rows(Path(__file__).with_name("columns.csv"), _HEAD)]


def table_schema(table: str, name: str = SCHEMA) -> pa.Schema:
    """Return the schema of a table of `columns.csv`; `name` is the value of `schema` in its metadata."""
    fields = []
    for row in _COLUMNS:
        if row["table"] == table:
            metadata = {"meaning": row["meaning"]} | ({"unit": row["unit"]} if row["unit"] else {})
            fields.append(pa.field(row["column"], _TYPES.get(row["type"], row["type"]), metadata=metadata))
    return pa.schema(fields, metadata={"schema": name})


#: The tables of a release by file name; a release has exactly these beside its manifest.
TABLES = {f"{table}.parquet": table_schema(table) for table in ("nodes", "items", "priors", "images")}
NODES, ITEMS, PRIORS, IMAGES = TABLES.values()
#: Columns of `successors.parquet`.
SUCCESSORS = pa.schema([("old_id", pa.string()), ("release", pa.string()), ("node_id", pa.string())])
#: Columns that were added within version 1: a release that is older lacks them, which is no error.
ADDED_COLUMNS = frozenset(row["column"] for row in _COLUMNS if row["added"])
#: Types that a column had in releases before 3.0.0, which are read all the same.
FORMER_TYPES = {"share_by_kind": pa.map_(pa.string(), pa.float64())}
