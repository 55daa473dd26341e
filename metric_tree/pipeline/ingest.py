"""Raw items to rows of a build: matched to a leaf, their words mapped to axes, parted into shards by node.

A block of lines in, Arrow bytes and refused lines out: pure, so that it runs the same in this process, in another one
and on another machine.
"""

from __future__ import annotations

import gzip
import hashlib
import json
import math
import re
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any

import pyarrow as pa

from crawler.items import STATED_KINDS, RawItem, bounded_lines, items_of_lines
from metric_base.errors import InputError
from metric_tree.axes import Sizes, sizes_from_words, stated_sizes
from metric_tree.curated.rules import shipped_exclusions
from taxonomy.categories import Match, Taxonomy

#: Shards of a build. A million rows are then 16,000 a shard, a few megabytes; ten million still fit in a worker.
SHARDS = 64

#: Lines of one block: a second or so of one worker's time, so that an interruption loses little.
BLOCK_LINES = 20_000

#: Matches that a worker remembers; categories repeat, titles mostly do not.
MAX_REMEMBERED_MATCHES = 200_000

#: Half-width of a stated range in standard deviations: low and high hold nine of ten (`RawItem.ranges_mm`).
RANGE_SD = 1.645

#: A person's range is stated from memory: narrow ones are too narrow and wide ones too wide. With s the stated standard
#: deviation of ln size, that of the objects about the typical size is WIDENING s^WIDENING_POWER: least squares over the
#: 118 axes that have a judged range and fifteen items or more of products, measurements and norms, of two sources or
#: more. No range is taken for more than `MOST_WIDENING` times as wide as was said.
#: A norm's tolerance is what it says.
WIDENING, WIDENING_POWER, MOST_WIDENING = 0.76, 0.71, 1.7

#: Flags of raw items that no build takes: sizes found in prose or typed into a form, and toys of the object.
UNUSED_FLAGS = ("low_trust", "placeholder", "toy_replica")

#: Raw files of a folder; beside them lie what `metric-tree import` refused and the images of a crawl.
_RAW = re.compile(r"^(?!pictures-\d).*(?<!\.quarantine)\.jsonl(\.gz)?$")

ROWS = pa.schema(
    [
        ("item_id", pa.string()),
        ("hash", pa.uint64()),
        ("node_id", pa.string()),
        ("pose", pa.string()),
        ("source", pa.string()),
        ("source_id", pa.string()),
        ("title", pa.string()),
        ("length_mm", pa.float64()),
        ("width_mm", pa.float64()),
        ("height_mm", pa.float64()),
        ("extents_mm", pa.list_(pa.float64())),
        ("range_sd", pa.list_(pa.float64())),
        ("kind", pa.string()),
        ("year", pa.int32()),
        ("region", pa.string()),
        ("url", pa.string()),
        ("licence", pa.string()),
        ("flags", pa.list_(pa.string())),
        ("scene", pa.string()),
        ("relative_sd", pa.float64()),
    ]
)


@dataclass(frozen=True, slots=True)
class Block:
    """Consecutive lines of one raw file; `first` is the number of the first, from 1."""

    path: str
    first: int
    lines: tuple[bytes, ...]


@dataclass(frozen=True, slots=True)
class Ingested:
    """What a block gave: `rows`, an Arrow file whose batch i is shard i, refused lines (JSON Lines), counts."""

    rows: bytes
    refused: bytes
    counts: Counter[str]


def raw_files(paths: Iterable[Path]) -> list[Path]:
    """The raw files under the given files and folders, sorted within a folder.

    Raises
    ------
    InputError
        A path does not exist, or a folder holds no `*.jsonl` or `*.jsonl.gz` (what importers refused is passed over).
    """
    files: list[Path] = []
    for path in paths:
        inside = sorted(file for file in path.rglob("*") if _RAW.search(file.name)) if path.is_dir() else [path]
        if not inside or not all(file.is_file() for file in inside):
            raise InputError(f"{path}: expected raw items (*.jsonl, *.jsonl.gz); found none")
        files += inside
    return files


