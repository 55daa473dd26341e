"""Assignment of stated sizes to axes: length, width and height, according to the ordinary pose of a node.

`length` is the longer horizontal extent, `width` the shorter one, `height` the vertical one
(docs/reference/formats.md, "Axes"). Shops use other words: the "width" of a television is its length, the "depth" of a
wardrobe its width, and the "height" of a phone is horizontal. If the words are ambiguous, a size is in `extents_mm`
only, and the fit sums over the assignments that the pose allows (`axis_assignments`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from metric_base.arrays import FloatArray

AXES = ("length", "width", "height")
EXTENTS = ("extent1", "extent2", "extent3")
DIMENSIONS = (*AXES, *EXTENTS)

#: Relative difference up to which two horizontal sizes are the same size, stated twice.
SIZE_RELATIVE_TOLERANCE = 0.005

#: Minimum ratio of height to the shorter horizontal size of a flat object that was measured on its edge: a record in a
#: rack, a magazine in its holder.
MIN_STANDING_RATIO = 1.5


@dataclass(frozen=True, slots=True)
class Sizes:
    """Sizes in mm: those of the axes that the words determine, and all stated outer sizes, longest first."""

    length: float | None
    width: float | None
    height: float | None
    extents: tuple[float, ...]


def sizes_from_words(words: Mapping[str, float | None], extents: Sequence[float] | None, pose: str) -> Sizes | None:
    """Return the sizes of an object from the axis words of its source.

    Parameters
    ----------
    words : mapping of str to float
        Sizes in mm by length, width, height, diameter, depth; empty if the source does not name axes.
    extents : sequence of float
        Outer sizes in mm, if the source does not name axes.
    pose : {'upright', 'flat', 'any'}
        Ordinary pose of the node.

    Returns
    -------
    Sizes or None
        None without a size, and for more than three sizes.
    """
    stated = {word: value for word, value in words.items() if value is not None}
    if not stated:
        outer = tuple(sorted(extents or (), reverse=True))
        return Sizes(None, None, None, outer) if 1 <= len(outer) <= 3 else None
    horizontal, height = horizontal_sizes(stated), stated.get("height")
    outer = tuple(sorted([*horizontal, *([height] if height is not None else [])], reverse=True))
    if not 1 <= len(outer) <= 3:
        return None
    if pose == "any":
        return Sizes(None, None, None, outer)
    if pose == "flat":
        return flat_sizes(stated, horizontal, outer)
    # A single "width" or "depth" may be the longer or the shorter side; one of three horizontal sizes is the height.
    length, width = None, None
    if len(horizontal) == 2:
        length, width = max(horizontal), min(horizontal)
    elif len(horizontal) == 1:
        length = stated.get("length")
    return Sizes(length, width, height, outer)


def horizontal_sizes(stated: Mapping[str, float]) -> list[float]:
    """Return the horizontal sizes that the words name, without a size that is stated twice.

    A diameter counts twice, unless two other words name horizontal sizes.
    """
    plain = [stated[word] for word in ("length", "width", "depth") if word in stated]
    if "diameter" in stated and len(plain) < 2:
        diameter = stated["diameter"]
        is_rod = "height" not in stated and bool(plain) and abs(plain[0] / diameter - 1) > SIZE_RELATIVE_TOLERANCE
        return [*(plain if is_rod else []), diameter, diameter]
    if len(plain) == 3 and "height" in stated:
        plain.sort()
        if plain[1] <= plain[0] * (1 + SIZE_RELATIVE_TOLERANCE):
            return plain[1:]
        if plain[2] <= plain[1] * (1 + SIZE_RELATIVE_TOLERANCE):
            return plain[:2]
    return plain


def flat_sizes(stated: Mapping[str, float], horizontal: Sequence[float], outer: tuple[float, ...]) -> Sizes:
    """Return the sizes of an object that lies flat; `outer` has its 1 to 3 sizes, longest first."""
    height = stated.get("height")
    if len(outer) == 3:
        # A height with a depth is that of a front (a phone, a painting), which is horizontal in this pose.
        if height is not None and "depth" not in stated and height < MIN_STANDING_RATIO * min(horizontal):
            return Sizes(max(horizontal), min(horizontal), height, outer)
        return Sizes(outer[0], outer[1], outer[2], outer)
    if len(outer) == 2 and height is None:
        return Sizes(outer[0], outer[1], None, outer)
    if outer == (stated.get("length"),):
        return Sizes(outer[0], None, None, outer)
    return Sizes(None, None, None, outer)


def stated_sizes(axes: Mapping[str, float | None], pose: str) -> Sizes:
    """Return the sizes of a row that states length, width and height in the ordinary pose (a curated range)."""
    stated = {axis: axes[axis] for axis in AXES if axes.get(axis) is not None}
    outer = tuple(sorted((size for size in stated.values() if size is not None), reverse=True))
    known = {} if pose == "any" else stated
    return Sizes(known.get("length"), known.get("width"), known.get("height"), outer)


def axis_assignments(axes: FloatArray, extents: FloatArray, pose: str) -> tuple[FloatArray, NDArray[np.intp]]:
    """Return all assignments of stated sizes to the axes of a pose.

    Horizontal axes, and the extents of an object without a pose, are in descending order; the height of an upright
    object may be any of the sizes.

    Parameters
    ----------
    axes : (n, 3) ndarray of float
        Length, width and height in mm, NaN if the words are ambiguous.
    extents : (n, 3) ndarray of float
        All stated sizes in mm, longest first, then NaN.
    pose : {'upright', 'flat', 'any'}
        Ordinary pose of the node.

    Returns
    -------
    x : (m, 3) ndarray of float
        Sizes of each candidate in mm by the axes of the pose, NaN if unknown.
    owner : (m,) ndarray of int
        Row of each candidate, ascending.
    """
    known = np.full_like(axes, np.nan) if pose == "any" else axes
    # 1. Sizes that no known axis explains, longest first.
    remaining = extents.copy()  # (n, 3)
    for axis in range(3):
        matches = np.isclose(remaining, known[:, axis : axis + 1], rtol=1e-6)
        remaining[matches & (np.cumsum(matches, axis=1) == 1)] = np.nan
    remaining = -np.sort(-remaining, axis=1)
    # 2. Rows with the same known axes and number of remaining sizes have the same assignments.
    codes = (~np.isnan(known)) @ np.array([1, 2, 4]) * 4 + (~np.isnan(remaining)).sum(axis=1)
    assigned, owners = [], []
    for code in np.unique(codes):
        rows = np.flatnonzero(codes == code)
        free = [axis for axis in range(3) if not code // 4 >> axis & 1]
        for assignment in permutations(free, min(int(code % 4), len(free))):
            ordered = [axis for axis in assignment if pose != "upright" or axis != 2]
            if ordered == sorted(ordered):
                x = known[rows].copy()
                x[:, list(assignment)] = remaining[rows, : len(assignment)]
                assigned.append(x)
                owners.append(rows)
    owner = np.concatenate(owners) if owners else np.empty(0, dtype=np.intp)
    order = np.argsort(owner, kind="stable")
    return (np.concatenate(assigned)[order] if assigned else np.empty((0, 3))), owner[order]
