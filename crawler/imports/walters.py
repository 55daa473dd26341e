"""The Walters Art Museum: sizes in sentences, `H: 3 1/4 x W: 5 in. (8.3 x 12.7 cm); H without base: 3 in. (7.6 cm)`."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from crawler.imports.declaration import Source, Table
from crawler.imports.table_files import Row, record_rows, rows
from crawler.imports.table_items import RowRejected, row_item, year
from crawler.items import RawItem
from crawler.text.cell_lengths import Measure, dimensions_mm, measures

_TABLE = Table(files=("walters_dims.jsonl",), records="objects/data/**/*.json", format="jsonl")

#: Classes and object names whose size is that of a sheet or an image.
_FLAT_CLASSES = frozenset({"Manuscripts & Rare Books", "Painting & Drawing", "Prints"})
_FLAT_NAMES = re.compile(
    r"folio|leaf|leaves|painting|drawing|print|photograph|miniature|icon|portrait|calligraph", re.IGNORECASE
)
_BOOK = re.compile(r"^(rare )?books?\b", re.IGNORECASE)
_PART_NAMES = re.compile(r"fragment|inlay", re.IGNORECASE)
_SET_NAMES = re.compile(r"\bsets?\b|service", re.IGNORECASE)
#: Words before a length that say that it is a part's; an object without its mount or stand is the object.
_PART = re.compile(
    r"\b(at|without (?!mount|stand)|excluding|bezel|hoop|frame|framed|(?<!without )mount|inner|interior|image|painted"
    r"|base|average|circumference|blade|sheath|dagger|chain|medallion|panel|center|of)\b",
    re.IGNORECASE,
)
#: `(h. x max. diam.)` behind the figures says what they are.
_ORDER = re.compile(
    r"\(((?:max\.? ?)?(?:h|w|d|l|diam)\.?(?:\s*[x×]\s*(?:max\.? ?)?(?:h|w|d|l|diam)\.?)*)\)", re.IGNORECASE
)
_LETTERS = {"h": "height", "w": "width", "d": "depth", "l": "length", "diam": "diameter"}
#: `H with handle:` is still a height of the whole.
_QUALIFIED = re.compile(
    r"\b(?:(?:max|overall|outer)\.?\s+)?(H|W|D|L|Diam)\b\.?(?:\s+(?:with |without (?:mount|stand))[^:;\d]*)?(?=\s*:)",
    re.IGNORECASE,
)
_BOUNDS_MM = (1.0, 6000.0)


def row_items(source: Source, folder: Path) -> Iterator[RawItem | RowRejected]:
    """A reading per object of `walters_dims.jsonl`, or of the museum's own repository."""
    path = folder if folder.is_file() else folder / _TABLE.files[0]
    for row in rows(_TABLE, path) if path.is_file() else record_rows(_TABLE, folder):
        try:
            yield _item(source, row)
        except RowRejected as rejected:
            yield rejected.at(source, row["ObjectID"])


def _item(source: Source, row: Row) -> RawItem:
    names = row["ObjectName"]
    _refuse_flat(row["Classification"], names)
    words, extents = _size(row["Dimensions"])
    first = re.split(r"[;,]", names, maxsplit=1)[0]
    return row_item(
        source,
        row["ObjectID"],
        words,
        extents=extents,
        bounds_mm=_BOUNDS_MM,
        category=[row["Classification"], re.sub(r"\s*\([^)]*\)", "", first)] if first else [],
        title=row["Title"],
        url=f"https://art.thewalters.org/detail/{row['ObjectID']}",
        dimensions_text=row["Dimensions"],
        year=year(row["DateText"]),
    )


def _refuse_flat(classification: str, names: str) -> None:
    if (classification in _FLAT_CLASSES and not _BOOK.match(names)) or _FLAT_NAMES.search(names):
        raise RowRejected("flat_picture", "ObjectName", names or classification)
    if _PART_NAMES.search(names):
        raise RowRejected("part_not_whole", "ObjectName", names)
    if _SET_NAMES.search(names):
        raise RowRejected("set_of_objects", "ObjectName", names)


def _size(text: str) -> tuple[dict[str, float], tuple[float, ...] | None]:
    """Axis words and extents of the first statement about the whole; bare figures give extents alone."""
    statements = [part.strip() for part in re.split(r"[;\r\n]+", text) if part.strip()]
    if not statements:
        raise RowRejected("no_size", "Dimensions", text)
    for statement in statements:
        if whole := _whole(statement):
            if len(whole) > 3:
                raise RowRejected("several_states", "Dimensions", text)
            return _by_words(whole, statement)
    raise RowRejected("part_not_whole" if any(map(measures, statements)) else "unreadable", "Dimensions", text)


def _whole(statement: str) -> tuple[Measure, ...]:
    """The lengths of a statement that are the whole object's; a part named at its head makes all of it a part's."""
    plain = _QUALIFIED.sub(r"\1", statement)
    lengths = measures(plain)
    starts = (0, *(measure.end for measure in lengths))
    of_part = [bool(_PART.search(plain[start : m.start])) for start, m in zip(starts, lengths, strict=False)]
    if not lengths or of_part[0]:
        return ()
    return tuple(measure for measure, part in zip(lengths, of_part, strict=True) if measure.mm and not part)


def _by_words(lengths: tuple[Measure, ...], statement: str) -> tuple[dict[str, float], tuple[float, ...] | None]:
    behind = _ORDER.search(statement)
    letters = re.findall(r"diam|[hwdl]", behind[1].lower()) if behind else []
    order = [_LETTERS[letter] for letter in letters]
    words = dimensions_mm(lengths, order) if len(order) in {0, len(lengths)} else {}
    complete = len(words) == len(lengths)
    return words, None if complete else tuple(measure.mm for measure in lengths)
