"""Where the files of an import come from and go to: a folder or a download; JSON Lines at one stroke."""

from __future__ import annotations

import gzip
import hashlib
from collections.abc import Iterable, Iterator
from pathlib import Path

from crawler.imports.downloads import NoInput, download
from crawler.imports.source_items import Import
from crawler.imports.sources import Source
from metric_base.files import whole_file

__all__ = ["changed_files", "quarantine_path", "source_folder", "write_import", "write_lines"]


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
    """Whether the folder is the source's own repository, one folder of which may have the source's name."""
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
