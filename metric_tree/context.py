"""Where and when: how far objects of a region and a year lie from their class, and how well that is known.

The mean ln size m_j of the rows of one source, region and span of years lies off the class's centre by

    m_j - mu = r(region_j) + t(year_j) + c_j + e(source_j) + noise_j

on each axis: Gaussian, with the shares `region`, `year`, `own` and the rest of the class's covariance between sources
B. r is shared within a country wholly, within a region by the part `kin`; t is that of years by exp(-apart / `years`);
c is of one context alone, for the models of a maker's list are no independent draws. The
effect of a context that is asked for is the conditional mean of r + t; what that leaves of their variance stays in B
(simple kriging; Cressie 1993, 3.2). The mean of a population, such as registered cars, has neither c nor e: what is
left of B is then its own, shared with the years near it, so that it outranks catalogues. Without data near the context
the effect is nothing and B stays what it was.

Importing this module needs NumPy alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple  # which takes a quarter of a dataclass's time in each query

import numpy as np

from metric_base.arrays import BoolArray, FloatArray
from metric_base.errors import InputError
from metric_base.regions import REGIONS, country_of, region_of

#: Sources whose means are of whole populations, such as registered cars. They have no error of their own, and at most
#: a definition's, one standard deviation of ln size: which vehicles are cars, with mirrors or without. A mean over many
#: boxes of a data set is as precise and is none.
POPULATIONS, DEFINITION_SD = frozenset({"car_fleet_context"}), 0.01

#: What the population of a region and that of one of its countries have in common of their own effect.
POPULATION_KIN = 0.7

#: Years that are no mistyping.
YEARS = (1000, 2100)


class Where(NamedTuple):
    """A context that is asked for: a region or a country's code, and a year; None is not stated."""

    region: str | None = None
    year: float | None = None

    def __str__(self) -> str:
        parts = (self.region, None if self.year is None else f"{self.year:g}")
        return ", ".join(part for part in parts if part is not None)


def where_of(asked: Where | Mapping[str, Any] | str) -> Where:
    """The context of a mapping or of a text such as `region=europe,year=2011`, `germany`, `1985` or `usa, 1985`.

    Raises
    ------
    InputError
        Another name than region and year, a place that is neither a region nor a country, or no year.

    >>> where_of("region=DE, year=2011"), where_of("usa, 1985")
    (Where(region='DE', year=2011.0), Where(region='US', year=1985.0))
    """
    if isinstance(asked, Where):
        return asked
    if isinstance(asked, str):
        pairs = [part.rpartition("=") for part in asked.split(",")]
        plain = {True: "year", False: "region"}
        asked = {name.strip() or plain[value.strip().isdigit()]: value.strip() for name, _, value in pairs}
    if not asked or not set(asked) <= {"region", "year"}:
        raise InputError(f"where: expected region, year or both; found {', '.join(map(str, asked)) or 'neither'}")
    return Where(_place(asked.get("region")), _year(asked.get("year")))


def _place(text: Any) -> str | None:
    if text is None:
        return None
    place = str(text).strip()
    place = country_of(place) or (
        place.upper() if len(place) == 2 else place.lower().replace(" ", "-").replace("_", "-")
    )
    if region_of(place) is None:
        known = ", ".join(sorted(REGIONS))
        raise InputError(f"where: region: expected {known}, a country or its two letters; found {text!r}")
    return None if place == "world" else place


def _year(text: Any) -> float | None:
    if text is None:
        return None
    try:
        year = float(text)
    except (TypeError, ValueError):
        year = 0.0
    if not YEARS[0] <= year <= YEARS[1]:
        raise InputError(f"where: year: expected a year from {YEARS[0]} to {YEARS[1]}; found {text!r}")
    return year


