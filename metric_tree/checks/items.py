"""Checks on the items of a release (codes 3xx): units, axis order, duplicates, and impossible sizes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from crawler.items import KINDS
from metric_base.arrays import FloatArray, grouped
from metric_tree.checks import unit_errors
from metric_tree.checks.duplicates import duplicates
from metric_tree.checks.finding import Finding
from metric_tree.fit.rows import extents_of

#: Minimum and maximum size in mm: from a foil of 0.01 mm to 5 km (the longest ship has 458 m, the highest building
#: 828 m; a suspension bridge is 2 to 3 km long).
PLAUSIBLE_MM = (0.01, 5e6)

#: Relative rounding error of axes that were sorted in another unit.
ORDER_TOLERANCE = 1e-6

#: Factor between the medians of two sources of a node from which they are not of the same objects.
SOURCE_FACTOR = 1.5

#: Maximum fraction of identical rows, 0 to 1; above, a list was copied into itself.
MAX_DUPLICATE_FRACTION = 0.2

#: Minimum number of values of each axis of a grid, in which every pair of values occurs.
MIN_GRID_VALUES = 3

#: Relative tolerance of equal steps between sizes.
STEP_TOLERANCE = 1e-3

AXES = ("length_mm", "width_mm", "height_mm")


def findings(items: pa.Table, nodes: pa.Table, manifest: Mapping[str, Any]) -> Iterator[Finding]:
    """Yield the findings on the items table, given the nodes and the sources of the manifest."""
    # Check ids, nodes, kinds, licences and sources (E301, E302, E305, E306).
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
    by_axis = [np.asarray(items[axis].to_numpy(zero_copy_only=False), dtype=np.float64) for axis in AXES]
    sizes = np.column_stack(by_axis)  # (n, 3)
    yield from _size_findings(items, sizes)
    extents = extents_of(items)  # (n, 3), longest first
    without = np.isnan(extents).all(axis=1)
    extents[without] = -np.sort(-sizes[without], axis=1)
    node_ids = items["node_id"].to_numpy(zero_copy_only=False).astype(str)
    for node_id, rows in _groups(node_ids):
        if len(rows) >= unit_errors.MIN_REFERENCE_ROWS:
            class_items = items.take(pa.array(rows))
            yield from _row_findings(class_items, node_id, sizes[rows], extents[rows])
            yield from _shape_findings(node_id, np.unique(np.nan_to_num(sizes[rows], nan=-1.0), axis=0))
            yield from _source_findings(class_items, node_id, sizes[rows])
    yield from _sibling_findings(nodes, node_ids, extents)


def _size_findings(items: pa.Table, sizes: FloatArray) -> Iterator[Finding]:
    """Check single rows (E303, E304, E307): sizes (n, 3) in mm that are impossible, out of order, or missing."""
    low, high = PLAUSIBLE_MM
    absurd = np.any((sizes < low) | (sizes > high) | np.isinf(sizes), axis=1)
    swapped = sizes[:, 1] > sizes[:, 0] * (1 + ORDER_TOLERANCE)
    empty = np.all(np.isnan(sizes), axis=1)
    columns = items["item_id"].to_pylist(), items["extents_mm"].to_pylist()
    for row, (item_id, extents) in enumerate(zip(*columns, strict=True)):
        if absurd[row] or any(not low <= side <= high for side in extents or []):
            values = f"{sizes[row].tolist()}, {extents}"
            yield Finding("E303", item_id, f"sizes: expected {low:g} to {high:g} mm; found {values}")
        if swapped[row]:
            yield Finding("E304", item_id, f"width_mm: expected at most the length; found {sizes[row].tolist()}")
        if any(after > before * (1 + ORDER_TOLERANCE) for before, after in pairwise(extents or [])):
            yield Finding("E304", item_id, f"extents_mm: expected longest first; found {extents}")
        if empty[row] and not extents:
            yield Finding("E307", item_id, "sizes: expected at least one; found none")


def _row_findings(items: pa.Table, node_id: str, sizes: FloatArray, extents: FloatArray) -> Iterator[Finding]:
    """Apply the rules of the build to a class: repeats (W308) and unit errors (W309, W310); (n, 3) in mm each."""
    node, source, kind, title = (items[name].to_pylist() for name in ("node_id", "source", "kind", "title"))
    kind = [one if one in KINDS else "default" for one in kind]
    all_sizes = np.column_stack([sizes, extents])
    repeats = duplicates(node, all_sizes, source, kind, [text or "" for text in title], [True] * len(node))
    copies = float((repeats >= 0).mean())
    if copies > MAX_DUPLICATE_FRACTION:
        yield Finding("W308", node_id, f"expected distinct rows; found {copies:.0%} of {len(node)} to be copies")
    reference = unit_errors.class_reference(extents)
    assert reference is not None  # of at least `MIN_REFERENCE_ROWS` rows
    factors = unit_errors.unit_error_factors(extents, reference)
    for row in np.flatnonzero(factors != 1.0):
        text = f"extents_mm: expected about {_centre(reference)}; found {_size_text(extents[row])}"
        item_id = items["item_id"][int(row)].as_py()
        if np.isfinite(factors[row]):
            yield Finding("W309", item_id, f"{text}, {_factor_text(factors[row])}")
        else:
            yield Finding("W310", item_id, text)


def _shape_findings(node_id: str, distinct: FloatArray) -> Iterator[Finding]:
    """Check distinct sizes (n, 3) for a constant dimension (W311), a grid, or equal steps (W312)."""
    counts = [len(np.unique(distinct[:, axis])) for axis in range(3)]
    for axis, column in enumerate(AXES):
        present = distinct[0, axis] > 0
        if present and counts[axis] == 1 and len(distinct) >= unit_errors.MIN_REFERENCE_ROWS:
            yield Finding("W311", node_id, f"{column}: expected a spread; found {distinct[0, axis]:g} on every row")
    varying = [count for count in counts if count > 1]
    if len(varying) > 1 and min(varying) >= MIN_GRID_VALUES and np.prod(varying) == len(distinct):
        yield Finding("W312", node_id, f"expected a sample; found every pair of {' x '.join(map(str, varying))} values")
    if len(varying) == 1 and len(distinct) >= unit_errors.MIN_REFERENCE_ROWS:
        steps = np.diff(np.sort(distinct[:, int(np.argmax(counts))]))
        if np.allclose(steps, steps[0], rtol=STEP_TOLERANCE):
            yield Finding("W312", node_id, f"expected a sample; found {max(varying)} values in equal steps")


def _source_findings(items: pa.Table, node_id: str, sizes: FloatArray) -> Iterator[Finding]:
    """Check for sources whose medians of sizes (n, 3) differ by more than `SOURCE_FACTOR` (W313)."""
    sources = items["source"].to_numpy(zero_copy_only=False).astype(str)
    medians = _medians_by(sources, sizes)
    for one, other in pairwise(sorted(medians)):
        difference = np.abs(np.log(medians[one] / medians[other]))
        if np.any(difference > np.log(SOURCE_FACTOR)):  # False if NaN
            worst = int(np.nanargmax(difference))
            text = f"{medians[one][worst]:.0f} mm in {one}, {medians[other][worst]:.0f} mm in {other}"
            yield Finding("W313", node_id, f"{AXES[worst]}: expected medians that agree; found {text}")


def _sibling_findings(nodes: pa.Table, node_ids: NDArray[np.str_], extents: FloatArray) -> Iterator[Finding]:
    """Check for classes whose median differs from their siblings by the factor of a unit (W314).

    node_ids : (n,) of the items; extents : (n, 3) mm, longest first, NaN beyond the last.
    """
    parents = dict(zip(nodes["node_id"].to_pylist(), nodes["parent_id"].to_pylist(), strict=True))
    medians = _medians_by(node_ids, extents)
    for family in grouped((parents.get(node_id), node_id) for node_id in medians).values():
        for node_id in family:
            others = np.array([np.log(medians[other]) for other in family if other != node_id])
            reference = unit_errors.sibling_reference(others)
            if reference is None:
                continue
            factor = float(unit_errors.unit_error_factors(medians[node_id][None], reference)[0])
            if np.isfinite(factor) and factor != 1.0:
                text = f"{_size_text(medians[node_id])}, {_factor_text(factor)}"
                yield Finding("W314", node_id, f"extents_mm: expected about {_centre(reference)}; found {text}")


def _factor_text(factor: float) -> str:
    is_large = factor > 1
    return f"{factor if is_large else 1 / factor:g} times too {'large' if is_large else 'small'}"


def _centre(reference: unit_errors.Reference) -> str:
    return _size_text(np.exp(reference.centre))


def _size_text(extents: FloatArray) -> str:
    """Return extents (3,) as text: `900 x 400 x 50 mm`."""
    return " x ".join(f"{side:.0f}" for side in extents if np.isfinite(side)) + " mm"


def _medians(sizes: FloatArray) -> FloatArray:
    """Return the medians (d,) of sizes (n, d), NaN for axes that no row states; no warning, unlike `nanmedian`."""
    known = np.any(np.isfinite(sizes), axis=0)
    return np.array([np.nanmedian(sizes[:, axis]) if known[axis] else np.nan for axis in range(sizes.shape[1])])


def _medians_by(keys: NDArray[np.str_], sizes: FloatArray) -> dict[str, FloatArray]:
    """Return the medians (d,) of the sizes (n, d) of each key (n,) with at least `MIN_REFERENCE_ROWS` rows."""
    groups = _groups(keys)
    return {key: _medians(sizes[rows]) for key, rows in groups if len(rows) >= unit_errors.MIN_REFERENCE_ROWS}


def _groups(keys: NDArray[np.str_]) -> Iterator[tuple[str, NDArray[np.int64]]]:
    """Yield the row indices (k,) of each of the keys (n,), sorted by key."""
    if not len(keys):
        return
    order = np.argsort(keys, kind="stable")
    names, starts = np.unique(keys[order], return_index=True)
    for key, rows in zip(names, np.split(order, starts[1:]), strict=True):
        yield str(key), rows
