"""Agreement of the masks between views: masks of another video, mirrored or of other pictures, do not fit the model.

A point on a chair lies in a chair's mask in every view that sees it. Masks that belong to other pictures put it in a
mask of the category here, and on the background or on another category there, hardly better than by chance.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from estimator.association.point_labels import PointLabels
from estimator.records.scene import Instance
from metric_base.arrays import FloatArray

__all__ = ["MaskAgreement", "mask_agreement", "mask_contradictions", "track_agreement", "track_contradictions"]

# Both measures are 1 for masks that fit and 0 for masks that agree by chance alone. A detector that misses most objects
# lowers the first and not the second, so both have to be low. Masks of the right pictures have 0.97 of both in made
# rooms; turned over, mirrored, or of a video played backwards, at most 0.3 and 0.6.
DOUBTFUL_COVER, DOUBTFUL_NAMES = 0.6, 0.8
WRONG_COVER, WRONG_NAMES = 0.45, 0.65
# Where the names are doubtful, masks with so little cover are of other pictures all the same: three quarters of what
# one view masks is bare in the next.
NO_COVER = 0.25
# Of the points that one mask of an object holds another of its masks holds so many, by the median object. In synthetic
# rooms with borders that are off by two pixels the median is at least 0.86, by four pixels 0.65; of masks of a crop, a
# squeezed or a letterboxed picture, or the next frame, at most 0.64.
DOUBTFUL_SHARE, WRONG_SHARE = 0.72, 0.62
# Objects, and pairs of views of the points of each, that a median needs; of objects with fewer points so many pairs
# together, of two objects at least.
MIN_TRACKS, MIN_TRACK_PAIRS, MIN_POOLED_TRACKS = 3, 40, 2
# Pairs of views of one point that tell chance from agreement.
MIN_PAIRS = 200


@dataclass(frozen=True, slots=True)
class MaskAgreement:
    """How well the masks of the views agree about the points they share, corrected for chance; NaN where unknown.

    cover : of the points in a mask of a category, how surely another view with masks of that category has them in one;
    names : of the points in masks of two views, how surely these have one category; pairs : of views that were compared
    for the names.
    """

    cover: float
    names: float
    pairs: int


def mask_agreement(labels: PointLabels, instances: Sequence[Instance]) -> MaskAgreement:
    """The agreement over all ordered pairs of views of a point, with Cohen's correction (k - c) / (1 - c) for chance.

    With a views that have a point in a mask of a category, and s that see it and have masks of the category, a (s - 1)
    pairs are asked about the cover and a (a - 1) agree. Boxes are left out: much of a box is background.
    """
    rows = np.array([row for row, instance in enumerate(instances) if not instance.from_box], dtype=np.int64)
    views = np.array([instances[row].view for row in rows], dtype=np.int64)
    names = np.array([instances[row].category for row in rows])
    counts = [
        _counts(labels, rows[names == name], views[names == name]) for name in sorted({str(name) for name in names})
    ]
    if not counts:
        return MaskAgreement(np.nan, np.nan, 0)
    inside = np.array([own for own, _ in counts])  # (c, n)
    asked = np.array([float(own @ (seen - 1)) for own, seen in counts])
    chance = np.array([own.sum() / max(float(seen.sum()), 1.0) for own, seen in counts])
    agreed = (inside * (inside - 1)).sum()
    named = inside.sum(axis=0)
    pairs = float((named * (named - 1)).sum())
    shares = inside.sum(axis=1) / max(float(inside.sum()), 1.0)
    return MaskAgreement(
        _beyond_chance(agreed, float(asked @ chance), float(asked.sum())),
        _beyond_chance(agreed, pairs * float(shares @ shares), pairs),
        int(pairs),
    )


def mask_contradictions(agreement: MaskAgreement) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """What the agreement says against the masks: sentences of doubt, and sentences that rule them out."""
    if agreement.pairs < MIN_PAIRS or not (agreement.cover < DOUBTFUL_COVER and agreement.names < DOUBTFUL_NAMES):
        return (), ()
    sentence = (
        f"the masks of different views hardly agree about the points they share ({max(agreement.cover, 0):.0%} beyond "
        "chance): check that they are of these pictures, not mirrored, shifted or of other frames"
    )
    wrong = agreement.cover < NO_COVER or (agreement.cover < WRONG_COVER and agreement.names < WRONG_NAMES)
    return ((), (sentence,)) if wrong else ((sentence,), ())


def track_agreement(labels: PointLabels, instances: Sequence[Instance], tracks: Iterable[Sequence[int]]) -> float:
    """Of the points in one mask of an object, the share that its mask of another view that sees them holds, too.

    The median over the objects (rows of their instances), or the share of all together where few of them have enough
    points; NaN where they have too few together.
    """
    counts = []
    for members in tracks:
        rows = [row for row in members if not instances[row].from_box]
        views = sorted({instances[row].view for row in rows})
        if len(views) < 2:
            continue
        inside = np.asarray(labels.membership[rows].sum(axis=0)).ravel()
        held = inside > 0
        seen = np.asarray(labels.visibility[views].sum(axis=0)).ravel()[held]
        own = np.minimum(inside[held], seen)
        counts.append((float((own * (own - 1)).sum()), float((own * (seen - 1)).sum())))
    agreed, pairs = np.array(counts).reshape(-1, 2).T
    enough = pairs >= MIN_TRACK_PAIRS
    if enough.sum() >= MIN_TRACKS:
        return float(np.median(agreed[enough] / pairs[enough]))
    together = len(counts) >= MIN_POOLED_TRACKS and pairs.sum() >= MIN_TRACK_PAIRS
    return float(agreed.sum() / pairs.sum()) if together else np.nan


def track_contradictions(share: float) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """What the agreement within objects says against the masks: sentences of doubt, and sentences of rejection."""
    if not share < DOUBTFUL_SHARE:
        return (), ()
    sentence = (
        f"the masks of an object hold only {share:.0%} of each other's points: check that they are of whole pictures, "
        "not cropped, padded, squeezed or of other frames"
    )
    return ((), (sentence,)) if share < WRONG_SHARE else ((sentence,), ())


def _counts(labels: PointLabels, rows: FloatArray, views: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(n,) views with a point in one of the masks `rows` (k,) of `views` (k,), and (n,) those of them that see it."""
    own, group = np.unique(views, return_inverse=True)
    merge = csr_array((np.ones(len(rows)), (group, np.arange(len(rows)))), shape=(len(own), len(rows)))
    inside = merge @ labels.membership[rows]
    inside.data[:] = 1
    return np.asarray(inside.sum(axis=0)).ravel(), np.asarray(labels.visibility[own].sum(axis=0)).ravel()


def _beyond_chance(agreed: float, chance: float, asked: float) -> float:
    """(agreed - chance) / (asked - chance), NaN where nothing can disagree."""
    return float((agreed - chance) / (asked - chance)) if asked - chance > 1e-9 * max(asked, 1.0) else np.nan
