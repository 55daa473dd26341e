"""Rules of reviewers: rows that are excluded from a class, and how often people mean which child by a plain name.

Each row of `exclusions.csv` has a reason. In `frequencies.csv`, `stated` is the estimate of the reviewer and `count`
the number of objects to which the annotators of ScanNet and Matterport3D gave the name of the child (the plain name for
the leaf of plain objects). With a count, `weight` is its fraction, to which the estimate contributes fifty objects;
otherwise it is the estimate.
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

_DIRECTORY = taxonomy_directory().parent / "curated"


class BadRule(InputError):
    """A row of a table of rules is invalid: the message has file, line, expected and found value."""


class Exclusion(msgspec.Struct, frozen=True, kw_only=True):
    """A row of `exclusions.csv`: rows of a source by node, by a word of the title, or by both."""

    source: Annotated[str, msgspec.Meta(min_length=1)]
    node_id: str = ""
    title: str = ""
    reason: Annotated[str, msgspec.Meta(min_length=1)]

    def __post_init__(self) -> None:
        expect(bool(self.node_id or self.title), "node_id, title", "one of them", Unquoted("neither"))


class Frequency(msgspec.Struct, frozen=True, kw_only=True):
    """A row of `frequencies.csv`: the weight of a child under the name of its parent."""

    node_id: str
    child_id: str
    weight: Annotated[float, msgspec.Meta(gt=0, le=1e9)]
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Exclusions:
    """Rows that are not plain objects of their class.

    rules : by source, pairs of a node (empty: any) and a pattern of the title (None: any)
    """

    rules: dict[str, list[tuple[str, re.Pattern[str] | None]]]

    def covers(self, source: str, node_id: str, title: str) -> bool:
        """Return True if a row is excluded."""
        return any(
            node in ("", node_id) and (pattern is None or pattern.search(title) is not None)
            for node, pattern in self.rules.get(source, ())
        )


@cache
def exclusions(path: Path = _DIRECTORY / "exclusions.csv") -> Exclusions:
    """Read the exclusions; none if the file does not exist. The word of a title is matched as a whole, in any case.

    Raises
    ------
    BadRule
        A row has no source, no reason, or neither a node nor a word.
    """
    rules: dict[str, list[tuple[str, re.Pattern[str] | None]]] = {}
    for _, row in read_csv(path, Exclusion, BadRule) if path.is_file() else ():
        word = re.compile(rf"\b{re.escape(row.title)}\b", re.IGNORECASE) if row.title else None
        rules.setdefault(row.source, []).append((row.node_id, word))
    return Exclusions(rules)


@cache
def stated_frequencies(path: Path = _DIRECTORY / "frequencies.csv") -> Mapping[str, Mapping[str, float]]:
    """Read the weights of the children of each node; children without a row have the weight 0.

    Raises
    ------
    BadRule
        A weight is not positive, or a child occurs twice.
    """
    weights: dict[str, dict[str, float]] = {}
    for place, row in read_csv(path, Frequency, BadRule):
        children = weights.setdefault(row.node_id, {})
        with in_file(place, BadRule):
            expect(row.child_id not in children, "child_id", "a child, once for each node", row.child_id)
        children[row.child_id] = row.weight
    return weights
