"""Rows that a reviewer took out of a class, with the reason (`data/curated/exclusions.csv`)."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from metric_base.errors import InputError
from metric_base.folders import taxonomy_directory
from taxonomy.levels import table_rows

__all__ = ["BadExclusion", "Exclusions", "shipped_exclusions"]

_COLUMNS = ("source", "node_id", "title", "reason")


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
        for where, row in table_rows(path, _COLUMNS):
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
