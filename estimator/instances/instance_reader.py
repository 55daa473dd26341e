"""Which form instances are in: by the files that are there and what is in them.

Instance masks that are arrays in memory.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from estimator.instances.coco import ignored_categories, is_panoptic, read_coco, read_panoptic
from estimator.instances.label_images import CATEGORIES, read_label_images
from estimator.instances.labelme import is_labelme, read_labelme
from estimator.instances.mask_arrays import LABELS, MASK_SUFFIXES, read_mask_files
from estimator.instances.view_matching import ViewLookup, finish_instances, mask_crop
from estimator.instances.yolo import NAME_FILES, read_yolo
from estimator.reconstructions.scene_reader import LEVELS_UP
from estimator.records.scene import Instance, Scene
from metric_base.arrays import BoolArray
from metric_base.errors import InputError, Unquoted, at_field, in_file
from metric_base.input_files import folder_entries, read_json

#: The masks of each image by its file name: category, mask (h, w) bool, and a score from 0 to 1 where there is one.
MasksByImage = Mapping[str, Iterable[tuple[str, BoolArray] | tuple[str, BoolArray, float]]]
#: What an error names in place of a file.
SOURCE = Path("masks")
FORMS = "COCO (dataset, results, panoptic), label images, YOLO text, labelme, {image}.npz"
Instances = tuple[tuple[Instance, ...], tuple[str, ...]]
INSTANCES = "instances.json"
PICTURES = "instances"


def instances_of_masks(masks: MasksByImage, scene: Scene) -> tuple[tuple[Instance, ...], tuple[str, ...]]:
    """The instances of masks by image name, numbered from 1, and warnings.

    A mask of another size than its camera is resampled; an empty one is left out.
    """
    rows = ViewLookup(scene)
    instances: list[Instance | None] = []
    for name, entries in masks.items():
        row = rows.row(name)
        for entry in entries:
            instances.append(None if row is None else _instance(str(len(instances) + 1), name, row, entry, scene))
    return finish_instances(SOURCE, scene, list(masks), instances, ())


def _instance(
    number: str, name: str, row: int, entry: tuple[str, BoolArray] | tuple[str, BoolArray, float], scene: Scene
) -> Instance | None:
    """The instance of an entry with mask (h, w), None of an empty one.

    InputError if the mask is not bool (h, w), or the score is not from 0 to 1.
    """
    category, mask, score = entry if len(entry) == 3 else (*entry, 1.0)
    mask = np.asarray(mask)
    if mask.ndim != 2 or mask.dtype != bool or not mask.size:
        raise InputError.at(SOURCE, f"image {name!r}", "masks of shape (h, w), bool", (mask.shape, str(mask.dtype)))
    if not 0 <= score <= 1:
        raise InputError.at(SOURCE, f"image {name!r}", "scores from 0 to 1", score)
    with in_file(SOURCE), at_field(f"image {name!r}"):
        crop = mask_crop(mask, scene.views[row].camera)
    return None if crop is None else Instance(number, row, category, crop[0], crop[1], float(score))


def has_instances(folder: Path) -> bool:
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


def read_instances(
    source: Path | str | MasksByImage | None, scene: Scene, categories: Path | str | None = None
) -> tuple[Instance, ...]:
    """The instance masks of a scene's views.

    Parameters
    ----------
    source : a COCO dataset or results file, a folder of label images, None for `instances.json` or `instances/` in the
        scene's folder; or the masks themselves, by image name: `(category, mask)` or `(category, mask, score)` with
        a mask of shape (h, w) bool of any resolution
    scene : the scene whose views the images are, joined by file name
    categories : a COCO dataset that names categories and images, for results

    Raises
    ------
    InputError
        The file cannot be read, or no image of it is a view of the scene.

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
) -> tuple[tuple[Instance, ...], tuple[str, ...]]:
    """The instances as `read_instances` takes them, and warnings."""
    if isinstance(source, Mapping):
        return instances_of_masks(source, scene)
    place = _default_instances(scene) if source is None else Path(source)
    return read_instance_files(scene, place, None if categories is None else Path(categories))


def default_instances(scene: Scene) -> Path | None:
    """The instances in the scene's folder or up to three above it, or None."""
    starts = [path.resolve() for path in (scene.path, scene.model_path) if path is not None]
    folders = dict.fromkeys(folder for start in starts for folder in (start, *list(start.parents)[:LEVELS_UP]))
    for folder in folders:
        for place in (folder / INSTANCES, folder / PICTURES):
            if place.is_file() or has_instances(place):
                return place
    return None


def _default_instances(scene: Scene) -> Path:
    place = default_instances(scene)
    if place is not None:
        return place
    ways = "--instances FILE, or --images DIR --detector MODEL (docs/how-to/detectors.md lists detectors)"
    expected = f"{INSTANCES} or {PICTURES}/ in it or above it, or {ways}"
    raise InputError.at(scene.path, "instances", expected, Unquoted("none"))
