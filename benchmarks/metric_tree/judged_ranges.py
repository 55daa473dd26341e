"""Compare ranges that a language model wrote blind with the shipped rows of their categories.

    python -m benchmarks.metric_tree.judged_ranges [TREE]

The ranges of `data/curated/blind.csv` and `blind_wide.csv` were written before the rows of their categories were
opened. For each axis with `MIN_ROWS` rows of products, measurements or standards: the fraction of rows within the range
as written and as widened by a build, and the factor on the written range that would contain 90 % of the rows.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from benchmarks.common import options_parser, print_rows
from metric_tree.axes import AXES
from metric_tree.curated.sizes import BLIND_TABLES, CuratedRange, blind_ranges
from metric_tree.fit.class_prior import NEW_SOURCE
from metric_tree.fit.rows import STRONG
from metric_tree.pipeline.ingest import widened_sd
from metric_tree.tree import Tree, open_tree

#: Minimum number of rows of an axis.
MIN_ROWS = 15
#: Standard deviations from the centre of a 90 % interval to its ends.
HALF_WIDTH = 1.645


class Axis(NamedTuple):
    """Comparison of one axis."""

    kind: str  #: Name of the node at the second level.
    as_written: float  #: Fraction of rows within the range, 0 to 1.
    widened: float  #: Fraction of rows within the widened range, 0 to 1.
    needed: float  #: Factor on the width of the range that contains 90 % of the rows.
    used: float  #: Factor of a build.


def main() -> None:
    """Print a row for each table, and for each kind of category."""
    parser = options_parser(__doc__)
    parser.add_argument("tree", nargs="?")
    tree = open_tree(parser.parse_args().tree)
    groups: defaultdict[str, list[Axis]] = defaultdict(list)
    for table in BLIND_TABLES:
        for row in blind_ranges(table):
            for axis in compared(tree, row) if tree.has_node(row.node_id) else ():
                groups[table].append(axis)
                groups[axis.kind].append(axis)
    columns = ("group", "axes", "as written", "widened", "factor needed", "factor used")
    print_rows(columns, ((name, *_summary(groups[name])) for name in sorted(groups, key=lambda one: -len(groups[one]))))


def compared(tree: Tree, row: CuratedRange) -> Iterator[Axis]:
    """Yield the comparisons of the axes of a range that have `MIN_ROWS` rows."""
    node = tree.node(row.node_id)
    items = [item for item in node.items().to_pylist() if item["kind"] in STRONG]
    for axis, span in zip(AXES, row.spans, strict=True):
        sizes = np.log([item[f"{axis}_mm"] for item in items if item[f"{axis}_mm"]])
        low, typical, high = span or (None, None, None)
        if low is None or typical is None or high is None or len(sizes) < MIN_ROWS:
            continue
        written = np.log(high / low) / (2 * HALF_WIDTH)
        sd = widened_sd(low, high)
        sd *= float(NEW_SOURCE.factor(0, sd)) ** 0.5
        off = np.abs(sizes - np.log(typical))
        as_written, widened = (float(np.mean(off <= HALF_WIDTH * one)) for one in (written, sd))
        needed = float(np.quantile(off, 0.9) / written / HALF_WIDTH)
        yield Axis(node.path[1], as_written, widened, needed, sd / written)


def _summary(axes: list[Axis]) -> tuple[object, ...]:
    means = (f"{np.mean([getattr(axis, name) for axis in axes]):.2f}" for name in ("as_written", "widened"))
    medians = (f"{np.median([getattr(axis, name) for axis in axes]):.2f}" for name in ("needed", "used"))
    return len(axes), *means, *medians


if __name__ == "__main__":
    main()
