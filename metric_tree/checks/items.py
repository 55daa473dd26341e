"""Checks on the items of a release (codes 3xx): units, axis order, duplicates, and sizes that cannot be."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from crawler.items import KINDS
from metric_base.arrays import FloatArray
from metric_tree.checks.duplicates import duplicates
from metric_tree.checks.finding import Finding
from metric_tree.checks.unit_errors import MIN_REFERENCE_ROWS, Reference, reference, sibling_reference, slip_factors
from metric_tree.fit.rows import extents_of

#: From a hundredth of a millimetre (foil) to five kilometres (the longest ship has 458 m, the highest building 828 m; a
#: suspension bridge is two or three kilometres long).
PLAUSIBLE_MM = (0.01, 5e6)

#: Rounding of axes that were sorted in another unit.
ORDER_TOLERANCE = 1e-6

#: Two sources of one node whose medians differ by this factor are not about the same objects.
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
    "E305": "a kind that the format does not know",
    "E306": "an item without licence, or of a source that the manifest does not name",
    "E307": "an item without any size",
    "W308": "identical rows make up much of a class",
    "W309": "a size that differs from its class by the factor of a unit (10, 25.4, 304.8, 1000)",
    "W310": "a size far outside its class",
    "W311": "a class of which one dimension is constant",
    "W312": "a class that is a grid of values, no sample",
    "W313": "sources that disagree about a class",
    "W314": "a class that differs from its siblings by the factor of a unit",
}


def findings(items: pa.Table, nodes: pa.Table, manifest: Mapping[str, Any]) -> Iterator[Finding]:
    """Findings on the items table, given the nodes and the manifest's sources."""
    yield from _identity_findings(items, nodes, manifest)
    sizes = np.column_stack([_numbers(items, axis) for axis in AXES])  # (n, 3)
    yield from _size_findings(items, sizes)
    extents = _extents(items, sizes)
    node_ids = items["node_id"].to_numpy(zero_copy_only=False).astype(str)
    for node_id, rows in _groups(node_ids):
        yield from _class_findings(items, node_id, rows, sizes[rows], extents[rows])
    yield from _sibling_findings(nodes, node_ids, extents)


def _extents(items: pa.Table, sizes: FloatArray) -> FloatArray:
    """Stated extents (n, 3) in mm, longest first, NaN beyond the last; the axes' own where a row has no extents."""
    extents = extents_of(items)
    without = np.isnan(extents).all(axis=1)
    extents[without] = -np.sort(-sizes[without], axis=1)
    return extents


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


def _size_findings(items: pa.Table, sizes: FloatArray) -> Iterator[Finding]:
    """Errors of single rows: sizes (n, 3) in mm that are absurd, in another order, or missing."""
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
    items: pa.Table, node_id: str, rows: NDArray[np.int64], sizes: FloatArray, extents: FloatArray
) -> Iterator[Finding]:
    """Errors of the rows (k,) of one class: copies, outliers, shapes; sizes and extents (n, 3) in mm."""
    if len(rows) < MIN_REFERENCE_ROWS:
        return
    own = items.take(pa.array(rows))
    copies = _share_of_copies(own, np.column_stack([sizes, extents]))
    if copies > DUPLICATE_SHARE:
        yield Finding("W308", node_id, f"expected distinct rows; found {copies:.0%} of {len(rows)} to be copies")
    yield from _outlier_findings(own, extents)
    yield from _shape_findings(node_id, np.unique(np.nan_to_num(sizes, nan=-1.0), axis=0))
    yield from _source_findings(items, node_id, rows, sizes)


def _share_of_copies(own: pa.Table, sizes: FloatArray) -> float:
    """Share of a class's rows that repeat another by the build's own rule; sizes (n, 6) mm."""
    node, source, kind, title = (own[name].to_pylist() for name in ("node_id", "source", "kind", "title"))
    known = [one if one in KINDS else "default" for one in kind]
    repeats = duplicates(node, sizes, source, known, [text or "" for text in title], [True] * len(node))
    return float((repeats >= 0).mean())


def _outlier_findings(own: pa.Table, extents: FloatArray) -> Iterator[Finding]:
    """Rows, extents (n, 3), that the build would refuse: `metric_tree.checks.unit_errors` has the rule."""
    against = reference(extents)
    if against is None:
        return
    factors = slip_factors(extents, against)
    for row in np.flatnonzero(factors != 1.0):
        text = f"extents_mm: expected about {_centre(against)}; found {_size_text(extents[row])}"
        item_id = own["item_id"][int(row)].as_py()
        if np.isfinite(factors[row]):
            yield Finding("W309", item_id, f"{text}, {_times(factors[row])}")
        else:
            yield Finding("W310", item_id, text)


