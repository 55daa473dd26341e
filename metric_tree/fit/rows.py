"""What a row is worth to the fit of its class: by its kind, and by how many rows its source has there.

The rows of one class, and what ranges and means among them state of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from metric_base.arrays import FloatArray, IntArray
from metric_tree.fit.mixture import SPREAD_FLOOR, Belief, Rows
from metric_tree.tiers import Evidence

#: Weight of one row by kind, for the shape of a class's distribution; where its centre lies is decided by
#: `metric_tree.fit.evidence_model`. A maker's figure, a measurement and a norm are sizes of real objects. An artist's
#: model is plausible, not measured, and a museum keeps what is rare or old: about a third of a row. A category value
#: says what someone finds typical: a tenth. Ranges and means do not count as rows.
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
#: The kind of a range that a reviewer or a program wrote, and that of a size that a standard fixes.
JUDGED, NORM = "judged", "norm"
#: Kinds of statements about many objects at once.
STATEMENTS = frozenset({JUDGED, NORM, "statistic"})
#: Kinds that are likenesses of objects, rare objects, or what someone finds typical.
MODELS = ("asset", "museum", "default")
#: Rows at which a source has half of its largest possible weight in a class. More rows of one shop tell of the shop:
#: fifty already know its mean to a seventh of the spread, less than the disagreement between sources.
SOURCE_HALF = 50.0
#: Kinds that are sizes of objects as they are sold, used and measured.
STRONG = frozenset({"product", "measured", "standard"})
#: Kinds that are sizes of objects one can put a rule to; a museum's are real, if rare or old.
PHYSICAL = STRONG | {"museum"}
#: Sets of kinds by which a release is counted; a judged range, a norm and a mean are none of them.
EVIDENCE = {"any": frozenset(KIND_WEIGHT) - STATEMENTS, "physical": PHYSICAL, "strong": STRONG}
#: With so many whole strong rows a class needs no other: three statuettes called `man` must not pull at people.
ENOUGH_STRONG = 30
#: With so many whole strong rows the others weigh half.
HALF_STRONG = 3.0
#: Weight of a row that states one size where others state more: a height says a third of what a box does.
LONE_PART = 1 / 3
#: Whole strong rows that a stated range stands for beside weak ones.
RANGE_ROWS = 10.0
#: Models of artists that exclude museum rows: one may be anything, three agree or do not.
ENOUGH_MODELS = 3
#: Rows that the spread of a stated range counts in place of the parent's: two and a half times as many, for it is of
#: the class itself.
STATED_ROWS = 20.0
#: Part of a stated range's variance that objects of one scene share: the range holds everything that a class may be.
STATED_SHARED = 0.35


def row_weights(
    sources: Sequence[str],
    kinds: Sequence[str],
    scene_share: FloatArray | None = None,
    stated: IntArray | None = None,
    ranged: bool = False,
) -> FloatArray:
    """Weight of each row, (n,).

    A source of m rows weighs m / (1 + m / SOURCE_HALF) in all, at most `SOURCE_HALF`, the weight of a random effect
    whose variance is 1 / SOURCE_HALF of the variance within. Rows that state one size of three weigh `LONE_PART`.
    Weak rows weigh less with every whole strong one, nothing beside `ENOUGH_STRONG` of them.

    Parameters
    ----------
    scene_share : (n,) one over the rows of the class in the row's scene: rooms weigh, not boxes
    stated : (n,) sizes that each row states; a row is whole if it states two, or no row does
    ranged : whether the class has a stated range
    """
    names = np.asarray(kinds)
    share = np.ones(len(names)) if scene_share is None else scene_share
    sizes = np.ones(len(names)) if stated is None else stated
    _, code = np.unique(np.asarray(sources), return_inverse=True)
    counts = np.bincount(code, share)
    lone = (sizes == 1) & (sizes.max(initial=1) > 1)
    weights: FloatArray = (
        np.array([KIND_WEIGHT[kind] for kind in kinds])
        * share
        * np.where(lone, LONE_PART, 1.0)
        / (1 + counts[code] / SOURCE_HALF)
    )
    strong = np.isin(names, sorted(STRONG))
    whole = float(share[strong & ~lone].sum()) + RANGE_ROWS * ranged
    weak = 0.0 if whole >= ENOUGH_STRONG else HALF_STRONG / (HALF_STRONG + whole)
    return np.where(strong, weights, weak * weights)


def shares(kinds: Sequence[str], weights: FloatArray) -> dict[str, float]:
    """Share of the weights (n,) by kind, sum 1."""
    total = float(weights.sum())
    by_kind = {kind: float(weights[np.asarray(kinds) == kind].sum()) / total for kind in sorted(set(kinds))}
    return {kind: share for kind, share in by_kind.items() if share > 0}


@dataclass(frozen=True, slots=True, eq=False)
class ClassRows:
    """Rows of one class in one frame of axes, duplicates already collapsed.

    x : (m, 3) candidates in ln mm, NaN where missing; owner : (m,) the row of each; sources, kinds : (n,) of the rows;
    range_sd : (n, 3) standard deviation of ln size that a row states, NaN elsewhere; n : items that the rows stand for,
    ranges and means not counted; scene_share : (n,) one over the rows of the class in the row's scene.
    """

    node_id: str
    axes: tuple[str, ...]
    x: FloatArray
    owner: NDArray[np.intp]
    sources: tuple[str, ...]
    kinds: tuple[str, ...]
    range_sd: FloatArray
    n: int
    scene_share: FloatArray | None = None

    @property
    def is_stated(self) -> bool:
        """Return True if nothing but ranges and means is known of the class."""
        return set(self.kinds) <= STATEMENTS

    @property
    def weights(self) -> FloatArray:
        """Weight of each row in the shape of the class, (n,)."""
        first = self.x[np.searchsorted(self.owner, np.arange(len(self.sources)))]
        stated = (~np.isnan(first)).sum(axis=1)
        return row_weights(self.sources, self.kinds, self.scene_share, stated, bool((self.range_sd > 0).any()))

    @property
    def evidence(self) -> Evidence:
        """The counts behind the class's tier: published means count as the real objects that they are of."""
        kinds = np.asarray(self.kinds)
        real = np.isin(kinds, sorted(STRONG | {"statistic"}))
        first = self.x[np.searchsorted(self.owner, np.arange(len(self.sources)))]
        stated = (~np.isnan(first)).sum(axis=1)
        named = ["product" if one else "default" for one in real]
        weights = row_weights(self.sources, named, self.scene_share, stated)
        return Evidence(
            float(weights[real].sum()),
            len({source for source, one in zip(self.sources, real, strict=True) if one}),
            int(np.isin(kinds, MODELS).sum()),
            int((kinds == JUDGED).sum()),
        )

    @property
    def worth(self) -> float:
        """How much a row states about the spread on average, 0 to 1; one where only products and measurements count."""
        weights = self.weights
        counting = weights > 0
        if not counting.any():
            return 1.0
        plain = row_weights(self.sources, ["product"] * len(self.kinds), self.scene_share)
        return float(min(1.0, weights[counting].sum() / plain[counting].sum()))


