"""What a row is worth to the fit of its class: by its kind, and by how many rows its source has there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from metric_base.arrays import FloatArray

__all__ = ["EVIDENCE", "KIND_WEIGHT", "SOURCE_HALF", "row_weights", "shares"]

#: Weight of one row by kind. A maker's figure, a measurement and a norm are sizes of real things. An artist's model is
#: plausible, not measured, and a museum keeps what is rare or old: about a third of a row. A category value says what
#: someone finds typical: a tenth. A curated range counts only where little else exists (`row_weights`).
KIND_WEIGHT = {
    "product": 1.0,
    "measured": 1.0,
    "standard": 1.0,
    "asset": 0.35,
    "museum": 0.35,
    "default": 0.1,
    "curated": 0.0,
}

#: Rows at which a source has half of its largest possible weight in a class. More rows of one shop tell of the shop:
#: fifty already know its mean to a seventh of the spread, less than the disagreement between sources.
SOURCE_HALF = 50.0

#: Kinds that are sizes of things as they are sold, used and measured.
STRONG = frozenset({"product", "measured", "standard"})

#: Kinds that are sizes of things one can put a rule to; a museum's are real, if rare or old.
PHYSICAL = STRONG | {"museum"}

#: Sets of kinds by which a release is counted; a curated range is not one of them.
EVIDENCE = {"any": frozenset(KIND_WEIGHT) - {"curated"}, "physical": PHYSICAL, "strong": STRONG}

#: With so many strong rows a class needs no other: three statuettes called `man` must not pull at the sizes of people.
ENOUGH_STRONG = 30

#: While the real rows weigh less than this, a curated range counts as one row: two toy bicycles are no fleet.
FEW = 3.0


def row_weights(sources: Sequence[str], kinds: Sequence[str]) -> FloatArray:
    """Weight of each row, (n,).

    A source of m rows weighs m / (1 + m / SOURCE_HALF) in all, at most `SOURCE_HALF`, the weight of a random effect
    whose variance is 1 / SOURCE_HALF of the variance within. With `ENOUGH_STRONG` strong rows the others weigh
    nothing; curated rows weigh one while the real ones weigh less than `FEW`.
    """
    _, code, counts = np.unique(np.asarray(sources), return_inverse=True, return_counts=True)
    weights: FloatArray = np.array([KIND_WEIGHT[kind] for kind in kinds]) / (1 + counts[code] / SOURCE_HALF)
    names = np.asarray(kinds)
    strong = np.isin(names, sorted(STRONG))
    if strong.sum() >= ENOUGH_STRONG:
        return np.where(strong, weights, 0.0)
    if weights.sum() < FEW:
        weights[names == "curated"] = 1.0
    return weights


def shares(kinds: Sequence[str], weights: FloatArray) -> dict[str, float]:
    """Share of the weight by kind, sum 1."""
    total = float(weights.sum())
    by_kind = {kind: float(weights[np.asarray(kinds) == kind].sum()) / total for kind in sorted(set(kinds))}
    return {kind: share for kind, share in by_kind.items() if share > 0}
