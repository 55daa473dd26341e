"""Open Images, segmentation masks (V5 to V7): a table of masks, images of masks, a table of class names.

A folder contains, at any depth, a table of masks, a table of class names, the images of the masks and the images
`<ImageID>.jpg`, with the file names of the set (the class names of V7 have a header, those of V5 do not) or of
FiftyOne. The image of a mask covers the same view as the image, but may have another size.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path

import cv2

from metric_base.arrays import grouped
from metric_base.images import checked_image, image_size
from metric_base.parsing import table_rows
from metric_tree.training.annotations import AnnotatedImage, AnnotatedObject, BadAnnotations, run_lengths

#: Label lists of the names.
LISTS = ("openimages_601",)

#: File names of the tables in the set and in FiftyOne.
TABLES = ("*-annotations-object-segmentation.csv", "segmentations.csv")
NAMES = ("*class-descriptions*.csv", "classes.csv")
_COLUMNS = ("MaskPath", "ImageID", "LabelName")


def open_images_images(folder: Path) -> Iterator[AnnotatedImage]:
    """Yield the images of a folder that have masks, in the order of their ids.

    The set has sixteen archives of masks; masks that are not in the folder are skipped.

    Raises
    ------
    BadAnnotations
        A table is missing or of another form, or a mask cannot be read.
    """
    names: dict[str, str] = {}
    for table in _files(folder, NAMES):
        with table.open(encoding="utf-8", newline="") as lines:  # ids begin with a slash, a header does not
            names |= {row[0]: row[1] for row in csv.reader(lines) if len(row) == 2 and row[0].startswith("/")}
    if not names:
        raise BadAnnotations.at(folder, "class names", " or ".join(NAMES), "none")
    masks = masks_by_image(folder)
    files = {path.name: path for path in sorted(folder.rglob("*")) if path.suffix.lower() in {".png", ".jpg"}}
    for image_id in sorted(masks):
        file = files.get(f"{image_id}.jpg")
        if file is None:
            continue
        width, height = image_size(file)
        objects = []
        for mask_name, label in masks[image_id]:
            if label not in names or mask_name not in files:
                continue
            mask = checked_image(files[mask_name], cv2.IMREAD_GRAYSCALE)
            if mask.shape != (height, width):
                mask = cv2.resize(mask, (width, height), interpolation=cv2.INTER_NEAREST)
            if mask.any():
                objects.append(AnnotatedObject((names[label],), *run_lengths(mask > 0)))
        yield AnnotatedImage(file, width, height, tuple(objects))


def masks_by_image(folder: Path) -> dict[str, list[tuple[str, str]]]:
    """Read file and label of the masks of each image id.

    Raises
    ------
    BadAnnotations
        There is no table of masks, or a table lacks a column.
    """
    tables = _files(folder, TABLES)
    if not tables:
        raise BadAnnotations.at(folder, "masks", " or ".join(TABLES), "none")
    rows = (row for file in tables for _, row in table_rows(file, _COLUMNS, BadAnnotations))
    return grouped((row["ImageID"], (row["MaskPath"], row["LabelName"])) for row in rows)


def _files(folder: Path, patterns: tuple[str, ...]) -> list[Path]:
    return sorted({file for pattern in patterns for file in folder.rglob(pattern)})
