"""What a row is worth to the fit of its class: by its kind, and by how many rows its source has there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from metric_base.arrays import FloatArray, IntArray

__all__ = [
    "EVIDENCE",
    "JUDGED",
    "KIND_WEIGHT",
    "MODELS",
    "NORM",
    "SOURCE_HALF",
    "STATEMENTS",
    "STRONG",
    "row_weights",
    "shares",
]

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