def _shape_findings(node_id: str, distinct: FloatArray) -> Iterator[Finding]:
    """Distinct sizes (n, 3) that are no sample: one value on every row, or a grid of values."""
    counts = [len(np.unique(distinct[:, axis])) for axis in range(3)]
    for axis, column in enumerate(AXES):
        present = distinct[0, axis] > 0
        if present and counts[axis] == 1 and len(distinct) >= MIN_REFERENCE_ROWS:
            yield Finding("W311", node_id, f"{column}: expected a spread; found {distinct[0, axis]:g} on every row")
    varying = [count for count in counts if count > 1]
    if len(varying) > 1 and min(varying) >= GRID_SIDE and np.prod(varying) == len(distinct):
        yield Finding("W312", node_id, f"expected a sample; found every pair of {' x '.join(map(str, varying))} values")
    if len(varying) == 1 and _is_regular(distinct[:, int(np.argmax(counts))]):
        yield Finding("W312", node_id, f"expected a sample; found {max(varying)} values in equal steps")


def _is_regular(values: FloatArray) -> bool:
    """Return True if values (n,) have equal steps."""
    steps = np.diff(np.sort(values))
    return len(values) >= MIN_REFERENCE_ROWS and bool(np.allclose(steps, steps[0], rtol=1e-3))


def _source_findings(items: pa.Table, node_id: str, rows: NDArray[np.int64], sizes: FloatArray) -> Iterator[Finding]:
    """Sources whose medians of sizes (n, 3) differ by more than `SOURCE_FACTOR`."""
    sources = items["source"].take(pa.array(rows)).to_numpy(zero_copy_only=False).astype(str)
    medians = {source: _medians(sizes[own]) for source, own in _groups(sources) if len(own) >= MIN_REFERENCE_ROWS}
    for one, other in pairwise(sorted(medians)):
        apart = np.abs(np.log(medians[one] / medians[other]))
        if np.any(apart > np.log(SOURCE_FACTOR)):  # NaN compares false
            worst = int(np.nanargmax(apart))
            text = f"{medians[one][worst]:.0f} mm in {one}, {medians[other][worst]:.0f} mm in {other}"
            yield Finding("W313", node_id, f"{AXES[worst]}: expected medians that agree; found {text}")


def _sibling_findings(nodes: pa.Table, node_ids: NDArray[np.str_], extents: FloatArray) -> Iterator[Finding]:
    """Classes whose median is off their siblings' by a factor.

    node_ids : (n,) of the items; extents : (n, 3) mm, longest first, NaN beyond the last.
    """
    parents = dict(zip(nodes["node_id"].to_pylist(), nodes["parent_id"].to_pylist(), strict=True))
    medians = {
        node_id: _medians(extents[rows]) for node_id, rows in _groups(node_ids) if len(rows) >= MIN_REFERENCE_ROWS
    }
    families: dict[str | None, list[str]] = {}
    for node_id in medians:
        families.setdefault(parents.get(node_id), []).append(node_id)
    for family in families.values():
        for node_id in family:
            others = np.array([np.log(medians[other]) for other in family if other != node_id])
            against = sibling_reference(others) if len(others) else None
            factor = float(slip_factors(medians[node_id][None], against)[0]) if against else 1.0
            if np.isfinite(factor) and factor != 1.0:
                medians_text = f"{_size_text(medians[node_id])}, {_times(factor)}"
                yield Finding("W314", node_id, f"extents_mm: expected about {_centre(against)}; found {medians_text}")


def _times(factor: float) -> str:
    large = factor > 1
    return f"{factor if large else 1 / factor:g} times too {'large' if large else 'small'}"


def _centre(against: Reference | None) -> str:
    return _size_text(np.exp(against.centre)) if against else "nothing"


def _size_text(extents: FloatArray) -> str:
    """Extents (3,) in words: `900 x 400 x 50 mm`."""
    return " x ".join(f"{side:.0f}" for side in extents if np.isfinite(side)) + " mm"


def _medians(sizes: FloatArray) -> FloatArray:
    """(d,) medians of sizes (n, d), NaN where no row states an axis."""
    known = np.any(np.isfinite(sizes), axis=0)
    return np.array([np.nanmedian(sizes[:, axis]) if known[axis] else np.nan for axis in range(sizes.shape[1])])


def _numbers(items: pa.Table, column: str) -> FloatArray:
    """(n,) a column as floats."""
    return np.asarray(items[column].to_numpy(zero_copy_only=False), dtype=np.float64)


def _groups(keys: NDArray[np.str_]) -> Iterator[tuple[str, NDArray[np.int64]]]:
    """Rows (k,) of each of the keys (n,), keys sorted."""
    if not len(keys):
        return
    order = np.argsort(keys, kind="stable")
    names, starts = np.unique(keys[order], return_index=True)
    for key, rows in zip(names, np.split(order, starts[1:]), strict=True):
        yield str(key), rows
