"""Convert rows of declared tables to raw items; rows without a valid size, category or text are rejected."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Self

from crawler.imports.declaration import BOUNDS_MM, REASONS, Amount, Rule, Source, Table
from crawler.imports.table_files import FIELD, Row, record_rows, rows
from crawler.items import BadRawItem, RawItem
from crawler.text.cell_lengths import AXES, UnreadableLength, dimensions_mm, extents_mm, length_mm, measures
from metric_base.errors import in_file
from metric_base.length_units import millimetres

#: Number of decimals of sizes in mm that are kept: one micrometre, finer than any source.
STORED_DECIMALS_MM = 3
#: Fields of an item that a table states as a template.
_TEXTS = ("title", "brand", "url", "region", "scene", "attribution", "kind", "synset", "licence")
#: Boundaries of words in CamelCase and in names with underscores.
_WORD_BOUNDARY = re.compile(r"(?<=[a-z0-9])(?=[A-Z])|[_|\s]+")


def _head(text: str) -> str:
    return re.split(r"[,;(]", text, maxsplit=1)[0].strip()


#: Filters of templates (`Table`).
_FILTERS: Mapping[str, Callable[[str], str]] = {
    "lower": str.lower,
    "head": _head,
    "part": lambda text: _head(text.split(":", maxsplit=1)[-1].strip()),
    "words": lambda text: " ".join(part for part in _WORD_BOUNDARY.split(text) if part).lower(),
}


class RowRejected(Exception):
    """A row that is not imported; raised by a reader, and kept for the quarantine file.

    Parameters
    ----------
    reason : str
        Code of `REASONS`.
    field : str
        Field in error.
    found : object
        Its value.
    """

    #: Maximum number of characters of the found value in the quarantine file.
    MAX_FOUND = 200

    def __init__(self, reason: str, field: str, found: object) -> None:
        super().__init__(reason, field, found)
        assert reason in REASONS, reason
        self.reason, self.field, self.found = reason, field, str(found)[: self.MAX_FOUND]
        self.source, self.row = "", ""

    def at(self, source: Source, row: str) -> Self:
        """Add the source and the row."""
        self.source, self.row = source.id, row
        return self

    def line(self) -> str:
        """Return the JSON line of the quarantine file."""
        names = ("source", "row", "reason", "field", "found")
        values = {"schema": "metric-tree/quarantine/1", **{name: getattr(self, name) for name in names}}
        return json.dumps(values, ensure_ascii=False)


def outcome(source: Source, row: str, item: Callable[[], RawItem]) -> RawItem | RowRejected:
    """Return the item of a row, or its rejection with the source and the row."""
    try:
        return item()
    except RowRejected as rejected:
        return rejected.at(source, row)


def row_item(
    source: Source,
    source_id: str,
    words: Mapping[str, float | None] | None = None,
    *,
    extents: Sequence[float] | None = None,
    bounds_mm: tuple[float, float] = BOUNDS_MM,
    category: Sequence[str] = (),
    **texts: Any,
) -> RawItem:
    """Return the raw item of a row, with the licence, kind, year, region and page of the source as defaults.

    Parameters
    ----------
    source : Source
    source_id : str
    words : mapping of str to float, optional
        Sizes in mm by axis name, such as `length`.
    extents : sequence of float, optional
        Sizes in mm; by default those of `words`.
    bounds_mm : tuple of float
        Minimum and maximum size.
    category : sequence of str
        Category path.
    **texts
        Other fields of the item; empty ones are omitted.

    Raises
    ------
    RowRejected
        There is no size, a size is outside of `bounds_mm`, or there is no category.
    BadRawItem
        A field has an invalid value, such as an unknown region.
    """
    stated = {axis: round(value, STORED_DECIMALS_MM) for axis, value in (words or {}).items() if value}
    rounded = tuple(sorted((round(side, STORED_DECIMALS_MM) for side in extents or ()), reverse=True))
    sides = rounded or extents_mm(stated)
    path = tuple(dict.fromkeys(text for part in category if (text := " ".join(part.split()))))
    if not sides:
        raise RowRejected("no_size", "dimensions", texts.get("dimensions_text") or "")
    if min(sides) < bounds_mm[0] or max(sides) > bounds_mm[1]:
        raise RowRejected("out_of_bounds", "extents_mm", list(sides))
    if not path:
        raise RowRejected("no_category", "category", texts.get("title", ""))
    defaults = {name: getattr(source, name) for name in ("licence", "kind", "year", "region")}
    given = {"url": source.page} | {key: value for key, value in texts.items() if value}
    with in_file(f"{source.id}: row {source_id}", BadRawItem):
        return RawItem(
            source=source.id,
            source_id=source_id,
            category_path=path,
            dimensions_mm={axis: stated.get(axis) for axis in AXES} if stated else {},
            extents_mm=sides,
            **(defaults | given),
        )


def year(text: str) -> int | None:
    """Return the first year from 1000 to 2099 in a text."""
    match = re.search(r"(?<!\d)(?:1\d|20)\d{2}(?!\d)", text)
    return int(match[0]) if match else None


def table_row_items(source: Source, folder: Path) -> Iterator[RawItem | RowRejected]:
    """Return an item or a rejection for each row of all tables of a source, in the order of tables, files and rows."""
    for table in source.tables:
        paths = _files(table, folder)
        if table.rest:  # only files that no other table of the source reads
            others = {path for other in source.tables if not other.rest for path in _files(other, folder)}
            paths = [] if folder.is_file() else [path for path in paths if path not in others]
        files: list[tuple[str, Iterator[Row]]] = [(path.stem, rows(table, path)) for path in paths]
        if not paths and not table.rest and folder.is_dir():
            # the set publishes each record as a JSON file
            files = [(Path(table.files[0]).stem, record_rows(table, folder))]
        for stem, lines in files:
            for number, row in enumerate(lines, start=1):
                named = _rename_values(table, row | {"file": stem, "row": str(number)})
                if all(_holds(rule, named) for rule in table.only):
                    yield outcome(source, f"{stem}:{number}", partial(_table_row_item, source, table, named))


def fill_template(template: str, row: Row) -> str:
    """Replace the columns in a template such as `{brand} {model}`; a missing column is empty."""

    def cell(match: re.Match[str]) -> str:
        text = row.get(match[1], "")
        return _FILTERS[match[2]](text) if match[2] else text

    return " ".join(FIELD.sub(cell, template).split()) if "{" in template else template


def _rename_values(table: Table, row: Row) -> Row:
    """Rename values of a row, and add the columns that are derived from others."""
    for column, others in table.names.items():
        row[column] = others.get(row.get(column, ""), row.get(column, ""))
    for name, cases in table.read.items():
        text = fill_template(cases.column, row)
        matches = ((pattern.search(text), value) for pattern, value in cases.cases)
        match, value = next(((match, value) for match, value in matches if match), (None, ""))
        if match is None:
            row[name] = fill_template(cases.default, row)
        else:
            row[name] = match.expand(value) if "\\" in value else value
    return row


def _files(table: Table, folder: Path) -> list[Path]:
    """Return the files of a table; `folder` may also be a single file."""
    if folder.is_file():
        return [folder] if any(folder.match(pattern) for pattern in table.files) else []
    return [path for pattern in table.files for path in sorted(folder.glob(pattern))]


def _table_row_item(source: Source, table: Table, row: Row) -> RawItem:
    """Return the item of a row by the declaration of its table, or raise `RowRejected`."""
    if table.refused:
        raise RowRejected(table.refused, "file", row["file"])
    for rule in table.reject:
        if _holds(rule, row):
            raise RowRejected(rule.outcome, rule.column, _rule_text(rule, row))
    words: dict[str, float]
    extents: tuple[float, ...] | None
    if table.text:
        text = _first_group(table.text_pattern, fill_template(table.text, row))
        lengths = tuple(measure for measure in measures(text, table.unit, table.decimal) if measure.mm)
        if len(lengths) > 3 and not all(measure.axis for measure in lengths):
            raise RowRejected("several_states", "text", text)
        if not lengths:
            raise RowRejected("no_size", "text", text)
        words = dimensions_mm(lengths, table.order)
        if len(words) == len(lengths) or all(measure.axis for measure in lengths):
            extents = extents_mm(words) or ()
        else:
            extents = tuple(sorted((measure.mm for measure in lengths), reverse=True))
        is_range = any(measure.is_range for measure in lengths)
    else:
        text, is_range = "", False
        words = {axis: mm for axis in table.axes if (mm := _length(table, row, axis))}
        extents = extents_mm(words)
    marks = (rule.outcome for rule in table.flag if _holds(rule, row))
    flags = dict.fromkeys([*table.flags, *marks, *(["range"] if is_range else [])])
    category = [fill_template(part, row) for part in table.category]
    if separator := table.category_separator.strip():
        category = [word for part in category for word in part.split(separator)]
    statistic = fill_template(table.statistic, row)
    return row_item(
        source,
        fill_template(table.id, row) or row["row"],
        words if table.labelled else {},
        extents=extents,
        bounds_mm=table.bounds_mm,
        category=category,
        dimensions_text=text,
        year=year(fill_template(table.year, row)),
        statistic="" if statistic == "instance" else statistic,
        relative_sd=float(fill_template(table.relative_sd, row) or 0) or None,
        **{name: fill_template(getattr(table, name), row) for name in _TEXTS},
        flags=tuple(flags),
        mass_kg=_amount(table.mass_kg, row),
        volume_l=_amount(table.volume_l, row),
    )


def _amount(declared: Amount | None, row: Row) -> float | None:
    """Return the mass in kg or the volume in litres of a row with six digits; None if no positive number is stated."""
    try:
        amount = float(row.get(declared.column, "")) * declared.factor if declared else 0.0
    except ValueError:
        return None
    return float(f"{amount:.6g}") if 0 < amount < math.inf else None


def _first_group(pattern: str, text: str) -> str:
    if not pattern:
        return text
    inside = re.search(pattern, text)
    return inside[1] if inside else ""


def _length(table: Table, row: Row, axis: str) -> float | None:
    """Return the length of an axis in mm; if the axis is declared with `minus`, the distance of two coordinates."""
    declared = table.columns_of_axes[axis]
    unit = declared.unit or table.unit or "mm"  # the type only: a declaration without a unit is rejected
    if declared.minus:
        try:
            sides = float(row[declared.column]) - float(row[declared.minus])
        except (KeyError, ValueError) as error:
            raise RowRejected("unreadable", declared.column, error) from None
        return millimetres(abs(sides), unit) * declared.factor
    text = _first_group(declared.pattern, row.get(declared.column, ""))
    try:
        length = length_mm(text, unit, table.decimal)
    except UnreadableLength as error:
        raise RowRejected("unreadable", declared.column, error) from None
    return length * declared.factor if length else None


def _rule_text(rule: Rule, row: Row) -> str:
    return fill_template(rule.column, row) if "{" in rule.column else row.get(rule.column, "")


def _holds(rule: Rule, row: Row) -> bool:
    text = _rule_text(rule, row)
    if rule.matches:
        return bool(rule.matches.search(text))
    if rule.listed:
        return text in rule.texts
    try:
        value = float(text)
    except ValueError:
        return False
    return (rule.below is not None and value < rule.below) or (rule.above is not None and value > rule.above)