@dataclass(frozen=True, slots=True, eq=False)
class Context:
    """Rows of one source in one region and span of years: how far they lie from their class.

    region : code of a country, a region, or None; year : the mean one, or None; offset : (d,) of ln size, NaN where
    unstated; variance : (d,) of its sampling error.
    """

    source: str
    region: str | None
    year: float | None
    offset: FloatArray
    variance: FloatArray

    @property
    def key(self) -> tuple[object, ...]:
        """What a copy of the context has in common with it."""
        return self.source, self.region, self.year, self.offset.tobytes()

    def axes(self, chosen: Sequence[int]) -> Context:
        """The same on some of the axes."""
        axes = list(chosen)
        return Context(self.source, self.region, self.year, self.offset[axes], self.variance[axes])

    def row(self) -> dict[str, Any]:
        """The context as one entry of the column `contexts` (`metric_tree.release.schema.PRIORS`)."""
        known = {"source": self.source, "region": self.region, "year": self.year}
        return known | {"offset": self.offset.tolist(), "variance": self.variance.tolist()}

    @classmethod
    def of_row(cls, row: Mapping[str, Any]) -> Context:
        """The context of an entry of the column."""
        offset, variance = (np.array(row[name], dtype=float) for name in ("offset", "variance"))
        return cls(row["source"], row["region"], row["year"], offset, variance)


class KnownContexts(NamedTuple):
    """The places (regions and codes of countries) and years of which a node's sources say something."""

    regions: tuple[str, ...] = ()
    years: tuple[int, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.regions or self.years)

    def __str__(self) -> str:
        first, last = (self.years[0], self.years[-1]) if self.years else (0, 0)
        years = f"{first}" if first == last else f"years from {first} to {last}"
        return ", ".join((*self.regions, *([years] if self.years else [])))

    def covers(self, where: Where, near: float) -> bool:
        """Return True if something is known of the place or its region, or of years that are as `near` to the year."""
        region, year = region_of(where.region) if where.region else None, where.year
        of_place = region is not None and any(region_of(one) == region for one in self.regions)
        return of_place or (year is not None and any(abs(one - year) <= near for one in self.years))


def known_contexts(contexts: Iterable[Context]) -> KnownContexts:
    """What is known of places and years; the world is not a place."""
    kept = tuple(contexts)
    regions = {one.region for one in kept if one.region and one.region != "world"}
    years = {round(one.year) for one in kept if one.year is not None}
    return KnownContexts(tuple(sorted(regions)), tuple(sorted(years)))


class ContextModel(NamedTuple):
    """How much of B is region and how much is year, learned over all classes (`metric_tree.fit.contexts`).

    region, year, own : shares of B, together at most 1; kin : share of a country's effect that its region has; years :
    those in which the effect of a year falls to a third.
    """

    region: float
    year: float
    own: float
    kin: float
    years: float

    def record(self) -> dict[str, float]:
        """The model as the manifest has it."""
        return {name: round(value, 4) for name, value in self._asdict().items()}


class Effect(NamedTuple):
    """What a context does: offset (d,) to ln size; factor (d,), the part of each variance of B that stays, 0 to 1."""

    offset: FloatArray
    factor: FloatArray


def context_effect(contexts: Sequence[Context], shared: FloatArray, where: Where, model: ContextModel) -> Effect:
    """The effect of a context on a class.

    Parameters
    ----------
    contexts : of the class; shared : (d,) variances of B
    """
    effect = Effect(np.zeros(len(shared)), np.ones(len(shared)))
    for axis, between in enumerate(shared):
        stated = [one for one in contexts if not np.isnan(one.offset[axis])]
        if not stated or between <= 0:
            continue
        noise = np.array([one.variance[axis] for one in stated])
        population = np.array([one.source in POPULATIONS for one in stated])
        noise[population] = DEFINITION_SD**2
        own = (1 - model.region - model.year) * population * _common_population(stated, where, model)
        whole = between * _likeness(stated).covariance(model, population) + np.diag(noise)
        near = between * (_nearness(stated, where, model) + own)
        solved = np.linalg.solve(whole, near)
        effect.offset[axis] = solved @ [one.offset[axis] for one in stated]
        most = model.region + model.year + (own.max() if len(own) else 0.0)
        effect.factor[axis] = 1 - min(float(solved @ near) / between, most)
    return effect