def blocks(files: Iterable[Path]) -> Iterator[Block]:
    """The lines of the files in blocks, in their order."""
    for path in files:
        with gzip.open(path) if path.suffix == ".gz" else path.open("rb") as file:
            first, lines = 1, bounded_lines(path, file)
            try:
                while piece := tuple(islice(lines, BLOCK_LINES)):
                    yield Block(str(path), first, piece)
                    first += len(piece)
            except (OSError, EOFError, zlib.error) as error:
                raise InputError(f"{path}: expected gzip data; found {error}") from None


def block_of(items: Iterable[RawItem], name: str) -> Block:
    """A block of items that are in no raw file."""
    return Block(name, 1, tuple(item.line().encode() for item in items))


def item_hash(item_id: str) -> int:
    """First eight bytes of the SHA-256 of an item id."""
    return int.from_bytes(hashlib.sha256(item_id.encode()).digest()[:8], "big")


def is_held_out(item_id: str, fold: int, folds: int) -> bool:
    """Return True if an item belongs to a fold (0 to folds - 1), which `--fold-out fold/folds` omits."""
    return item_hash(item_id) % folds == fold


def ingest_block(
    block: Block,
    taxonomy: Callable[[], Taxonomy],
    fold_out: tuple[int, int] | None = None,
    left_out: frozenset[str] = frozenset(),
) -> Ingested:
    """The rows of a block and what was refused, with the reason.

    Parameters
    ----------
    taxonomy : gives the taxonomy; called once in a process
    fold_out : fold I of N of the items that the build does not see; norms and judged ranges are no items
    left_out : sources that the build does not use

    Raises
    ------
    BadRawItem
        A line is no raw item; the message names the file and the line.
    """
    rows: list[list[dict[str, Any]]] = [[] for _ in range(SHARDS)]
    refused: list[str] = []
    counts: Counter[str] = Counter()
    for item in items_of(block):
        row, reason = _row(item, taxonomy, fold_out, left_out)
        counts[reason or "taken"] += 1
        if row is not None:
            rows[_shards(taxonomy)[row["node_id"]]].append(row)
        elif reason in REFUSALS:
            refused.append(refusal(reason, item.source, item.source_id, item.title, item.category_path))
    return Ingested(_arrow(rows), "".join(refused).encode(), counts)


#: Reasons for which a raw item is kept for a maintainer to look at (the others are the maintainer's own choice).
REFUSALS = {
    "no_category": "the taxonomy does not know what the object is",
    "excluded": "a reviewer took it out of its class (data/curated/exclusions.csv)",
    "no_size": "no outer size is stated, or four numbers where three are possible",
    "low_trust": "the size was only found in prose",
    "toy_replica": "a toy of the object, at a size of its own",
    "placeholder": "the size is what is typed into a form that asks for one: 1 x 1 x 1",
}


def refusal(reason: str, source: str, source_id: str, title: str, category: Sequence[str], detail: str = "") -> str:
    """One line of the quarantine file."""
    record: dict[str, Any] = {"schema": "metric-tree/refused/1", "reason": reason}
    record |= {"source": source, "source_id": source_id, "title": title, "category": list(category)}
    return json.dumps(record | ({"detail": detail} if detail else {}), ensure_ascii=False) + "\n"


def items_of(block: Block) -> Iterator[RawItem]:
    """The items of a block's lines.

    Raises
    ------
    BadRawItem
        A line is no raw item; the message names the file and the line.
    """
    return items_of_lines(block.path, block.lines, block.first)


