"""Import a source: find its files, read every row, merge identical items, sample large categories, write JSON Lines."""

from __future__ import annotations

import gzip
import hashlib
import math
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path

from crawler.imports.declaration import Source
from crawler.imports.downloads import NoInput, download
from crawler.imports.table_items import RowRejected, table_row_items
from crawler.items import RawItem
from metric_base.arrays import grouped
from metric_base.files import whole_file, write_whole

#: Flag of items that are a sample of a larger set.
SAMPLED = "sampled"


@dataclass(frozen=True, slots=True)
class Import:
    """Result of an import: rows = counts of the items + rejected rows + sampled out."""

    source: Source
    items: tuple[RawItem, ...]
    rejected: tuple[RowRejected, ...]
    n_rows: int
    n_sampled_out: int = 0

    @property
    def reasons(self) -> dict[str, int]:
        """Number of rejected rows by reason code."""
        return dict(sorted(Counter(row.reason for row in self.rejected).items()))


def import_source(source: Source, folder: Path) -> Import:
    """Import the files of a source.

    Identical items are merged if the declaration demands it (`collapse`, `one_per_title`), and large categories are
    sampled (`per_category`). Source ids are made unique: a repeated one gets `#2`, `#3`.

    Parameters
    ----------
    source : Source
    folder : Path
        Folder of its files, or the one file.
    """
    outcomes = list(row_items(source, folder))
    rejected = tuple(one for one in outcomes if isinstance(one, RowRejected))
    items = [one for one in outcomes if isinstance(one, RawItem)]
    kept = _without_copies(items) if source.collapse else items
    kept = _one_per_title(kept) if source.one_per_title else kept
    drawn = list(_sample(kept, source.per_category)) if source.per_category else kept
    n_out = sum(item.count for item in kept) - sum(item.count for item in drawn)
    unique, seen = [], Counter[str]()
    for item in drawn:
        seen[item.source_id] += 1
        times = seen[item.source_id]
        unique.append(replace(item, source_id=f"{item.source_id}#{times}") if times > 1 else item)
    return Import(source, tuple(unique), rejected, len(outcomes), n_out)


def row_items(source: Source, folder: Path) -> Iterator[RawItem | RowRejected]:
    """Return an item or a rejection for each row of the files of a source, in order."""
    if source.excluded:
        return iter(())
    if source.reader:
        module = import_module(f"crawler.imports.{source.reader}")
        outcomes: Iterator[RawItem | RowRejected] = module.row_items(source, folder)
        return outcomes
    return table_row_items(source, folder)


def _without_copies(items: Iterable[RawItem]) -> list[RawItem]:
    """Merge items of the same category, title, brand, sizes and flags into the first, with their number as count.

    A mass or a volume in which they differ is omitted.
    """

    def content(item: RawItem) -> object:
        sizes = tuple(sorted((axis, value or 0.0) for axis, value in item.dimensions_mm.items()))
        return item.category_path, item.title, item.brand, sizes, item.extents_mm, item.flags

    merged = []
    for group in grouped((content(item), item) for item in items).values():
        amounts = {(item.mass_kg, item.volume_l) for item in group}
        mass_kg, volume_l = amounts.pop() if len(amounts) == 1 else (None, None)
        merged.append(replace(group[0], count=sum(item.count for item in group), mass_kg=mass_kg, volume_l=volume_l))
    return merged


def _one_per_title(items: Iterable[RawItem]) -> list[RawItem]:
    """Keep the item of median volume for each title, with the number of rows as count."""
    kept = []
    for group in grouped((item.title, item) for item in items).values():
        median = sorted(group, key=lambda item: math.prod(item.extents_mm or ()))[(len(group) - 1) // 2]
        kept.append(replace(median, count=sum(item.count for item in group)) if len(group) > 1 else median)
    return kept


def _sample(items: list[RawItem], per_category: int) -> Iterator[RawItem]:
    """Keep at most `per_category` items of each category, those with the lowest hashes of their ids, in order."""

    def digest(item: RawItem) -> str:
        return hashlib.sha256(f"{item.source}:{item.source_id}".encode()).hexdigest()

    by_category = grouped((item.category_path, item) for item in items)
    large = {path: group for path, group in by_category.items() if len(group) > per_category}
    kept = {id(item) for group in large.values() for item in sorted(group, key=digest)[:per_category]}
    for item in items:
        if item.category_path not in large:
            yield item
        elif id(item) in kept:
            yield replace(item, flags=(*item.flags, SAMPLED))


def source_folder(source: Source, given: Path | None) -> Path:
    """Return the folder (or the one file) to read: `given`, its subfolder with the name of the source, or the download.

    Raises
    ------
    NoInput
        There is no such folder or the files cannot be downloaded.
    """
    if given is None:
        return download(source)
    below = given / source.id
    # the repository of a source may have a folder with the name of the source
    is_repository = any(any(given.glob(table.records)) for table in source.tables if table.records)
    if below.is_dir() and not is_repository:
        return below
    if not given.exists():
        raise NoInput(f"{given}: expected the files of {source.id}; found no such file or folder")
    patterns = [pattern for table in source.tables for pattern in table.files]
    if not given.is_dir() and not (given.is_file() and (not patterns or any(map(given.match, patterns)))):
        expected = f"a folder, or a file such as {', '.join(patterns[:3]) or 'those of the set'}"
        raise NoInput(f"{given}: expected {expected}; found {'another file' if given.is_file() else 'a device'}")
    return given


def changed_files(source: Source, folder: Path) -> Iterator[Path]:
    """Return the files that exist but differ from those with which the declaration was checked (SHA-256)."""
    for file in source.files:
        path = folder if folder.is_file() and folder.name == Path(file.path).name else folder / file.path
        if path.is_file():
            with path.open("rb") as data:
                if hashlib.file_digest(data, "sha256").hexdigest() != file.sha256:
                    yield path


def quarantine_path(path: Path) -> Path:
    """Return the quarantine file of an import: `ikea.quarantine.jsonl.gz` for `ikea.jsonl.gz`."""
    stem, _, rest = path.name.partition(".jsonl")
    return path.with_name(f"{stem}.quarantine.jsonl{rest}")


def write_import(result: Import, path: Path, option: str | None = None) -> None:
    """Write the items of an import as JSON Lines (gzip by the name), and rejected rows to the quarantine file.

    If one of the two cannot be written, neither is.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(quarantine_path(path), option) as rejected, whole_file(path, option) as items:
        rejected.write_bytes(_lines_data(path, (row.line() for row in result.rejected)))
        items.write_bytes(_lines_data(path, (item.line() for item in result.items)))


def write_lines(path: Path, lines: Iterable[str], option: str | None = None) -> None:
    """Write a text file, compressed if the name ends in `.gz`; the same lines give the same bytes."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, _lines_data(path, lines), option)


def _lines_data(path: Path, lines: Iterable[str]) -> bytes:
    """Return the bytes of a text file, compressed if its name ends in `.gz`."""
    text = "".join(f"{line}\n" for line in lines).encode()
    return gzip.compress(text, compresslevel=9, mtime=0) if path.suffix == ".gz" else text
