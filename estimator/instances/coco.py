"""Instances in COCO's form: a dataset (polygons, run lengths), or results, a bare list that may hold boxes only."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from estimator.instances.crops import ViewNames, differs_in_aspect, joined_instances, mask_crop
from estimator.instances.masks import box_mask, coco_mask, picture_size
from estimator.reconstructions.checked_files import json_array, json_object, read_json
from estimator.records.scene import Instance, Scene
from metric_base.faults import InputFault, Words

__all__ = ["ignored_categories", "read_coco"]


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


def read_coco(scene: Scene, file: Path, categories: Path | None = None) -> tuple[tuple[Instance, ...], tuple[str, ...]]:
    """The instances of a dataset or of results, and warnings.

    Results take names and images from the dataset `categories`, by default `<stem>_categories.json` beside the
    file. Annotations of images that match no view, empty masks and crowds (many objects in one mask) are left out
    with a warning. A box without a mask stands in for one and is marked.
    """
    frame, annotations = _document(scene, file, categories)
    if not annotations:
        raise InputFault.at(file, "annotations", "at least one", 0)
    found = [_instance(file, row, annotation, frame, scene) for row, annotation in enumerate(annotations)]
    names = [image.file_name for image in frame.images.values()]
    warnings = _warnings(file, annotations, frame, scene, found)
    if categories is not None and frame.file != categories:
        warnings.append(ignored_categories(categories, file, "is a dataset"))
    return joined_instances(file, scene, names, found, warnings)


def ignored_categories(categories: Path | str, instances: Path, what: str) -> str:
    """The warning for `--categories` beside instances that name their own."""
    return f"--categories {categories}: not read, for {instances} {what} with categories of its own"


def _document(scene: Scene, file: Path, categories: Path | None) -> tuple[CocoFrame, list[Any]]:
    document = read_json(file)
    if isinstance(document, dict):
        return _frame(file, document, scene), json_array(file, "annotations", document.get("annotations"))
    annotations = json_array(file, "document", document)
    named = categories or file.with_name(f"{file.stem}_categories.json")
    if not named.is_file():
        expected = "a dataset that names categories and images (--categories)"
        raise InputFault.at(file, "categories", expected, Words(f"no file {named.name} beside it"))
    return _frame(named, json_object(named, "document", read_json(named)), scene), annotations


def _warnings(
    file: Path, annotations: list[Any], frame: CocoFrame, scene: Scene, found: list[Instance | None]
) -> list[str]:
    """One line for each kind of annotation that was left out or looks wrong."""
    warnings = []
    crowds = [bool(annotation.get("iscrowd")) for annotation in annotations]
    if any(crowds):
        warnings.append(f"{file}: {sum(crowds)} crowd annotations are left out")
    empty = sum(
        frame.images[annotation["image_id"]].view is not None and not crowd and instance is None
        for annotation, crowd, instance in zip(annotations, crowds, found, strict=True)
    )
    if empty:
        warnings.append(f"{file}: {empty} masks without a pixel are left out")
    turned = [image for image in frame.images.values() if _turned(image, scene)]
    if turned:
        found_size = f"{turned[0].file_name!r} is {turned[0].size}"
        warnings.append(f"{file}: {len(turned)} images are of another shape than their camera, such as {found_size}")
    return warnings


def _turned(image: CocoImage, scene: Scene) -> bool:
    if image.view is None or image.size is None:
        return False
    return differs_in_aspect(image.size, scene.views[image.view].camera)


def _frame(file: Path, document: dict[str, Any], scene: Scene) -> CocoFrame:
    rows = ViewNames(scene)
    images: dict[Hashable, CocoImage] = {}
    for field, key, image in _entries(file, "images", document):
        name = _text(file, f"{field} file_name", image.get("file_name"))
        size = (image.get("width"), image.get("height"))
        stated = None if size == (None, None) else picture_size(file, f"{field} width and height", size)
        images[key] = CocoImage(name, stated, rows.row(name))
    names = {
        key: _text(file, f"{field} name", category.get("name"))
        for field, key, category in _entries(file, "categories", document)
    }
    return CocoFrame(file, images, names)


def _entries(file: Path, part: str, document: dict[str, Any]) -> list[tuple[str, Hashable, dict[str, Any]]]:
    """Field, id and object of each entry of a part; every id once."""
    entries, seen = [], set()
    for number, value in enumerate(json_array(file, part, document.get(part))):
        field = f"{part}[{number}]"
        entry = json_object(file, field, value)
        key = _key(file, f"{field} id", entry.get("id"))
        if key in seen:
            raise InputFault.at(file, f"{field} id", "each id once", Words(f"{key!r} twice"))
        seen.add(key)
        entries.append((field, key, entry))
    return entries


def _key(file: Path, field: str, value: object) -> Hashable:
    if isinstance(value, bool) or not isinstance(value, int | str):
        raise InputFault.at(file, field, "a number", value)
    return value


def _text(file: Path, field: str, value: object) -> str:
    if not isinstance(value, str) or not value.strip():
        raise InputFault.at(file, field, "a name", value)
    return value


def _instance(file: Path, row: int, entry: object, frame: CocoFrame, scene: Scene) -> Instance | None:
    """One annotation as an instance, or None where it has no view or no pixels."""
    field = f"annotations[{row}]"
    annotation = json_object(file, field, entry)
    image_id = _key(file, f"{field} image_id", annotation.get("image_id"))
    category_id = _key(file, f"{field} category_id", annotation.get("category_id"))
    if image_id not in frame.images:
        raise InputFault.at(file, f"{field} image_id", f"an image of {frame.file.name}", image_id)
    if category_id not in frame.categories:
        raise InputFault.at(file, f"{field} category_id", f"a category of {frame.file.name}", category_id)
    score = 1.0 if annotation.get("score") is None else annotation["score"]
    if isinstance(score, bool) or not isinstance(score, int | float) or not 0 <= score <= 1:
        raise InputFault.at(file, f"{field} score", "a number from 0 to 1", score)
    image = frame.images[image_id]
    if image.view is None or annotation.get("iscrowd"):
        return None
    camera = scene.views[image.view].camera
    size = image.size or (camera.width, camera.height)
    segmentation = annotation.get("segmentation")
    if segmentation:
        mask = coco_mask(file, field, segmentation, size)
    else:
        mask = box_mask(file, field, annotation.get("bbox"), size)
    crop = mask_crop(mask, camera)
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
