"""How far curated ranges can be trusted: `python -m benchmarks.taxonomy.curated RAW... [--table blind_wide]`.

The ranges of `data/curated/blind.csv`, and of `blind_wide.csv` by a second writer, were written, and committed,
before the sizes of these classes were opened. For each class: the share of its items, dimension by dimension, that
lie within low and high (wanted: 0.85 to 0.95), and the median over the typical value. The fit does not take a range
at its word but makes narrow ones wider and wide ones narrower (`believed_spread`); the last line says what the ranges
then cover. Axes are named as a build names them; items that do not say which axis is which are left out. A source
counts by no more than `MOST` items of a class, taken in their order, so that no shop is the class.
"""

from __future__ import annotations

import argparse
import statistics
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from crawler.items import RawItem, raw_items
from metric_tree.axes import AXES, sizes_from_words
from metric_tree.build.ingest import believed_spread, stated_spread
from taxonomy.catalogue import default_catalogue
from taxonomy.categories import Category
from taxonomy.curated import BLIND_TABLES, CuratedRange, blind_ranges
from taxonomy.matching.shipped import default_taxonomy

MOST = 200
#: Values of a dimension from which a share can be told.
FEWEST = 5


def ancestors(node_id: str | None, by_id: dict[str, Category]) -> Iterator[str]:
    """A node, and all above it; an unspecified leaf stands for its inner node too."""
    while node_id is not None:
        yield node_id
        node_id = by_id[node_id].parent_id


def values_by_class(files: Iterable[Path], wanted: set[str]) -> dict[str, list[list[float]]]:
    """Sizes in mm along length, width, height of the items of each class; of things without a pose, longest first."""
    taxonomy = default_taxonomy()
    by_id = {category.node_id: category for category in default_catalogue().categories}
    found: dict[str, list[list[float]]] = defaultdict(lambda: [[], [], []])
    taken: Counter[tuple[str, str]] = Counter()
    for item in (item for file in files for item in raw_items(file) if item.kind != "curated"):
        leaf = taxonomy.match(item).node_id
        for node_id in wanted & set(ancestors(leaf, by_id)):
            if taken[node_id, item.source] < MOST:
                taken[node_id, item.source] += 1
                for axis, value in enumerate(_axes(item, by_id[str(leaf)].pose)):
                    if value is not None:
                        found[node_id][axis].append(value)
    return found


def _axes(item: RawItem, pose: str) -> tuple[float | None, ...]:
    found = sizes_from_words(item.dimensions_mm, item.extents_mm, pose)
    if found is None:
        return ()
    if pose == "any":
        return found.extents if len(found.extents) == 3 else ()
    return found.length, found.width, found.height


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("raw", nargs="+", type=Path)
    parser.add_argument("--table", choices=BLIND_TABLES, default=BLIND_TABLES[0])
    arguments = parser.parse_args()
    ranges = blind_ranges(arguments.table)
    found = values_by_class(arguments.raw, {row.node_id for row in ranges})
    print("| class | items | length | width | height | median over typical |\n|---|---|---|---|---|---|")
    tested = [row for row in ranges if any(len(values) >= FEWEST for values in found.get(row.node_id, ()))]
    for row in tested:
        cells = [_cell(row, axis, found[row.node_id][axis]) for axis in range(len(AXES))]
        items = max(len(values) for values in found[row.node_id])
        medians = ", ".join(_median(row, axis, found[row.node_id][axis]) for axis in range(len(AXES)))
        print(f"| {row.node_id} | {items} | {' | '.join(cells)} | {medians} |")
    print(f"\n{len(tested)} classes")
    for title, fitted in (("as written", False), ("as the fit believes them", True)):
        pairs = [counts for row in tested for counts in [_counts(row, found[row.node_id], fitted)] if counts[1]]
        inside, known = (sum(column) for column in zip(*pairs, strict=True))
        shares = [part / whole for part, whole in pairs]
        print(
            f"{title}: {inside / known:.3f} of {known} sizes covered;"
            f" of a class's sizes, mean {statistics.mean(shares):.3f}, median {statistics.median(shares):.3f}"
        )


def _bounds(row: CuratedRange, axis: int, fitted: bool = False) -> tuple[float, float, float] | None:
    """Low, typical and high of an axis, as written or as the fit believes them, about the typical value."""
    low, typical, high = row.low[axis], row.typical[axis], row.high[axis]
    if low is None or typical is None or high is None:
        return None
    factor = believed_spread(low, high) / stated_spread(low, high) if fitted and high > low else 1.0
    return typical * (low / typical) ** factor, typical, typical * (high / typical) ** factor


def _counts(row: CuratedRange, values: Sequence[Sequence[float]], fitted: bool) -> tuple[int, int]:
    """Sizes within the range, as written or as the fit believes it, and sizes."""
    inside = known = 0
    for axis, column in enumerate(values):
        bounds = _bounds(row, axis, fitted)
        if bounds and len(column) >= FEWEST:
            inside += sum(bounds[0] <= value <= bounds[2] for value in column)
            known += len(column)
    return inside, known


def _cell(row: CuratedRange, axis: int, values: Sequence[float]) -> str:
    bounds = _bounds(row, axis)
    if bounds is None or len(values) < FEWEST:
        return "-"
    return f"{sum(bounds[0] <= value <= bounds[2] for value in values) / len(values):.2f}"


def _median(row: CuratedRange, axis: int, values: Sequence[float]) -> str:
    bounds = _bounds(row, axis)
    return f"{statistics.median(values) / bounds[1]:.2f}" if bounds and len(values) >= FEWEST else "-"


if __name__ == "__main__":
    main()
