"""BOLTS: tables of standard parts in YAML, a class each; the letters of a standard's drawing name the columns."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from crawler.imports.declaration import Source
from crawler.imports.table_files import BadTable, yaml_document
from crawler.imports.table_items import RowRejected, row_item
from crawler.items import RawItem
from crawler.text.units import millimetres

#: Classes whose tables give a whole part, by the start of their id: category, and the column of each axis.
#: `s` of a nut is its width across flats, `e` across corners; `d2` of a washer or a bearing its outer diameter.
_WHOLE: Mapping[str, tuple[tuple[str, ...], Mapping[str, str]]] = {
    "hexagonthinnut": (("nut", "hexagon nut"), {"length": "e_min", "width": "s", "height": "m_max"}),
    "hexagonnut": (("nut", "hexagon nut"), {"length": "e_min", "width": "s", "height": "m_max"}),
    "plainwasher": (("washer", "plain washer"), {"diameter": "d2", "height": "s"}),
    "heavydutyplainwasher": (("washer", "plain washer"), {"diameter": "d2", "height": "s"}),
    "singlerowradialbearing": (("ball bearing",), {"diameter": "d2", "height": "B"}),
    "doublerowradialbearing": (("ball bearing",), {"diameter": "d2", "height": "B"}),
    "cylindricalrollerbearing": (("roller bearing",), {"diameter": "d2", "height": "B"}),
    "axialthrustbearing": (("thrust bearing",), {"diameter": "D_g", "height": "T"}),
    "round_battery": (("battery", "dry cell"), {"diameter": "d", "height": "h"}),
    "plateflange": (("pipe flange",), {"diameter": "D", "height": "b"}),
    "blindflange": (("pipe flange",), {"diameter": "D", "height": "b"}),
}
_UNITS = {"Length (mm)": "mm", "Length (in)": "in"}


def row_items(source: Source, folder: Path) -> Iterator[RawItem | RowRejected]:
    """A reading per table row of every class in `*.blt`, in the order of files, classes and rows."""
    paths = sorted(folder.glob("*.blt"))
    if not paths:
        raise BadTable(f"{folder}: expected *.blt; found no such file")
    for path in paths:
        document = yaml_document(path)
        if not isinstance(document, Mapping) or not isinstance(document.get("classes"), list):
            raise BadTable(f"{path}: classes: expected a list; found none")
        for entry in document["classes"]:
            yield from _class_items(source, entry)


def _class_items(source: Source, entry: Mapping[str, Any]) -> Iterator[RawItem | RowRejected]:
    parameters = entry.get("parameters") or {}
    units = {name: _UNITS[kind] for name, kind in (parameters.get("types") or {}).items() if kind in _UNITS}
    tables = parameters.get("tables") or []
    for table in tables if isinstance(tables, list) else [tables]:
        for key, values in table["data"].items():
            row = dict(zip(table["columns"], values, strict=False))
            if not set(row) & set(units):  # a table of names (postfixes, finishes), not of sizes
                continue
            try:
                yield _item(source, entry, str(key), row, units)
            except RowRejected as rejected:
                yield rejected.at(source, f"{entry['id']}:{key}")


def _item(
    source: Source, entry: Mapping[str, Any], key: str, row: Mapping[str, Any], units: Mapping[str, str]
) -> RawItem:
    whole = next((value for start, value in _WHOLE.items() if entry["id"].startswith(start)), None)
    if whole is None or not set(whole[1].values()) & set(row):
        raise RowRejected("part_not_whole", "class", entry["id"])
    category, axes = whole
    words = {
        axis: millimetres(float(row[column]), units.get(column, "mm"))
        for axis, column in axes.items()
        if isinstance(row.get(column), int | float)
    }
    return row_item(source, f"{entry['id']}-{key}", words, category=category, title=f"{_name(entry)} {key}")


def _name(entry: Mapping[str, Any]) -> str:
    names = entry.get("names") or entry["id"]
    first = names[0] if isinstance(names, list) else names
    return str(first["name"] if isinstance(first, Mapping) else first)
