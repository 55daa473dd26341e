"""Named variants of categories (`data/curated/variants.csv`), and sizes that a name states (`stated_sizes.csv`).

A variant is one real size of a category: an LP of records, a container of 20 feet. The table is shipped with the
program and applies to every release. A rule of `stated_sizes.csv` gives sizes for a number in a name: the length of a
television from its diagonal.

Both replace the marginal of a prior in the dimensions that they state. With x = ln(size), H the rows of the identity
for the stated dimensions, y their ln sizes with covariance R, and the gain K = C H' (H C H')^-1 of a component with
mean m and covariance C, the component becomes

    m + K (y - H m),   C - K H C + K R K'

with a weight proportional to w N(y; H m, H C H' + R) (Jeffrey's rule). The components are then one Gaussian with the
mean and the covariance of their mixture.
"""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import msgspec
import numpy as np

from metric_base.errors import InputError, expect, in_file
from metric_base.folders import data_folder
from metric_base.length_units import MILLIMETRES, UNIT_WORDS, unit
from metric_base.records import read_csv
from metric_base.regions import region_of
from metric_base.statistics import mixture_log_density
from metric_tree.axes import AXES, EXTENTS
from metric_tree.context import PRESENT, Where
from metric_tree.prior import STATED_SHARED, Prior
from taxonomy.words.spelling import plain_fold, singular_phrases

#: Document of a size that is customary in trade and that no standard fixes; the tier of such a variant is `judged`.
TRADE = "trade size"
#: Minimum standard deviation of ln size of a variant: a tolerance below 0.1 % is below the error of any measurement.
MIN_LOG_SD = 0.001

Text: TypeAlias = Annotated[str, msgspec.Meta(min_length=1)]
Millimetres: TypeAlias = Annotated[float, msgspec.Meta(gt=0, le=1e9)]

#: Millilitres in one unit, by word.
LITRES = {"l": 1000.0, "liter": 1000.0, "litre": 1000.0, "ml": 1.0, "cl": 10.0}
LITRES |= {"liters": 1000.0, "litres": 1000.0}
_WORDS = sorted((re.escape(word) for word in (*UNIT_WORDS, *LITRES)), key=len, reverse=True)
#: A number with its unit; the number is not a part of a ratio, a product or a list.
QUANTITY = re.compile(rf"(?<![\w.,/×:])(\d+(?:[.,]\d+)?)[\s-]*({'|'.join(_WORDS)})(?![\w/]|\s*\d)", re.IGNORECASE)
#: A number of seats, and a size of shoes in Paris points.
SEATS = re.compile(r"(?<![\w.,/])(\d{1,2})[\s-]*seat(?:s|er|ers)?\b", re.IGNORECASE)
SHOE_SIZE = re.compile(r"\b(?:eu\s+)?(?:size|eu)\s+(\d\d(?:[.,]5)?)(?![\w.,/])", re.IGNORECASE)


class BadVariant(InputError):
    """A row of a table of variants or of rules is invalid: the message has file, line, expected and found value."""


class Variant(msgspec.Struct, frozen=True, kw_only=True):
    """A row of `variants.csv`: one size of a category, from size - tolerance to size + tolerance."""

    node_id: Text
    name: Text
    aliases: str = ""  #: Names that mean the variant, separated by semicolons.
    region: str | None = None
    years: Annotated[str, msgspec.Meta(pattern=r"^\d{4}-(\d{4})?$")] | None = None
    share: Annotated[float, msgspec.Meta(gt=0, le=1)] | None = None  #: Fraction of the objects in circulation.
    length_mm: Millimetres | None = None
    length_tolerance_mm: Millimetres | None = None
    width_mm: Millimetres | None = None
    width_tolerance_mm: Millimetres | None = None
    height_mm: Millimetres | None = None
    height_tolerance_mm: Millimetres | None = None
    document: Text
    clause: Text
    source: Text
    written: Annotated[str, msgspec.Meta(pattern=r"^\d{4}-\d\d-\d\d$")]

    def __post_init__(self) -> None:
        for axis in AXES:
            size, tolerance = getattr(self, f"{axis}_mm"), getattr(self, f"{axis}_tolerance_mm")
            is_valid = (size is None) == (tolerance is None) and (size is None or tolerance < size)
            expect(is_valid, axis, "a size with a smaller tolerance, or neither", [size, tolerance])
        expect(bool(self.sizes), "sizes", "at least one axis", list(self.sizes))

    @property
    def sizes(self) -> dict[str, tuple[float, float]]:
        """Size and tolerance in mm of each stated axis; for a node with sorted extents, length is the longest."""
        values = ((axis, getattr(self, f"{axis}_mm"), getattr(self, f"{axis}_tolerance_mm")) for axis in AXES)
        return {axis: (size, tolerance) for axis, size, tolerance in values if size is not None}

    def is_of(self, year: float | None) -> bool:
        """Return whether the variant is in use in a year, or today for None; one without years always is."""
        first, _, last = (self.years or "-").partition("-")
        return float(first or 0) <= (year or PRESENT) <= float(last or math.inf)

    @property
    def norm(self) -> str | None:
        """Document and clause; None for a trade size."""
        return None if self.document == TRADE else f"{self.document}, {self.clause}"

    @property
    def stated(self) -> StatedSize:
        """The sizes, which replace those of a prior; size +- tolerance is the central 90 % interval (1.645 sd)."""
        sizes = {axis: (mm, max(tolerance / mm / 1.645, MIN_LOG_SD)) for axis, (mm, tolerance) in self.sizes.items()}
        return StatedSize(self.name, sizes, self)


