"""Which form instances are in: by the files that are there and what is in them."""

from __future__ import annotations

from pathlib import Path

from estimator.instances.coco import ignored_categories, read_coco
from estimator.instances.label_images import CATEGORIES, read_label_images
from estimator.instances.labelme import is_labelme, read_labelme
from estimator.instances.mask_arrays import LABELS, MASK_SUFFIXES, read_mask_files
from estimator.instances.panoptic import is_panoptic, read_panoptic
from estimator.instances.yolo import NAME_FILES, read_yolo
from estimator.records.scene import Instance, Scene
from metric_base.errors import InputError, Unquoted
from metric_base.input_files import folder_entries, read_json

__all__ = ["FORMS", "holds_instances", "read_instance_files"]

FORMS = "COCO (dataset, results, panoptic), label images, YOLO text, labelme, {image}.npz"

Instances = tuple[tuple[Instance, ...], tuple[str, ...]]


def holds_instances(folder: Path) -> bool:
    """Whether a folder called `instances` holds masks in a form that is read."""
    return folder.is_dir() and any(
        entry.name in {CATEGORIES, LABELS, *NAME_FILES} or entry.suffix in {".npz", ".json"}
        for entry in folder_entries(folder)
    )


def read_instance_files(scene: Scene, place: Path, names: Path | None = None) -> Instances:
    """The instances of a file or a folder in any form that is read, and warnings.

    names : a file that names categories (and images), for the forms that lack them.

    Raises
    ------
    InputError
        The place is in no form that is read, or what it holds is damaged.
    """
    return _read_folder(scene, place, names) if place.is_dir() else _read_file(scene, place, names)


def _read_file(scene: Scene, file: Path, names: Path | None) -> Instances:
    if file.suffix in {".yaml", ".yml"}:
        return read_yolo(scene, file.parent, file)
    document = read_json(file)
    if is_panoptic(document):
        return _warn_of_names(read_panoptic(scene, file, document), names, file)
    if is_labelme(document):
        return _warn_of_names(read_labelme(scene, [file], file), names, file)
    return read_coco(scene, file, names, document)


def _read_folder(scene: Scene, folder: Path, names: Path | None) -> Instances:
    entries = [entry for entry in folder_entries(folder) if entry.is_file()]
    if any(entry.name == CATEGORIES for entry in entries):
        return _warn_of_names(read_label_images(scene, folder), names, folder)
    masks = [entry for entry in entries if entry.suffix in MASK_SUFFIXES and entry.name != LABELS]
    documents = [entry for entry in masks if entry.suffix == ".json"]
    if documents and is_labelme(read_json(documents[0])):
        return _warn_of_names(read_labelme(scene, documents, folder), names, folder)
    if masks:
        return read_mask_files(scene, folder, masks, names)
    if any(entry.suffix == ".txt" for entry in entries) or (folder / "labels").is_dir():
        return read_yolo(scene, folder, names)
    raise InputError.at(
        folder, "instances", FORMS, Unquoted(", ".join(entry.name for entry in entries[:5]) or "nothing")
    )


def _warn_of_names(read: Instances, names: Path | None, place: Path) -> Instances:
    """What was read, with a warning where `names` was given in vain."""
    instances, warnings = read
    return instances, warnings if names is None else (*warnings, ignored_categories(names, place, "are masks"))
