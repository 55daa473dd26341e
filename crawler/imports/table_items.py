"""The columns that a declared table reads, looked for in the header of each of its files.

Plain tables read by their declarations alone.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from crawler.imports.declaration import REASONS, Axis, Cases, Rule, Source, Table
from crawler.imports.table_files import FIELD, Row, _head, _part, _words, record_rows, rows
from crawler.items import BadRawItem, RawItem
from crawler.text.cell_lengths import AXES, Measure, UnreadableLength, extents_mm, length_mm, measures, words_mm
from crawler.text.units import millimetres
from metric_base.errors import in_file

#: Digits after the point of a stored millimetre: a micrometre, finer than any source measures.
STORED_DECIMALS_MM = 3
_FILTERS: Mapping[str, Callable[[str], str]] = {"lower": str.lower, "head": _head, "part": _part, "words": _words}


@dataclass(frozen=True, slots=True)
class Refusal:
    """A row that is not imported: its place in the table, its reason code, the field in error and its text."""

    source: str
    row: str
    reason: str
    field: str
    found: str

    def line(self) -> str:
        """The refusal as one JSON line of a quarantine file."""
        return json.dumps({"schema": "metric-tree/quarantine/1", **asdict(self)}, ensure_ascii=False)


Reading = RawItem | Refusal


class Refused(Exception):
    """Raised inside a reader to refuse the current row: reason code, field, what was found."""

    def __init__(self, reason: str, field: str, found: object) -> None:
        super().__init__(reason, field, found)
        assert reason in REASONS, reason
        self.reason, self.field, self.found = reason, field, str(found)

    def refusal(self, source: Source, row: str) -> Refusal:
        """The refusal for the quarantine file."""
        return Refusal(source.id, row, self.reason, self.field, self.found[:200])


def item(
    source: Source,
    source_id: str,
    words: Mapping[str, float | None] | None = None,
    *,
    extents: Sequence[float] | None = None,
    bounds_mm: tuple[float, float] = (0.1, 500_000.0),
    category: Sequence[str] = (),
    **texts: Any,
) -> RawItem:
    """The raw item of a row: the source's terms filled in, extents from the axis words where none are given.

    Raises
    ------
    Refused
        No size, a size outside `bounds_mm`, or no category.
    BadRawItem
        A text is not what its field must be, such as a region.
    """
    stated = {axis: round(value, STORED_DECIMALS_MM) for axis, value in (words or {}).items() if value}
    sides = (
        tuple(sorted((round(e, STORED_DECIMALS_MM) for e in extents), reverse=True)) if extents else extents_mm(stated)
    )
    path = tuple(dict.fromkeys(text for part in category if (text := " ".join(part.split()))))
    if not sides:
        raise Refused("no_size", "dimensions", texts.get("dimensions_text") or "")
    if min(sides) < bounds_mm[0] or max(sides) > bounds_mm[1]:
        raise Refused("out_of_bounds", "extents_mm", list(sides))
    if not path:
        raise Refused("no_category", "category", texts.get("title", ""))
    given = {key: value for key, value in texts.items() if value}
    with in_file(f"{source.id}: row {source_id}", BadRawItem):
        return RawItem(
            source=source.id,
            source_id=source_id,
            category_path=path,
            dimensions_mm={axis: stated.get(axis) for axis in AXES} if stated else {},
            extents_mm=sides,
            **(_defaults(source) | given),
        )


def _defaults(source: Source) -> dict[str, Any]:
    """What the source states about all its rows."""
    return {
        "licence": source.licence,
        "kind": source.kind,
        "year": source.year,
        "region": source.region,
        "url": source.page,
    }


def year(text: str) -> int | None:
    """The first year from 1000 to 2099 in a text."""
    match = re.search(r"(?<!\d)(?:1\d|20)\d{2}(?!\d)", text)
    return int(match[0]) if match else None


@dataclass(frozen=True, slots=True)
class _Size:
    words: dict[str, float]
    extents: tuple[float, ...] | None
    text: str = ""
    is_range: bool = False


def table_readings(source: Source, folder: Path) -> Iterator[Reading]:
    """The readings of all tables of a source, in the order of the declaration, the files and the rows."""
    for table in source.tables:
        for stem, lines in _row_files(source, table, folder):
            for number, row in enumerate(lines, start=1):
                named = _rename_values(table, row | {"file": stem, "row": str(number)})
                if all(_holds(rule, named) for rule in table.only):
                    yield _reading(source, table, named)


def _row_files(source: Source, table: Table, folder: Path) -> Iterator[tuple[str, Iterator[Row]]]:
    """Stem and rows of each file of a table; where there is none, the records of its public form are read."""
    paths = _rest(source, folder, table) if table.rest else _files(table, folder)
    for path in paths:
        yield path.stem, rows(table, path)
    if not paths and not table.rest and folder.is_dir():
        yield Path(table.files[0]).stem, record_rows(table, folder)


def fill_template(template: str, row: Row) -> str:
    """The template with the row's columns in place: `{brand} {model}`; an absent column is empty."""

    def cell(match: re.Match[str]) -> str:
        text = row.get(match[1], "")
        return _FILTERS[match[2]](text) if match[2] else text

    return " ".join(FIELD.sub(cell, template).split()) if "{" in template else template


