"""How wide things are of which a range was stated: `python -m benchmarks.taxonomy.widening WORK`.

WORK is a folder with the cleaned rows of a build (`benchmarks.metric_tree.leave_source_out --work`). For each axis
with a curated range and `LEAST_ROWS` sizes or more of products, measurements and norms: the stated standard deviation
of ln size, and that of the sizes about the typical size, so that nine of ten lie within 1.645 of it. The last line is
the power law that `believed_spread` takes, by least squares over the axes that two sources or more speak of. A norm's
range is left out.
"""

from __future__ import annotations

import argparse
import pickle
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np

from metric_base.arrays import FloatArray
from metric_base.terminal import print_table
from metric_tree.axes import EXTENTS
from metric_tree.build.ingest import RANGE_SD, stated_spread
from metric_tree.fit.class_rows import ClassRows
from metric_tree.fit.evidence import SOURCE_HALF, STRONG
from taxonomy.curated import CuratedRange, Triple, blind_ranges, curated_ranges
from taxonomy.levels import DIMENSIONS

LEAST_ROWS = 15

BINS = (0.0, 0.1, 0.2, 0.3, 0.45, 0.65, 3.0)


def spreads(rows: ClassRows, stated: CuratedRange) -> Iterator[tuple[float, float, int]]:
    """Stated and seen standard deviation of ln size, and the sources, of each axis that is known well enough."""
    readings = np.bincount(rows.owner, minlength=len(rows.kinds))
    strong = np.isin(rows.kinds, sorted(STRONG)) & (readings == 1)
    x = rows.x[np.searchsorted(rows.owner, np.arange(len(rows.kinds)))]
    _, code, counts = np.unique(np.asarray(rows.sources), return_inverse=True, return_counts=True)
    weights = (1 / (1 + counts / SOURCE_HALF))[code]
    for axis, (low, typical, high) in enumerate(_ends(rows, stated)):
        own = strong & ~np.isnan(x[:, axis])
        if low and typical and high and high > low and own.sum() >= LEAST_ROWS:
            seen = _spread(x[own, axis] - np.log(typical), weights[own])
            yield stated_spread(low, high), seen, len(set(np.asarray(rows.sources)[own].tolist()))


def _ends(rows: ClassRows, stated: CuratedRange) -> list[Triple]:
    """Low, typical and high by axis of the rows' frame."""
    ends = list(zip(stated.low, stated.typical, stated.high, strict=True))
    if rows.axes == EXTENTS:
        order = sorted(range(3), key=lambda axis: -(stated.typical[axis] or 0.0))
        return [ends[axis] for axis in order]
    return [ends[list(DIMENSIONS.values()).index(axis)] for axis in rows.axes]


def _spread(off: FloatArray, weights: FloatArray) -> float:
    """Standard deviation of a Gaussian nine tenths of which lie as near its middle as the sizes, `off` (n,) from it."""
    order = np.argsort(np.abs(off))
    mass = np.cumsum(weights[order]) / weights.sum()
    return float(np.abs(off)[order][np.searchsorted(mass, 0.9)]) / RANGE_SD


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("work", type=Path)
    ranges = {row.node_id: row for row in (*blind_ranges(), *curated_ranges()) if not row.standard}
    pairs: list[tuple[float, float, int]] = []
    for path in sorted(parser.parse_args().work.glob("clean-*.classes")):
        for rows in pickle.loads(path.read_bytes()):  # noqa: S301 - written by a build of this program
            stated = ranges.get(rows.node_id, ranges.get(rows.node_id.removesuffix("/other")))
            pairs += spreads(rows, stated) if stated else ()
    table = np.array([pair for pair in pairs if pair[1] > 0])  # (n, 3)
    lines = []
    for low, high in pairwise(BINS):
        own = table[(table[:, 0] >= low) & (table[:, 0] < high)]
        if len(own):
            lines.append((f"{low} to {high}", len(own), *(f"{value:.3f}" for value in np.median(own[:, :2], axis=0))))
    print_table(["stated", "axes", "median stated", "median seen"], lines)
    for least in (1, 2):
        own = np.log(table[table[:, 2] >= least][:, :2])
        power, level = np.polyfit(own[:, 0], own[:, 1], 1)
        print(f"{len(own)} axes of {least} sources or more: seen = {np.exp(level):.2f} stated^{power:.2f}")


if __name__ == "__main__":
    main()
