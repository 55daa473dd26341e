"""Median sizes of the objects of a region and a year, written by a language model after documents that each row names.

The table `populations.csv` is shipped with the program and applies to every release, as the variants do. A row is a
context without an error of the source (`metric_tree.context.POPULATIONS`): the prior of its place and year has its
median, and the weight of the row decreases with the difference in years, and is multiplied by 0.7 if only its region is
that of the query. Rows of other countries have no effect. A row without a year holds for every year. Rows of the world
give a trend in time, for queries with a year.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np

from metric_base.arrays import grouped
from metric_base.errors import InputError, expect
from metric_base.folders import data_folder
from metric_base.records import read_csv
from metric_base.regions import region_of
from metric_tree.axes import AXES, EXTENTS
from metric_tree.context import DEFINITION_SD, PRESENT, YEARS, Context, Where
from metric_tree.prior import Prior
from metric_tree.variants import Millimetres, Text


class BadPopulation(InputError):
    """A row of the table is invalid: the message has file, line, expected and found value."""


class Population(msgspec.Struct, frozen=True, kw_only=True):
    """A row of `populations.csv`; for a node with sorted extents, length is the longest."""

    node_id: Text
    region: Text  #: Code of a country, or a region.
    year: Annotated[float, msgspec.Meta(ge=YEARS[0], le=YEARS[1])] | None = None  #: None: every year.
    length_mm: Millimetres | None = None
    width_mm: Millimetres | None = None
    height_mm: Millimetres | None = None
    document: Text
    source: Text
    written: Text

    def __post_init__(self) -> None:
        expect(region_of(self.region) is not None, "region", "a region or the two letters of a country", self.region)
        expect(any(getattr(self, f"{axis}_mm") for axis in AXES), "sizes", "at least one axis", "none")

    def context(self, prior: Prior, where: Where) -> Context:
        """Return the context with the offset from the median of a prior, for a query at `where`."""
        sizes = (self.length_mm, self.width_mm, self.height_mm)
        axes = AXES if prior.dims[0] in AXES else EXTENTS
        stated = np.array([sizes[axes.index(dim)] or np.nan for dim in prior.dims])
        offset = np.log(stated / prior.quantile(0.5))
        region = where.region or "world" if self.region == "world" else self.region
        year = where.year if self.year is None else self.year
        return Context("populations", region, year, offset, np.where(np.isnan(offset), np.nan, DEFINITION_SD**2))


@cache
def populations(path: Path | None = None) -> Mapping[str, Sequence[Population]]:
    """Read the populations of each node of the project, or of another file. Raises BadPopulation for an invalid row."""
    rows = read_csv(path or data_folder() / "curated" / "populations.csv", Population, BadPopulation)
    return grouped((row.node_id, row) for _, row in rows)


def population_contexts(node_id: str, prior: Prior, where: Where) -> tuple[Where, tuple[Context, ...]]:
    """Return the contexts for a query: of its country and region, or else of the world if the query has a year.

    The query is returned with the year `PRESENT` if there are contexts and it has no year.
    """
    rows = populations().get(node_id, ())
    places = (where.region, region_of(where.region)) if where.region else ()
    chosen = [row for row in rows if row.region in places]
    if not chosen and where.year is not None:
        chosen = [row for row in rows if row.region == "world"]
    dated = where._replace(year=where.year or PRESENT) if chosen else where
    return dated, tuple(row.context(prior, dated) for row in chosen)