def _rename_values(table: Table, row: Row) -> Row:
    """The row with its values renamed and the columns that are read out of others."""
    for column, others in table.names.items():
        row[column] = others.get(row.get(column, ""), row.get(column, ""))
    for name, cases in table.read.items():
        row[name] = _case(cases, row)
    return row


def _case(cases: Cases, row: Row) -> str:
    r"""The value of the first case that matches, with what its groups matched in place of `\1`; else the default."""
    text = fill_template(cases.column, row)
    for pattern, value in cases.cases:
        if match := pattern.search(text):
            return match.expand(value) if "\\" in value else value
    return fill_template(cases.default, row)


def _files(table: Table, folder: Path) -> list[Path]:
    """The table's files: `folder` may also be the one file itself."""
    if folder.is_file():
        return [folder] if any(folder.match(pattern) for pattern in table.files) else []
    return [path for pattern in table.files for path in sorted(folder.glob(pattern))]


def _rest(source: Source, folder: Path, table: Table) -> list[Path]:
    """The files of the patterns that no other table reads."""
    if folder.is_file():
        return []
    others = {path for other in source.tables if not other.rest for path in _files(other, folder)}
    return [path for pattern in table.files for path in sorted(folder.glob(pattern)) if path not in others]


def _reading(source: Source, table: Table, row: Row) -> Reading:
    try:
        if table.refused:
            raise Refused(table.refused, "file", row["file"])
        for rule in table.reject:
            if _holds(rule, row):
                raise Refused(rule.outcome, rule.column, _rule_text(rule, row))
        return _item(source, table, row, _size(table, row))
    except Refused as refused:
        return refused.refusal(source, f"{row['file']}:{row['row']}")


def _item(source: Source, table: Table, row: Row, size: _Size) -> Reading:
    marks = (rule.outcome for rule in table.flag if _holds(rule, row))
    flags = dict.fromkeys([*table.flags, *marks, *(["range"] if size.is_range else [])])
    return item(
        source,
        fill_template(table.id, row) or row["row"],
        size.words if table.labelled else {},
        extents=size.extents,
        bounds_mm=table.bounds_mm,
        category=_category(table, row),
        title=fill_template(table.title, row),
        brand=fill_template(table.brand, row),
        url=fill_template(table.url, row),
        dimensions_text=size.text,
        year=year(fill_template(table.year, row)),
        region=fill_template(table.region, row),
        scene=fill_template(table.scene, row),
        statistic=_statistic(fill_template(table.statistic, row)),
        relative_sd=float(fill_template(table.relative_sd, row) or 0) or None,
        attribution=fill_template(table.attribution, row),
        kind=fill_template(table.kind, row),
        synset=fill_template(table.synset, row),
        licence=fill_template(table.licence, row),
        flags=tuple(flags),
    )


def _statistic(text: str) -> str:
    return "" if text == "instance" else text


def _category(table: Table, row: Row) -> list[str]:
    parts = [fill_template(part, row) for part in table.category]
    separator = table.category_separator.strip()
    return [word for part in parts for word in part.split(separator)] if separator else parts


def _size(table: Table, row: Row) -> _Size:
    if table.text:
        return _text_size(table, row)
    words = {axis: mm for axis in table.axes if (mm := _length(table, row, axis))}
    return _Size(words, extents_mm(words))


def _text_size(table: Table, row: Row) -> _Size:
    text = _first_group(table.text_pattern, fill_template(table.text, row))
    lengths = tuple(measure for measure in measures(text, table.unit, table.decimal) if measure.mm)
    if len(lengths) > 3 and not all(measure.axis for measure in lengths):
        raise Refused("several_states", "text", text)
    if not lengths:
        raise Refused("no_size", "text", text)
    words = words_mm(lengths, table.order)
    return _Size(words, _extents(words, lengths), text, any(measure.is_range for measure in lengths))


def _first_group(pattern: str, text: str) -> str:
    if not pattern:
        return text
    inside = re.search(pattern, text)
    return inside[1] if inside else ""


def _extents(words: dict[str, float], lengths: tuple[Measure, ...]) -> tuple[float, ...]:
    """The outer size: by the words where every length has one, else the bare lengths."""
    if len(words) == len(lengths) or all(measure.axis for measure in lengths):
        return extents_mm(words) or ()
    return tuple(sorted((measure.mm for measure in lengths), reverse=True))


def _length(table: Table, row: Row, axis: str) -> float | None:
    declared = table.columns_of_axes[axis]
    if declared.minus:
        return _difference(table, row, axis)
    text = _first_group(declared.pattern, row.get(declared.column, ""))
    try:
        length = length_mm(text, _unit(table, declared), table.decimal)
    except UnreadableLength as error:
        raise Refused("unreadable", declared.column, error) from None
    return length * declared.factor if length else None


def _unit(table: Table, axis: Axis) -> str:
    return axis.unit or table.unit or "mm"  # a table without any unit has not passed its door


def _difference(table: Table, row: Row, axis: str) -> float:
    """The distance of the two sides of a box, whose coordinates may be negative."""
    declared = table.columns_of_axes[axis]
    try:
        sides = float(row[declared.column]) - float(row[declared.minus])
    except (KeyError, ValueError) as error:
        raise Refused("unreadable", declared.column, error) from None
    return millimetres(abs(sides), _unit(table, declared)) * declared.factor


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
