"""Listings of Amazon Berkeley Objects: `listings/metadata/listings_*.json.gz`, one product of a marketplace per line.

According to the README of the set, `item_dimensions` contains height, length and width, each with `value` and `unit` of
the seller and with `normalized_value` in one unit. Texts are lists of `language_tag` and `value`. `product_type` is a
list of one code (`CELLULAR_PHONE_CASE`), the same in every language. A listing is identified by `item_id` and
`domain_name`.
"""

from __future__ import annotations

import gzip
import io
import tarfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from crawler.imports.declaration import Source
from crawler.imports.table_files import BadTable, whole_json
from crawler.imports.table_items import RowRejected, row_item
from crawler.items import RawItem
from metric_base.length_units import millimetres, unit

_FILES = "listings_*.json*"
_AXES = ("length", "width", "height")
_BOUNDS_MM = (2.0, 6000.0)

#: Codes of departments and of goods sold by volume, which are not kinds of objects.
_NOT_AN_OBJECT = frozenset({
    "ACCESSORY", "BABY_PRODUCT", "BEAUTY", "GROCERY", "HARDWARE", "HEALTH_PERSONAL_CARE", "HOME",
    "HOME_FURNITURE_AND_DECOR", "JANITORIAL_SUPPLY", "KITCHEN", "LUXURY_BEAUTY", "OFFICE_PRODUCTS",
    "OUTDOOR_LIVING", "PET_SUPPLIES", "SPORTING_GOODS", "TOOLS", "TOYS_AND_GAMES", "WIRELESS_ACCESSORY",
})  # fmt: skip

#: Value of mandatory fields that a seller has not measured.
_UNFILLED = 1.0

#: Maximum absolute value of a size in any unit; JSON may contain integers that are too large for a float.
MAX_VALUE = 1e9

#: Maximum length of a line in bytes; a listing has some kilobytes.
MAX_LINE_BYTES = 1 << 22

#: Maximum number of consecutive empty lines; a gzip file of 0.3 MB can contain 300 MB of them.
MAX_EMPTY_LINES = 1000


def row_items(source: Source, folder: Path) -> Iterator[RawItem | RowRejected]:
    """Return an item or a rejection for each listing.

    Parameters
    ----------
    source : Source
    folder : Path
        The folder `listings/metadata`, one of its files, or `abo-listings.tar`. Of a product that several marketplaces
        list, the first listing is used.

    Raises
    ------
    BadTable
        There is no such file, or it is not an archive, gzip or JSON.
    """
    seen: set[str] = set()
    for name, lines in _files(folder):
        for number, line in enumerate(lines, start=1):
            place = f"{name}:{number}"
            try:
                listing = whole_json(line)
            except (ValueError, RecursionError) as error:
                raise BadTable(f"{place}: expected a JSON object; found {str(error)[:200]}") from None
            if not isinstance(listing, dict):
                raise BadTable(f"{place}: expected a JSON object; found {type(listing).__name__}")
            item_id = str(listing.get("item_id") or "")
            try:
                if item_id in seen:
                    raise RowRejected("superseded", "item_id", item_id)
                seen.add(item_id)
                yield _item(source, listing, item_id or place)
            except RowRejected as rejected:
                yield rejected.at(source, place)


def _files(folder: Path) -> Iterator[tuple[str, Iterable[bytes]]]:
    """Return name and lines of each file, in the order of the names."""
    if folder.is_file() and folder.name.endswith(".tar"):
        with _readable(folder), tarfile.open(folder) as archive:
            members = sorted((member for member in archive if member.isfile()), key=lambda member: member.name)
            for member in members:
                if Path(member.name).match(_FILES) and (data := archive.extractfile(member)) is not None:
                    yield Path(member.name).name, _lines(data, member.name)
        return
    paths = [folder] if folder.is_file() else sorted(folder.glob(f"**/{_FILES}"))
    if not paths:
        raise BadTable(f"{folder}: expected abo-listings.tar or {_FILES}; found no such file")
    for path in paths:
        with _readable(path), path.open("rb") as data:
            yield path.name, _lines(data, path.name)


def _lines(data: IO[bytes], name: str) -> Iterator[bytes]:
    lines = io.BufferedReader(gzip.GzipFile(fileobj=data)) if name.endswith(".gz") else data
    empty = 0
    with _readable(name):
        while line := lines.readline(MAX_LINE_BYTES):
            empty = 0 if line.strip() else empty + 1
            if empty > MAX_EMPTY_LINES:
                raise BadTable(f"{name}: expected a listing in each line; found {MAX_EMPTY_LINES} empty lines in a row")
            if not empty:
                yield line


@contextmanager
def _readable(path: Path | str) -> Iterator[None]:
    try:
        yield
    except (OSError, EOFError, tarfile.TarError) as error:
        raise BadTable(f"{path}: expected listings of the set; found {str(error)[:200]}") from None


def _item(source: Source, listing: Mapping[str, Any], item_id: str) -> RawItem:
    code = _text(listing, "product_type").upper()
    if code in _NOT_AN_OBJECT:
        raise RowRejected("not_an_object", "product_type", code)
    domain = str(listing.get("domain_name") or "")
    # Sizes by axis in mm, from the normalised values or else from those of the seller.
    stated = listing.get("item_dimensions")
    if not isinstance(stated, dict):
        raise RowRejected("no_size", "item_dimensions", stated or "")
    sizes: dict[str, float] = {}
    for axis in _AXES:
        dimension = stated.get(axis)
        if not dimension:
            continue
        values = (dimension.get("normalized_value"), dimension) if isinstance(dimension, dict) else ()
        value = next((v for v in values if isinstance(v, dict) and isinstance(v.get("value"), int | float)), None)
        key = unit(str(value.get("unit") or "")) if value else None
        if value is None or key is None or not -MAX_VALUE < value["value"] < MAX_VALUE:
            raise RowRejected("unreadable", f"item_dimensions.{axis}", value if value and key is None else dimension)
        sizes[axis] = millimetres(float(value["value"]), key)
    typed = {str((stated.get(axis) or {}).get("value")) for axis in sizes}
    if len(sizes) == len(_AXES) and typed <= {str(_UNFILLED), "1"}:
        raise RowRejected("marked_unusable", "item_dimensions", "1 x 1 x 1")
    return row_item(
        source,
        item_id,
        sizes,
        bounds_mm=_BOUNDS_MM,
        category=[code.replace("_", " ").lower()] if code else [],
        title=_text(listing, "item_name"),
        brand=_text(listing, "brand"),
        region=str(listing.get("country") or "") or None,
        url=f"https://www.{domain}/dp/{item_id}" if domain else source.url,
    )


def _text(listing: Mapping[str, Any], field: str) -> str:
    """Return the English text of a field, else the first text."""
    entries = listing.get(field)
    texts = entries if isinstance(entries, list) else []
    texts = [text for text in texts if isinstance(text, dict) and text.get("value")]
    english = [text for text in texts if str(text.get("language_tag", "")).startswith("en")]
    return " ".join(str((english or texts)[0]["value"]).split()) if texts else ""
