"""Heights of what is built in: nobody sees the underside of a sink, or what is under a counter as part of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from estimator.records.measured_object import MeasuredObject
from estimator.results.categories import LabelMeaning
from metric_base.arrays import BoolArray

__all__ = ["UNSEEN_UNDERSIDE", "cut_sides", "with_unseen_undersides"]

#: The note of an object whose height is truncated for this reason alone.
UNSEEN_UNDERSIDE = "its underside is not seen"


def with_unseen_undersides(
    objects: Sequence[MeasuredObject], by_name: Mapping[str, LabelMeaning]
) -> tuple[MeasuredObject, ...]:
    """The objects, the heights of what is built in truncated: what is seen ends above the underside.

    An object that reaches down to the plane that it stands on is whole. Where the prior judges no other whole side,
    the height stays: it is better than nothing.
    """
    return tuple(_with_unseen_underside(item, by_name[item.category]) for item in objects)


def cut_sides(item: MeasuredObject) -> BoolArray:
    """(3,) the truncated sides that another picture may show."""
    cut = np.asarray(item.truncated, dtype=bool)
    return cut & [True, True, UNSEEN_UNDERSIDE not in item.notes]


def _with_unseen_underside(item: MeasuredObject, meaning: LabelMeaning) -> MeasuredObject:
    cut = np.asarray(item.truncated, dtype=bool)
    judged = () if meaning.prior is None else meaning.prior.dims
    others = np.isfinite(item.extents[:2]) & ~cut[:2] & [axis in judged for axis in ("length", "width")]
    stands = not item.vertical_known or item.unsupported_height is not None
    if meaning.node is None or meaning.node.underside_seen or stands or cut[2] or not others.any():
        return item
    return replace(item, truncated=np.array([*cut[:2], True]), notes=(*item.notes, UNSEEN_UNDERSIDE))
