"""Checks on the items of a release (codes 3xx): units, axis order, duplicates, and sizes that cannot be."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from crawler.items import KINDS
from metric_tree.checks.finding import Finding

__all__ = ["CODES", "findings"]

#: From a hundredth of a millimetre (foil) to a kilometre (the longest ship has 458 m, the highest building 828 m).
PLAUSIBLE_MM = (0.01, 1e6)

#: Rounding of axes that were sorted in another unit.
ORDER_TOLERANCE = 1e-6

#: A unit mistaken for another multiplies a size by one of these: cm and mm, inch and mm, inch and cm, m and mm.
UNIT_SLIPS = (10.0, 25.4, 2.54, 1000.0, 100.0)

#: A slip stands this close to a unit factor, in natural log: a tenth either way.
SLIP_TOLERANCE = 0.10

#: An item is far out where it lies this many robust deviations from its node, and at least this factor.
FAR_DEVIATIONS, FAR_FACTOR = 6.0, 2.2

#: Below this many items a node's own median says little.
ENOUGH = 8

#: Two sources of one node whose medians differ by this factor are not about the same things.
SOURCE_FACTOR = 1.5

#: More than this share of identical rows is a list copied into itself.
DUPLICATE_SHARE = 0.2

#: A list is a grid where every pair of its distinct values occurs and there are at least this many of each.
GRID_SIDE = 3

AXES = ("length_mm", "width_mm", "height_mm")

CODES = {
    "E301": "an item that hangs on no leaf",
    "E302": "two items with one id",
    "E303": "a size that no object has",
    "E304": "axes out of order: width over length, or extents not longest first",
    "E305": "a kind that the contract does not know",
    "E306": "an item without licence, or of a source that the manifest does not name",
    "E307": "an item without any size",
    "W308": "identical rows make up much of a class",
    "W309": "a size that stands a unit's factor away from its class",
    "W310": "a size far outside its class",
    "W311": "a class of which one dimension is constant",
    "W312": "a class that is a grid of values, no sample",
    "W313": "sources that disagree about a class",
    "W314": "a class that stands a unit's factor away from its siblings",
}


def findings(items: pa.Table, nodes: pa.Table, manifest: Mapping[str, Any]) -> Iterator[Finding]:
    """Findings on the items table, given the nodes and the manifest's sources."""
    yield from _identity_findings(items, nodes, manifest)
    sizes = np.column_stack([_numbers(items, axis) for axis in AXES])
    yield from _size_findings(items, sizes)
    node_ids = items["node_id"].to_numpy(zero_copy_only=False).astype(str)
    for node_id, rows in _groups(node_ids):
        yield from _class_findings(items, node_id, rows, sizes[rows])
    yield from _sibling_findings(nodes, node_ids, sizes)


def _identity_findings(items: pa.Table, nodes: pa.Table, manifest: Mapping[str, Any]) -> Iterator[Finding]:
    leaves = set(nodes["node_id"].to_pylist()) - set(nodes["parent_id"].to_pylist())
    sources = {source["id"] for source in manifest["sources"]}
    columns = ("item_id", "node_id", "kind", "licence", "source")
    seen: set[str] = set()
    for item_id, node_id, kind, licence, source in zip(*(items[c].to_pylist() for c in columns), strict=True):
        if item_id in seen:
            yield Finding("E302", item_id, "item_id: expected one row; found another")
        seen.add(item_id)
        if node_id not in leaves:
            yield Finding("E301", item_id, f"node_id: expected a leaf; found {node_id!r}")
        if kind not in KINDS:
            yield Finding("E305", item_id, f"kind: expected one of {', '.join(sorted(KINDS))}; found {kind!r}")
        if not licence or source not in sources:
            yield Finding("E306", item_id, f"licence, source: expected both named; found {licence!r}, {source!r}")


def _size_findings(items: pa.Table, sizes: NDArray[np.float64]) -> Iterator[Finding]:
    ids = items["item_id"].to_pylist()
    extents = items["extents_mm"].to_pylist()
    low, high = PLAUSIBLE_MM
    absurd = np.any((sizes < low) | (sizes > high) | np.isinf(sizes), axis=1)
    swapped = sizes[:, 1] > sizes[:, 0] * (1 + ORDER_TOLERANCE)
    empty = np.all(np.isnan(sizes), axis=1)
    for number, (item_id, sides) in enumerate(zip(ids, extents, strict=True)):
        if absurd[number] or any(not low <= side <= high for side in sides or []):
            values = f"{sizes[number].tolist()}, {sides}"
            yield Finding("E303", item_id, f"sizes: expected {low:g} to {high:g} mm; found {values}")
        if swapped[number]:
            yield Finding("E304", item_id, f"width_mm: expected at most the length; found {sizes[number].tolist()}")
        if any(after > before * (1 + ORDER_TOLERANCE) for before, after in pairwise(sides or [])):
            yield Finding("E304", item_id, f"extents_mm: expected longest first; found {sides}")
        if empty[number] and not sides:
            yield Finding("E307", item_id, "sizes: expected at least one; found none")


def _class_findings(
    items: pa.Table, node_id: str, rows: NDArray[np.int64], sizes: NDArray[np.float64]
) -> Iterator[Finding]:
    if len(rows) < ENOUGH:
        return
    distinct = np.unique(np.nan_to_num(sizes, nan=-1.0), axis=0)
    copies = 1 - len(distinct) / len(rows)
    if copies > DUPLICATE_SHARE:
        yield Finding("W308", node_id, f"expected distinct rows; found {copies:.0%} of {len(rows)} to be copies")
    yield from _outlier_findings(items, rows, sizes)
    yield from _shape_findings(node_id, distinct)
    yield from _source_findings(items, node_id, rows, sizes)