@dataclass(frozen=True, slots=True, eq=False)
class StatedSize:
    """Sizes that a name states, in addition to its node."""

    name: str  #: Name of the variant, or the number with its unit.
    sizes: Mapping[str, tuple[float, float]]  #: Size in mm and standard deviation of ln size by axis.
    variant: Variant | None = None

    def of(self, prior: Prior, are_sorted: bool) -> Prior:
        """Return a prior with the marginals of the stated sizes, by the equation in the docstring of this module.

        Parameters
        ----------
        prior : Prior
        are_sorted : bool
            Whether length, width and height of the category are its sorted extents.
        """
        sizes = dict(self.sizes)
        if prior.dims[0] in EXTENTS and len(sizes) == len(AXES):
            sizes = dict(zip(EXTENTS, sorted(sizes.values(), reverse=True), strict=True))
        elif prior.dims[0] in EXTENTS:
            sizes = {EXTENTS[AXES.index(axis)]: size for axis, size in sizes.items() if are_sorted}
        rows = [index for index, dim in enumerate(prior.dims) if dim in sizes]
        if not rows:
            return prior
        y, sd = np.array([sizes[prior.dims[row]] for row in rows]).T
        y = np.log(y)
        covariances = prior.covariances + prior.shared_covariance
        log_weights, means, posterior = [], [], []
        for weight, mean, covariance in zip(prior.weights, prior.means, covariances, strict=True):
            stated = covariance[np.ix_(rows, rows)]
            gain = np.linalg.solve(stated, covariance[rows]).T
            density = mixture_log_density(y[None], np.ones(1), mean[None, rows], (stated + np.diag(sd**2))[None])[0]
            log_weights.append(math.log(max(weight, 1e-300)) + float(density))
            means.append(mean + gain @ (y - mean[rows]))
            posterior.append(covariance - gain @ covariance[rows] + gain @ np.diag(sd**2) @ gain.T)
        weights = np.exp(np.array(log_weights) - max(log_weights))
        weights /= weights.sum()
        mean = weights @ np.array(means)
        off = np.array(means) - mean
        covariance = np.tensordot(weights, np.array(posterior) + off[:, :, None] * off[:, None, :], axes=1)
        covariance = (covariance + covariance.T) / 2 + MIN_LOG_SD**2 / 10 * np.eye(len(mean))
        is_whole = len(rows) == len(prior.dims)
        norm = self.variant.norm if self.variant else None
        return replace(
            prior,
            weights=np.ones(1),
            means=mean[None],
            covariances=((1 - STATED_SHARED) * covariance)[None],
            shared_covariance=STATED_SHARED * covariance,
            heldout_log_density=None,
            contexts=(),
            tier="norm" if norm and is_whole else "judged" if is_whole else prior.tier,
            norm=norm,
        )


class StatedSizeRule(msgspec.Struct, frozen=True, kw_only=True):
    """A row of `stated_sizes.csv`: sizes of a category and its descendants from a number in the name.

    The size of an axis is `factor * number ** exponent` in mm; the number is in mm, ml, seats or Paris points.
    """

    node_id: Text
    quantity: Literal["length", "volume", "seats", "shoe size"]
    axes: Annotated[str, msgspec.Meta(pattern=r"^\w+ [\d.]+(; \w+ [\d.]+)*$")]  #: Axis and factor, such as `length 1`.
    exponent: Annotated[float, msgspec.Meta(gt=0, le=1)]
    low: Annotated[float, msgspec.Meta(gt=0)]  #: Minimum number; below, the number has another meaning.
    high: Annotated[float, msgspec.Meta(gt=0)]
    sd_log: Annotated[float, msgspec.Meta(gt=0, le=0.5)]
    reason: Text
    source: Text
    written: Text

    def __post_init__(self) -> None:
        expect(self.low < self.high, "high", f"a number above {self.low:g}", self.high)
        axes = [part.split()[0] for part in self.axes.split("; ")]
        expect(set(axes) <= set(AXES), "axes", ", ".join(AXES), self.axes)

    def stated(self, number: float, words: str) -> StatedSize:
        """Return the sizes for a number; `words` is the number as it stands in the name."""
        parts = (part.split() for part in self.axes.split("; "))
        sizes = {axis: (float(factor) * number**self.exponent, self.sd_log) for axis, factor in parts}
        return StatedSize(words, sizes)


