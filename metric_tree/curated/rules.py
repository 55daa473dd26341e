"""How often people mean which child by a plain name (`data/curated/frequencies.csv`).

`stated` is what a reviewer said. Where `count` says how many objects ScanNet's and Matterport3D's annotators gave the
child's name (the plain name of the leaf of plain objects), `weight` is their share with the reviewer's word as fifty
objects more; else it is the reviewer's word.

Rows that a reviewer took out of a class, with the reason (`data/curated/exclusions.csv`).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from metric_base.errors import InputError
from metric_base.folders import taxonomy_directory
from taxonomy.levels import table_rows

EXCLUSION_COLUMNS = ("source", "node_id", "title", "reason")
FREQUENCY_COLUMNS = ("node_id", "child_id", "weight", "reason")


class BadExclusion(InputError):
    """A row of the table of exclusions that cannot be used: file, line, expected, found."""


@dataclass(frozen=True, slots=True)
class Exclusions:
    """Rows of one source that are not the plain object: by node, by a word of the title, or both.

    rules : by source, pairs of a node (empty: any) and a pattern of the title (None: any)
    """

    rules: dict[str, list[tuple[str, re.Pattern[str] | None]]]

    def covers(self, source: str, node_id: str, title: str) -> bool:
        """Whether a row is excluded."""
        return any(
            node in ("", node_id) and (pattern is None or pattern.search(title) is not None)
            for node, pattern in self.rules.get(source, ())
        )

    @classmethod
    def of_table(cls, path: Path) -> Exclusions:
        """The rules of a table: a word of a title counts whole, in any case.

        Raises
        ------
        BadExclusion
            A row has no source, no reason, or neither a node nor a word.
        """
        rules: dict[str, list[tuple[str, re.Pattern[str] | None]]] = {}
        for where, row in table_rows(path, EXCLUSION_COLUMNS):
            for name in ("source", "reason"):
                if not row[name]:
                    raise BadExclusion(f"{where}: {name}: expected a value; found none")
            if not (row["node_id"] or row["title"]):
                raise BadExclusion(f"{where}: node_id, title: expected one of them; found neither")
            word = re.compile(rf"\b{re.escape(row['title'])}\b", re.IGNORECASE) if row["title"] else None
            rules.setdefault(row["source"], []).append((row["node_id"], word))
        return cls(rules)


@cache
def shipped_exclusions() -> Exclusions:
    """The project's own table; a taxonomy without one excludes nothing."""
    path = taxonomy_directory().parent / "curated" / "exclusions.csv"
    return Exclusions.of_table(path) if path.is_file() else Exclusions({})


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
    for where, row in table_rows(
        path or taxonomy_directory().parent / "curated" / "frequencies.csv", FREQUENCY_COLUMNS
    ):
        try:
            weight = float(row["weight"])
        except ValueError:
            weight = 0.0
        children = weights.setdefault(row["node_id"], {})
        if not 0 < weight < float("inf") or row["child_id"] in children:
            raise BadFrequency(f"{where}: weight: expected one positive number for a child; found {row['weight']!r}")
        children[row["child_id"]] = weight
    return weights
