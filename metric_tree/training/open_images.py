"""Open Images, segmentation masks (V5 to V7): a table of masks, images of masks, a table of class names.

The folder holds, at any depth, a table of masks, a table of class names, the masks' images and the images
`<ImageID>.jpg`, called as the set calls them (V7's class names have a header, V5's none) or as FiftyOne stores them. A
mask's image may be of another size than the image's own: it covers the same view.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path

from metric_base.images import read_picture
from metric_tree.training.annotations import AnnotatedObject, AnnotatedPicture, BadAnnotations, run_lengths

#: How its names are read.
LISTS = ("openimages_601",)

#: By the set's own names, then by FiftyOne's.
TABLES = ("*-annotations-object-segmentation.csv", "segmentations.csv")
NAMES = ("*class-descriptions*.csv", "classes.csv")
_COLUMNS = ("MaskPath", "ImageID", "LabelName")


def open_images_pictures(folder: Path) -> Iterator[AnnotatedPicture]:
    """The images that are in the folder and have masks, in the order of their ids.

    Raises
    ------
    BadAnnotations
        A table is missing or of another form, or a mask cannot be read.
    """
    names = _names(folder)
    rows = _rows(folder)
    files = {path.name: path for path in sorted(folder.rglob("*")) if path.suffix.lower() in {".png", ".jpg"}}
    for image_id in sorted(rows):
        picture = files.get(f"{image_id}.jpg")
        if picture is not None:
            yield _picture(picture, rows[image_id], names, files)


def _picture(
    file: Path, rows: list[tuple[str, str]], names: dict[str, str], files: dict[str, Path]
) -> AnnotatedPicture:
    import cv2
    from PIL import Image

    with Image.open(file) as header:
        width, height = header.size
    objects = []
    for mask_name, label in rows:
        if label not in names or mask_name not in files:
            continue  # masks come in sixteen archives; a user may have fetched some
        picture = read_picture(files[mask_name], cv2.IMREAD_GRAYSCALE)
        if picture is None:
            raise BadAnnotations.at(files[mask_name], "mask", "a picture", "something else")
        if picture.shape != (height, width):
            picture = cv2.resize(picture, (width, height), interpolation=cv2.INTER_NEAREST)
        if picture.any():
            objects.append(AnnotatedObject((names[label],), *run_lengths(picture > 0)))
    return AnnotatedPicture(file, width, height, tuple(objects))


def _names(folder: Path) -> dict[str, str]:
    names: dict[str, str] = {}
    for file in _files(folder, NAMES):
        with file.open(encoding="utf-8", newline="") as lines:  # machine ids begin with a slash, a header does not
            names |= {row[0]: row[1] for row in csv.reader(lines) if len(row) == 2 and row[0].startswith("/")}
    if not names:
        raise BadAnnotations.at(folder, "class names", " or ".join(NAMES), "none")
    return names


def _rows(folder: Path) -> dict[str, list[tuple[str, str]]]:
    """Mask file and label of each image's objects."""
    rows: dict[str, list[tuple[str, str]]] = {}
    tables = _files(folder, TABLES)
    if not tables:
        raise BadAnnotations.at(folder, "masks", " or ".join(TABLES), "none")
    for file in tables:
        with file.open(encoding="utf-8", newline="") as lines:
            reader = csv.DictReader(lines)
            if not set(_COLUMNS) <= set(reader.fieldnames or ()):
                raise BadAnnotations.at(file, "columns", ", ".join(_COLUMNS), ", ".join(reader.fieldnames or ()))
            for row in reader:
                rows.setdefault(row["ImageID"], []).append((row["MaskPath"], row["LabelName"]))
    return rows


def _files(folder: Path, patterns: tuple[str, ...]) -> list[Path]:
    return sorted({file for pattern in patterns for file in folder.rglob(pattern)})
