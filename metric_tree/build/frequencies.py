"""How often people mean which child by a plain name (`data/curated/frequencies.csv`).

`stated` is what a reviewer said. Where `count` says how many objects ScanNet's and Matterport3D's annotators gave the
child's name (the plain name of the leaf of plain objects), `weight` is their share with the reviewer's word as fifty
objects more; else it is the reviewer's word.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path

from metric_base.errors import InputError
from metric_base.folders import taxonomy_directory
from taxonomy.levels import table_rows

__all__ = ["BadFrequency", "stated_frequencies"]

_COLUMNS = ("node_id", "child_id", "weight", "reason")


class BadFrequency(InputError):
    """A row of the table of frequencies that cannot be used: file, line, expected, found."""


@cache
def stated_frequencies(path: Path | None = None) -> Mapping[str, Mapping[str, float]]:
    """Weights by child of each node that the table has; children that it does not name weigh nothing.

    Raises
    ------
    BadFrequency
        A weight is no positive number, or a child is named twice.
    """
    weights: dict[str, dict[str, float]] = {}
    for where, row in table_rows(path or taxonomy_directory().parent / "curated" / "frequencies.csv", _COLUMNS):
        try:
            weight = float(row["weight"])
        except ValueError:
            weight = 0.0
        children = weights.setdefault(row["node_id"], {})
        if not 0 < weight < float("inf") or row["child_id"] in children:
            raise BadFrequency(f"{where}: weight: expected one positive number for a child; found {row['weight']!r}")
        children[row["child_id"]] = weight
    return weights
