"""Rows of one class for its fit, their weights, and the statements (ranges, norms, published means) among them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from metric_base.arrays import FloatArray, IntArray
from metric_tree.fit.mixture import SPREAD_FLOOR, NormalInverseWishart, Rows
from metric_tree.prior import STATED_SHARED
from metric_tree.tiers import Evidence

#: Weight of a row by kind for the shape of the distribution; `metric_tree.fit.evidence_model` determines the mean. A
#: catalogue size, a measurement and a norm are sizes of real objects. The model of an artist is plausible but not
#: measured, and museums keep rare or old objects: about a third of a row. A default of a category is an opinion about
#: the typical size: a tenth. Ranges and means are not rows.
KIND_WEIGHT = {
    "product": 1.0,
    "measured": 1.0,
    "standard": 1.0,
    "asset": 0.35,
    "museum": 0.35,
    "default": 0.1,
    "judged": 0.0,
    "statistic": 0.0,
    "norm": 0.0,
}
#: Kind of a range that a reviewer or a program wrote, and of a size that a standard fixes.
JUDGED, NORM = "judged", "norm"
#: Kinds of statements about many objects at once.
STATEMENTS = frozenset({JUDGED, NORM, "statistic"})
#: Kinds of models, of rare objects, and of opinions about the typical size.
MODELS = ("asset", "museum", "default")
#: Rows at which a source has half of its maximum weight in a class. Further rows of a shop describe the shop: 50
#: already determine its mean to 1/7 of the standard deviation, less than the disagreement between sources.
SOURCE_HALF_ROWS = 50.0
#: Kinds that are sizes of objects as they are sold, used and measured.
STRONG = frozenset({"product", "measured", "standard"})
#: Kinds that are sizes of physical objects, including those of museums.
PHYSICAL = STRONG | {"museum"}
#: Sets of kinds by which the items of a release are counted, without statements.
EVIDENCE = {"any": frozenset(KIND_WEIGHT) - STATEMENTS, "physical": PHYSICAL, "strong": STRONG}
#: Number of complete strong rows from which weak rows have no weight: three statuettes called `man` must not shift the
#: size of people.
WEAK_ZERO_WEIGHT_ROWS = 30
#: Number of complete strong rows at which weak rows have half their weight.
WEAK_HALF_WEIGHT_ROWS = 3.0
#: Weight of a row with a single size if other rows have more: a height is a third of a box.
SINGLE_SIZE_WEIGHT = 1 / 3
#: Number of complete strong rows to which a stated range is equivalent, for the weight of weak rows.
RANGE_EQUIVALENT_ROWS = 10.0
#: Minimum number of artists' models for the exclusion of museum rows: a single model may be wrong, three can be
#: compared.
MIN_MODELS = 3
#: Weight of the standard deviation of a stated range, in rows. It is 2.5 times the weight of the parent, because the
#: range describes the class itself.
STATED_ROWS = 20.0


def row_weights(
    sources: Sequence[str],
    kinds: Sequence[str],
    row_share: FloatArray | None = None,
    n_stated: IntArray | None = None,
    has_range: bool = False,
) -> FloatArray:
    """Compute the weight of each row, (n,).

    A source of m rows has the total weight m / (1 + m / SOURCE_HALF_ROWS), as a random effect with the variance
    W / SOURCE_HALF_ROWS. Rows with one size of three are multiplied by `SINGLE_SIZE_WEIGHT`. The weight of weak rows
    decreases with the number of complete strong rows and is 0 from `WEAK_ZERO_WEIGHT_ROWS`.

    Parameters
    ----------
    sources, kinds : (n,) sequence of str
        Source and kind of evidence of each row.
    row_share : (n,) float, optional
        Reciprocal of the number of rows of the class in the scene of the row, so that rooms are counted, not boxes; of
        a norm, its share in circulation.
    n_stated : (n,) int, optional
        Number of sizes of each row. A row is complete if it has two, or if no row has.
    has_range : bool
        Whether the class has a stated range.
    """
    names = np.asarray(kinds)
    share = np.ones(len(names)) if row_share is None else row_share
    sizes = np.ones(len(names)) if n_stated is None else n_stated
    _, code = np.unique(np.asarray(sources), return_inverse=True)
    counts = np.bincount(code, share)
    is_single = (sizes == 1) & (sizes.max(initial=1) > 1)
    by_kind: FloatArray = np.array([KIND_WEIGHT[kind] for kind in kinds])
    weights = by_kind * share * np.where(is_single, SINGLE_SIZE_WEIGHT, 1.0) / (1 + counts[code] / SOURCE_HALF_ROWS)
    strong = np.isin(names, sorted(STRONG))
    complete = float(share[strong & ~is_single].sum()) + RANGE_EQUIVALENT_ROWS * has_range
    weak = 0.0 if complete >= WEAK_ZERO_WEIGHT_ROWS else WEAK_HALF_WEIGHT_ROWS / (WEAK_HALF_WEIGHT_ROWS + complete)
    return np.where(strong, weights, weak * weights)


def shares(kinds: Sequence[str], weights: FloatArray) -> dict[str, float]:
    """Return the fraction of the weights (n,) by kind, sum 1."""
    total = float(weights.sum())
    by_kind = {kind: float(weights[np.asarray(kinds) == kind].sum()) / total for kind in sorted(set(kinds))}
    return {kind: share for kind, share in by_kind.items() if share > 0}


@dataclass(frozen=True, slots=True, eq=False)
class ClassRows:
    """Rows of one class in one frame of axes, without duplicates; m candidates in total (`metric_tree.fit.mixture`)."""

    node_id: str
    axes: tuple[str, ...]
    x: FloatArray  #: (m, 3) candidates in ln mm, NaN if missing.
    owner: NDArray[np.intp]  #: (m,) row of each candidate.
    sources: tuple[str, ...]  #: (n,)
    kinds: tuple[str, ...]  #: (n,)
    range_sd: FloatArray  #: (n, 3) stated standard deviation of ln size, NaN without.
    n: int  #: Number of items of the class, without ranges and means.
    #: (n,) reciprocal of the number of rows in the scene of the row; of a norm, its share in circulation.
    row_share: FloatArray | None = None

    @property
    def is_stated(self) -> bool:
        """Return True if the class has only ranges and means."""
        return set(self.kinds) <= STATEMENTS

    @property
    def first(self) -> FloatArray:
        """First candidate of each row, (n, 3) in ln mm."""
        return self.x[np.searchsorted(self.owner, np.arange(len(self.sources)))]

    @property
    def weights(self) -> FloatArray:
        """Weight of each row for the shape of the class, (n,)."""
        n_stated = (~np.isnan(self.first)).sum(axis=1)
        return row_weights(self.sources, self.kinds, self.row_share, n_stated, bool((self.range_sd > 0).any()))

    @property
    def evidence(self) -> Evidence:
        """Counts for the tier of the class; published means are counted as real objects."""
        kinds = np.asarray(self.kinds)
        real = np.isin(kinds, sorted(STRONG | {"statistic"}))
        n_stated = (~np.isnan(self.first)).sum(axis=1)
        real_or_weak = ["product" if one else "default" for one in real]
        weights = row_weights(self.sources, real_or_weak, self.row_share, n_stated)
        return Evidence(
            float(weights[real].sum()),
            len({source for source, one in zip(self.sources, real, strict=True) if one}),
            int(np.isin(kinds, MODELS).sum()),
            int((kinds == JUDGED).sum()),
        )

    @property
    def information(self) -> float:
        """Mean information of a row about the standard deviation, relative to a product: 0 to 1."""
        weights = self.weights
        has_weight = weights > 0
        if not has_weight.any():
            return 1.0
        as_products = row_weights(self.sources, ["product"] * len(self.kinds), self.row_share)
        return float(min(1.0, weights[has_weight].sum() / as_products[has_weight].sum()))


@dataclass(frozen=True, slots=True, eq=False)
class Statements:
    """Ranges and means of s sources."""

    names: tuple[str, ...]  #: (s,)
    kinds: tuple[str, ...]  #: (s,)
    means: FloatArray  #: (s, 3) of ln mm, NaN if not stated.
    sd: FloatArray  #: (s, 3) standard deviation of ln size, NaN if not stated.
    of_items: NDArray[np.bool_]  #: (3,) whether rows of items state the axis.

    @property
    def spread(self) -> FloatArray:
        """Mean stated standard deviation of ln size of each axis, (3,), NaN without."""
        return nanmean(self.sd)


def without_museums(rows: ClassRows) -> ClassRows:
    """Return the class without its museum rows, if it has a range, a product, or `MIN_MODELS` models.

    Objects of museums are of another time, and often of another sense of the word: their mirrors are of bronze.
    """
    kinds = np.asarray(rows.kinds)
    museum = kinds == "museum"
    has_models = int((kinds == "asset").sum()) >= MIN_MODELS
    has_others = has_models or bool(np.isin(kinds, sorted(STRONG | {JUDGED})).any())
    return take_rows(rows, np.flatnonzero(~museum)) if museum.any() and has_others else rows


def without_open_numbers(rows: ClassRows) -> ClassRows:
    """Return the class without rows that state a single number of an unknown axis, if there are other rows.

    The height of a flat object is such a number: a laptop in a room is open, and a book is upright on its shelf.
    """
    candidates = np.bincount(rows.owner, minlength=len(rows.sources))
    is_open = (candidates > 1) & ((~np.isnan(rows.first)).sum(axis=1) == 1)
    return take_rows(rows, np.flatnonzero(~is_open)) if is_open.any() and not is_open.all() else rows


def take_rows(rows: ClassRows, chosen: NDArray[np.intp]) -> ClassRows:
    """Return the class with the rows `chosen` (m,), ascending; its number of items is unchanged."""
    keep = np.isin(rows.owner, chosen)
    return replace(
        rows,
        x=rows.x[keep],
        owner=np.searchsorted(chosen, rows.owner[keep]),
        sources=tuple(rows.sources[row] for row in chosen),
        kinds=tuple(rows.kinds[row] for row in chosen),
        range_sd=rows.range_sd[chosen],
        row_share=None if rows.row_share is None else rows.row_share[chosen],
    )


def weighted_rows(rows: ClassRows) -> tuple[Rows, list[str], list[str]]:
    """Return the rows with a positive weight, and the source and kind of each."""
    weights = rows.weights
    counting = np.flatnonzero(weights > 0)
    sources, kinds = ([names[row] for row in counting] for names in (rows.sources, rows.kinds))
    return Rows(rows.x, rows.owner, weights).subset(counting), sources, kinds


def statements_of(rows: ClassRows) -> Statements:
    """Return the ranges and means among the rows, combined by source; rows with an unknown axis order are ignored."""
    first = rows.first
    has_one_order = np.bincount(rows.owner, minlength=len(rows.sources)) == 1
    is_statement = np.array([kind in STATEMENTS for kind in rows.kinds], dtype=bool) & has_one_order
    names = sorted({name for name, states in zip(rows.sources, is_statement, strict=True) if states})
    by_source = [is_statement & (np.asarray(rows.sources) == name) for name in names]
    return Statements(
        tuple(names),
        tuple(rows.kinds[int(np.flatnonzero(mask)[0])] for mask in by_source),
        np.array([nanmean(first[mask]) for mask in by_source]).reshape(-1, 3),
        np.array([nanmean(rows.range_sd[mask]) for mask in by_source]).reshape(-1, 3),
        np.asarray((~np.isnan(first[~np.isin(rows.kinds, sorted(STATEMENTS))])).any(axis=0)),
    )


def nanmean(values: FloatArray) -> FloatArray:
    """Return the mean over the rows of (n, 3), NaN for columns without a value; no warning, unlike `numpy.nanmean`."""
    known = (~np.isnan(values)).sum(axis=0)
    return np.asarray(np.where(known > 0, np.nansum(values, axis=0) / np.maximum(known, 1), np.nan))


def class_belief(belief: NormalInverseWishart, statements: Statements) -> NormalInverseWishart:
    """Replace mean and covariance of the prior of a class by its stated sizes and standard deviations.

    The stated sizes determine axes that a row leaves open. Their error is the fraction `STATED_SHARED` of the variance
    of the range, which objects of one scene have in common. The weight of the covariance is that of a range only if the
    ranges state each axis that items state: the height of compact cars is no evidence for their lengths.
    """
    means = nanmean(statements.means)
    if not np.isnan(means).all():
        rows = max(belief.mean_rows, (1 - STATED_SHARED) / STATED_SHARED)
        belief = replace(belief, mean=np.where(np.isnan(means), belief.mean, means), mean_rows=rows)
    is_stated = ~np.isnan(statements.spread)
    if not is_stated.any():
        return belief
    sd = np.sqrt(np.diagonal(belief.covariance))
    part = math.sqrt(1 - STATED_SHARED)
    scale = np.where(is_stated, part * statements.spread, sd) / sd
    covariance = belief.covariance * np.outer(scale, scale)
    if (statements.of_items & ~is_stated).any():
        return replace(belief, covariance=covariance)
    floor = min(SPREAD_FLOOR, float(np.nanmin(statements.spread)) / 2)
    return replace(belief, covariance=covariance, covariance_rows=STATED_ROWS, floor=floor)


def within_range(shared: FloatArray, statements: Statements) -> FloatArray:
    """Limit the variances of B (3, 3) to the fraction `STATED_SHARED` of the variances of the stated ranges."""
    bound = np.sqrt(STATED_SHARED) * np.nan_to_num(statements.spread, nan=np.inf)
    sd = np.sqrt(np.diagonal(shared))
    scale = np.minimum(1.0, bound / np.maximum(sd, 1e-12))
    return np.asarray(shared * np.outer(scale, scale))


def extents_of(table: pa.Table) -> FloatArray:
    """Return the column `extents_mm` as an array (n, 3), NaN beyond the last extent."""
    return matrix_of_lists(table["extents_mm"])


def matrix_of_lists(column: pa.ChunkedArray) -> FloatArray:
    """Return a list column as an array (n, 3), NaN beyond the last value."""
    lengths = pc.fill_null(pc.list_value_length(column), 0).to_numpy(zero_copy_only=False).astype(np.intp)
    rows = np.repeat(np.arange(len(lengths)), lengths)
    index = np.arange(len(rows)) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    padded = np.full((len(lengths), 3), np.nan)
    padded[rows, index] = pc.list_flatten(column).to_numpy(zero_copy_only=False)
    return padded
