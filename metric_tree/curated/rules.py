"""Rules of reviewers: rows that are excluded from a class, and how often people mean which child by a plain name.

`exclusions.csv` lists rows with a reason. In `frequencies.csv`, `stated` is the reviewer's estimate; if `count` has the
number of objects to which the annotators of ScanNet and Matterport3D gave the name of the child (the plain name for the
leaf of plain objects), `weight` is their share, with the estimate as fifty objects more; otherwise it is the estimate.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated

import msgspec

from metric_base.errors import InputError, Unquoted, expect, in_file
from metric_base.folders import taxonomy_directory
from metric_base.records import read_csv


class _ExclusionRow(msgspec.Struct, kw_only=True):
    """A row of `exclusions.csv`."""

    source: Annotated[str, msgspec.Meta(min_length=1)]
    node_id: str = ""
    title: str = ""
    reason: Annotated[str, msgspec.Meta(min_length=1)]


class _FrequencyRow(msgspec.Struct, kw_only=True):
    """A row of `frequencies.csv`."""

    node_id: str
    child_id: str
    weight: Annotated[float, msgspec.Meta(gt=0, le=1e9)]
    reason: str = ""


class BadExclusion(InputError):
    """A row of the table of exclusions that cannot be used: file, line, expected, found."""


@dataclass(frozen=True, slots=True)
class Exclusions:
    """Rows of one source that are not the plain object: by node, by a word of the title, or both.

    rules : by source, pairs of a node (empty: any) and a pattern of the title (None: any)
    """

    rules: dict[str, list[tuple[str, re.Pattern[str] | None]]]

    def covers(self, source: str, node_id: str, title: str) -> bool:
        """Return True if a row is excluded."""
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
        for place, row in read_csv(path, _ExclusionRow, BadExclusion):
            with in_file(place, BadExclusion):
                expect(bool(row.node_id or row.title), "node_id, title", "one of them", Unquoted("neither"))
            word = re.compile(rf"\b{re.escape(row.title)}\b", re.IGNORECASE) if row.title else None
            rules.setdefault(row.source, []).append((row.node_id, word))
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
    table = path or taxonomy_directory().parent / "curated" / "frequencies.csv"
    for place, row in read_csv(table, _FrequencyRow, BadFrequency):
        children = weights.setdefault(row.node_id, {})
        with in_file(place, BadFrequency):
            expect(row.child_id not in children, "child_id", "a child, once for each node", row.child_id)
        children[row.child_id] = row.weight
    return weights