class Likeness(NamedTuple):
    """What pairs of contexts have in common, (n, n): source, place, country, region alone (0 or 1), years apart."""

    source: FloatArray
    place: FloatArray
    country: FloatArray
    region: FloatArray
    apart: FloatArray

    @classmethod
    def of(cls, sources: Sequence[str], regions: Sequence[str | None], years: Sequence[float | None]) -> Likeness:
        """The likeness of contexts; an unknown place or year is like none but itself."""
        known = np.array([np.nan if year is None else year for year in years])
        apart = np.abs(known[:, None] - known)
        unlike = np.where(np.eye(len(known)) > 0, 0.0, np.inf)
        places = [(region or f"unknown {row}") for row, region in enumerate(regions)]
        country, region = _kinship(places, places)
        same = (np.asarray(sources)[:, None] == np.asarray(sources)).astype(float)
        return cls(same, _population_kinship(places, places), country, region, np.where(np.isnan(apart), unlike, apart))

    def covariance(self, model: ContextModel, population: BoolArray | None = None) -> FloatArray:
        """Covariance (n, n) of r + t + c + e, in parts of B; without c and e for the means of populations, (n,)."""
        source = (1 - model.region - model.year - model.own) * self.source + model.own * np.eye(len(self.source))
        if population is not None:
            common = (1 - model.region - model.year) * self.place * np.exp(-self.apart / model.years)
            source = np.where(np.logical_or.outer(population, population), 0.0, source)
            source = source + np.outer(population, population) * common
        region = model.region * (self.country + model.kin * self.region)
        return np.asarray(source + region + model.year * np.exp(-self.apart / model.years))


def _common_population(contexts: Sequence[Context], where: Where, model: ContextModel) -> FloatArray:
    """(n,) what the populations of contexts have in common with that of `where`, 0 to 1, beside r and t."""
    place = _population_kinship([where.region or "nowhere"], [one.region or "unknown" for one in contexts])[0]
    # without a year it may be any
    apart = np.array([
        model.years / 2 if one.year is None or where.year is None else abs(one.year - where.year) for one in contexts
    ])  # fmt: skip
    return np.asarray(place * np.exp(-apart / model.years))


def _population_kinship(a: Sequence[str], b: Sequence[str]) -> FloatArray:
    """(n, m) what the populations of places have in common: of two countries, what both have with their region."""

    def kinship(one: str, other: str) -> float:
        if one == other:
            return 1.0
        regions = {region_of(one) or one, region_of(other) or other}
        steps = 2 - (one in REGIONS) - (other in REGIONS)
        return 0.0 if len(regions) > 1 or "world" in regions else POPULATION_KIN**steps

    return np.array([[kinship(one, other) for other in b] for one in a])


def _likeness(contexts: Sequence[Context]) -> Likeness:
    return Likeness.of(*zip(*((one.source, one.region, one.year) for one in contexts), strict=True))


def _nearness(contexts: Sequence[Context], where: Where, model: ContextModel) -> FloatArray:
    """Covariance (n,) of r + t of the contexts with those of `where`, in parts of B."""
    places = [(one.region or f"unknown {row}") for row, one in enumerate(contexts)]
    country, region = _kinship([where.region or "nowhere"], places)
    apart = np.array(
        [np.inf if one.year is None or where.year is None else abs(one.year - where.year) for one in contexts]
    )
    near = model.region * (country + model.kin * region)[0] + model.year * np.exp(-apart / model.years)
    return np.asarray(near)


def _kinship(a: Sequence[str], b: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """Return whether pairs of places are one country, and whether they share only the region, (n, m) each.

    The world is not a place.
    """
    of_a, of_b = (np.array([region_of(place) or place for place in places]) for places in (a, b))
    same = (np.asarray(a)[:, None] == np.asarray(b)) & ~np.isin(np.asarray(a), sorted(REGIONS))[:, None]
    alike = (of_a[:, None] == of_b) & (of_a != "world")[:, None]
    return same.astype(float), (alike & ~same).astype(float)
