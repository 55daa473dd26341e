"""Walters Art Museum: sizes in sentences, `H: 3 1/4 x W: 5 in. (8.3 x 12.7 cm); H without base: 3 in. (7.6 cm)`."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from crawler.imports.declaration import Source, Table
from crawler.imports.table_files import Row, record_rows, rows
from crawler.imports.table_items import RowRejected, outcome, row_item, year
from crawler.items import RawItem
from crawler.text.cell_lengths import Measure, dimensions_mm, measures

_TABLE = Table(files=("walters_dims.jsonl",), records="objects/data/**/*.json", format="jsonl")

#: Classes and names of objects whose size is the size of a sheet or an image.
_FLAT_CLASSES = frozenset({"Manuscripts & Rare Books", "Painting & Drawing", "Prints"})
_FLAT_NAMES = re.compile(
    r"folio|leaf|leaves|painting|drawing|print|photograph|miniature|icon|portrait|calligraph", re.IGNORECASE
)
_BOOK = re.compile(r"^(rare )?books?\b", re.IGNORECASE)
_PART_NAMES = re.compile(r"fragment|inlay", re.IGNORECASE)
_SET_NAMES = re.compile(r"\bsets?\b|service", re.IGNORECASE)
#: Words before the length of a part; an object without its mount or stand is still the object.
_PART = re.compile(
    r"\b(at|without (?!mount|stand)|excluding|bezel|hoop|frame|framed|(?<!without )mount|inner|interior|image|painted"
    r"|base|average|circumference|blade|sheath|dagger|chain|medallion|panel|center|of)\b",
    re.IGNORECASE,
)
#: Axes after the lengths: `(h. x max. diam.)`.
_ORDER = re.compile(
    r"\(((?:max\.? ?)?(?:h|w|d|l|diam)\.?(?:\s*[x×]\s*(?:max\.? ?)?(?:h|w|d|l|diam)\.?)*)\)", re.IGNORECASE
)
_LETTERS = {"h": "height", "w": "width", "d": "depth", "l": "length", "diam": "diameter"}
#: `H with handle:` is still the height of the object.
_QUALIFIED = re.compile(
    r"\b(?:(?:max|overall|outer)\.?\s+)?(H|W|D|L|Diam)\b\.?(?:\s+(?:with |without (?:mount|stand))[^:;\d]*)?(?=\s*:)",
    re.IGNORECASE,
)
_BOUNDS_MM = (1.0, 6000.0)


def row_items(source: Source, folder: Path) -> Iterator[RawItem | RowRejected]:
    """Return an item or a rejection for each object of `walters_dims.jsonl`, or of the repository of the museum."""
    path = folder if folder.is_file() else folder / _TABLE.files[0]
    for row in rows(_TABLE, path) if path.is_file() else record_rows(_TABLE, folder):
        yield outcome(source, row["ObjectID"], partial(_item, source, row))


def _item(source: Source, row: Row) -> RawItem:
    """Return the item of an object, or raise `RowRejected`."""
    classification, names = row["Classification"], row["ObjectName"]
    if (classification in _FLAT_CLASSES and not _BOOK.match(names)) or _FLAT_NAMES.search(names):
        raise RowRejected("flat_picture", "ObjectName", names or classification)
    if _PART_NAMES.search(names):
        raise RowRejected("part_not_whole", "ObjectName", names)
    if _SET_NAMES.search(names):
        raise RowRejected("set_of_objects", "ObjectName", names)
    words, extents = _size(row["Dimensions"])
    name = re.split(r"[;,]", names, maxsplit=1)[0]
    return row_item(
        source,
        row["ObjectID"],
        words,
        extents=extents,
        bounds_mm=_BOUNDS_MM,
        category=[classification, re.sub(r"\s*\([^)]*\)", "", name)] if name else [],
        title=row["Title"],
        url=f"https://art.thewalters.org/detail/{row['ObjectID']}",
        dimensions_text=row["Dimensions"],
        year=year(row["DateText"]),
    )


def _size(text: str) -> tuple[dict[str, float], tuple[float, ...] | None]:
    """Return sizes by axis and extents of the first statement about the object; only extents if axes are missing."""
    statements = [part.strip() for part in re.split(r"[;\r\n]+", text) if part.strip()]
    if not statements:
        raise RowRejected("no_size", "Dimensions", text)
    for statement in statements:
        lengths = _lengths_of_object(statement)
        if len(lengths) > 3:
            raise RowRejected("several_states", "Dimensions", text)
        if lengths:
            after = _ORDER.search(statement)
            order = [_LETTERS[letter] for letter in re.findall(r"diam|[hwdl]", after[1].lower())] if after else []
            words = dimensions_mm(lengths, order) if len(order) in {0, len(lengths)} else {}
            return words, None if len(words) == len(lengths) else tuple(length.mm for length in lengths)
    raise RowRejected("part_not_whole" if any(map(measures, statements)) else "unreadable", "Dimensions", text)


def _lengths_of_object(statement: str) -> tuple[Measure, ...]:
    """Return the lengths of a statement that are not of a part; none if it begins with the name of a part."""
    text = _QUALIFIED.sub(r"\1", statement)
    lengths = measures(text)
    starts = (0, *(length.end for length in lengths))
    is_of_part = [bool(_PART.search(text[start : m.start])) for start, m in zip(starts, lengths, strict=False)]
    if not lengths or is_of_part[0]:
        return ()
    return tuple(length for length, is_part in zip(lengths, is_of_part, strict=True) if length.mm and not is_part)
