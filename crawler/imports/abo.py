"""Amazon Berkeley Objects, the listings: `listings/metadata/listings_*.json.gz`, a product of a marketplace a line.

After the set's own README: `item_dimensions` holds height, length and width, each with `value` and `unit` as the seller
typed them and `normalized_value` in one unit; texts are lists of `language_tag` and `value`; `product_type` is a list
of one code (`CELLULAR_PHONE_CASE`), the same in every language; a listing is `item_id` on `domain_name`.
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
from crawler.text.units import millimetres, unit

_FILES = "listings_*.json*"
_AXES = ("length", "width", "height")
_BOUNDS_MM = (2.0, 6000.0)

#: Codes of departments and of what is sold by volume: they name no kind of object.
_NOT_AN_OBJECT = frozenset(
    {
        "ACCESSORY", "BABY_PRODUCT", "BEAUTY", "GROCERY", "HARDWARE", "HEALTH_PERSONAL_CARE", "HOME",
        "HOME_FURNITURE_AND_DECOR", "JANITORIAL_SUPPLY", "KITCHEN", "LUXURY_BEAUTY", "OFFICE_PRODUCTS",
        "OUTDOOR_LIVING", "PET_SUPPLIES", "SPORTING_GOODS", "TOOLS", "TOYS_AND_GAMES", "WIRELESS_ACCESSORY",
    }
)  # fmt: skip

#: A seller who fills three fields with 1 has measured nothing.
_UNFILLED = 1.0

#: No number of a size is larger, in any unit; JSON has integers that no float holds.
_LARGEST = 1e9

#: Longest line that is read: a listing has some kilobytes.
_LONGEST = 1 << 22

#: Empty lines in a row that are passed over; a gzip file of 0.3 MB can hold 300 MB of them.
_EMPTY_LINES = 1000


def row_items(source: Source, folder: Path) -> Iterator[RawItem | RowRejected]:
    """A reading per listing: of the folder `listings/metadata`, one of its files, or `abo-listings.tar`.

    A product that several marketplaces list is read once, where it comes first.

    Raises
    ------
    BadTable
        There is no such file, or it is no archive, gzip or JSON.
    """
    seen: set[str] = set()
    for name, lines in _files(folder):
        for number, line in enumerate(lines, start=1):
            place = f"{name}:{number}"
            listing = _listing(line, place)
            item_id = str(listing.get("item_id") or "")
            try:
                if item_id in seen:
                    raise RowRejected("superseded", "item_id", item_id)
                seen.add(item_id)
                yield _item(source, listing, item_id or place)
            except RowRejected as rejected:
                yield rejected.at(source, place)


def _files(folder: Path) -> Iterator[tuple[str, Iterable[bytes]]]:
    """Name and lines of each file, in the order of the names."""
    if folder.is_file() and folder.name.endswith(".tar"):
        with _readable(folder), tarfile.open(folder) as archive:
            members = sorted((one for one in archive if one.isfile()), key=lambda one: one.name)
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
        while line := lines.readline(_LONGEST):
            empty = 0 if line.strip() else empty + 1
            if empty > _EMPTY_LINES:
                raise BadTable(f"{name}: expected a listing in each line; found {_EMPTY_LINES} empty lines in a row")
            if not empty:
                yield line


@contextmanager
def _readable(path: Path | str) -> Iterator[None]:
    try:
        yield
    except (OSError, EOFError, tarfile.TarError) as error:
        raise BadTable(f"{path}: expected listings of the set; found {str(error)[:200]}") from None


def _listing(line: bytes, place: str) -> Mapping[str, Any]:
    try:
        listing = whole_json(line)
    except (ValueError, RecursionError) as error:
        raise BadTable(f"{place}: expected a JSON object; found {str(error)[:200]}") from None
    if not isinstance(listing, dict):
        raise BadTable(f"{place}: expected a JSON object; found {type(listing).__name__}")
    return listing


def _item(source: Source, listing: Mapping[str, Any], item_id: str) -> RawItem:
    code = _text(listing, "product_type").upper()
    if code in _NOT_AN_OBJECT:
        raise RowRejected("not_an_object", "product_type", code)
    words = _sizes(listing)
    title = _text(listing, "item_name")
    domain = str(listing.get("domain_name") or "")
    return row_item(
        source,
        item_id,
        words,
        bounds_mm=_BOUNDS_MM,
        category=[code.replace("_", " ").lower()] if code else [],
        title=title,
        brand=_text(listing, "brand"),
        region=str(listing.get("country") or "") or None,
        url=f"https://www.{domain}/dp/{item_id}" if domain else source.url,
    )


def _sizes(listing: Mapping[str, Any]) -> dict[str, float]:
    """The stated axes in mm."""
    stated = listing.get("item_dimensions")
    if not isinstance(stated, dict):
        raise RowRejected("no_size", "item_dimensions", stated or "")
    values = {axis: _length(axis, stated[axis]) for axis in _AXES if stated.get(axis)}
    typed = {str((stated.get(axis) or {}).get("value")) for axis in values}
    if len(values) == len(_AXES) and typed <= {str(_UNFILLED), "1"}:
        raise RowRejected("marked_unusable", "item_dimensions", "1 x 1 x 1")
    return values


def _length(axis: str, stated: Any) -> float:
    """Millimetres of one axis: as it was brought to one unit, else as it was typed."""
    for one in (stated.get("normalized_value"), stated) if isinstance(stated, dict) else ():
        if isinstance(one, dict) and isinstance(one.get("value"), int | float):
            key = unit(str(one.get("unit") or ""))
            if key is None:
                raise RowRejected("unreadable", f"item_dimensions.{axis}", one)
            if not -_LARGEST < one["value"] < _LARGEST:
                break
            return millimetres(float(one["value"]), key)
    raise RowRejected("unreadable", f"item_dimensions.{axis}", stated)


def _text(listing: Mapping[str, Any], field: str) -> str:
    """The English text of a field, else its first."""
    entries = listing.get(field)
    texts = [one for one in entries if isinstance(one, dict) and one.get("value")] if isinstance(entries, list) else []
    english = [one for one in texts if str(one.get("language_tag", "")).startswith("en")]
    return " ".join(str((english or texts)[0]["value"]).split()) if texts else ""