def _outlier_findings(items: pa.Table, rows: NDArray[np.int64], sizes: NDArray[np.float64]) -> Iterator[Finding]:
    with np.errstate(invalid="ignore", divide="ignore"):
        logs = np.log(sizes)
    for axis, column in enumerate(AXES):
        known = logs[:, axis][np.isfinite(logs[:, axis])]
        if len(known) < ENOUGH:
            continue
        centre = np.median(known)
        spread = 1.4826 * np.median(np.abs(known - centre))
        offset = logs[:, axis] - centre
        bound = max(FAR_DEVIATIONS * spread, np.log(FAR_FACTOR))
        for row in np.flatnonzero(np.abs(offset) > bound):
            item_id = items["item_id"][int(rows[row])].as_py()
            text = f"{column}: expected about {np.exp(centre):.0f} mm; found {sizes[row, axis]:g}"
            slip = _slip(float(offset[row]))
            yield Finding("W309", item_id, f"{text}, {slip}") if slip else Finding("W310", item_id, text)


def _shape_findings(node_id: str, distinct: NDArray[np.float64]) -> Iterator[Finding]:
    counts = [len(np.unique(distinct[:, axis])) for axis in range(3)]
    for axis, column in enumerate(AXES):
        present = distinct[0, axis] > 0
        if present and counts[axis] == 1 and len(distinct) >= ENOUGH:
            yield Finding("W311", node_id, f"{column}: expected a spread; found {distinct[0, axis]:g} on every row")
    varying = [count for count in counts if count > 1]
    if len(varying) > 1 and min(varying) >= GRID_SIDE and np.prod(varying) == len(distinct):
        yield Finding("W312", node_id, f"expected a sample; found every pair of {' x '.join(map(str, varying))} values")
    if len(varying) == 1 and _is_regular(distinct[:, int(np.argmax(counts))]):
        yield Finding("W312", node_id, f"expected a sample; found {max(varying)} values in equal steps")


def _is_regular(values: NDArray[np.float64]) -> bool:
    steps = np.diff(np.sort(values))
    return len(values) >= ENOUGH and bool(np.allclose(steps, steps[0], rtol=1e-3))


def _source_findings(
    items: pa.Table, node_id: str, rows: NDArray[np.int64], sizes: NDArray[np.float64]
) -> Iterator[Finding]:
    sources = items["source"].take(pa.array(rows)).to_numpy(zero_copy_only=False).astype(str)
    medians = {source: _medians(sizes[own]) for source, own in _groups(sources) if len(own) >= ENOUGH}
    for one, other in pairwise(sorted(medians)):
        apart = np.abs(np.log(medians[one] / medians[other]))
        if np.any(apart > np.log(SOURCE_FACTOR)):  # NaN compares false
            worst = int(np.nanargmax(apart))
            text = f"{medians[one][worst]:.0f} mm in {one}, {medians[other][worst]:.0f} mm in {other}"
            yield Finding("W313", node_id, f"{AXES[worst]}: expected medians that agree; found {text}")


def _sibling_findings(nodes: pa.Table, node_ids: NDArray[np.str_], sizes: NDArray[np.float64]) -> Iterator[Finding]:
    parents = dict(zip(nodes["node_id"].to_pylist(), nodes["parent_id"].to_pylist(), strict=True))
    largest = np.nanmax(np.where(np.isnan(sizes), -np.inf, sizes), axis=1, initial=-np.inf)
    medians = {node_id: float(np.median(largest[rows])) for node_id, rows in _groups(node_ids) if len(rows) >= ENOUGH}
    medians = {node_id: median for node_id, median in medians.items() if median > 0}  # the rest state extents alone
    for node_id, median in medians.items():
        siblings = [
            m for other, m in medians.items() if other != node_id and parents.get(other) == parents.get(node_id)
        ]
        if len(siblings) < 3 or median <= 0:
            continue
        logs = np.log(siblings)
        offset = np.log(median) - float(np.median(logs))
        spread = max(float(1.4826 * np.median(np.abs(logs - np.median(logs)))), np.log(FAR_FACTOR) / FAR_DEVIATIONS)
        slip = _slip(offset)
        if slip and abs(offset) > FAR_DEVIATIONS * spread:
            expected = f"about {np.exp(np.median(logs)):.0f} mm as its siblings"
            yield Finding("W314", node_id, f"largest extent: expected {expected}; found {median:.0f}, {slip}")


def _slip(offset: float) -> str | None:
    for factor in UNIT_SLIPS:
        if abs(abs(offset) - np.log(factor)) < SLIP_TOLERANCE:
            return f"{factor:g} times too {'large' if offset > 0 else 'small'}"
    return None


def _medians(sizes: NDArray[np.float64]) -> NDArray[np.float64]:
    known = np.any(np.isfinite(sizes), axis=0)
    return np.array([np.nanmedian(sizes[:, axis]) if known[axis] else np.nan for axis in range(sizes.shape[1])])


def _numbers(items: pa.Table, column: str) -> NDArray[np.float64]:
    return np.asarray(items[column].to_numpy(zero_copy_only=False), dtype=np.float64)


def _groups(keys: NDArray[np.str_]) -> Iterator[tuple[str, NDArray[np.int64]]]:
    """Rows of each key, keys sorted."""
    order = np.argsort(keys, kind="stable")
    names, starts = np.unique(keys[order], return_index=True)
    for key, rows in zip(names, np.split(order, starts[1:]), strict=True):
        if len(rows):
            yield str(key), rows
