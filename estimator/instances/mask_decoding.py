"""Decode masks of COCO to arrays: polygons, run lengths as text or numbers, and boxes.

All input is checked before it is drawn: pycocotools writes outside the mask if run lengths do not add up to its size.
"""

from __future__ import annotations

import numpy as np

from estimator.projection.cameras import MAX_PIXELS, MAX_SIDE_PX
from metric_base.arrays import BoolArray, FloatArray, IntArray
from metric_base.errors import FieldError, Unquoted, at_field, expect
from metric_base.parsing import json_object

#: Maximum length of the outlines of a mask, in pixels. A mask of a large image has about 100,000 pixels, and drawing
#: needs about 100 bytes per pixel.
MAX_OUTLINE_PX = 2_000_000
#: Maximum number of characters of a run length; six characters of 5 bits are enough for `MAX_PIXELS`.
_MAX_RUN_CHARS = 6


def checked_image_size(size: object) -> tuple[int, int]:
    """Return `size` as two integers; FieldError unless they are the sides of an image."""
    if isinstance(size, list | tuple) and len(size) == 2:
        first, second = size
        are_integers = all(isinstance(side, int) and not isinstance(side, bool) for side in size)
        if are_integers and 0 < first <= MAX_SIDE_PX and 0 < second <= MAX_SIDE_PX and first * second <= MAX_PIXELS:
            return first, second
    raise FieldError("", f"two whole numbers from 1 to {MAX_SIDE_PX}", size)


def decode_segmentation(segmentation: object, size: tuple[int, int]) -> BoolArray:
    """Return the mask (h, w) of a `segmentation` of COCO.

    Parameters
    ----------
    segmentation : object
        Polygons, or run lengths with their size.
    size : (width, height)
        Size of the image of polygons.

    Raises
    ------
    FieldError
        A polygon or a run length is invalid, or an outline is too long.
    """
    if isinstance(segmentation, list):
        from pycocotools import mask as coco  # takes a quarter of a second, and is not necessary for run lengths

        width, height = size
        outlines, length = [], 0.0
        for index, polygon in enumerate(segmentation):
            corners = _numbers(polygon)
            if corners is None or len(corners) < 6 or len(corners) % 2:
                found = Unquoted(f"{len(polygon)} values" if isinstance(polygon, list) else type(polygon).__name__)
                raise FieldError(f"polygon {index}", "at least three pairs of finite numbers", found)
            # Corners outside the image are moved to its border, which limits the length of the outline.
            outline = np.clip(corners.reshape(-1, 2), -1.0, [width + 1.0, height + 1.0])
            length += float(np.abs(np.diff(outline, axis=0, append=outline[:1])).sum())
            outlines.append(outline)
        expect(length <= MAX_OUTLINE_PX, "polygons", f"outlines of at most {MAX_OUTLINE_PX} pixels", int(length))
        runs = coco.frPyObjects([outline.ravel().tolist() for outline in outlines], height, width)
        return _mask_of_runs(_decoded_lengths(coco.merge(runs)["counts"].decode("ascii")), width, height)
    record = json_object(segmentation, "segmentation")
    with at_field("segmentation size"):
        height, width = checked_image_size(record.get("size"))
    counts = record.get("counts")
    if isinstance(counts, str):
        lengths = _decoded_lengths(counts)
    else:
        numbers = _numbers(counts)
        if numbers is None or (numbers != np.floor(numbers)).any() or (np.abs(numbers) > MAX_PIXELS).any():
            raise FieldError("segmentation counts", "whole numbers or COCO's compressed text", counts)
        lengths = numbers.astype(np.int64)
    if (lengths < 0).any() or lengths.sum() != width * height:
        expected = f"runs that add up to {height} x {width} pixels"
        raise FieldError("segmentation counts", expected, Unquoted(str(lengths.sum())))
    return _mask_of_runs(lengths, width, height)


def box_mask(box: object, size: tuple[int, int]) -> BoolArray:
    """Return the mask (h, w) of the pixels whose centre is in a box (x, y, width, height)."""
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


def _mask_of_runs(lengths: IntArray, width: int, height: int) -> BoolArray:
    """Return the mask (h, w) of run lengths of 0, 1, 0, ... along the columns."""
    is_set = np.arange(len(lengths)) % 2 == 1
    return np.asarray(np.repeat(is_set, lengths).reshape(width, height).T)


def _numbers(values: object) -> FloatArray | None:
    """Return finite numbers (n,), or None."""
    if not isinstance(values, list) or any(isinstance(value, bool | str) for value in values):
        return None
    try:
        numbers = np.array(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        return None
    return numbers if numbers.ndim == 1 and np.isfinite(numbers).all() else None


def _decoded_lengths(text: str) -> IntArray:
    """Decode compressed run lengths (n,) of COCO.

    A character encodes 5 bits, from "0" on; the sixth bit marks that the number continues. From the third number on,
    the text contains the difference from the number two before it (cocoapi, maskApi.c, rleFrString).
    """
    codes = np.array([ord(character) for character in text], dtype=np.int64) - 48
    if not len(codes) or (codes < 0).any() or (codes > 63).any() or codes[-1] & 0x20:
        raise FieldError("segmentation counts", "COCO's compressed run lengths", text)
    ends = np.flatnonzero((codes & 0x20) == 0)
    starts = np.concatenate([[0], ends[:-1] + 1])
    sizes = ends - starts + 1
    if sizes.max() > _MAX_RUN_CHARS:
        raise FieldError("segmentation counts", f"numbers of at most {_MAX_RUN_CHARS} characters", text)
    digit = np.arange(len(codes)) - np.repeat(starts, sizes)
    values = np.add.reduceat((codes & 0x1F) << (5 * digit), starts)
    values -= np.where(codes[ends] & 0x10, 1 << (5 * sizes), 0)
    values[1::2] = np.cumsum(values[1::2])
    values[2::2] = np.cumsum(values[2::2])
    return values
