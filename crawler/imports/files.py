"""Where the files of an import come from and go to: a folder or a verified download; JSON Lines at one stroke."""

from __future__ import annotations

import gzip
import os
from collections.abc import Iterable
from pathlib import Path

from crawler.faults import InputFault
from crawler.imports import Import
from crawler.sources import Source

__all__ = ["CACHE_VARIABLE", "NoInput", "downloaded", "quarantine_path", "source_folder", "write_import", "write_lines"]

#: Moves the cache of downloaded sources.
CACHE_VARIABLE = "METRIC_TREE_CACHE"


class NoInput(InputFault):
    """The files of a source are neither at hand nor to be had."""


def source_folder(source: Source, given: Path | None) -> Path:
    """The folder (or the one file) to read: `given`, its subfolder of the source's name, else the download.

    Raises
    ------
    NoInput
        There is no such folder or the files cannot be downloaded.
    """
    if given is None:
        return downloaded(source)
    below = given / source.id
    if below.is_dir():
        return below
    if not given.exists():
        raise NoInput(f"{given}: expected the files of {source.id}; found no such file or folder")
    return given


def downloaded(source: Source) -> Path:
    """The source's files from their public addresses, checked against their sha256, in the user's cache.

    Raises
    ------
    NoInput
        A file has no public address, or no network answers, or what came is another file.
    """
    without = [file.path for file in source.files if not file.url]
    if without or not source.files:
        raise NoInput(
            f"{source.id}: expected --input: {', '.join(without) or 'its files'} was cut down from a larger set "
            f"and has no address of its own (see {source.url})"
        )
    import pooch
    import requests

    pooch.get_logger().setLevel("WARNING")  # a fault is one line, not two
    store = pooch.create(
        path=pooch.os_cache("metric-tree") / "sources" / source.id,
        base_url="",
        env=CACHE_VARIABLE,
        registry={file.path: f"sha256:{file.sha256}" for file in source.files},
        urls={file.path: file.url for file in source.files},
    )
    try:
        for file in source.files:
            store.fetch(file.path)
    except requests.ConnectionError:
        raise NoInput(f"{source.id}: expected a download of {file.url} or --input; found no connection") from None
    except (requests.RequestException, OSError, ValueError) as error:
        reason = str(error).splitlines()[0][:200]
        raise NoInput(f"{source.id}: expected a download of {file.url} or --input; found {reason}") from None
    return Path(store.abspath)


def quarantine_path(path: Path) -> Path:
    """The quarantine file beside an import: `ikea.jsonl.gz` has `ikea.quarantine.jsonl.gz`."""
    stem, _, rest = path.name.partition(".jsonl")
    return path.with_name(f"{stem}.quarantine.jsonl{rest}")


def write_import(result: Import, path: Path) -> None:
    """The items of an import as JSON Lines (gzip by the name) and its refusals in the quarantine file beside it."""
    write_lines(quarantine_path(path), (refusal.line() for refusal in result.refusals))
    write_lines(path, (item.line() for item in result.items))


def write_lines(path: Path, lines: Iterable[str]) -> None:
    """A text file, gzip where the name ends in `.gz`, written aside and renamed; the same lines give the same bytes."""
    path.parent.mkdir(parents=True, exist_ok=True)
    text = "".join(f"{line}\n" for line in lines).encode()
    # mtime 0 and no name inside: the bytes depend on the lines alone.
    data = gzip.compress(text, compresslevel=9, mtime=0) if path.suffix == ".gz" else text
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        temporary.write_bytes(data)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
