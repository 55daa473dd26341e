"""Instances in COCO's form: a dataset (polygons, run lengths), or results, a bare list that may hold boxes only.

COCO's panoptic form: a JSON file, and a PNG for each image whose colours number its segments.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from estimator.instances.label_images import read_png
from estimator.instances.mask_decoding import box_mask, checked_image_size, decode_segmentation
from estimator.instances.view_matching import ViewLookup, differs_in_aspect, finish_instances, mask_crop
from estimator.records.scene import Instance, Scene
from metric_base.errors import FieldError, InputError, Unquoted, at_field, in_file
from metric_base.input_files import is_file, read_json
from metric_base.parsing import json_array, json_object
from taxonomy.label_lists import label_names

#: A detector's box may reach beyond the picture by a hundredth or two, and one box in ten by more.
BEYOND, MOST_BEYOND = 1.03, 0.1
#: Where the pictures of segments are, seen from the JSON file; `{stem}` is its name.
FOLDERS = ("{stem}", ".", "panoptic")


@dataclass(frozen=True, slots=True)
class CocoImage:
    """An image of the dataset: its file, its size (width, height) where stated, and the row of its view."""

    file_name: str
    size: tuple[int, int] | None
    view: int | None


@dataclass(frozen=True, slots=True)
class CocoFrame:
    """What annotations refer to: images and category names by id, and the file that says so."""

    file: Path
    images: dict[Hashable, CocoImage]
    categories: dict[Hashable, str]


def read_coco(
    scene: Scene, file: Path, categories: Path | None = None, document: Any = None
) -> tuple[tuple[Instance, ...], tuple[str, ...]]:
    """The instances of a dataset or of results, and warnings.

    Results take names and images from the dataset `categories`, by default `<stem>_categories.json` beside the
    file; without one, each entry states its `file_name` and its `category`, or an id of COCO's 91 categories.
    Annotations of images that match no view, empty masks and crowds (many objects in one mask) are left out
    with a warning. A box without a mask stands in for one and is marked. document : the file's, where it was read.
    """
    frame, annotations, warnings = _document(scene, file, categories, read_json(file) if document is None else document)
    with in_file(file):
        if not annotations:
            raise FieldError("annotations", "at least one", 0)
        instances = [_instance(row, annotation, frame, scene) for row, annotation in enumerate(annotations)]
        _expect_boxes_inside(annotations, frame, scene)
    names = [image.file_name for image in frame.images.values()]
    warnings = [*warnings, *_warnings(file, annotations, frame, scene, instances)]
    if categories is not None and frame.file != categories:
        warnings.append(ignored_categories(categories, file, "is a dataset"))
    return finish_instances(file, scene, names, instances, warnings)


def _expect_boxes_inside(annotations: list[Any], frame: CocoFrame, scene: Scene) -> None:
    """See that boxes lie in their pictures; FieldError where many reach beyond: two corners, or of larger pictures."""
    beyond, total, corners, first = 0, 0, True, ""
    for row, annotation in enumerate(annotations):
        image, box = frame.images[annotation["image_id"]], annotation.get("bbox")
        if image.view is None or not isinstance(box, list) or len(box) != 4 or annotation.get("segmentation"):
            continue
        camera = scene.views[image.view].camera
        width, height = image.size or (camera.width, camera.height)
        left, top, third, fourth = (float(value) for value in box)
        total += 1
        corners &= left < third <= width * BEYOND and top < fourth <= height * BEYOND
        if left + third > width * BEYOND or top + fourth > height * BEYOND:
            beyond += 1
            first = first or f"annotations[{row}]: {box} in {width} x {height}"
    if beyond > max(MOST_BEYOND * total, 1):
        advice = "; they are two corners" if corners else ""
        expected = "x, y, width, height inside the picture"
        raise FieldError("bbox", expected, Unquoted(f"{beyond} of {total} beyond it{advice}, such as {first}"))


def ignored_categories(categories: Path | str, instances: Path, what: str) -> str:
    """The warning for `--categories` beside instances that name their own."""
    return f"--categories {categories}: not read, for {instances} {what} with categories of its own"


def _document(
    scene: Scene, file: Path, categories: Path | None, document: Any
) -> tuple[CocoFrame, list[Any], list[str]]:
    """The frame, the annotations, and warnings."""
    if isinstance(document, dict):
        with in_file(file):
            return _frame(file, document, scene), json_array(document.get("annotations"), "annotations"), []
    with in_file(file):
        annotations = json_array(document)
    named = categories or file.with_name(f"{file.stem}_categories.json")
    if categories is None and not named.is_file() and _name_themselves(annotations):
        return _own_frame(file, annotations, scene)
    if not named.is_file():
        expected = "a dataset that names categories and images (--categories), or entries with file_name and category"
        raise InputError.at(file, "categories", expected, Unquoted(f"no file {named.name} beside it"))
    with in_file(named):
        return _frame(named, json_object(read_json(named)), scene), annotations, []


def _name_themselves(annotations: list[Any]) -> bool:
    return bool(annotations) and all(isinstance(entry, dict) and "file_name" in entry for entry in annotations)


def _own_frame(file: Path, annotations: list[Any], scene: Scene) -> tuple[CocoFrame, list[Any], list[str]]:
    """The frame of results whose entries name their images; ids become those names, also in the annotations."""
    rows, coco = ViewLookup(scene), label_names("coco_91")
    images: dict[Hashable, CocoImage] = {}
    categories: dict[Hashable, str] = {}
    entries, by_number = [], 0
    for number, entry in enumerate(annotations):
        with in_file(file), at_field(f"annotations[{number}]"):
            image = _text("file_name", entry["file_name"])
            name = next((entry[key] for key in ("category", "category_name", "label") if key in entry), None)
            if name is None:
                by_number += 1
                key = _key("category_id", entry.get("category_id"))
                name = coco[key] if isinstance(key, int) and 0 < key < len(coco) else ""
                if not name:
                    raise FieldError("category", "a name, or a category_id of COCO's 91", entry.get("category_id"))
            category = _text("category", name)
        images.setdefault(image, CocoImage(image, None, rows.row(image)))
        categories[category] = category
        entries.append({**entry, "image_id": image, "category_id": category})
    warning = f"{file}: {by_number} category ids without a name are read as COCO's own (1 person, 3 car, 62 chair ...)"
    return CocoFrame(file, images, categories), entries, [warning] if by_number else []


def _warnings(
    file: Path, annotations: list[Any], frame: CocoFrame, scene: Scene, instances: list[Instance | None]
) -> list[str]:
    """One line for each kind of annotation that was left out or looks wrong."""
    warnings = []
    crowds = [bool(annotation.get("iscrowd")) for annotation in annotations]
    if any(crowds):
        warnings.append(f"{file}: {sum(crowds)} crowd annotations are left out")
    empty = sum(
        frame.images[annotation["image_id"]].view is not None and not crowd and instance is None
        for annotation, crowd, instance in zip(annotations, crowds, instances, strict=True)
    )
    if empty:
        warnings.append(f"{file}: {empty} masks without a pixel are left out")
    names = Counter(image.file_name for image in frame.images.values())
    name, times = max(names.items(), key=lambda entry: entry[1], default=("", 0))
    if times > 1:
        warnings.append(f"{file}: {name!r} is the file_name of {times} images: their masks are taken for one picture's")
    turned = [image for image in frame.images.values() if _is_turned(image, scene)]
    if turned:
        found_size = f"{turned[0].file_name!r} is {turned[0].size}"
        warnings.append(f"{file}: {len(turned)} images are of another shape than their camera, such as {found_size}")
    return warnings


def _is_turned(image: CocoImage, scene: Scene) -> bool:
    if image.view is None or image.size is None:
        return False
    return differs_in_aspect(image.size, scene.views[image.view].camera)


def _frame(file: Path, document: dict[str, Any], scene: Scene) -> CocoFrame:
    rows = ViewLookup(scene)
    images: dict[Hashable, CocoImage] = {}
    for field, key, image in entries_by_id("images", document):
        with at_field(field):
            name = _text("file_name", image.get("file_name"))
            size = (image.get("width"), image.get("height"))
            with at_field("width and height"):
                stated = None if size == (None, None) else checked_image_size(size)
        images[key] = CocoImage(name, stated, rows.row(name))
    return CocoFrame(file, images, category_names(document))


def category_names(document: dict[str, Any]) -> dict[Hashable, str]:
    """The names by id of a dataset's `categories`; FieldError where one has none."""
    names = {}
    for field, key, category in entries_by_id("categories", document):
        with at_field(field):
            names[key] = _text("name", category.get("name"))
    return names


