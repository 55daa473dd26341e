"""Masks of COCO's kinds as arrays: polygons, run lengths in words or numbers, and boxes that stand in for them.

Everything is checked before it is drawn: pycocotools writes past the picture when run lengths do not add up to it.
"""

from __future__ import annotations

import numpy as np

from estimator.projection.cameras import MAX_PIXELS, MAX_SIDE_PX
from metric_base.arrays import BoolArray, FloatArray, IntArray
from metric_base.errors import FieldError, Unquoted, at_field
from metric_base.parsing import json_object

#: Longest outline that is drawn: a mask of a large picture has some 100,000 pixels of it, and drawing takes
#: about 100 bytes a pixel.
MAX_OUTLINE_PX = 2_000_000
#: Longest word of a run length: 6 letters of 5 bits hold every length up to MAX_PIXELS.
_MAX_LETTERS = 6


def checked_image_size(size: object) -> tuple[int, int]:
    """`size` as two whole numbers, if a picture can have these sides."""
    if isinstance(size, list | tuple) and len(size) == 2:
        first, second = size
        whole = all(isinstance(side, int) and not isinstance(side, bool) for side in size)
        if whole and 0 < first <= MAX_SIDE_PX and 0 < second <= MAX_SIDE_PX and first * second <= MAX_PIXELS:
            return first, second
    raise FieldError("", f"two whole numbers from 1 to {MAX_SIDE_PX}", size)


def decode_segmentation(segmentation: object, size: tuple[int, int]) -> BoolArray:
    """(h, w) of a `segmentation`: polygons on a picture of `size` (width, height), or run lengths of their own size."""
    if isinstance(segmentation, list):
        return _polygon_mask(segmentation, size)
    runs = json_object(segmentation, "segmentation")
    with at_field("segmentation size"):
        height, width = checked_image_size(runs.get("size"))
    lengths = _run_lengths(runs.get("counts"))
    if (lengths < 0).any() or lengths.sum() != width * height:
        expected = f"runs that add up to {height} x {width} pixels"
        raise FieldError("segmentation counts", expected, Unquoted(str(lengths.sum())))
    return _mask_of_runs(lengths, width, height)


def box_mask(box: object, size: tuple[int, int]) -> BoolArray:
    """(h, w) with the pixels whose centre lies in the box (x, y, width, height) set."""
    numbers = _numbers(box)
    if numbers is None or numbers.shape != (4,) or (numbers[2:] <= 0).any():
        expected = "a bbox of x, y and a positive width and height, or a segmentation"
        raise FieldError("bbox", expected, box)
    width, height = size
    corner = numbers[:2] + numbers[2:]
    left, top, right, bottom = np.clip(np.rint([*numbers[:2], *corner]), 0, [width, height, width, height]).astype(int)
    mask = np.zeros((height, width), dtype=bool)
    mask[top:bottom, left:right] = True
    return mask


def _polygon_mask(polygons: list[object], size: tuple[int, int]) -> BoolArray:
    """(h, w) mask of polygons for a picture of `size` (width, height); FieldError names a bad polygon."""
    from pycocotools import mask as coco  # a quarter of a second, and run lengths do without

    width, height = size
    outlines = []
    for number, polygon in enumerate(polygons):
        corners = _numbers(polygon)
        if corners is None or len(corners) < 6 or len(corners) % 2:
            actual = Unquoted(f"{len(polygon)} values" if isinstance(polygon, list) else type(polygon).__name__)
            raise FieldError(f"polygon {number}", "at least three pairs of finite numbers", actual)
        # corners beyond the picture are moved to its border, so that no outline is endless
        outlines.append(np.clip(corners.reshape(-1, 2), -1.0, [width + 1.0, height + 1.0]))
    length = sum(_perimeter(outline) for outline in outlines)
    if length > MAX_OUTLINE_PX:
        raise FieldError("polygons", f"outlines of at most {MAX_OUTLINE_PX} pixels", int(length))
    runs = coco.frPyObjects([outline.ravel().tolist() for outline in outlines], height, width)
    spelled = coco.merge(runs)["counts"].decode("ascii")
    return _mask_of_runs(_spelled_lengths(spelled), width, height)


def _mask_of_runs(lengths: IntArray, width: int, height: int) -> BoolArray:
    """(h, w) of runs of 0, 1, 0, ... that follow each other down the columns."""
    inside = np.arange(len(lengths)) % 2 == 1
    return np.asarray(np.repeat(inside, lengths).reshape(width, height).T)


def _perimeter(outline: FloatArray) -> float:
    """Length of a closed outline (n, 2) along rows and columns."""
    return float(np.abs(np.diff(outline, axis=0, append=outline[:1])).sum())


def _numbers(values: object) -> FloatArray | None:
    """(n,) finite numbers, or None."""
    if not isinstance(values, list) or any(isinstance(value, bool | str) for value in values):
        return None
    try:
        numbers = np.array(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        return None
    return numbers if numbers.ndim == 1 and np.isfinite(numbers).all() else None


def _run_lengths(counts: object) -> IntArray:
    """(n,) run lengths of a list of numbers or of COCO's compressed text."""
    if isinstance(counts, str):
        return _spelled_lengths(counts)
    numbers = _numbers(counts)
    if numbers is None or (numbers != np.floor(numbers)).any() or (np.abs(numbers) > MAX_PIXELS).any():
        raise FieldError("segmentation counts", "whole numbers or COCO's compressed text", counts)
    return numbers.astype(np.int64)


def _spelled_lengths(text: str) -> IntArray:
    """(n,) run lengths of COCO's text: letters of 5 bits from "0" on, the sixth bit says that the number goes on.

    From the third on a number is the difference from the one two before it (cocoapi, maskApi.c, rleFrString).
    """
    letters = np.array([ord(letter) for letter in text], dtype=np.int64) - 48
    if not len(letters) or (letters < 0).any() or (letters > 63).any() or letters[-1] & 0x20:
        raise FieldError("segmentation counts", "COCO's compressed run lengths", text)
    ends = np.flatnonzero((letters & 0x20) == 0)
    starts = np.concatenate([[0], ends[:-1] + 1])
    sizes = ends - starts + 1
    if sizes.max() > _MAX_LETTERS:
        raise FieldError("segmentation counts", f"numbers of at most {_MAX_LETTERS} letters", text)
    places = np.arange(len(letters)) - np.repeat(starts, sizes)
    values = np.add.reduceat((letters & 0x1F) << (5 * places), starts)
    values -= np.where(letters[ends] & 0x10, 1 << (5 * sizes), 0)
    values[1::2] = np.cumsum(values[1::2])
    values[2::2] = np.cumsum(values[2::2])
    return values
