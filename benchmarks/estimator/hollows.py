"""Which height a sink or a basket has in which source, and what it brings that a sink's underside is not seen.

    python -m benchmarks.estimator.hollows --raw RAW --cache CACHE --tables TABLES

Prints the heights by class and source. Then, for classes of real scans, how far the scale by one object alone is off
with its height as it is and truncated; the tree has none of them but the baths of 3RScan. The classes with an unseen
underside were chosen on the even half.
"""

from __future__ import annotations

import argparse
import csv
import json
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.accuracy.unseen import SIGMA, rooms_of, sorted_extents, unseen_tree
from benchmarks.common import table_head
from estimator.records.measured_object import MeasuredObject
from estimator.results.estimate import scale_of_objects
from metric_base.arrays import FloatArray
from metric_tree.tree import Tree

#: Categories as sources write them.
CLASSES = ("sink", "washbasin", "bathtub", "basket", "laundry hamper", "trash can", "bucket", "bowl", "toilet")
#: Sources with fewer heights of a class are not printed.
LEAST_ROWS = 5
JUDGED = ("sink", "counter", "bathtub")


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    for name in ("--raw", "--cache", "--tables"):
        parser.add_argument(name, type=Path, required=True)
    options = parser.parse_args()
    print(table_head(("class", "source", "rows", "5 %", "median", "95 %")))
    for (category, source), heights in sorted(_heights(options.raw).items()):
        if len(heights) >= LEAST_ROWS:
            low, middle, high = np.quantile(heights, (0.05, 0.5, 0.95))
            print(f"| {category} | {source} | {len(heights)} | {low:.0f} | {middle:.0f} | {high:.0f} |")
    tree, _ = unseen_tree(options.raw, options.cache)
    columns = ("class", "source", "half", "objects", "error", "height truncated", "difference", "95 %", "log density")
    print("\n" + table_head(columns))
    for source, category, half, sizes in _scans(options.tables):
        rows = np.array([[_error(category, extents, cut, tree) for cut in (False, True)] for extents in sizes])
        (plain, before), (truncated, after) = rows.mean(axis=0)
        change = rows[:, 1, 0] - rows[:, 0, 0]
        means = np.random.default_rng(0).choice(change, (4000, len(change))).mean(axis=1)
        low, high = np.quantile(means, (0.025, 0.975))
        errors = f"{plain:.1%} | {truncated:.1%} | {truncated - plain:+.1%} | {low:+.1%} to {high:+.1%}"
        print(f"| {category} | {source} | {half} | {len(rows)} | {errors} | {before:.2f} to {after:.2f} |")


def _heights(raw: Path) -> dict[tuple[str, str], list[float]]:
    """Stated heights in mm by category and source."""
    heights: dict[tuple[str, str], list[float]] = defaultdict(list)
    for file in sorted(raw.glob("*.jsonl")):
        for row in map(json.loads, file.open(encoding="utf-8")) if "quarantine" not in file.name else ():
            category = (row.get("category_path") or [""])[-1].lower()
            height = (row.get("dimensions_mm") or {}).get("height")
            if category in CLASSES and height:
                heights[category, file.stem].append(height)
    return heights


def _scans(tables: Path) -> Iterator[tuple[str, str, str, list[FloatArray]]]:
    """Source, category, half and extents (3,) in mm of the objects of rooms that were scanned."""
    rooms = rooms_of(tables / "scannet18_boxes" / "scannet18_boxes.csv")
    scannet = [(number, *one) for number, name in enumerate(sorted(rooms)) for one in rooms[name]]
    with (tables / "3rscan_boxes" / "3rscan_boxes.csv").open(encoding="utf-8", newline="") as lines:
        rows = enumerate(csv.DictReader(lines))
        sized = (
            (n, r["category"], [float(r[f"{a}_mm"] or "nan") for a in ("length", "width", "height")]) for n, r in rows
        )
        rscan = [one for one in sized if min(one[2]) > 0]
    for source, entries in (("ScanNet", scannet), ("3RScan", rscan)):
        for category in JUDGED:
            for parity, half in enumerate(("even", "odd")):
                own = [sorted_extents(sizes) for n, name, sizes in entries if name == category and n % 2 == parity]
                yield source, category, half, own


def _error(category: str, extents: FloatArray, cut: bool, tree: Tree) -> tuple[float, float]:
    """|ln scale| and the log density at the true scale, 1 m per unit; what stands is not cut by the estimate itself."""
    truncated = np.array([False, False, cut])
    item = MeasuredObject(
        "1", category, extents / 1000, np.array(SIGMA), truncated=truncated, unsupported_height=extents[2] / 1000
    )
    result = scale_of_objects([item], tree)
    curve = result.curve
    if curve is None:
        raise AssertionError(category)
    return abs(float(np.log(result.modes[0].scale))), float(np.log(np.interp(0, curve.log_scale, curve.density)))


if __name__ == "__main__":
    main()