def entries_by_id(part: str, document: dict[str, Any]) -> list[tuple[str, Hashable, dict[str, Any]]]:
    """Field, id and object of each entry of a part of a dataset; FieldError where an id is there twice."""
    entries, seen = [], set()
    for number, value in enumerate(json_array(document.get(part), part)):
        field = f"{part}[{number}]"
        entry = json_object(value, field)
        with at_field(field):
            key = _key("id", entry.get("id"))
            if key in seen:
                raise FieldError("id", "each id once", Unquoted(f"{key!r} twice"))
        seen.add(key)
        entries.append((field, key, entry))
    return entries


def _key(field: str, value: object) -> Hashable:
    if isinstance(value, bool) or not isinstance(value, int | str):
        raise FieldError(field, "a number", value)
    return value


def _text(field: str, value: object) -> str:
    if not isinstance(value, str) or not value.strip():
        raise FieldError(field, "a name", value)
    return value


def _instance(row: int, entry: object, frame: CocoFrame, scene: Scene) -> Instance | None:
    """One annotation as an instance, or None where it has no view or no pixels."""
    with at_field(f"annotations[{row}]"):
        annotation = json_object(entry, "")
        image_id = _key("image_id", annotation.get("image_id"))
        category_id = _key("category_id", annotation.get("category_id"))
        if image_id not in frame.images:
            raise FieldError("image_id", f"an image of {frame.file.name}", image_id)
        if category_id not in frame.categories:
            raise FieldError("category_id", f"a category of {frame.file.name}", category_id)
        score = 1.0 if annotation.get("score") is None else annotation["score"]
        if isinstance(score, bool) or not isinstance(score, int | float) or not 0 <= score <= 1:
            raise FieldError("score", "a number from 0 to 1", score)
        image = frame.images[image_id]
        if image.view is None or annotation.get("iscrowd"):
            return None
        camera = scene.views[image.view].camera
        size = image.size or (camera.width, camera.height)
        segmentation = annotation.get("segmentation")
        crop = mask_crop(
            decode_segmentation(segmentation, size) if segmentation else box_mask(annotation.get("bbox"), size), camera
        )
    if crop is None:
        return None
    track = annotation.get("track_id")
    return Instance(
        id=str(annotation.get("id", row)),
        view=image.view,
        category=frame.categories[category_id],
        mask=crop[0],
        origin=crop[1],
        score=float(score),
        from_box=not segmentation,
        track=None if track is None else str(track),
    )


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
    rows = ViewLookup(scene)
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
    return finish_instances(file, scene, names, instances, ())


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
