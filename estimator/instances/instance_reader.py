"""Find the instance masks of a scene, recognise their format, and read them; masks in memory are accepted, too."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from estimator.instances.coco import ignored_categories, is_panoptic, read_coco, read_panoptic
from estimator.instances.label_images import CATEGORIES, read_label_images
from estimator.instances.labelme import is_labelme, read_labelme
from estimator.instances.mask_arrays import LABELS, MASK_SUFFIXES, read_mask_files
from estimator.instances.view_matching import Instances, ViewLookup, finish_instances, instance_of_mask
from estimator.instances.yolo import NAME_FILES, read_yolo
from estimator.reconstructions.image_files import folders_above
from estimator.records.scene import Instance, Scene
from metric_base.arrays import BoolArray
from metric_base.errors import InputError, Unquoted, at_field, in_file
from metric_base.input_files import folder_entries, read_json

#: Masks of each image by its file name: category, mask (h, w) of bool, and optionally a score from 0 to 1.
MasksByImage = Mapping[str, Iterable[tuple[str, BoolArray] | tuple[str, BoolArray, float]]]
#: Name of masks in memory in messages.
SOURCE = Path("masks")
#: Formats of a folder, for a message.
FORMATS = "COCO (dataset, results, panoptic), label images, YOLO text, labelme, {image}.npz"
#: File and folder of the masks of a scene.
INSTANCES_FILE, INSTANCES_FOLDER = "instances.json", "instances"


def read_instances(
    source: Path | str | MasksByImage | None, scene: Scene, categories: Path | str | None = None
) -> tuple[Instance, ...]:
    """Read the instance masks of the views of a scene.

    Parameters
    ----------
    source : Path, str, mapping or None
        File or folder in one of the supported formats (docs/reference/formats.md), or None for `instances.json` or
        `instances/` in the folder of the scene or above it. A mapping contains masks by image name:
        `(category, mask)` or `(category, mask, score)` with a mask (h, w) of bool, at any resolution.
    scene : Scene
        The images of the masks are matched to its views by file name.
    categories : Path or str, optional
        File with the names of the categories (and images), for formats that do not contain them, such as results of
        COCO.

    Returns
    -------
    tuple of Instance

    Raises
    ------
    InputError
        The file cannot be read, or none of its images is a view of the scene.

    Examples
    --------
    >>> import estimator
    >>> scene = estimator.read_scene("data/scenes/demo_room")
    >>> instances = estimator.read_instances("data/scenes/demo_room/instances.json", scene)
    >>> instances[0].category, instances[0].mask.dtype.name
    ('couch', 'bool')
    """
    return read_instances_and_warnings(scene, source, categories)[0]


def read_instances_and_warnings(
    scene: Scene, source: Path | str | MasksByImage | None = None, categories: Path | str | None = None
) -> Instances:
    """Return the instances as `read_instances` does, and warnings."""
    if isinstance(source, Mapping):
        return instances_of_masks(source, scene)
    path = default_instances(scene) if source is None else Path(source)
    if path is None:
        options = "--instances FILE, or --images DIR --detector MODEL (docs/how-to/detectors.md lists detectors)"
        expected = f"{INSTANCES_FILE} or {INSTANCES_FOLDER}/ in it or above it, or {options}"
        raise InputError.at(scene.path, "instances", expected, Unquoted("none"))
    return read_instance_files(scene, path, None if categories is None else Path(categories))


def default_instances(scene: Scene) -> Path | None:
    """Return the masks in the folder of the scene or above it, or None."""
    for folder in folders_above(scene):
        for path in (folder / INSTANCES_FILE, folder / INSTANCES_FOLDER):
            if path.is_file() or has_instances(path):
                return path
    return None


def has_instances(folder: Path) -> bool:
    """Return True if a folder contains masks in a supported format."""
    return folder.is_dir() and any(
        entry.name in {CATEGORIES, LABELS, *NAME_FILES} or entry.suffix in {".npz", ".json"}
        for entry in folder_entries(folder)
    )


def read_instance_files(scene: Scene, path: Path, names: Path | None = None) -> Instances:
    """Read a file or a folder of masks in any supported format.

    Parameters
    ----------
    scene : Scene
    path : Path
    names : Path, optional
        File with the names of categories (and images), for formats that do not contain them.

    Returns
    -------
    instances : tuple of Instance
    warnings : tuple of str

    Raises
    ------
    InputError
        The format is unknown, or a file is damaged.
    """
    if path.is_dir():
        return _read_folder(scene, path, names)
    if path.suffix in {".yaml", ".yml"}:
        return read_yolo(scene, path.parent, path)
    document = read_json(path)
    if is_panoptic(document):
        return _with_warning(read_panoptic(scene, path, document), names, path)
    if is_labelme(document):
        return _with_warning(read_labelme(scene, [path], path), names, path)
    return read_coco(scene, path, names, document)


def instances_of_masks(masks: MasksByImage, scene: Scene) -> Instances:
    """Return the instances of masks in memory, numbered from 1, and warnings.

    A mask with another size than its camera is resampled; empty masks are dropped.

    Raises
    ------
    InputError
        A mask is not a bool array (h, w), a score is not between 0 and 1, or no image is a view.
    """
    lookup = ViewLookup(scene)
    instances: list[Instance | None] = []
    for name, entries in masks.items():
        row = lookup.row(name)
        for entry in entries:
            instances.append(None)
            if row is None:
                continue
            category, mask, score = entry if len(entry) == 3 else (*entry, 1.0)
            mask = np.asarray(mask)
            if mask.ndim != 2 or mask.dtype != bool or not mask.size:
                found = (mask.shape, str(mask.dtype))
                raise InputError.at(SOURCE, f"image {name!r}", "masks of shape (h, w), bool", found)
            if not 0 <= score <= 1:
                raise InputError.at(SOURCE, f"image {name!r}", "scores from 0 to 1", score)
            with in_file(SOURCE), at_field(f"image {name!r}"):
                instances[-1] = instance_of_mask(scene, row, str(len(instances)), category, mask, float(score))
    return finish_instances(SOURCE, scene, list(masks), instances)


def _read_folder(scene: Scene, folder: Path, names: Path | None) -> Instances:
    """Read a folder of masks."""
    entries = [entry for entry in folder_entries(folder) if entry.is_file()]
    if any(entry.name == CATEGORIES for entry in entries):
        return _with_warning(read_label_images(scene, folder), names, folder)
    masks = [entry for entry in entries if entry.suffix in MASK_SUFFIXES and entry.name != LABELS]
    documents = [entry for entry in masks if entry.suffix == ".json"]
    if documents and is_labelme(read_json(documents[0])):
        return _with_warning(read_labelme(scene, documents, folder), names, folder)
    if masks:
        return read_mask_files(scene, folder, masks, names)
    if any(entry.suffix == ".txt" for entry in entries) or (folder / "labels").is_dir():
        return read_yolo(scene, folder, names)
    found = Unquoted(", ".join(entry.name for entry in entries[:5]) or "nothing")
    raise InputError.at(folder, "instances", FORMATS, found)


def _with_warning(read: Instances, names: Path | None, path: Path) -> Instances:
    """Add a warning if `names` was given but the masks contain names."""
    instances, warnings = read
    return instances, warnings if names is None else (*warnings, ignored_categories(names, path, "are masks"))