@dataclass(frozen=True, slots=True, eq=False)
class Statements:
    """What ranges and means say, source by source: names, kinds (s,), means and sd (s, 3) of ln mm, NaN unstated."""

    names: tuple[str, ...]
    kinds: tuple[str, ...]
    means: FloatArray
    sd: FloatArray

    @property
    def spread(self) -> FloatArray:
        """Standard deviation of ln size that is stated of each axis, (3,), NaN of none."""
        return nanmean(self.sd)


def without_museums(rows: ClassRows) -> ClassRows:
    """The rows less those of museums, if anything else speaks of the class: a range, a product, some artists' models.

    What a museum keeps is of another time, and often of another sense of the word: a mirror is of bronze there.
    """
    kinds = np.asarray(rows.kinds)
    museum = kinds == "museum"
    models = int((kinds == "asset").sum()) >= ENOUGH_MODELS
    else_known = models or bool(np.isin(kinds, sorted(STRONG | {JUDGED})).any())
    return take_rows(rows, np.flatnonzero(~museum)) if museum.any() and else_known else rows


def without_open_numbers(rows: ClassRows) -> ClassRows:
    """The rows less those that state one number and not of which axis, if any other speaks of the class.

    The height of what lies flat is such a number: a laptop in a room is open, and a book stands on its shelf.
    """
    first = np.searchsorted(rows.owner, np.arange(len(rows.sources)))
    candidates = np.bincount(rows.owner, minlength=len(rows.sources))
    is_open = (candidates > 1) & ((~np.isnan(rows.x[first])).sum(axis=1) == 1)
    return take_rows(rows, np.flatnonzero(~is_open)) if is_open.any() and not is_open.all() else rows


