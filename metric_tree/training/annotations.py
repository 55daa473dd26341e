"""What every reader of another data set returns: images with named masks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from metric_base.arrays import BoolArray, IntArray
from metric_base.errors import InputError
from metric_base.images import read_picture


class BadAnnotations(InputError):
    """Annotations that cannot be read: file, field, expected, found."""

    @classmethod
    def at(cls, file: Path | str, field: str, expected: str, value: object) -> BadAnnotations:
        """The error in one line."""
        return cls(f"{file}: {field}: expected {expected}; found {str(value)[:120]}")


@dataclass(frozen=True, slots=True, eq=False)
class AnnotatedObject:
    """One object of an image: the set's own label (or its synonyms, first first) and COCO's `segmentation` of it."""

    names: tuple[str, ...]
    segmentation: Any
    area: float
    bbox: tuple[float, float, float, float]
    crowd: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class AnnotatedPicture:
    """An image on the user's disk and all that is annotated in it."""

    file: Path
    width: int
    height: int
    objects: tuple[AnnotatedObject, ...] = field(default=())

    def __iter__(self) -> Iterator[AnnotatedObject]:
        return iter(self.objects)


def coded_picture(path: Path, size: tuple[int, int] | None = None) -> IntArray:
    """(h, w, 3) red, green, blue of an image whose colours are numbers.

    Raises
    ------
    BadAnnotations
        It is no image of three channels, or not of the given (height, width).
    """
    import cv2

    pixels = read_picture(path, cv2.IMREAD_UNCHANGED)
    if pixels is None or pixels.ndim != 3 or pixels.shape[2] != 3 or pixels.dtype != np.uint8:
        actual = "no picture" if pixels is None else f"shape {pixels.shape}, {pixels.dtype}"
        raise BadAnnotations.at(path, "picture", "three channels of 8 bits", actual)
    if size is not None and pixels.shape[:2] != size:
        raise BadAnnotations.at(path, "size", f"{size} (height, width), as the picture's", f"{pixels.shape[:2]}")
    return np.asarray(pixels[:, :, ::-1], dtype=np.int64)


def run_lengths(mask: BoolArray) -> tuple[dict[str, Any], float, tuple[float, float, float, float]]:
    """COCO's compressed run lengths of a mask (h, w), its area and its box (x, y, width, height)."""
    from pycocotools import mask as coco

    runs = coco.encode(np.asfortranarray(mask.astype(np.uint8)))
    area, box = float(coco.area(runs)), coco.toBbox(runs)
    counts = {"size": [int(side) for side in runs["size"]], "counts": runs["counts"].decode("ascii")}
    return counts, area, (float(box[0]), float(box[1]), float(box[2]), float(box[3]))
