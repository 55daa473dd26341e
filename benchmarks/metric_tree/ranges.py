"""How much a judged range helps a thin class: fits of a few rows with and without it, scored on another source.

    python -m benchmarks.metric_tree.ranges RAW... --work DIR

The ranges are those of `blind.csv` and `blind_wide.csv`, written before the rows of their classes were opened. Of each
class with two sources of ten real rows or more, every such source is held out in turn: the class is fitted with k rows
drawn from the other sources, and with none of its range, with it as shipped (20 rows' worth), and with half and twice
the worth. Columns as in `leave_source_out`, classes counted once.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from benchmarks.metric_tree.leave_source_out import Rows, Score, held_rows, rows_parser
from metric_cli.terminal import print_table
from metric_tree.fit import class_rows
from metric_tree.fit.class_prior import class_prior
from metric_tree.fit.class_rows import ClassRows, take_rows
from metric_tree.fit.evidence import JUDGED, KIND_WEIGHT, STRONG
from metric_tree.fit.kinds import learn_kinds
from taxonomy.curated import BLIND_TABLES, blind_ranges

LEAST_ROWS = 10
COUNTS = (1, 2, 3, 5, 10, 20, 50)

#: Ways to fit, by the rows that the spread of a range counts; None without the range.
WAYS = {"no range": None, "10 rows": 10.0, "20 rows, as shipped": 20.0, "40 rows": 40.0}


def cases(build: Rows) -> Iterator[tuple[str, ClassRows, str]]:
    """Node, rows and the source that is held out."""
    named = {row.node_id for table in BLIND_TABLES for row in blind_ranges(table)}
    for node_id, rows in build.rows.items():
        if node_id.removesuffix("/other") not in named and node_id not in named:
            continue
        real = np.isin(rows.kinds, sorted(STRONG))
        names, number = np.unique(np.asarray(rows.sources)[real], return_counts=True)
        enough = names[number >= LEAST_ROWS]
        if len(enough) >= 2 and JUDGED in rows.kinds:
            yield from ((node_id, rows, str(name)) for name in enough)


def main() -> None:
    """Print a line for each number of rows and each way."""
    build = Rows.stated(rows_parser(__doc__).parse_args())
    families = build.hierarchy.families()
    first = [(families[n], one.moments[0].disagreement) for n, one in build.classes.items()]
    model = learn_kinds(((family, own) for family, own in first if own is not None), sorted(KIND_WEIGHT))
    beliefs = build.hierarchy.beliefs(m for one in build.classes.values() for m in one.moments)
    parents = {category.node_id: category.parent_id or "" for category in build.hierarchy.categories}
    scores: dict[tuple[int, str], dict[str, list[Score]]] = {}
    for node_id, rows, source in cases(build):
        sizes = held_rows(rows, source, 0)
        sizes = sizes[~np.isnan(sizes).any(axis=1)]
        pool = np.flatnonzero(np.isin(rows.kinds, sorted(STRONG)) & (np.asarray(rows.sources) != source))
        shuffled = np.random.default_rng(0).permutation(pool)
        for count in COUNTS if len(sizes) else ():
            if count > len(pool):
                break
            for way, worth in WAYS.items():
                kept = np.isin(np.arange(len(rows.kinds)), shuffled[:count])
                kept |= (np.asarray(rows.kinds) == JUDGED) & (worth is not None)
                class_rows.STATED_ROWS = worth or class_rows.STATED_ROWS
                own = replace(take_rows(rows, np.flatnonzero(kept)), n=count)
                prior = class_prior(own, beliefs[parents[node_id], rows.axes], model, families[node_id], heldout=False)
                places = [rows.axes.index(dim) for dim in prior.dims]
                scores.setdefault((count, way), {}).setdefault(node_id, []).append(Score.of(prior, sizes[:, places]))
    lines = []
    for (count, way), by_class in scores.items():
        table = np.array(
            [
                [np.mean([getattr(s, f) for s in own]) for f in ("density", "inside", "error")]
                for own in by_class.values()
            ]
        )
        lines.append(
            (count, way, len(table), f"{np.median(table[:, 0]):.2f}", *(f"{v:.2f}" for v in table[:, 1:].mean(axis=0)))
        )
    print_table(["rows", "fit", "classes", "log density", "inside 90 %", "error of the median"], lines)


if __name__ == "__main__":
    main()