def _row(
    item: RawItem, taxonomy: Callable[[], Taxonomy], fold_out: tuple[int, int] | None, left_out: frozenset[str]
) -> tuple[dict[str, Any] | None, str]:
    """The row of an item, or None and the reason."""
    item_id = f"{item.source}:{item.source_id}"
    if item.source in left_out:
        return None, "source_left_out"
    if fold_out is not None and item.kind not in STATED_KINDS and is_held_out(item_id, *fold_out):
        return None, "fold_left_out"
    if distrusted := next((flag for flag in UNUSED_FLAGS if flag in item.flags), None):
        return None, distrusted
    node_id = _match(item, taxonomy).node_id
    if node_id is None or shipped_exclusions().covers(item.source, node_id, item.title):
        return None, "no_category" if node_id is None else "excluded"
    pose = _poses(taxonomy)[node_id]
    if item.kind in STATED_KINDS:
        stated: Sizes | None = stated_sizes(item.dimensions_mm, pose)
    else:
        stated = sizes_from_words(item.dimensions_mm, item.extents_mm, pose)
    if stated is None:
        return None, "no_size"
    return {
        "item_id": item_id,
        "hash": item_hash(item_id),
        "node_id": node_id,
        "pose": pose,
        "source": item.source,
        "source_id": item.source_id,
        "title": item.title,
        "length_mm": stated.length,
        "width_mm": stated.width,
        "height_mm": stated.height,
        "extents_mm": stated.extents,
        "range_sd": _range_sd(item, stated),
        "kind": _kind(item),
        "year": item.year,
        "region": item.region,
        "url": item.url or None,
        "licence": item.licence,
        "flags": item.flags,
        "scene": item.scene,
        "relative_sd": item.relative_sd,
    }, ""


def _kind(item: RawItem) -> str:
    """What a row counts as: a mean of many is a statistic, a range of before release 3.0.0 a judged one."""
    if item.statistic is not None:
        return "statistic"
    return "judged" if item.kind == "curated" else item.kind


_remembered: dict[tuple[object, ...], Match] = {}


def _match(item: RawItem, taxonomy: Callable[[], Taxonomy]) -> Match:
    key = (taxonomy, item.source, item.category_path, item.title, item.synset)
    if key not in _remembered:
        if len(_remembered) >= MAX_REMEMBERED_MATCHES:
            _remembered.clear()
        _remembered[key] = _taxonomy(taxonomy).match(item)
    return _remembered[key]


@cache
def _taxonomy(factory: Callable[[], Taxonomy]) -> Taxonomy:
    return factory()


@cache
def _poses(factory: Callable[[], Taxonomy]) -> dict[str, str]:
    return {category.node_id: category.pose for category in _taxonomy(factory).categories()}


@cache
def _shards(factory: Callable[[], Taxonomy]) -> dict[str, int]:
    """Shard of each node: all rows of a node lie in one, and shards follow the order of the node ids."""
    nodes = sorted(_poses(factory))
    return {node_id: rank * SHARDS // len(nodes) for rank, node_id in enumerate(nodes)}


def _range_sd(item: RawItem, stated: Sizes) -> list[float] | None:
    """Standard deviation of ln size of each extent that an item states of many objects: norm, range, statistic."""
    if item.relative_sd is not None:
        return [item.relative_sd] * len(stated.extents)
    if not item.ranges_mm:
        return None
    spread = stated_spread if item.kind == "norm" else believed_spread
    spreads = {item.dimensions_mm.get(word): spread(low, high) for word, (low, high) in item.ranges_mm.items()}
    return [spreads.get(extent, math.nan) for extent in stated.extents]


def stated_spread(low: float, high: float) -> float:
    """Standard deviation of ln size of a range that holds nine of ten.

    >>> round(stated_spread(500, 1000), 3)
    0.211
    """
    return math.log(high / low) / (2 * RANGE_SD)


def believed_spread(low: float, high: float) -> float:
    """Standard deviation of ln size of the objects of which a person states a range.

    >>> round(believed_spread(500, 1000), 3), round(believed_spread(100, 2000), 3), round(believed_spread(99, 101), 3)
    (0.252, 0.711, 0.01)
    """
    stated = stated_spread(low, high)
    return min(MOST_WIDENING * stated, WIDENING * math.pow(stated, WIDENING_POWER))


def _arrow(shards: Sequence[Sequence[dict[str, Any]]]) -> bytes:
    sink = pa.BufferOutputStream()
    with pa.ipc.new_file(sink, ROWS, options=pa.ipc.IpcWriteOptions(compression="zstd")) as writer:
        for rows in shards:
            writer.write_batch(pa.RecordBatch.from_pylist(rows, schema=ROWS))
    return bytes(sink.getvalue())
