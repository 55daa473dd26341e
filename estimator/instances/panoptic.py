"""COCO's panoptic form: a JSON file, and a PNG for each image whose colours number its segments."""

from __future__ import annotations

from collections.abc import Hashable
from pathlib import Path
from typing import Any

import numpy as np

from estimator.instances.coco import category_names, entries_by_id
from estimator.instances.label_images import read_png
from estimator.instances.masks_in_views import ViewNames, joined_instances, mask_crop
from estimator.reconstructions.checked_files import json_array, json_object
from estimator.records.scene import Instance, Scene
from metric_base.errors import FieldError, InputError, Unquoted, at_field, in_file
from metric_base.input_files import is_file

__all__ = ["is_panoptic", "read_panoptic"]

#: Where the pictures of segments are, seen from the JSON file; `{stem}` is its name.
FOLDERS = ("{stem}", ".", "panoptic")


def is_panoptic(document: object) -> bool:
    """Whether a JSON document is of this form."""
    annotations = document.get("annotations") if isinstance(document, dict) else None
    first = annotations[0] if isinstance(annotations, list) and annotations else None
    return isinstance(first, dict) and "segments_info" in first


def read_panoptic(scene: Scene, file: Path, document: Any) -> tuple[tuple[Instance, ...], tuple[str, ...]]:
    """The instances of a panoptic file, and warnings; stuff (`isthing` 0) and crowds are left out.

    Raises
    ------
    InputError
        The file or a PNG of it is damaged, or the PNG of a view is missing.
    """
    rows = ViewNames(scene)
    instances: list[Instance | None] = []
    names: list[str] = []
    with in_file(file):
        categories = category_names(document)
        countable = _object_categories(document)
        images = {key: image.get("file_name") for _, key, image in entries_by_id("images", document)}
        for number, value in enumerate(json_array(document.get("annotations"), "annotations")):
            with at_field(f"annotations[{number}]"):
                annotation = json_object(value, "")
                name = images.get(annotation.get("image_id"), annotation.get("file_name"))
                if not isinstance(name, str) or not name:
                    raise FieldError("image_id", "an image of the file", annotation.get("image_id"))
                row = rows.row(name)
                names.append(name)
                if row is not None:
                    instances += _instances(scene, row, file, annotation, categories, countable)
    return joined_instances(file, scene, names, instances, ())


def _object_categories(document: dict[str, Any]) -> set[Hashable]:
    return {key for _, key, entry in entries_by_id("categories", document) if entry.get("isthing", 1)}


def _instances(
    scene: Scene,
    row: int,
    file: Path,
    annotation: dict[str, Any],
    categories: dict[Hashable, str],
    countable: set[Hashable],
) -> list[Instance | None]:
    stated = annotation.get("file_name")
    if not isinstance(stated, str) or Path(stated).name != stated:
        raise FieldError("file_name", "the name of a PNG", stated)
    folders = (file.parent / place.format(stem=file.stem) for place in FOLDERS)
    picture = next((path for folder in folders if is_file(path := folder / stated)), None)
    if picture is None:
        raise InputError.at(file, "file_name", f"{file.stem}/{stated} beside the file", Unquoted("no such file"))
    colours = read_png(picture)
    if colours.ndim != 3:
        raise InputError.at(picture, "channels", "3, the number of a segment in base 256", 1)
    blue, green, red = (colours[..., channel].astype(np.int64) for channel in range(3))
    numbers = red + 256 * green + 65536 * blue
    instances: list[Instance | None] = []
    for place, value in enumerate(json_array(annotation.get("segments_info"), "segments_info")):
        with at_field(f"segments_info[{place}]"):
            segment = json_object(value, "")
            category = segment.get("category_id")
            if not isinstance(category, int | str) or category not in categories:
                raise FieldError("category_id", "a category of the file", category)
            if segment.get("iscrowd") or category not in countable:
                continue
            crop = mask_crop(numbers == segment.get("id"), scene.views[row].camera)
            if crop is not None:
                score = segment.get("score", 1.0)
                score = float(score) if isinstance(score, int | float) and 0 <= score <= 1 else 1.0
                instances.append(Instance(f"{row}:{segment.get('id')}", row, categories[category], *crop, score=score))
    return instances
