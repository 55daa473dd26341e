"""BOLTS: YAML tables of standard parts, one per class; columns have the letters of the drawing in the standard."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from crawler.imports.declaration import Source
from crawler.imports.table_files import BadTable, yaml_document
from crawler.imports.table_items import RowRejected, outcome, row_item
from crawler.items import RawItem
from metric_base.length_units import millimetres
from metric_base.parsing import table_rows

#: Classes of complete parts by the start of their id: category, and column of each axis. For a nut, `s` is the width
#: across flats and `e` the width across corners; for a washer or a bearing, `d2` is the outer diameter.
_WHOLE = {
    row["class"]: (row["category"].split("|"), dict(axis.split("=") for axis in row["axes"].split()))
    for _, row in table_rows(Path(__file__).with_name("bolts.csv"), ("class", "category", "axes"))
}
_UNITS = {"Length (mm)": "mm", "Length (in)": "in"}


def row_items(source: Source, folder: Path) -> Iterator[RawItem | RowRejected]:
    """Return an item or a rejection for each row of each class in `*.blt`, in the order of files, classes and rows."""
    paths = sorted(folder.glob("*.blt"))
    if not paths:
        raise BadTable(f"{folder}: expected *.blt; found no such file")
    for path in paths:
        document = yaml_document(path)
        if not isinstance(document, Mapping) or not isinstance(document.get("classes"), list):
            raise BadTable(f"{path}: classes: expected a list; found none")
        for entry in document["classes"]:
            parameters = entry.get("parameters") or {}
            units = {name: _UNITS[kind] for name, kind in (parameters.get("types") or {}).items() if kind in _UNITS}
            tables = parameters.get("tables") or []
            for table in tables if isinstance(tables, list) else [tables]:
                for key, values in table["data"].items():
                    row = dict(zip(table["columns"], values, strict=False))
                    if set(row) & set(units):  # otherwise it is a table of names (postfixes, finishes)
                        item = partial(_item, source, entry, str(key), row, units)
                        yield outcome(source, f"{entry['id']}:{key}", item)


def _item(
    source: Source, entry: Mapping[str, Any], key: str, row: Mapping[str, Any], units: Mapping[str, str]
) -> RawItem:
    """Return the item of a row of a class, or raise `RowRejected`."""
    whole = next((value for start, value in _WHOLE.items() if entry["id"].startswith(start)), None)
    if whole is None or not set(whole[1].values()) & set(row):
        raise RowRejected("part_not_whole", "class", entry["id"])
    category, axes = whole
    words = {
        axis: millimetres(float(row[column]), units.get(column, "mm"))
        for axis, column in axes.items()
        if isinstance(row.get(column), int | float)
    }
    names = entry.get("names") or entry["id"]
    name = names[0] if isinstance(names, list) else names
    title = f"{name['name'] if isinstance(name, Mapping) else name} {key}"
    return row_item(source, f"{entry['id']}-{key}", words, category=category, title=title)
