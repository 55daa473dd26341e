"""A crawl's items on disk: JSON Lines in segments that are written whole, named by the range they hold.

The frontier has the items first (with the page, in one transaction); a segment is written from there under a temporary
name and renamed. A kill between the two costs nothing: the next write begins behind the last whole segment.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from itertools import islice
from pathlib import Path
from typing import Literal, Protocol, TypeAlias

from metric_base.files import whole_file

__all__ = ["SEGMENT_ITEMS", "last_written", "write_segments"]

#: Items of one segment: some megabytes, so that a build streams them and a copy of a crawl is a matter of files.
SEGMENT_ITEMS = 5_000

Kind: TypeAlias = Literal["items", "pictures"]

_NAME = re.compile(r"(?P<kind>items|pictures)-(?P<first>\d{9})-(?P<last>\d{9})\.jsonl")


class _Lines(Protocol):
    def lines(self, after: int = 0, kind: Kind = "items") -> Iterable[tuple[int, str]]: ...


def last_written(folder: Path, kind: Kind = "items") -> int:
    """The number of the last item, or picture, that a whole segment holds."""
    matches = (_NAME.fullmatch(path.name) for path in folder.glob(f"{kind}-*.jsonl"))
    return max((int(match["last"]) for match in matches if match), default=0)


def write_segments(frontier: _Lines, folder: Path) -> int:
    """Write all items and pictures that no segment holds yet; the number of items."""
    _write_kind(frontier, folder, "pictures")
    return _write_kind(frontier, folder, "items")


def _write_kind(frontier: _Lines, folder: Path, kind: Kind) -> int:
    count = 0
    lines = iter(frontier.lines(last_written(folder, kind), kind))
    while batch := list(islice(lines, SEGMENT_ITEMS)):
        span = f"{batch[0][0]:09d}-{batch[-1][0]:09d}"
        _replace(folder / f"{kind}-{span}.jsonl", [line for _, line in batch])
        count += len(batch)
    return count


def _replace(path: Path, lines: list[str]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as work:
        work.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
