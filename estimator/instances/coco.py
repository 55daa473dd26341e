"""Read instances in the formats of COCO: datasets (polygons, run lengths), results (a list), and panoptic segmentation.

Results may contain boxes without masks. A panoptic dataset has a PNG for each image, whose colours number its segments.
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
from estimator.instances.view_matching import (
    MAX_ASPECT_DIFFERENCE,
    Instances,
    ViewLookup,
    aspect_difference,
    finish_instances,
    instance_of_mask,
    within_limits,
)
from estimator.records.scene import Instance, Scene
from metric_base.errors import FieldError, InputError, Unquoted, at_field, expect, in_file
from metric_base.input_files import is_file, read_json
from metric_base.parsing import json_array, json_name, json_object, json_records
from taxonomy.label_lists import label_names

#: Maximum extent of a box relative to its image; detectors exceed the image slightly.
MAX_BOX_EXTENT = 1.03
#: Maximum fraction of the boxes that may exceed it.
MAX_EXCEEDING_FRACTION = 0.1
#: Folders of the PNG files of a panoptic dataset, relative to its JSON file with the stem `{stem}`.
PANOPTIC_FOLDERS = ("{stem}", ".", "panoptic")

#: Image of a dataset: file name, size (width, height) if it is stated, and row of the view.
ImageRecord = tuple[str, tuple[int, int] | None, int | None]


@dataclass(frozen=True, slots=True)
class _Dataset:
    """Images and category names by id, to which annotations refer, and their file."""

    file: Path
    images: dict[Hashable, ImageRecord]
    categories: dict[Hashable, str]


def read_coco(scene: Scene, file: Path, categories: Path | None = None, document: Any = None) -> Instances:
    """Read a dataset or results of COCO.

    Parameters
    ----------
    scene : Scene
    file : Path
    categories : Path, optional
        Dataset with the images and categories of results; by default `<stem>_categories.json` in the same folder.
        Without one, each result contains its `file_name` and its `category`, or an id of the 91 categories of COCO.
    document : object, optional
        Content of the file, if it is already read.

    Returns
    -------
    instances : tuple of Instance
        Boxes without a mask are filled and marked. Images that match no view, empty masks and crowds (several objects
        in one mask) are omitted.
    warnings : tuple of str

    Raises
    ------
    InputError
        The file is damaged, an id is unknown, many boxes exceed their images, or no image is a view.
    """
    document = read_json(file) if document is None else document
    dataset, annotations, warnings = _read_document(scene, file, categories, document)
    with in_file(file):
        expect(annotations, "annotations", "at least one", 0)
        decoded = (_instance(index, annotation, dataset, scene) for index, annotation in enumerate(annotations))
        instances = list(within_limits(decoded))
        _check_boxes(annotations, dataset, scene)
    warnings = [*warnings, *_warnings(file, annotations, dataset, scene, instances)]
    if categories is not None and dataset.file != categories:
        warnings.append(ignored_categories(categories, file, "is a dataset"))
    return finish_instances(file, scene, [name for name, _, _ in dataset.images.values()], instances, warnings)


def ignored_categories(categories: Path | str, instances: Path, kind: str) -> str:
    """Return the warning for `--categories` if the instances contain the names of their categories."""
    return f"--categories {categories}: not read, because {instances} {kind} with category names"


def _read_document(
    scene: Scene, file: Path, categories: Path | None, document: Any
) -> tuple[_Dataset, list[Any], list[str]]:
    """Return images and categories, annotations, and warnings."""
    if isinstance(document, dict):
        with in_file(file):
            return _dataset(file, document, scene), json_array(document.get("annotations"), "annotations"), []
    with in_file(file):
        annotations = json_array(document)
    dataset_file = categories or file.with_name(f"{file.stem}_categories.json")
    if not dataset_file.is_file():
        name_their_images = annotations and all(
            isinstance(entry, dict) and "file_name" in entry for entry in annotations
        )
        if categories is None and name_their_images:
            return _dataset_of_results(file, annotations, scene)
        expected = "a dataset that names categories and images (--categories), or entries with file_name and category"
        raise InputError.at(file, "categories", expected, Unquoted(f"no file {dataset_file.name} in its folder"))
    with in_file(dataset_file):
        return _dataset(dataset_file, json_object(read_json(dataset_file)), scene), annotations, []


def _dataset(file: Path, document: dict[str, Any], scene: Scene) -> _Dataset:
    """Read the images and categories of a dataset."""
    lookup = ViewLookup(scene)
    images: dict[Hashable, ImageRecord] = {}
    for field, key, image in _entries_by_id("images", document):
        with at_field(field):
            name = json_name(image.get("file_name"), "file_name")
            size = (image.get("width"), image.get("height"))
            with at_field("width and height"):
                checked = None if size == (None, None) else checked_image_size(size)
        images[key] = (name, checked, lookup.row(name))
    return _Dataset(file, images, _category_names(document))


def _dataset_of_results(file: Path, annotations: list[Any], scene: Scene) -> tuple[_Dataset, list[Any], list[str]]:
    """Return the dataset of results that contain the names of their images, which become the ids of the annotations."""
    lookup, coco_names = ViewLookup(scene), label_names("coco_91")
    images: dict[Hashable, ImageRecord] = {}
    categories: dict[Hashable, str] = {}
    entries, n_numbered = [], 0
    for index, entry in enumerate(annotations):
        with in_file(file), at_field(f"annotations[{index}]"):
            image = json_name(entry["file_name"], "file_name")
            name = next((entry[key] for key in ("category", "category_name", "label") if key in entry), None)
            if name is None:
                n_numbered += 1
                key = _key("category_id", entry.get("category_id"))
                name = coco_names[key] if isinstance(key, int) and 0 < key < len(coco_names) else ""
                expect(name, "category", "a name, or a category_id of COCO's 91", entry.get("category_id"))
            category = json_name(name, "category")
        images.setdefault(image, (image, None, lookup.row(image)))
        categories[category] = category
        entries.append({**entry, "image_id": image, "category_id": category})
    ids = "category ids without a name are read as those of COCO (1 person, 3 car, 62 chair ...)"
    return _Dataset(file, images, categories), entries, [f"{file}: {n_numbered} {ids}"] if n_numbered else []


def _category_names(document: dict[str, Any]) -> dict[Hashable, str]:
    """Return the names of the categories of a dataset by id."""
    names = {}
    for field, key, category in _entries_by_id("categories", document):
        with at_field(field):
            names[key] = json_name(category.get("name"), "name")
    return names


def _entries_by_id(part: str, document: dict[str, Any]) -> list[tuple[str, Hashable, dict[str, Any]]]:
    """Return field, id and object of each entry of a part of a dataset; FieldError if an id occurs twice."""
    entries, known = [], set()
    for field, entry in json_records(document.get(part), part):
        with at_field(field):
            key = _key("id", entry.get("id"))
            expect(key not in known, "id", "each id once", Unquoted(f"{key!r} twice"))
        known.add(key)
        entries.append((field, key, entry))
    return entries


def _key(field: str, value: object) -> Hashable:
    """Return an id; FieldError unless it is an integer or a text."""
    if isinstance(value, bool) or not isinstance(value, int | str):
        raise FieldError(field, "a number", value)
    return value


def _instance(index: int, entry: object, dataset: _Dataset, scene: Scene) -> Instance | None:
    """Return an annotation as an instance, or None if it has no view or no pixels."""
    with at_field(f"annotations[{index}]"):
        annotation = json_object(entry, "")
        image_id = _key("image_id", annotation.get("image_id"))
        category_id = _key("category_id", annotation.get("category_id"))
        expect(image_id in dataset.images, "image_id", f"an image of {dataset.file.name}", image_id)
        expect(category_id in dataset.categories, "category_id", f"a category of {dataset.file.name}", category_id)
        score = 1.0 if annotation.get("score") is None else annotation["score"]
        if isinstance(score, bool) or not isinstance(score, int | float) or not 0 <= score <= 1:
            raise FieldError("score", "a number from 0 to 1", score)
        _, size, row = dataset.images[image_id]
        if row is None or annotation.get("iscrowd"):
            return None
        camera = scene.views[row].camera
        size = size or (camera.width, camera.height)
        segmentation = annotation.get("segmentation")
        mask = decode_segmentation(segmentation, size) if segmentation else box_mask(annotation.get("bbox"), size)
        identity, category = str(annotation.get("id", index)), dataset.categories[category_id]
        track = None if annotation.get("track_id") is None else str(annotation["track_id"])
        return instance_of_mask(
            scene, row, identity, category, mask, float(score), from_box=not segmentation, track=track
        )


def _check_boxes(annotations: list[Any], dataset: _Dataset, scene: Scene) -> None:
    """Raise FieldError if many boxes exceed their images: they are two corners, or belong to larger images."""
    n_boxes, are_corners, exceeding = 0, True, []
    for index, annotation in enumerate(annotations):
        (_, size, row), box = dataset.images[annotation["image_id"]], annotation.get("bbox")
        if row is None or not isinstance(box, list) or len(box) != 4 or annotation.get("segmentation"):
            continue
        camera = scene.views[row].camera
        width, height = size or (camera.width, camera.height)
        left, top, third, fourth = (float(value) for value in box)
        n_boxes += 1
        are_corners &= left < third <= width * MAX_BOX_EXTENT and top < fourth <= height * MAX_BOX_EXTENT
        if left + third > width * MAX_BOX_EXTENT or top + fourth > height * MAX_BOX_EXTENT:
            exceeding.append(f"annotations[{index}]: {box} in {width} x {height}")
    if len(exceeding) > max(MAX_EXCEEDING_FRACTION * n_boxes, 1):
        advice = "; they are two corners" if are_corners else ""
        found = Unquoted(f"{len(exceeding)} of {n_boxes} beyond it{advice}, such as {exceeding[0]}")
        raise FieldError("bbox", "x, y, width, height inside the image", found)


def _warnings(
    file: Path, annotations: list[Any], dataset: _Dataset, scene: Scene, instances: list[Instance | None]
) -> list[str]:
    """Return a warning for each kind of annotation that is omitted or suspicious."""
    warnings = []
    is_crowd = [bool(annotation.get("iscrowd")) for annotation in annotations]
    if any(is_crowd):
        warnings.append(f"{file}: {sum(is_crowd)} crowd annotations are omitted")
    n_empty = sum(
        dataset.images[annotation["image_id"]][2] is not None and not crowd and instance is None
        for annotation, crowd, instance in zip(annotations, is_crowd, instances, strict=True)
    )
    if n_empty:
        warnings.append(f"{file}: {n_empty} masks without a pixel are omitted")
    names = Counter(name for name, _, _ in dataset.images.values())
    name, count = max(names.items(), key=lambda entry: entry[1], default=("", 0))
    if count > 1:
        warnings.append(f"{file}: {name!r} is the file_name of {count} images: their masks are assigned to one image")
    rotated = [
        (name, size)
        for name, size, row in dataset.images.values()
        if row is not None
        and size is not None
        and aspect_difference(size, scene.views[row].camera) > MAX_ASPECT_DIFFERENCE
    ]
    if rotated:
        example = f"{rotated[0][0]!r} is {rotated[0][1]}"
        warnings.append(f"{file}: {len(rotated)} images have another shape than their camera, such as {example}")
    return warnings


def is_panoptic(document: object) -> bool:
    """Return True if a JSON document is a panoptic dataset."""
    annotations = document.get("annotations") if isinstance(document, dict) else None
    first = annotations[0] if isinstance(annotations, list) and annotations else None
    return isinstance(first, dict) and "segments_info" in first


def read_panoptic(scene: Scene, file: Path, document: Any) -> Instances:
    """Read a panoptic dataset; stuff (`isthing` 0) and crowds are omitted.

    Returns
    -------
    instances : tuple of Instance
    warnings : tuple of str

    Raises
    ------
    InputError
        The file or one of its PNG files is damaged, or the PNG of a view is missing.
    """
    lookup = ViewLookup(scene)
    instances: list[Instance | None] = []
    names: list[str] = []
    with in_file(file):
        categories = _category_names(document)
        things = {key for _, key, entry in _entries_by_id("categories", document) if entry.get("isthing", 1)}
        images = {key: image.get("file_name") for _, key, image in _entries_by_id("images", document)}
        for field, annotation in json_records(document.get("annotations"), "annotations"):
            with at_field(field):
                name = images.get(annotation.get("image_id"), annotation.get("file_name"))
                if not isinstance(name, str) or not name:
                    raise FieldError("image_id", "an image of the file", annotation.get("image_id"))
                row = lookup.row(name)
                names.append(name)
                if row is not None:
                    instances += _segments(scene, row, file, annotation, categories, things)
    return finish_instances(file, scene, names, instances)


def _segments(
    scene: Scene,
    row: int,
    file: Path,
    annotation: dict[str, Any],
    categories: dict[Hashable, str],
    things: set[Hashable],
) -> list[Instance | None]:
    """Return the segments of an image that are instances; `things` are the ids of countable categories."""
    name = annotation.get("file_name")
    if not isinstance(name, str) or Path(name).name != name:
        raise FieldError("file_name", "the name of a PNG", name)
    folders = (file.parent / folder.format(stem=file.stem) for folder in PANOPTIC_FOLDERS)
    path = next((path for folder in folders if is_file(path := folder / name)), None)
    if path is None:
        raise InputError.at(file, "file_name", f"{file.stem}/{name} in its folder", Unquoted("no such file"))
    colours = read_png(path)
    if colours.ndim != 3 or colours.shape[2] < 3:
        raise InputError.at(path, "channels", "3, the number of a segment in base 256", 1)
    red, green, blue = (colours[..., channel].astype(np.int64) for channel in range(3))
    numbers = red + 256 * green + 65536 * blue
    instances: list[Instance | None] = []
    for field, segment in json_records(annotation.get("segments_info"), "segments_info"):
        with at_field(field):
            category = segment.get("category_id")
            if not isinstance(category, int | str) or category not in categories:
                raise FieldError("category_id", "a category of the file", category)
            if segment.get("iscrowd") or category not in things:
                continue
            number, score = segment.get("id"), segment.get("score", 1.0)
            score = float(score) if isinstance(score, int | float) and 0 <= score <= 1 else 1.0
            mask = np.asarray(numbers == number)
            instances.append(instance_of_mask(scene, row, f"{row}:{number}", categories[category], mask, score))
    return instances