def take_rows(rows: ClassRows, chosen: NDArray[np.intp]) -> ClassRows:
    """The class with the rows `chosen` (m,), ascending; the items that it stands for are the same."""
    kept = np.isin(rows.owner, chosen)
    return replace(
        rows,
        x=rows.x[kept],
        owner=np.searchsorted(chosen, rows.owner[kept]),
        sources=tuple(rows.sources[row] for row in chosen),
        kinds=tuple(rows.kinds[row] for row in chosen),
        range_sd=rows.range_sd[chosen],
        scene_share=None if rows.scene_share is None else rows.scene_share[chosen],
    )


def weighted_rows(rows: ClassRows) -> tuple[Rows, list[str], list[str]]:
    """The rows that count, with their weights, and the source and kind of each."""
    weights = rows.weights
    counting = np.flatnonzero(weights > 0)
    sources, kinds = ([names[row] for row in counting] for names in (rows.sources, rows.kinds))
    return Rows(rows.x, rows.owner, weights).subset(counting), sources, kinds


def statements_of(rows: ClassRows) -> Statements:
    """The ranges and means among the rows, those of one source together; a row of open axes states nothing."""
    first = rows.x[np.searchsorted(rows.owner, np.arange(len(rows.sources)))]  # (n, 3)
    plain = np.bincount(rows.owner, minlength=len(rows.sources)) == 1
    stating = np.array([kind in STATEMENTS for kind in rows.kinds], dtype=bool) & plain
    names = sorted({name for name, states in zip(rows.sources, stating, strict=True) if states})
    own = [stating & (np.asarray(rows.sources) == name) for name in names]
    return Statements(
        tuple(names),
        tuple(rows.kinds[int(np.flatnonzero(mask)[0])] for mask in own),
        np.array([nanmean(first[mask]) for mask in own]).reshape(-1, 3),
        np.array([nanmean(rows.range_sd[mask]) for mask in own]).reshape(-1, 3),
    )


def nanmean(values: FloatArray) -> FloatArray:
    """Mean over the rows of (n, 3), NaN where none is known."""
    known = (~np.isnan(values)).sum(axis=0)
    return np.asarray(np.where(known > 0, np.nansum(values, axis=0) / np.maximum(known, 1), np.nan))


def own_belief(belief: Belief, statements: Statements) -> Belief:
    """The parent's belief, with the sizes and the spread that are stated of the class itself in place of the parent's.

    The sizes say which axis a number is of where a row leaves it open; they are off by the part of the range that
    objects of one scene share.
    """
    means = nanmean(statements.means)
    if not np.isnan(means).all():
        rows = max(belief.mean_rows, (1 - STATED_SHARED) / STATED_SHARED)
        belief = replace(belief, mean=np.where(np.isnan(means), belief.mean, means), mean_rows=rows)
    stated = ~np.isnan(statements.spread)
    if not stated.any():
        return belief
    own = np.sqrt(np.diagonal(belief.covariance))
    part = math.sqrt(1 - STATED_SHARED)
    scale = np.where(stated, part * statements.spread, own) / own
    covariance = belief.covariance * np.outer(scale, scale)
    floor = min(SPREAD_FLOOR, float(np.nanmin(statements.spread)) / 2)
    return replace(belief, covariance=covariance, covariance_rows=STATED_ROWS, floor=floor)


def within_range(shared: FloatArray, statements: Statements) -> FloatArray:
    """B (3, 3), on no axis with more than its part of a stated range's variance."""
    bound = np.sqrt(STATED_SHARED) * np.nan_to_num(statements.spread, nan=np.inf)
    sd = np.sqrt(np.diagonal(shared))
    scale = np.minimum(1.0, bound / np.maximum(sd, 1e-12))
    return np.asarray(shared * np.outer(scale, scale))


def extents_of(table: pa.Table) -> FloatArray:
    """Column `extents_mm` as (n, 3), NaN beyond the last."""
    return matrix_of_lists(table["extents_mm"])


def matrix_of_lists(column: pa.ChunkedArray) -> FloatArray:
    """A list column as (n, 3), NaN beyond the last."""
    lengths = pc.fill_null(pc.list_value_length(column), 0).to_numpy(zero_copy_only=False).astype(np.intp)
    rows = np.repeat(np.arange(len(lengths)), lengths)
    place = np.arange(len(rows)) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    padded = np.full((len(lengths), 3), np.nan)
    padded[rows, place] = pc.list_flatten(column).to_numpy(zero_copy_only=False)
    return padded
