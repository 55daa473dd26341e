"""Masks that are larger than their objects, seen by the points of their rims.

The rim of a right mask is on the object, and other views have its points in the object's masks. The rim of a mask that
was grown is on what is behind or beside the object: views from elsewhere have its points outside, while hardly a point
just outside one mask is inside another. Cars whose windows show what is behind look the same (`walk_carpark`, whose
masks are right: .75 and 2.3). Borders that are rough, by a detector's or an annotator's hand, fail in both
directions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.association.point_labels import PointLabels
from estimator.records.scene import Instance, View
from metric_base.arrays import BoolArray, IntArray

__all__ = ["RimAgreement", "rim_agreement", "rim_doubts"]

# The rim is this share of the square root of a mask's pixels wide, and of fewer pixels the mask has none.
RIM_SHARE, MIN_RIM_PX = 0.1, 2
# Masks that are looked at; of more, every so-manieth.
MAX_MASKS = 2000
# Looks of other views that shares need.
MIN_LOOKS = 100
# Masks are too large where other views agree about less than this of the rims, and where they disagree so much more
# about points inside than about points just outside. In synthetic rooms right masks have .95 or more; those grown by a
# fifth .59 to .77 and a ratio of 2 to 3.3; by two pixels .82 or more; borders that are off by four pixels a ratio of 1
# to 1.6.
GROWN_INSIDE, GROWN_RATIO = 0.8, 1.8


@dataclass(frozen=True, slots=True)
class RimAgreement:
    """How other views of an object see points near the borders of its masks; NaN where too few do.

    inside : of their looks at points in the rim, the share that has them in a mask of the object; outside : the same
    of points that are just outside the mask.
    """

    inside: float
    outside: float


def rim_agreement(
    views: Sequence[View], labels: PointLabels, instances: Sequence[Instance], tracks: Sequence[Sequence[int]]
) -> RimAgreement:
    """The agreement over the masks of all tracks, rows of `instances` each; boxes are left out."""
    step = max(1, sum(map(len, tracks)) // MAX_MASKS)
    looks = np.zeros((2, 2))
    for members in tracks:
        rows = [row for row in members if not instances[row].from_box]
        shown = sorted({instances[row].view for row in rows})
        if len(shown) < 2:
            continue
        inside = np.asarray(labels.membership[rows].sum(axis=0)).ravel()
        seen = np.asarray(labels.visibility[shown].sum(axis=0)).ravel()
        for row in rows[::step]:
            for side, points in enumerate(_beside_border(views[instances[row].view], instances[row])):
                others = np.maximum(seen[points] - 1, 0)
                agreeing = np.maximum(inside[points] - (side == 0), 0)
                looks[side] += np.minimum(agreeing, others).sum(), others.sum()
    shares = np.where(looks[:, 1] >= MIN_LOOKS, looks[:, 0] / np.maximum(looks[:, 1], 1), np.nan)
    return RimAgreement(float(shares[0]), float(shares[1]))


def rim_doubts(agreement: RimAgreement) -> tuple[str, ...]:
    """What the rims say against the masks, as sentences."""
    apart = 1 - agreement.inside
    if not (agreement.inside < GROWN_INSIDE and apart >= GROWN_RATIO * agreement.outside):
        return ()
    return (
        f"other views have {apart:.0%} of the points in the rims of the masks outside: the masks are larger than their "
        "objects, and the scale too small, or one sees through the rims (windows, leaves)",
    )


def _beside_border(view: View, instance: Instance) -> tuple[IntArray, IntArray]:
    """Rows (k,) of the view's observed points in the rim of a mask, and (j,) of those as far outside it."""
    mask = instance.mask
    reach = round(RIM_SHARE * float(np.sqrt(np.count_nonzero(mask))))
    none: IntArray = np.empty(0, dtype=np.int64)
    if reach < MIN_RIM_PX:
        return none, none
    height, width = mask.shape
    column, row = np.floor(view.keypoints - instance.origin).astype(np.int64).T
    near = (column >= -reach) & (row >= -reach) & (column < width + reach) & (row < height + reach)
    column, row, points = column[near], row[near], view.point_index[near]
    # the sums over all upper left corners give that of any square
    sums = np.pad(mask.cumsum(axis=0, dtype=np.int64).cumsum(axis=1), ((1, 0), (1, 0)))
    top, bottom = (np.clip(row + edge, 0, height) for edge in (-reach, reach + 1))
    left, right = (np.clip(column + edge, 0, width) for edge in (-reach, reach + 1))
    filled = sums[bottom, right] - sums[top, right] - sums[bottom, left] + sums[top, left]
    on_crop: BoolArray = (column >= 0) & (row >= 0) & (column < width) & (row < height)
    within = on_crop & mask[row.clip(0, height - 1), column.clip(0, width - 1)]
    whole = filled == (2 * reach + 1) ** 2
    return points[within & ~whole], points[~within & (filled > 0)]
