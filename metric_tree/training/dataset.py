"""A COCO data set for instance segmentation on disk: synthetic images, and images of other sets."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import cv2
import numpy as np

from metric_base.arrays import grouped
from metric_base.errors import InputError
from metric_base.executors import executor_of
from metric_base.files import whole_folder
from metric_base.images import checked_image, write_image
from metric_tree.training.annotations import AnnotatedImage, AnnotatedObject, run_lengths
from metric_tree.training.classes import Classes
from metric_tree.training.composition import Cutout, Image, compose, random_background

SPLITS = ("train", "val")

#: Quality of the JPEG files of synthetic images, about that of COCO.
JPEG_QUALITY = 92

_SUFFIXES = frozenset({".jpg", ".jpeg", ".png", ".webp", ".bmp"})

#: Split of an image, its entry in `images`, and its objects in `annotations`, without ids.
Entry: TypeAlias = tuple[str, dict[str, Any], list[dict[str, Any]]]


@dataclass(frozen=True, slots=True)
class Plan:
    """Options of a data set."""

    pictures: int  #: Number of synthetic images.
    size: tuple[int, int] = (640, 480)  #: Width and height of a synthetic image in pixels.
    val_share: float = 0.1  #: Fraction of items and images in the validation split.
    seed: int = 0
    backgrounds: tuple[Path, ...] = ()
    jobs: int = 1  #: Number of processes.


@dataclass(slots=True)
class DatasetSummary:
    """Counts of a written data set."""

    pictures: Counter[str] = field(default_factory=Counter)  #: Images by split.
    objects: Counter[str] = field(default_factory=Counter)  #: Objects by split.
    by_category: Counter[int] = field(default_factory=Counter)  #: Objects by class id.
    ambiguous: dict[str, int] = field(default_factory=dict)  #: Omitted objects by label (`Classes.ambiguous`).


def export_dataset(
    out: Path,
    classes: Classes,
    cutouts: Sequence[Cutout],
    plan: Plan,
    others: Iterable[tuple[tuple[str, ...], Iterable[AnnotatedImage]]] = (),
    progress: Callable[[Iterable[Any], int], Iterable[Any]] = lambda items, _: items,
) -> DatasetSummary:
    """Write a data set: `images/<split>/` and `annotations/instances_<split>.json`.

    The same input gives the same bytes. The split of an item, and of an image of another set, depends on a hash of its
    name, so that no item is in both splits. Images of other sets are not copied; the data set contains their paths.

    Parameters
    ----------
    out : Path
        Folder of the data set, which must not exist.
    classes : Classes
        Classes of the data set.
    cutouts : sequence of Cutout
        Cut-outs to paste.
    plan : Plan
        Number and form of the synthetic images.
    others : iterable of (tuple of str, iterable of AnnotatedImage)
        For each other data set the label lists of its names, and its images.
    progress : callable
        Wraps an iterable of the given length.

    Raises
    ------
    InputError
        `out` exists, an annotation is invalid, or there is no image to write.
    """
    if out.exists():
        raise InputError(f"{out}: already exists; expected a new path for a data set")
    matched = []  # before the long work, so that a damaged file is reported at once
    for lists, images in others:
        for image in images:
            entry = matching_entry(image, classes, lists, plan.val_share)
            matched += [entry] if entry else []
    summary = DatasetSummary()
    with whole_folder(out) as work:
        entries = list(progress(synthetic_entries(work, cutouts, plan), plan.pictures if cutouts else 0)) + matched
        if not entries:
            raise InputError("export: expected cut-outs, or images with objects of the categories; found none")
        (work / "annotations").mkdir(exist_ok=True)
        for split in SPLITS:
            document = coco_document([entry for entry in entries if entry[0] == split], classes, plan.seed, split)
            file = work / "annotations" / f"instances_{split}.json"
            file.write_text(json.dumps(document, ensure_ascii=False) + "\n", encoding="utf-8")
            summary.pictures[split] += len(document["images"])
            summary.objects[split] += len(document["annotations"])
            summary.by_category.update(one["category_id"] for one in document["annotations"])
    summary.ambiguous = dict(sorted(classes.ambiguous.items()))
    return summary


def matching_entry(image: AnnotatedImage, classes: Classes, lists: tuple[str, ...], val_share: float) -> Entry | None:
    """Return the entry of an image of another set; None without objects of the classes, or if its file is missing."""
    classed = [(one, classes.of_label(one.names, lists)) for one in image.objects]
    annotations = [one.record(category) for one, category in classed if category is not None]
    if not annotations or not image.file.is_file():
        return None
    record = {"file_name": str(image.file.resolve()), "width": image.width, "height": image.height}
    return split_of(image.file.name, val_share), record, annotations


def synthetic_entries(work: Path, cutouts: Sequence[Cutout], plan: Plan) -> Iterator[Entry]:
    """Write the synthetic images and yield their entries; each depends only on its number and the seed."""
    if not cutouts or not plan.pictures:
        return
    by_split: dict[str, list[list[Cutout]]] = {}
    for split in SPLITS:
        chosen = (cutout for cutout in cutouts if split_of(cutout.item_id, plan.val_share) == split)
        by_class = grouped((cutout.category, cutout) for cutout in chosen)
        by_split[split] = [by_class[category] for category in sorted(by_class)]
    n_val = round(plan.pictures * plan.val_share) if by_split["val"] and by_split["train"] else 0
    if not by_split["train"]:
        by_split = {"train": by_split["val"], "val": []}
    tasks = [("val" if number < n_val else "train", number) for number in range(plan.pictures)]
    for split in SPLITS:
        (work / "images" / split).mkdir(parents=True)
    function = partial(synthetic_entry, work, by_split, plan)
    with executor_of(plan.jobs, None) as pool:
        yield from map(function, tasks) if pool is None else pool.map(function, tasks, chunksize=8)


def synthetic_entry(
    work: Path, cutouts: Mapping[str, Sequence[Sequence[Cutout]]], plan: Plan, task: tuple[str, int]
) -> Entry:
    """Write a synthetic image and return its entry.

    Parameters
    ----------
    work : Path
        Folder of the data set.
    cutouts : mapping
        Cut-outs of each class, by split.
    plan : Plan
        Size, backgrounds and seed.
    task : tuple
        Split and number of the image.
    """
    split, number = task
    generator = np.random.default_rng([plan.seed, number])
    width, height = plan.size
    if plan.backgrounds:
        background = random_window(plan.backgrounds, (height, width), generator)
    else:
        background = random_background((height, width), generator)
    composition = compose(cutouts[split], background, generator)
    name = f"{split}/{number:08d}.jpg"
    write_image(work / "images" / name, composition.image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    annotations = []
    for index, layer in enumerate(composition.layers):
        mask = composition.labels == index
        own = {
            "item_id": layer.cutout.item_id,
            "licence": layer.cutout.licence,
            "size_mm": round(layer.size_mm, 1),
            "size_of": layer.cutout.axis,
            "visible_share": round(float(mask.sum() / layer.area), 4),
        }
        annotations.append(AnnotatedObject((), *run_lengths(mask)).record(layer.cutout.category) | own)
    image = {"file_name": name, "width": width, "height": height, "px_per_mm": round(composition.px_per_mm, 6)}
    return split, image, annotations


def random_window(files: Sequence[Path], size: tuple[int, int], generator: np.random.Generator) -> Image:
    """Return a random part of a random image, resized to the given (height, width)."""
    file = files[int(generator.integers(len(files)))]
    pixels = checked_image(file, cv2.IMREAD_COLOR)
    height, width = size
    factor = generator.uniform(0.6, 1.0) * min(pixels.shape[0] / height, pixels.shape[1] / width)
    h, w = max(int(height * factor), 1), max(int(width * factor), 1)
    top, left = int(generator.integers(pixels.shape[0] - h + 1)), int(generator.integers(pixels.shape[1] - w + 1))
    window = pixels[top : top + h, left : left + w]
    interpolation = cv2.INTER_AREA if factor > 1 else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(window, (width, height), interpolation=interpolation))


def coco_document(entries: Iterable[Entry], classes: Classes, seed: int, split: str) -> dict[str, Any]:
    """Return the annotation file of a split in the form of COCO, with ids from 1."""
    images: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    for _, image, objects in entries:
        images.append({"id": len(images) + 1, **image})
        for one in objects:
            annotations.append({"id": len(annotations) + 1, "image_id": len(images), **one})
    version = classes.tree.version
    return {
        "info": {"description": "Metric-Tree training set", "version": version, "seed": seed, "split": split},
        "licenses": [],
        "images": images,
        "annotations": annotations,
        "categories": classes.categories(),
    }


def split_of(name: str, val_share: float) -> str:
    """Return the split of a name by its hash; the fraction `val_share` of the names is in `val`."""
    fraction = int(hashlib.sha256(name.encode()).hexdigest()[:8], 16) / 16**8
    return "val" if fraction < val_share else "train"


def background_files(folder: Path) -> tuple[Path, ...]:
    """Return the images of a folder, sorted by path.

    Raises
    ------
    InputError
        There are none.
    """
    files = tuple(path for path in sorted(folder.rglob("*")) if path.suffix.lower() in _SUFFIXES)
    if not files:
        raise InputError(f"{folder}: expected images to paste on; found none")
    return files
