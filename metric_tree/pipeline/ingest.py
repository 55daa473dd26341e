"""Step 1 of a build: raw items to rows, matched to a leaf, with their sizes on axes, in shards by node.

`ingest_block` reads a range of bytes of a file and returns bytes. It reads no other state but the taxonomy, so that it
gives the same result in this process, in another one and on another machine.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import pyarrow as pa

from crawler.items import MAX_LINE, STATED_KINDS, BadRawItem, RawItem, bounded_lines, items_of_lines, raw_lines
from metric_base.errors import InputError
from metric_base.files import whole_file
from metric_base.remote import file_size, is_remote, opened, remote_files, url_of
from metric_tree.axes import Sizes, sizes_from_words, stated_sizes
from metric_tree.curated.rules import exclusions
from metric_tree.release.schema import table_schema
from taxonomy.categories import Match, Taxonomy

#: Number of shards of a build. A million rows are 16,000 per shard, a few megabytes; ten million still fit in a worker.
SHARDS = 64

#: Size of a block in bytes, 20,000 lines: about one second of one worker, so that an interruption loses little.
BLOCK_BYTES = 12_000_000

#: Maximum number of matches in the cache of a worker; categories repeat, titles mostly do not. Of the 54,714 shipped
#: raw items, 31,644 find their match in this cache, and 31,887 in one of 200,000.
MAX_CACHED_MATCHES = 20_000

#: Half-width of a stated range in standard deviations: 90 % of the objects are between low and high
#: (`RawItem.ranges_mm`).
RANGE_HALF_WIDTH_SD = 1.645

#: A range from memory is too narrow if it is narrow and too wide if it is wide. With s the stated standard deviation of
#: ln size, the standard deviation of the objects about the typical size is WIDENING s^WIDENING_POWER: least squares
#: over the 118 axes with a judged range and 15 items or more (products, measurements, norms) of two sources or more.
WIDENING, WIDENING_POWER = 0.76, 0.71

#: Maximum factor from the stated to the widened standard deviation.
MAX_WIDENING = 1.7

#: Flags of raw items that no build uses: sizes from prose, placeholder values of a form, and toys of the object.
UNUSED_FLAGS = ("low_trust", "placeholder", "toy_replica")

#: Reasons for which a raw item is written to the quarantine file; other reasons are options of the build.
QUARANTINED = ("no_category", "excluded", "no_size", *UNUSED_FLAGS)

#: Raw files of a folder; next to them are the rejected rows of `metric-tree import` and the image records of a crawl.
_RAW = re.compile(r"^(?!pictures-\d).*(?<!\.quarantine)\.jsonl(\.gz)?$")

#: Rows between the steps of a build.
ROWS = table_schema("ingested", "metric-tree/ingested/1")
#: Columns that are fields of a raw item.
_OF_ITEM = ["source", "source_id", "title", "year", "region", "licence", "flags", "attribution", "scene", "relative_sd",
            "mass_kg", "volume_l"]  # fmt: skip


@dataclass(frozen=True, slots=True)
class Block:
    """The lines of a raw file that begin in a range of bytes; a worker reads them."""

    path: Path  #: Uncompressed file, local or at a URL.
    start: int  #: First byte.
    stop: int  #: Byte after the last one.
    name: str  #: File of the caller, for messages.


@dataclass(frozen=True, slots=True)
class IngestedRows:
    """Result of step 1 for a block."""

    rows: bytes  #: Arrow file of `ROWS`; batch i is shard i.
    refused: bytes  #: Lines of the quarantine file.
    counts: Counter[str]  #: Raw items by outcome.


@dataclass(frozen=True, slots=True, eq=False)
class _LoadedTaxonomy:
    """A taxonomy in one process, with the pose and the shard of each node."""

    taxonomy: Taxonomy
    poses: dict[str, str]
    shards: dict[str, int]  #: All rows of a node are in one shard, and shards have the order of the node ids.
    matches: dict[tuple[object, ...], Match] = field(default_factory=dict)

    def match(self, item: RawItem) -> Match:
        """Return the match of an item, from the cache if an equal one was matched before."""
        key = (item.source, item.category_path, item.title, item.synset)
        if key not in self.matches:
            if len(self.matches) >= MAX_CACHED_MATCHES:
                self.matches.clear()
            self.matches[key] = self.taxonomy.match(item)
        return self.matches[key]


@cache
def _loaded(factory: Callable[[], Taxonomy]) -> _LoadedTaxonomy:
    taxonomy = factory()
    poses = {category.node_id: category.pose for category in taxonomy.categories()}
    shards = {node_id: rank * SHARDS // len(poses) for rank, node_id in enumerate(sorted(poses))}
    return _LoadedTaxonomy(taxonomy, dict(poses), shards)


def raw_files(paths: Iterable[Path]) -> list[Path]:
    """Return the raw files among the given files and in the given folders, local or at URLs, sorted within a folder.

    Raises
    ------
    InputError
        A path does not exist, or a folder contains no `*.jsonl` or `*.jsonl.gz` (without files of rejected rows).
    """
    files: list[Path] = []
    for path in paths:
        if is_remote(path):
            inside = [file for file in remote_files(path) if file == path or _RAW.search(file.name)]
        else:
            inside = sorted(file for file in path.rglob("*") if _RAW.search(file.name)) if path.is_dir() else [path]
        if not inside or not all(is_remote(file) or file.is_file() for file in inside):
            raise InputError(f"{url_of(path)}: expected raw items (*.jsonl, *.jsonl.gz); found none")
        files += inside
    return files


def unpack(path: Path, target: Path) -> None:
    """Decompress a raw file (gzip), of which any block can be read then.

    Raises
    ------
    InputError
        The file is damaged or has a line that is too long.
    """
    with whole_file(target) as part, part.open("wb") as file:
        file.writelines(raw_lines(path))


def blocks(path: Path, name: str) -> Iterator[Block]:
    """Yield the blocks of an uncompressed raw file, in order; `name` is the file of the caller."""
    size = file_size(path)
    for start in range(0, size, BLOCK_BYTES):
        yield Block(path, start, min(start + BLOCK_BYTES, size), name)


def items_of(block: Block) -> Iterator[RawItem]:
    """Yield the items of a block.

    Raises
    ------
    BadRawItem
        A line is not a raw item; the message names the file and the line.
    """
    try:
        yield from items_of_lines(block.name, _lines(block), 1)
    except BadRawItem:
        if block.start:  # only a message needs the number of the first line, which costs a pass over the file
            first = 1 + sum(1 for _ in _lines(replace(block, start=0, stop=block.start)))
            deque(items_of_lines(block.name, _lines(block, first), first), maxlen=0)
        raise


def _lines(block: Block, first: int = 1) -> Iterator[bytes]:
    """Yield the lines that begin in the range of a block, the first of which has the number `first`."""
    with opened(block.path) as file:
        position = block.start
        if position:  # a line that begins before belongs to the previous block
            file.seek(position - 1)
            position += len(file.readline(MAX_LINE)) - 1
        for line in bounded_lines(block.name, file, first):
            if position >= block.stop:
                return
            position += len(line)
            yield line


def item_hash(item_id: str) -> int:
    """Return the first eight bytes of the SHA-256 of an item id."""
    return int.from_bytes(hashlib.sha256(item_id.encode()).digest()[:8], "big")


def is_held_out(item_id: str, fold: int, folds: int) -> bool:
    """Return True if an item belongs to a fold (0 to folds - 1), which `--fold-out fold/folds` omits."""
    return item_hash(item_id) % folds == fold


def ingest_block(
    block: Block,
    taxonomy: Callable[[], Taxonomy],
    fold_out: tuple[int, int] | None = None,
    left_out: frozenset[str] = frozenset(),
) -> IngestedRows:
    """Convert the raw items of a block to rows.

    Parameters
    ----------
    block : Block
        Range of a file of raw items.
    taxonomy : callable
        Function that returns the taxonomy; called once in a process.
    fold_out : tuple of int, optional
        Fold I of N of the items that is omitted. Norms and judged ranges are not items.
    left_out : frozenset of str
        Sources that the build does not use.

    Raises
    ------
    BadRawItem
        A line is not a raw item; the message names the file and the line.
    """
    shards: list[list[dict[str, Any]]] = [[] for _ in range(SHARDS)]
    refused: list[str] = []
    counts: Counter[str] = Counter()
    for item in items_of(block):
        row: dict[str, Any] | None = None
        reason = _omission(item, fold_out, left_out)
        if not reason:
            row, reason = _row(item, _loaded(taxonomy))
        counts[reason or "taken"] += 1
        if row is not None:
            shards[_loaded(taxonomy).shards[row["node_id"]]].append(row)
        elif reason in QUARANTINED:
            refused.append(refusal(reason, item.source, item.source_id, item.title, item.category_path))
    sink = pa.BufferOutputStream()
    with pa.ipc.new_file(sink, ROWS, options=pa.ipc.IpcWriteOptions(compression="zstd")) as writer:
        for rows in shards:
            writer.write_batch(pa.RecordBatch.from_pylist(rows, schema=ROWS))
    return IngestedRows(bytes(sink.getvalue()), "".join(refused).encode(), counts)


def refusal(reason: str, source: str, source_id: str, title: str, category: Sequence[str], detail: str = "") -> str:
    """Return a line of the quarantine file (`metric-tree/refused/1`).

    Reasons of step 1: `no_category` (the taxonomy has no category for the item), `excluded` (by a reviewer, in
    `data/curated/exclusions.csv`), `no_size` (no outer size, or four numbers for three axes), `low_trust` (size from
    prose), `toy_replica` (a toy of the object), `placeholder` (a default value of a form, such as 1 x 1 x 1). Reasons
    of step 2: `duplicate`, `unit_slip` (factor of a unit from its class), `far_outlier` (far from its class without a
    unit that explains it), `not_carried` (absent from the release that is carried over).
    """
    record: dict[str, Any] = {"schema": "metric-tree/refused/1", "reason": reason}
    record |= {"source": source, "source_id": source_id, "title": title, "category": list(category)}
    return json.dumps(record | ({"detail": detail} if detail else {}), ensure_ascii=False) + "\n"


def range_sd(low: float, high: float) -> float:
    """Return the standard deviation of ln size of a range that contains 90 % of the objects.

    >>> round(range_sd(500, 1000), 3)
    0.211
    """
    return math.log(high / low) / (2 * RANGE_HALF_WIDTH_SD)


def widened_sd(low: float, high: float) -> float:
    """Return the standard deviation of ln size of the objects for which a person states a range (`WIDENING`).

    >>> round(widened_sd(500, 1000), 3), round(widened_sd(100, 2000), 3), round(widened_sd(99, 101), 3)
    (0.252, 0.711, 0.01)
    """
    sd = range_sd(low, high)
    return min(MAX_WIDENING * sd, WIDENING * math.pow(sd, WIDENING_POWER))


def _omission(item: RawItem, fold_out: tuple[int, int] | None, left_out: frozenset[str]) -> str:
    """Return the reason for which the build does not use an item at all, or an empty text."""
    if item.source in left_out:
        return "source_left_out"
    if fold_out is not None and item.kind not in STATED_KINDS and is_held_out(item.identity, *fold_out):
        return "fold_left_out"
    return next((flag for flag in UNUSED_FLAGS if flag in item.flags), "")


def _row(item: RawItem, loaded: _LoadedTaxonomy) -> tuple[dict[str, Any] | None, str]:
    """Return the row of an item (`ROWS`), or None and the reason."""
    node_id = loaded.match(item).node_id
    if node_id is None:
        return None, "no_category"
    if exclusions().covers(item.source, node_id, item.title):
        return None, "excluded"
    pose = loaded.poses[node_id]
    sizes: Sizes | None
    if item.kind in STATED_KINDS:
        sizes = stated_sizes(item.dimensions_mm, pose)
    else:
        sizes = sizes_from_words(item.dimensions_mm, item.extents_mm, pose)
    if sizes is None:
        return None, "no_size"
    kind = item.kind if item.kind != "curated" else "judged"  # the name before release 3.0.0
    spreads: list[float] | None = None
    if item.relative_sd is not None:
        spreads = [item.relative_sd] * len(sizes.extents)
    elif item.ranges_mm:
        sd_of = range_sd if item.kind == "norm" else widened_sd  # the tolerance of a norm is exact
        by_size = {item.dimensions_mm.get(word): sd_of(low, high) for word, (low, high) in item.ranges_mm.items()}
        spreads = [by_size.get(extent, math.nan) for extent in sizes.extents]
    return {name: getattr(item, name) for name in _OF_ITEM} | {
        "item_id": item.identity,
        "hash": item_hash(item.identity),
        "node_id": node_id,
        "pose": pose,
        "length_mm": sizes.length,
        "width_mm": sizes.width,
        "height_mm": sizes.height,
        "extents_mm": sizes.extents,
        "range_sd": spreads,
        "kind": kind if item.statistic is None else "statistic",
        "url": item.url or None,
    }, ""