@cache
def variants(path: Path | None = None) -> Mapping[str, tuple[Variant, ...]]:
    """Read the variants of each node of the project, or of another file.

    Raises
    ------
    BadVariant
        A size is not positive or lacks its tolerance, a cell is empty, or two rows have the same name or alias.
    """
    by_node: defaultdict[str, list[Variant]] = defaultdict(list)
    names: set[str] = set()
    for place, row in read_csv(path or data_folder() / "curated" / "variants.csv", Variant, BadVariant):
        with in_file(place, BadVariant):
            is_new = all(row.name != one.name for one in by_node[row.node_id])
            expect(is_new, "name", "a name that no other variant of the node has", row.name)
            for alias in filter(None, row.aliases.split("; ")):
                expect(variant_form(alias) not in names, "aliases", "an alias that no other variant has", alias)
                names.add(variant_form(alias))
        by_node[row.node_id].append(row)
    return {node_id: tuple(rows) for node_id, rows in by_node.items()}


@cache
def _by_alias() -> Mapping[str, Variant]:
    rows = (row for node_rows in variants().values() for row in node_rows)
    return {variant_form(alias): row for row in rows for alias in row.aliases.split("; ") if alias}


def named_variant(text: str) -> Variant | None:
    """Return the variant that a text names; case, hyphens, plurals and the spelling of units are ignored.

    >>> named_variant("20-foot containers").name, named_variant("chair")
    ('1CC, 20 feet', None)
    """
    form = variant_form(text)
    known = _by_alias()
    return next((known[one] for one in (form, *singular_phrases(form)) if one in known), None)


def variant_form(text: str) -> str:
    """Return a normalised name whose numbers are followed by the symbol of their unit."""

    def with_symbol(match: re.Match[str]) -> str:
        return f"{match[1].replace(',', '.')} {unit_symbol(match[2].lower())} "

    return plain_fold(QUANTITY.sub(with_symbol, text))


def unit_symbol(word: str) -> str:
    """Return the symbol of a unit word of `QUANTITY` in lower case: `in` for `inches`, `l` for `litres`."""
    return unit(word) or ("l" if LITRES[word] == LITRES["l"] else word)


@cache
def stated_size_rules(path: Path | None = None) -> tuple[StatedSizeRule, ...]:
    """Read the rules of the project, or of another file. Raises BadVariant for an invalid row."""
    table = path or data_folder() / "curated" / "stated_sizes.csv"
    return tuple(row for _, row in read_csv(table, StatedSizeRule, BadVariant))


@dataclass(frozen=True, slots=True)
class Quantity:
    """A number with its unit in a name."""

    kind: str  #: `StatedSizeRule.quantity`.
    number: float  #: In mm, ml, seats or Paris points.
    words: str  #: The number and its unit as in the name.
    rest: str  #: The name without them.

    def stated(self, node_ids: Iterable[str]) -> StatedSize | None:
        """Return the sizes for the first of some nodes that has a rule; None without a rule or out of its range."""
        rules = {rule.node_id: rule for rule in stated_size_rules() if rule.quantity == self.kind}
        rule = next((rules[node_id] for node_id in node_ids if node_id in rules), None)
        return rule.stated(self.number, self.words) if rule and rule.low <= self.number <= rule.high else None


def quantity_in(text: str) -> Quantity | None:
    """Return the number with a unit in a name; None if there is none, if there are several, or without other words.

    >>> quantity_in("55-inch TV").number, quantity_in("1.5 l bottle").kind, quantity_in("2 x 4 m rug")
    (1397.0, 'volume', None)
    """
    if len(re.findall(r"\d+(?:[.,]\d+)?", text)) != 1:
        return None
    for kind, pattern in (("seats", SEATS), ("shoe size", SHOE_SIZE), ("length", QUANTITY)):
        match = pattern.search(text)
        rest = " ".join((text[: match.start()] + " " + text[match.end() :]).split()) if match else ""
        if match and rest:
            number, word = float(match[1].replace(",", ".")), match[2].lower() if kind == "length" else ""
            if word in LITRES:
                return Quantity("volume", number * LITRES[word], match[0].strip(), rest)
            factor = MILLIMETRES[unit(word) or "mm"] if kind == "length" else 1.0
            return Quantity(kind, round(number * factor, 6), match[0].strip(), rest)
    return None


def regional_prior(prior: Prior, rows: Sequence[Variant], where: Where, are_sorted: bool) -> Prior | None:
    """Return the mixture of the variants of a region or country and a year, weighted by their shares (1 if not stated).

    A country without variants has those of its region. None if there are none, or if a category whose tier is not
    `norm` has variants without shares: other sizes than those of the table may be frequent.
    """
    places = (where.region, region_of(where.region)) if where.region else ()
    found = ([row for row in rows if row.region == place and row.is_of(where.year)] for place in places)
    local = next(filter(None, found), [])
    if not local or (prior.tier != "norm" and any(row.share is None for row in local)):
        return None
    weights = np.array([row.share or 1.0 for row in local])
    parts = [row.stated.of(prior, are_sorted) for row in local]
    return replace(
        parts[0],
        weights=weights / weights.sum(),
        means=np.concatenate([one.means for one in parts]),
        covariances=np.concatenate([one.covariances for one in parts]),
        shared_covariance=parts[0].shared_covariance,
        norm="; ".join(row.norm for row in local if row.norm) or None,
        note=f"{where}: {', '.join(row.name for row in local)}",
    )
