"""Tables of bounding boxes: one object a row, with a name and its sizes in metres."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from estimator.assets.asset import Asset, Body, Up, Word
from metric_base.errors import InputError, Unquoted
from metric_base.input_files import read_text

__all__ = ["read_boxes"]

COLUMNS = ("name", "x", "y", "z")
#: Largest table as text.
MAX_BYTES = 1 << 28


def read_boxes(path: Path, up: Up | None = None) -> Iterator[Asset]:
    """An asset for each row of a CSV or Parquet table with the columns name, x, y, z (metres) and perhaps category, up.

    Raises
    ------
    InputError
        The table has other columns, or a size is no positive number.
    """
    for number, row in enumerate(_rows(path), start=2):
        place = Path(f"{path}:{number}")
        try:
            sizes = np.array([float(row[axis]) for axis in COLUMNS[1:]])
        except (TypeError, ValueError):
            sizes = np.array([np.nan] * 3)
        if not (np.isfinite(sizes).all() and (sizes >= 0).all() and sizes.max() > 0):
            texts = ", ".join(str(row[axis]) for axis in COLUMNS[1:])
            raise InputError.at(place, "x, y, z", "sizes in metres, at least one above 0", Unquoted(texts))
        stated: Up | None = row["up"] if row.get("up") in ("x", "y", "z") else up  # type: ignore[assignment]
        text = str(row.get("category") or row["name"])
        body = Body(str(row["name"]), np.zeros(3), sizes, (Word("title", text),))
        yield Asset(place, "box", 1.0, stated, (body,))


def _rows(path: Path) -> Iterator[dict[str, str]]:
    if path.suffix.lower() == ".parquet":
        import pyarrow as pa
        import pyarrow.parquet as pq

        try:
            table = pq.read_table(path)
        except (pa.ArrowInvalid, OSError) as error:
            raise InputError.at(path, "file", "a Parquet table", Unquoted(type(error).__name__)) from None
        _check_columns(path, table.column_names)
        yield from table.to_pylist()
        return
    rows = csv.DictReader(read_text(path, MAX_BYTES).splitlines())
    _check_columns(path, list(rows.fieldnames or []))
    yield from rows


def _check_columns(path: Path, names: list[str]) -> None:
    missing = [name for name in COLUMNS if name not in names]
    if missing:
        raise InputError.at(path, "columns", ", ".join(COLUMNS), Unquoted(", ".join(names) or "none"))
