"""ADE20K, the full set 2021_17_01: beside each picture a JSON with polygons and a picture of classes, `*_seg.png`.

In `*_seg.png` the class of a pixel is red / 10 * 256 + green, the `name_ndx` of the JSON. Polygons run beneath what
stands in front; the class picture shows what is seen. The visible mask of an object is where both agree.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from metric_base.arrays import BoolArray
from metric_base.input_files import MAX_JSON_BYTES, read_bytes
from metric_tree.training.annotations import (
    AnnotatedObject,
    AnnotatedPicture,
    BadAnnotations,
    coded_picture,
    run_lengths,
)

__all__ = ["files", "picture"]


def files(folder: Path) -> list[Path]:
    """The annotations that have a picture beside them."""
    return [file for file in sorted(folder.rglob("*.json")) if file.with_suffix(".jpg").is_file()]


def picture(file: Path) -> AnnotatedPicture:
    """The picture of an annotation.

    Raises
    ------
    BadAnnotations
        The JSON is not ADE20K's, or `*_seg.png` is of another size.
    """
    try:
        # the set's own reader takes Latin-1: names were typed by hand, and some are no UTF-8
        annotation = json.loads(read_bytes(file, limit=MAX_JSON_BYTES).decode("latin-1"))["annotation"]
        height, width = int(annotation["imsize"][0]), int(annotation["imsize"][1])
        seen = _classes(file, (height, width))
        whole = [one for one in annotation["object"] if int(one["parts"]["part_level"]) == 0]
        objects = [_object(one, (height, width), seen) for one in whole]
    except (KeyError, TypeError, ValueError, IndexError, RecursionError) as error:
        if isinstance(error, BadAnnotations):
            raise
        expected = "annotation with imsize and objects of name, name_ndx, parts and polygon"
        raise BadAnnotations.at(file, "annotation", expected, repr(error)) from None
    return AnnotatedPicture(file.with_suffix(".jpg"), width, height, tuple(one for one in objects if one is not None))


def _object(one: dict[str, Any], size: tuple[int, int], seen: NDArray[np.int64] | None) -> AnnotatedObject | None:
    """The object of an entry, None where nothing of it shows; seen : (h, w) class numbers; size : (height, width)."""
    mask = _draw(one["polygon"], size)
    if seen is not None:
        mask &= seen == int(one["name_ndx"])
    if not mask.any():
        return None
    names = (*(name.strip() for name in one["name"].split(",")), *((one["raw_name"],) if one.get("raw_name") else ()))
    return AnnotatedObject(tuple(dict.fromkeys(names)), *run_lengths(mask))


def _draw(polygon: dict[str, list[float]], size: tuple[int, int]) -> BoolArray:
    """(h, w) mask of a polygon in pixels; size : (height, width)."""
    import cv2

    corners = np.column_stack([np.array(polygon["x"], dtype=float), np.array(polygon["y"], dtype=float)])
    canvas = np.zeros(size, dtype=np.uint8)
    if len(corners):
        cv2.fillPoly(canvas, [np.rint(np.clip(corners, -1e4, 1e5)).astype(np.int32)], (1,))
    return canvas.astype(bool)


def _classes(file: Path, size: tuple[int, int]) -> NDArray[np.int64] | None:
    """(h, w) class numbers of the picture of classes, or None if there is no such picture."""
    path = file.with_name(f"{file.stem}_seg.png")
    if not path.is_file():
        return None
    coded = coded_picture(path, size)
    return np.asarray(coded[:, :, 0] // 10 * 256 + coded[:, :, 1])
