"""The columns that a declared table reads, looked for in the header of each of its files."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from crawler.imports.declaration import Table
from metric_base.errors import FieldError, InputError, Unquoted

__all__ = ["FIELD", "MissingColumn", "expect_columns"]

#: A column in a template, with its filter: `{brand}`, `{title|head}`.
FIELD = re.compile(r"\{([^{}|]+)(?:\|(\w+))?\}")

#: Names that mean a column in every table.
_GIVEN = frozenset({"file", "row"})


class MissingColumn(InputError):
    """A file lacks a declared column: another table, or a later form of it, that would yield nothing or nonsense."""


def expect_columns(table: Table, header: Sequence[str]) -> None:
    """See that the header has every column that the declaration reads.

    Raises
    ------
    FieldError
        One is missing: it names those that are missing and those that there are.
    """
    known = _GIVEN.union(table.read, header)
    missing = sorted({column for column in _named_columns(table) if column not in known})
    if missing:
        present = ", ".join(map(repr, header))[:200]
        raise FieldError("columns", ", ".join(map(repr, missing)), Unquoted(present))


def _named_columns(table: Table) -> Iterator[str]:
    """Every column that the table's axes, templates and rules name."""
    for axis in table.columns_of_axes.values():
        yield axis.column
        if axis.minus:
            yield axis.minus
    texts = [table.text, table.id, table.title, table.brand, table.url, table.year, table.region, table.synset]
    texts += [table.scene, table.statistic, table.relative_sd, table.attribution]
    texts += [*table.category, table.kind, table.licence, *(cases.column for cases in table.read.values())]
    for rule in (*table.only, *table.reject, *table.flag):
        if "{" in rule.column:
            texts.append(rule.column)
        else:
            yield rule.column
    yield from table.names
    yield from (match[1] for text in texts for match in FIELD.finditer(text))
