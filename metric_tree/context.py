"""Regions and years: effect of a context (region, year) on the size of a class, by kriging of the source means.

The mean ln size m_j of the rows of one source, region and span of years differs from the centre mu of the class by

    m_j - mu = r(region_j) + t(year_j) + c_j + e(source_j) + noise_j

on each axis. All terms are Gaussian. Their variances are the fractions `region`, `year`, `own` and the remainder of the
covariance B between sources. r is equal within a country, and has the correlation `kin` within a region. t has the
correlation exp(-|difference| / `years`) between years. c is independent for each context, because the models of a
manufacturer are not independent draws. The effect of a context is the conditional mean of r + t. The conditional
variance remains in B (simple kriging; Cressie 1993, Statistics for Spatial Data, 3.2). The mean of a population, such
as registered cars, has neither c nor e: the remainder of B is an effect of the population, correlated over years, so
that it has more weight than catalogues. Without data close to the context the effect is zero and B is unchanged.

This module imports only NumPy, because queries load it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple  # defined in a quarter of the time of a dataclass, in each query

import numpy as np

from metric_base.arrays import BoolArray, FloatArray
from metric_base.errors import InputError
from metric_base.regions import REGIONS, country_of, region_of

#: Sources whose means are of complete populations, such as registered cars; they have no error of a sample. A mean over
#: the boxes of a data set is as precise, but not of a population.
POPULATIONS = frozenset({"car_fleet_context", "populations"})

#: Year that a query without a year means, if there are populations of its region (`metric_tree.populations`).
PRESENT = 2025.0

#: Standard deviation of ln size of the definition of a population: which vehicles are cars, with mirrors or without.
DEFINITION_SD = 0.01

#: Correlation between the populations of a region and of one of its countries.
POPULATION_KIN = 0.7

#: Minimum and maximum valid year.
YEARS = (1000, 2100)


class Where(NamedTuple):
    """A context of a query."""

    region: str | None = None  #: A region or a country code.
    year: float | None = None

    def __str__(self) -> str:
        parts = (self.region, None if self.year is None else f"{self.year:g}")
        return ", ".join(part for part in parts if part is not None)


def where_of(asked: Where | Mapping[str, Any] | str) -> Where:
    """Parse a context: a mapping, or a text such as `region=europe,year=2011`, `germany`, `1985` or `usa, 1985`.

    Raises
    ------
    InputError
        A name other than region and year, an unknown region or country, or an invalid year.

    >>> where_of("region=DE, year=2011"), where_of("usa, 1985")
    (Where(region='DE', year=2011.0), Where(region='US', year=1985.0))
    """
    if isinstance(asked, Where):
        return asked
    if isinstance(asked, str):
        pairs = [part.rpartition("=") for part in asked.split(",")]
        default = {True: "year", False: "region"}
        asked = {name.strip() or default[value.strip().isdigit()]: value.strip() for name, _, value in pairs}
    if not asked or not set(asked) <= {"region", "year"}:
        raise InputError(f"where: expected region, year or both; found {', '.join(map(str, asked)) or 'neither'}")
    region, year = (asked.get(name) for name in ("region", "year"))
    return Where(None if region is None else _region_code(str(region)), None if year is None else _year(year))


def _region_code(text: str) -> str | None:
    """Return the code of a country or a region; None for the world."""
    code = country_of(text.strip())
    if code is None:
        name = text.strip()
        code = name.upper() if len(name) == 2 else name.lower().replace(" ", "-").replace("_", "-")
    if region_of(code) is None:
        known = ", ".join(sorted(REGIONS))
        raise InputError(f"where: region: expected {known}, a country or its two letters; found {text!r}")
    return None if code == "world" else code


def _year(value: Any) -> float:
    try:
        year = float(value)
    except (TypeError, ValueError):
        year = 0.0
    if not YEARS[0] <= year <= YEARS[1]:
        raise InputError(f"where: year: expected a year from {YEARS[0]} to {YEARS[1]}; found {value!r}")
    return year


@dataclass(frozen=True, slots=True, eq=False)
class Context:
    """Offset of the rows of one source, region and span of years from their class."""

    source: str
    region: str | None  #: Code of a country, or a region.
    year: float | None  #: Mean year.
    offset: FloatArray  #: (d,) of ln size, NaN if not stated.
    variance: FloatArray  #: (d,) sampling variance of the offset.

    @property
    def key(self) -> tuple[object, ...]:
        """Equal for copies of the context."""
        return self.source, self.region, self.year, self.offset.tobytes()

    def axes(self, chosen: Sequence[int]) -> Context:
        """Return the context on the given axes."""
        axes = list(chosen)
        return Context(self.source, self.region, self.year, self.offset[axes], self.variance[axes])

    def row(self) -> dict[str, Any]:
        """Return an entry of the column `contexts` (`metric_tree.release.schema.PRIORS`)."""
        known = {"source": self.source, "region": self.region, "year": self.year}
        return known | {"offset": self.offset.tolist(), "variance": self.variance.tolist()}

    @classmethod
    def of_row(cls, row: Mapping[str, Any]) -> Context:
        """Return the context of an entry of the column `contexts`."""
        offset, variance = (np.array(row[name], dtype=float) for name in ("offset", "variance"))
        return cls(row["source"], row["region"], row["year"], offset, variance)


class KnownContexts(NamedTuple):
    """Regions (with codes of countries) and years with data of a node."""

    regions: tuple[str, ...] = ()
    years: tuple[int, ...] = ()

    def __str__(self) -> str:
        first, last = (self.years[0], self.years[-1]) if self.years else (0, 0)
        years = f"{first}" if first == last else f"years from {first} to {last}"
        return ", ".join((*self.regions, *([years] if self.years else [])))

    def covers(self, where: Where, max_years: float) -> bool:
        """Return True if there are data of the region, or of a year within `max_years` of the year."""
        region, year = region_of(where.region) if where.region else None, where.year
        has_region = region is not None and any(region_of(one) == region for one in self.regions)
        return has_region or (year is not None and any(abs(one - year) <= max_years for one in self.years))


def known_contexts(contexts: Iterable[tuple[str | None, float | None]]) -> KnownContexts:
    """Return the regions and years of contexts (region, year), without the world."""
    contexts = tuple(contexts)
    regions = {region for region, _ in contexts if region and region != "world"}
    years = {round(year) for _, year in contexts if year is not None}
    return KnownContexts(tuple(sorted(regions)), tuple(sorted(years)))


class ContextModel(NamedTuple):
    """Fractions of B by region and by year, fitted to all classes (`metric_tree.fit.contexts`)."""

    region: float  #: Fraction of B that is an effect of the region.
    year: float  #: Fraction of B that is an effect of the year.
    own: float  #: Fraction of B that is an effect of a single context.
    kin: float  #: Correlation of the effects of countries of one region.
    years: float  #: Years in which the correlation between years decreases to 1 / e.

    def record(self) -> dict[str, float]:
        """Return the model as in the manifest of a release."""
        return {name: round(value, 4) for name, value in self._asdict().items()}


class Effect(NamedTuple):
    """Effect of a context on a class."""

    offset: FloatArray  #: (d,) added to ln size.
    factor: FloatArray  #: (d,) factor on the variances of B, 0 to 1.


def context_effect(contexts: Sequence[Context], shared: FloatArray, where: Where, model: ContextModel) -> Effect:
    """Compute the effect of a context on a class by simple kriging; see the equation of the module.

    Parameters
    ----------
    contexts : sequence of Context
        Contexts of the class.
    shared : (d,) float
        Variances of B.
    where : Where
        Context of the query.
    model : ContextModel
        Fractions of B.
    """
    effect = Effect(np.zeros(len(shared)), np.ones(len(shared)))
    for axis, between in enumerate(shared):
        stated = [one for one in contexts if not np.isnan(one.offset[axis])]
        if not stated or between <= 0:
            continue
        noise = np.array([one.variance[axis] for one in stated])
        is_population = np.array([one.source in POPULATIONS for one in stated])
        noise[is_population] = DEFINITION_SD**2
        similarity = _similarity(tuple((one.source, one.region, one.year) for one in stated))
        covariance = between * similarity.covariance(model, is_population) + np.diag(noise)
        common, population = query_covariance(stated, where, model)
        population = (1 - model.region - model.year) * is_population * population
        query = between * (common + population)
        weights = np.linalg.solve(covariance, query)
        effect.offset[axis] = weights @ [one.offset[axis] for one in stated]
        max_explained = model.region + model.year + population.max()
        effect.factor[axis] = 1 - min(float(weights @ query) / between, max_explained)
    return effect


def query_covariance(contexts: Sequence[Context], where: Where, model: ContextModel) -> tuple[FloatArray, FloatArray]:
    """Return the covariance (n,) of r + t with the context `where`, as a fraction of B, and of populations, 0 to 1.

    Without a year the context is of any year: r + t has no covariance over time, a population an average one.
    """
    places = [(one.region or f"unknown {index}") for index, one in enumerate(contexts)]
    country, region = _same_country_or_region([where.region or "nowhere"], places)
    years = [None if one.year is None or where.year is None else abs(one.year - where.year) for one in contexts]
    distance = np.array([np.inf if one is None else one for one in years])
    common = model.region * (country + model.kin * region)[0] + model.year * np.exp(-distance / model.years)
    population = _population_correlation([where.region or "world"], [one.region or "unknown" for one in contexts])[0]
    distance = np.array([model.years / 2 if one is None else one for one in years])
    return np.asarray(common), np.asarray(population * np.exp(-distance / model.years))


class ContextSimilarity(NamedTuple):
    """Similarities of pairs of n contexts, (n, n) each."""

    source: FloatArray  #: 1 if the source is equal, else 0.
    population: FloatArray  #: Correlation of the populations of the regions, 0 to 1.
    country: FloatArray  #: 1 if the country is equal, else 0.
    region: FloatArray  #: 1 if only the region is equal, else 0.
    years: FloatArray  #: Absolute difference of the years, infinite if one is unknown.

    @classmethod
    def of(cls, contexts: Sequence[tuple[str, str | None, float | None]]) -> ContextSimilarity:
        """Return the similarities of contexts (source, region, year); an unknown value equals only itself."""
        sources = np.array([source for source, _, _ in contexts])
        known = np.array([np.nan if year is None else year for _, _, year in contexts])
        years = np.abs(known[:, None] - known)
        unknown = np.where(np.eye(len(known)) > 0, 0.0, np.inf)
        places = [(region or f"unknown {index}") for index, (_, region, _) in enumerate(contexts)]
        country, region = _same_country_or_region(places, places)
        source = (sources[:, None] == sources).astype(float)
        population = _population_correlation(places, places)
        return cls(source, population, country, region, np.where(np.isnan(years), unknown, years))

    def covariance(self, model: ContextModel, is_population: BoolArray | None = None) -> FloatArray:
        """Return the covariance (n, n) of r + t + c + e, as a fraction of B; populations (n,) have neither c nor e."""
        source = (1 - model.region - model.year - model.own) * self.source + model.own * np.eye(len(self.source))
        if is_population is not None:
            common = (1 - model.region - model.year) * self.population * np.exp(-self.years / model.years)
            source = np.where(np.logical_or.outer(is_population, is_population), 0.0, source)
            source = source + np.outer(is_population, is_population) * common
        region = model.region * (self.country + model.kin * self.region)
        return np.asarray(source + region + model.year * np.exp(-self.years / model.years))


#: Similarities of the contexts of the last priors: a table of regions and years needs those of a node many times.
_similarity = lru_cache(maxsize=16)(ContextSimilarity.of)


def _population_correlation(a: Sequence[str], b: Sequence[str]) -> FloatArray:
    """Return the correlation (n, m) of populations: `POPULATION_KIN` for each step from a country to its region."""
    regions_a, regions_b = (np.array([region_of(place) or place for place in places]) for places in (a, b))
    steps_a, steps_b = (np.array([place not in REGIONS for place in places], dtype=int) for places in (a, b))
    is_related = (regions_a[:, None] == regions_b) & (regions_a != "world")[:, None]
    related = np.where(is_related, POPULATION_KIN ** (steps_a[:, None] + steps_b), 0.0)
    return np.where(np.asarray(a)[:, None] == np.asarray(b), 1.0, related)


def _same_country_or_region(a: Sequence[str], b: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """Return 1 for pairs of the same country, and 1 for pairs of only the same region, (n, m) each; never the world."""
    regions_a, regions_b = (np.array([region_of(place) or place for place in places]) for places in (a, b))
    country = (np.asarray(a)[:, None] == np.asarray(b)) & ~np.isin(np.asarray(a), sorted(REGIONS))[:, None]
    region = (regions_a[:, None] == regions_b) & (regions_a != "world")[:, None]
    return country.astype(float), (region & ~country).astype(float)
