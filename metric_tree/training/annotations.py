"""Annotated images of other data sets: images with named masks."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from metric_base.arrays import BoolArray, IntArray
from metric_base.errors import InputError
from metric_base.images import read_image


class BadAnnotations(InputError):
    """Annotations cannot be read: the message has file, field, expected and found value."""

    @classmethod
    def at(cls, file: Path | str, field: str, expected: str, value: object) -> BadAnnotations:
        """Return the error of a field."""
        return cls(f"{file}: {field}: expected {expected}; found {str(value)[:120]}")


@dataclass(frozen=True, slots=True, eq=False)
class AnnotatedObject:
    """An object of an image."""

    names: tuple[str, ...]  #: Label of the data set, then its synonyms.
    segmentation: Any  #: `segmentation` of COCO.
    area: float  #: Pixels.
    bbox: tuple[float, float, float, float]  #: x, y, width, height in pixels.
    crowd: bool = False

    def record(self, category_id: int) -> dict[str, Any]:
        """Return the annotation of COCO with the id of its class."""
        shape = {"segmentation": self.segmentation, "area": self.area, "bbox": list(self.bbox)}
        return {"category_id": category_id, **shape, "iscrowd": int(self.crowd)}


@dataclass(frozen=True, slots=True, eq=False)
class AnnotatedImage:
    """An image file of the user with its annotated objects."""

    file: Path
    width: int
    height: int
    objects: tuple[AnnotatedObject, ...]


def coded_image(path: Path, size: tuple[int, int] | None = None) -> IntArray:
    """Read an image whose colours are numbers: red, green and blue, (h, w, 3).

    Raises
    ------
    BadAnnotations
        The file is not an image with three channels of 8 bits, or its (height, width) is not `size`.
    """
    import cv2

    pixels = read_image(path, cv2.IMREAD_UNCHANGED)
    if pixels is None or pixels.ndim != 3 or pixels.shape[2] != 3 or pixels.dtype != np.uint8:
        actual = "no image" if pixels is None else f"shape {pixels.shape}, {pixels.dtype}"
        raise BadAnnotations.at(path, "image", "three channels of 8 bits", actual)
    if size is not None and pixels.shape[:2] != size:
        raise BadAnnotations.at(path, "size", f"{size} (height, width), as the image's", f"{pixels.shape[:2]}")
    return np.asarray(pixels[:, :, ::-1], dtype=np.int64)


def run_lengths(mask: BoolArray) -> tuple[dict[str, Any], float, tuple[float, float, float, float]]:
    """Return the compressed run lengths of COCO of a mask (h, w), its area and its box (x, y, width, height)."""
    from pycocotools import mask as coco

    runs = coco.encode(np.asfortranarray(mask.astype(np.uint8)))
    area, box = float(coco.area(runs)), coco.toBbox(runs)
    counts = {"size": [int(side) for side in runs["size"]], "counts": runs["counts"].decode("ascii")}
    return counts, area, (float(box[0]), float(box[1]), float(box[2]), float(box[3]))
