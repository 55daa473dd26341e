"""COCO's own annotations (`instances_*.json`), and LVIS's, which have the same form."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from metric_base.input_files import MAX_JSON_BYTES, read_text
from metric_tree.training.annotations import AnnotatedObject, AnnotatedPicture, BadAnnotations

#: How its names are read.
LISTS = ("coco_80", "lvis_v1")

_PARTS = ("images", "annotations", "categories")


def coco_pictures(file: Path, images: Path) -> Iterator[AnnotatedPicture]:
    """The images of an annotation file, in its order, with all their objects.

    images : folder of the images. LVIS names no file but an address, whose last two parts are folder and file.

    Raises
    ------
    BadAnnotations
        The file is no such document.
    """
    document = _document(file)
    names = {category["id"]: category["name"].replace("_", " ") for category in document["categories"]}
    of_image: dict[Any, list[AnnotatedObject]] = {}
    for row, annotation in enumerate(document["annotations"]):
        try:
            x, y, width, height = (float(value) for value in annotation["bbox"])
            one = AnnotatedObject(
                (names[annotation["category_id"]],),
                annotation["segmentation"],
                float(annotation["area"]),
                (x, y, width, height),
                bool(annotation.get("iscrowd", 0)),
            )
            of_image.setdefault(annotation["image_id"], []).append(one)
        except (KeyError, TypeError, ValueError) as error:
            expected = "category_id, image_id, segmentation, area and bbox"
            raise BadAnnotations.at(file, f"annotations[{row}]", expected, repr(error)) from None
    for row, image in enumerate(document["images"]):
        try:
            name = image.get("file_name") or "/".join(image["coco_url"].split("/")[-2:])
            yield AnnotatedPicture(
                images / name, int(image["width"]), int(image["height"]), tuple(of_image.get(image["id"], ()))
            )
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise BadAnnotations.at(file, f"images[{row}]", "id, file_name, width and height", repr(error)) from None


def _document(file: Path) -> dict[str, Any]:
    try:
        document = json.loads(read_text(file, MAX_JSON_BYTES))
    except (ValueError, RecursionError) as error:
        raise BadAnnotations.at(file, "document", "JSON", error) from None
    for part in _PARTS:
        if not isinstance(document, dict) or not isinstance(document.get(part), list):
            raise BadAnnotations.at(file, part, "an array", "none")
    return dict(document)
