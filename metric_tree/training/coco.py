"""Annotations of COCO (`instances_*.json`), and of LVIS, which have the same form."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from metric_base.errors import damage_as_field_error, in_file
from metric_base.input_files import MAX_JSON_BYTES, read_text
from metric_base.parsing import json_array, json_object
from metric_tree.training.annotations import AnnotatedImage, AnnotatedObject, BadAnnotations

#: Label lists of the names.
LISTS = ("coco_80", "lvis_v1")


def coco_images(file: Path, images: Path) -> Iterator[AnnotatedImage]:
    """Yield the images of an annotation file, in its order, with all their objects.

    Parameters
    ----------
    file : Path
        JSON file.
    images : Path
        Folder of the images. LVIS has addresses instead of file names, which end in folder and file.

    Raises
    ------
    BadAnnotations
        The file is not JSON, or a part of it is missing or invalid.
    """
    with in_file(file, BadAnnotations):
        with damage_as_field_error("JSON", (ValueError, RecursionError), str, field="document"):
            document = json_object(json.loads(read_text(file, MAX_JSON_BYTES)))
        for part in ("images", "annotations", "categories"):
            json_array(document.get(part), part)
    names = {category["id"]: category["name"].replace("_", " ") for category in document["categories"]}
    objects: defaultdict[Any, list[AnnotatedObject]] = defaultdict(list)
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
            objects[annotation["image_id"]].append(one)
        except (KeyError, TypeError, ValueError) as error:
            expected = "category_id, image_id, segmentation, area and bbox"
            raise BadAnnotations.at(file, f"annotations[{row}]", expected, repr(error)) from None
    for row, image in enumerate(document["images"]):
        try:
            name = image.get("file_name") or "/".join(image["coco_url"].split("/")[-2:])
            size = int(image["width"]), int(image["height"])
            yield AnnotatedImage(images / name, *size, tuple(objects.get(image["id"], ())))
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise BadAnnotations.at(file, f"images[{row}]", "id, file_name, width and height", repr(error)) from None
