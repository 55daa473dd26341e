"""A crawl's items on disk: JSON Lines in segments that are written whole, named by the range they hold.

The frontier has the items first (with the page, in one transaction); a segment is written from there under a temporary
name and renamed. A kill between the two costs nothing: the next write begins behind the last whole segment.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Protocol

__all__ = ["SEGMENT_ITEMS", "write_segments", "written"]

#: Items of one segment: some megabytes, so that a build streams them and a copy of a crawl is a matter of files.
SEGMENT_ITEMS = 5_000

_NAME = re.compile(r"(?P<kind>items|pictures)-(?P<first>\d{9})-(?P<last>\d{9})\.jsonl")


class _Lines(Protocol):
    def lines(self, after: int = 0) -> Iterable[tuple[int, str]]: ...


def written(folder: Path) -> int:
    """The number of the last item that a whole segment holds."""
    matches = (_NAME.fullmatch(path.name) for path in folder.glob("items-*.jsonl"))
    return max((int(match["last"]) for match in matches if match), default=0)


def write_segments(frontier: _Lines, folder: Path) -> int:
    """Write all items that no segment holds yet; the number of them."""
    batch: list[tuple[int, str]] = []
    count = 0
    for entry in frontier.lines(written(folder)):
        batch.append(entry)
        count += 1
        if len(batch) == SEGMENT_ITEMS:
            _write(batch, folder)
            batch = []
    _write(batch, folder)
    return count


def _write(batch: list[tuple[int, str]], folder: Path) -> None:
    """One segment of items and, where there are any, one of pictures; the items' comes last and marks both as done."""
    if not batch:
        return
    pictures = [line for _, line in batch if json.loads(line)["schema"].startswith("metric-tree/picture/")]
    known = set(pictures)
    items = [line for _, line in batch if line not in known]
    span = f"{batch[0][0]:09d}-{batch[-1][0]:09d}"
    if pictures:
        _replace(folder / f"pictures-{span}.jsonl", pictures)
    _replace(folder / f"items-{span}.jsonl", items)


def _replace(path: Path, lines: list[str]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    work = path.with_name(f".{path.name}.{os.getpid()}")
    work.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
    work.replace(path)
