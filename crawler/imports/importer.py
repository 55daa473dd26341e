"""Where the files of an import come from and go to: a folder or a download; JSON Lines at one stroke.

What comes of a row: a raw item, or a refusal with its reason.

The items of a source: every row read, identical items merged, large categories drawn down.
"""

from __future__ import annotations

import gzip
import hashlib
import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path

from crawler.imports.declaration import Source
from crawler.imports.downloads import NoInput, download
from crawler.imports.table_items import Reading, Refusal, table_readings
from crawler.items import RawItem
from metric_base.files import whole_file

#: Flag of items that are a sample of a larger set.
SAMPLED = "sampled"


@dataclass(frozen=True, slots=True)
class Import:
    """What an import yields: items, refusals, and how many rows were read; rows = counts + refusals + left out."""

    source: Source
    items: tuple[RawItem, ...]
    refusals: tuple[Refusal, ...]
    n_rows: int
    n_sampled_out: int = 0

    @property
    def reasons(self) -> dict[str, int]:
        """Refused rows by reason code."""
        return dict(sorted(Counter(refusal.reason for refusal in self.refusals).items()))


def readings(source: Source, folder: Path) -> Iterator[Reading]:
    """What comes of each row of the source, whose files lie in `folder`, in their order."""
    if source.excluded:
        return iter(())
    if source.reader:
        module = import_module(f"crawler.imports.{source.reader}")
        outcomes: Iterator[Reading] = module.readings(source, folder)
        return outcomes
    return table_readings(source, folder)


def import_items(source: Source, outcomes: Iterable[Reading]) -> Import:
    """The readings of a source, with identical items made one and large categories drawn down.

    Source ids are made unique: a repeated one gets `#2`, `#3`.
    """
    items: list[RawItem] = []
    refusals: list[Refusal] = []
    for reading in outcomes:
        if isinstance(reading, Refusal):
            refusals.append(reading)
        else:
            items.append(reading)
    n_rows = len(items) + len(refusals)
    kept = list(_collapse(items)) if source.collapse else items
    kept = list(_one_per_title(kept)) if source.one_per_title else kept
    drawn = list(_draw(kept, source.per_category)) if source.per_category else kept
    n_out = sum(i.count for i in kept) - sum(i.count for i in drawn)
    return Import(source, tuple(_unique(drawn)), tuple(refusals), n_rows, n_out)


def _collapse(items: Iterable[RawItem]) -> Iterator[RawItem]:
    """Identical items (category, title, brand, sizes, flags) as one with their number, the first standing for all."""
    groups: dict[object, list[RawItem]] = {}
    for item in items:
        sizes = tuple(sorted((axis, value or 0.0) for axis, value in item.dimensions_mm.items()))
        key = (item.category_path, item.title, item.brand, sizes, item.extents_mm, item.flags)
        groups.setdefault(key, []).append(item)
    for group in groups.values():
        yield replace(group[0], count=sum(item.count for item in group)) if len(group) > 1 else group[0]


def _one_per_title(items: Iterable[RawItem]) -> Iterator[RawItem]:
    """One item per title: the middle one by volume, standing for as many rows as there were."""
    groups: dict[str, list[RawItem]] = defaultdict(list)
    for item in items:
        groups[item.title].append(item)
    for group in groups.values():
        middle = sorted(group, key=lambda item: math.prod(item.extents_mm or ()))[(len(group) - 1) // 2]
        yield replace(middle, count=sum(item.count for item in group)) if len(group) > 1 else middle


def _draw(items: list[RawItem], per_category: int) -> Iterator[RawItem]:
    """At most `per_category` items of each category: those whose ids have the lowest hashes, in their old order."""
    by_category: dict[tuple[str, ...], list[RawItem]] = defaultdict(list)
    for item in items:
        by_category[item.category_path].append(item)
    large = {path: group for path, group in by_category.items() if len(group) > per_category}
    kept = {id(item) for group in large.values() for item in sorted(group, key=_hash)[:per_category]}
    for item in items:
        if item.category_path not in large:
            yield item
        elif id(item) in kept:
            yield replace(item, flags=(*item.flags, SAMPLED))


def _hash(item: RawItem) -> str:
    return hashlib.sha256(f"{item.source}:{item.source_id}".encode()).hexdigest()


def _unique(items: Iterable[RawItem]) -> Iterator[RawItem]:
    seen: Counter[str] = Counter()
    for item in items:
        seen[item.source_id] += 1
        times = seen[item.source_id]
        yield replace(item, source_id=f"{item.source_id}#{times}") if times > 1 else item


def source_folder(source: Source, given: Path | None) -> Path:
    """The folder (or the one file) to read: `given`, its subfolder of the source's name, else the download.

    Raises
    ------
    NoInput
        There is no such folder or the files cannot be downloaded.
    """
    if given is None:
        return download(source)
    below = given / source.id
    if below.is_dir() and not _is_repository(source, given):
        return below
    if not given.exists():
        raise NoInput(f"{given}: expected the files of {source.id}; found no such file or folder")
    patterns = [pattern for table in source.tables for pattern in table.files]
    if not given.is_dir() and not (given.is_file() and (not patterns or any(map(given.match, patterns)))):
        expected = f"a folder, or a file such as {', '.join(patterns[:3]) or 'those of the set'}"
        raise NoInput(f"{given}: expected {expected}; found {'another file' if given.is_file() else 'a device'}")
    return given


def _is_repository(source: Source, folder: Path) -> bool:
    """Return True if the folder is the source's own repository, one folder of which may have the source's name."""
    return any(any(folder.glob(table.records)) for table in source.tables if table.records)


def changed_files(source: Source, folder: Path) -> Iterator[Path]:
    """The declared files that are there but are not, byte for byte, those that the declaration was checked with."""
    for file in source.files:
        itself = folder.is_file() and folder.name == Path(file.path).name
        path = folder if itself else folder / file.path
        if path.is_file():
            with path.open("rb") as data:
                if hashlib.file_digest(data, "sha256").hexdigest() != file.sha256:
                    yield path


def quarantine_path(path: Path) -> Path:
    """The quarantine file beside an import: `ikea.jsonl.gz` has `ikea.quarantine.jsonl.gz`."""
    stem, _, rest = path.name.partition(".jsonl")
    return path.with_name(f"{stem}.quarantine.jsonl{rest}")


def write_import(result: Import, path: Path, option: str | None = None) -> None:
    """The items of an import as JSON Lines (gzip by the name) and its refusals in the quarantine file beside it."""
    write_lines(quarantine_path(path), (refusal.line() for refusal in result.refusals), option)
    write_lines(path, (item.line() for item in result.items), option)


def write_lines(path: Path, lines: Iterable[str], option: str | None = None) -> None:
    """A text file, gzip where the name ends in `.gz`, written aside and renamed; the same lines give the same bytes."""
    path.parent.mkdir(parents=True, exist_ok=True)
    text = "".join(f"{line}\n" for line in lines).encode()
    # mtime 0 and no name inside: the bytes depend on the lines alone.
    data = gzip.compress(text, compresslevel=9, mtime=0) if path.suffix == ".gz" else text
    with whole_file(path, option) as work:
        work.write_bytes(data)
