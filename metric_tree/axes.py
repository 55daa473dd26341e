"""Which axis is which: from a source's words to length, width and height, by the node's ordinary pose.

The one place that knows it (docs/reference/formats.md, "Words"). `length` is the longer horizontal extent, `width` the
shorter one, `height` the vertical one. A shop's words are others: a television's "width" is our length, a wardrobe's
"depth" is our width, a phone's "height" lies down. What the words leave open stays open: it goes into `extents_mm`
alone and the fit sums over the assignments that the pose allows (`candidates`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, permutations

import numpy as np
from numpy.typing import NDArray

from metric_base.arrays import FloatArray

AXES = ("length", "width", "height")
EXTENTS = ("extent1", "extent2", "extent3")

_HORIZONTAL = ("length", "width", "depth")

#: Relative difference below which two stated horizontal sizes are one size said twice.
SAME_SIZE_SHARE = 0.005

#: A height over so many of the shorter side is that of an object which lies flat by nature and stood on its edge: a
#: record in a rack, a magazine in its holder.
MIN_STANDING_RATIO = 1.5


@dataclass(frozen=True, slots=True)
class Sizes:
    """Sizes in mm: what the words tell of each axis, and every stated outer size, longest first."""

    length: float | None
    width: float | None
    height: float | None
    extents: tuple[float, ...]


def sizes_from_words(words: Mapping[str, float | None], extents: Sequence[float] | None, pose: str) -> Sizes | None:
    """The sizes of one object from its source's axis words, or None where nothing is stated or four numbers are.

    Parameters
    ----------
    words : mm by length, width, height, diameter, depth; empty where the source names no axes
    extents : mm, the outer sizes, where the source names no axes
    pose : `upright`, `flat` or `any`
    """
    stated = {word: value for word, value in words.items() if value is not None}
    if not stated:
        outer = tuple(sorted(extents or (), reverse=True))
        return Sizes(None, None, None, outer) if 1 <= len(outer) <= 3 else None
    horizontal = _horizontal(stated)
    height = stated.get("height")
    outer = tuple(sorted([*horizontal, *([height] if height is not None else [])], reverse=True))
    if not 1 <= len(outer) <= 3:
        return None
    if pose == "any":
        return Sizes(None, None, None, outer)
    return (_flat if pose == "flat" else _upright)(stated, horizontal, height, outer)


def stated_sizes(axes: Mapping[str, float | None], pose: str) -> Sizes:
    """The sizes of a row that already speaks of our length, width and height (a curated range)."""
    stated = {axis: axes[axis] for axis in AXES if axes.get(axis) is not None}
    outer = tuple(sorted((size for size in stated.values() if size is not None), reverse=True))
    known = {} if pose == "any" else stated
    return Sizes(known.get("length"), known.get("width"), known.get("height"), outer)


def axis_assignments(axes: FloatArray, extents: FloatArray, pose: str) -> tuple[FloatArray, NDArray[np.intp]]:
    """Every assignment of stated sizes to the axes of a pose.

    Parameters
    ----------
    axes : (n, 3) length, width, height, NaN where the words leave it open
    extents : (n, 3) every stated size, longest first, NaN beyond the last

    Returns
    -------
    x : (m, 3) sizes by the axes of the pose, NaN where missing
    owner : (m,) the row of each candidate, ascending
    """
    known = np.full_like(axes, np.nan) if pose == "any" else axes
    left = _remaining_extents(known, extents)  # (n, 3)
    codes = (~np.isnan(known)) @ np.array([1, 2, 4]) * 4 + (~np.isnan(left)).sum(axis=1)
    assigned, owners = [], []
    for code in np.unique(codes):
        rows = np.flatnonzero(codes == code)
        free = [axis for axis in range(3) if not code // 4 >> axis & 1]
        for assignment in _assignments(free, int(code % 4), pose):
            x = known[rows].copy()
            x[:, list(assignment)] = left[rows, : len(assignment)]
            assigned.append(x)
            owners.append(rows)
    owner = np.concatenate(owners) if owners else np.empty(0, dtype=np.intp)
    order = np.argsort(owner, kind="stable")
    return (np.concatenate(assigned)[order] if assigned else np.empty((0, 3))), owner[order]


def _horizontal(stated: Mapping[str, float]) -> list[float]:
    """Horizontal sizes that the words name; a diameter counts twice unless two other words say the same."""
    plain = [stated[word] for word in _HORIZONTAL if word in stated]
    if "diameter" in stated and len(plain) < 2:
        rod = [
            size for size in plain if "height" not in stated and abs(size / stated["diameter"] - 1) > SAME_SIZE_SHARE
        ]
        return [*rod, stated["diameter"], stated["diameter"]]
    if len(plain) == 3 and "height" in stated:
        plain.sort()
        return (
            plain[1:]
            if plain[1] <= plain[0] * (1 + SAME_SIZE_SHARE)
            else plain[:2]
            if plain[2] <= plain[1] * (1 + SAME_SIZE_SHARE)
            else plain
        )
    return plain


def _upright(
    stated: Mapping[str, float], horizontal: list[float], height: float | None, outer: tuple[float, ...]
) -> Sizes:
    if len(horizontal) == 2:
        return Sizes(max(horizontal), min(horizontal), height, outer)
    if len(horizontal) == 1 and "length" in stated:
        return Sizes(horizontal[0], None, height, outer)
    # one "width" or "depth" may be the longer or the shorter side; three sizes without a height hide the vertical one
    return Sizes(None, None, height, outer)


def _flat(
    stated: Mapping[str, float], horizontal: list[float], height: float | None, outer: tuple[float, ...]
) -> Sizes:
    if len(outer) == 3:
        # a height beside a depth is that of a face seen from the front (a phone, an image), which lies down here
        if height is not None and "depth" not in stated and height < MIN_STANDING_RATIO * min(horizontal):
            return Sizes(max(horizontal), min(horizontal), height, outer)
        return Sizes(outer[0], outer[1], outer[2], outer)
    if len(outer) == 2 and height is None:
        return Sizes(outer[0], outer[1], None, outer)
    if outer == (stated.get("length"),):
        return Sizes(outer[0], None, None, outer)
    return Sizes(None, None, None, outer)


def _remaining_extents(known: FloatArray, extents: FloatArray) -> FloatArray:
    """The extents (n, 3) that no known axis accounts for, longest first, NaN beyond the last."""
    left = extents.copy()
    for axis in range(3):
        matches = np.isclose(left, known[:, axis : axis + 1], rtol=1e-6)
        first = matches & (np.cumsum(matches, axis=1) == 1)
        left[first] = np.nan
    sorted_left: FloatArray = -np.sort(-left, axis=1)
    return sorted_left


def _assignments(free: Sequence[int], numbers: int, pose: str) -> list[tuple[int, ...]]:
    """Axes for `numbers` sizes, longest first: sorted axes keep their order, an upright height may be any of them."""
    chosen = permutations(free, min(numbers, len(free)))
    return [axes for axes in chosen if _is_sorted([axis for axis in axes if pose != "upright" or axis != 2])]


def _is_sorted(axes: Sequence[int]) -> bool:
    return all(a < b for a, b in pairwise(axes))
