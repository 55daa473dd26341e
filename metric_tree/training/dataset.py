"""A COCO instance-segmentation data set on disk: synthetic images and the user's own, written whole or not at all."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from metric_base.errors import InputError
from metric_base.files import whole_folder
from metric_base.images import read_picture
from metric_tree.training.annotations import AnnotatedPicture, BadAnnotations, run_lengths
from metric_tree.training.classes import Classes
from metric_tree.training.composition import Cutout, Picture, compose, random_background

SPLITS = ("train", "val")

#: Quality of the synthetic images' JPEG: COCO's own are about that.
JPEG_QUALITY = 92

_SUFFIXES = frozenset({".jpg", ".jpeg", ".png", ".webp", ".bmp"})


@dataclass(frozen=True, slots=True)
class Plan:
    """What to make: images in all, (width, height) of each, share of the validation split, processes."""

    pictures: int
    size: tuple[int, int] = (640, 480)
    val_share: float = 0.1
    seed: int = 0
    backgrounds: tuple[Path, ...] = ()
    jobs: int = 1


@dataclass(slots=True)
class DatasetSummary:
    """What was written: images and objects per split and class, and labels that were too wide to tell."""

    pictures: Counter[str] = field(default_factory=Counter)
    objects: Counter[str] = field(default_factory=Counter)
    by_category: Counter[int] = field(default_factory=Counter)
    ambiguous: dict[str, int] = field(default_factory=dict)


def export_dataset(
    out: Path,
    classes: Classes,
    cutouts: Sequence[Cutout],
    plan: Plan,
    others: Iterable[tuple[tuple[str, ...], Iterable[AnnotatedPicture]]] = (),
    progress: Callable[[Iterable[Any], int], Iterable[Any]] = lambda items, _: items,
) -> DatasetSummary:
    """Write the data set: `images/<split>/`, `annotations/instances_<split>.json`; the same bytes for the same input.

    Items and the user's images belong to one split each, by a hash of their name, so that what is tested on was
    never trained on. The user's images stay where they are and are named by their whole path.

    others : for each further set, how its labels are read, and its images

    Raises
    ------
    InputError
        Something is at `out` already, or there is nothing to write.
    """
    if out.exists():
        raise InputError(f"{out}: already exists; expected a new path for a data set")
    summary = DatasetSummary()
    matched = list(_matching_pictures(others, classes, plan))  # first: a damaged file is reported before the long work
    with whole_folder(out) as work:
        parts: dict[str, list[tuple[dict[str, Any], list[dict[str, Any]]]]] = {split: [] for split in SPLITS}
        for split, image, annotations in progress(
            _synthetic_pictures(work, cutouts, plan), plan.pictures if cutouts else 0
        ):
            parts[split].append((image, annotations))
        for split, records in matched:
            parts[split].append(records)
        if not any(parts.values()):
            raise InputError("export: expected cut-outs, or pictures with objects of the categories; found none")
        for split, entries in parts.items():
            _write(work / "annotations" / f"instances_{split}.json", entries, classes, plan, summary, split)
    summary.ambiguous = dict(sorted(classes.ambiguous.items()))
    return summary


def _synthetic_pictures(
    work: Path, cutouts: Sequence[Cutout], plan: Plan
) -> Iterator[tuple[str, dict[str, Any], list[dict[str, Any]]]]:
    """Synthetic images with their annotations, each from its own number and the seed, whatever the processes."""
    if not cutouts or not plan.pictures:
        return
    groups = {
        split: _groups([one for one in cutouts if _split(one.item_id, plan.val_share) == split]) for split in SPLITS
    }
    n_val = round(plan.pictures * plan.val_share) if groups["val"] and groups["train"] else 0
    if not groups["train"]:
        groups, n_val = {"train": groups["val"], "val": []}, 0
    tasks = [("val" if number < n_val else "train", number) for number in range(plan.pictures)]
    for split in SPLITS:
        (work / "images" / split).mkdir(parents=True)
    make = partial(_picture, work, groups, plan)
    if plan.jobs == 1:
        yield from map(make, tasks)
        return
    with ProcessPoolExecutor(plan.jobs) as pool:
        yield from pool.map(make, tasks, chunksize=8)


def _picture(
    work: Path, groups: dict[str, list[list[Cutout]]], plan: Plan, task: tuple[str, int]
) -> tuple[str, dict[str, Any], list[dict[str, Any]]]:
    import cv2

    split, number = task
    generator = np.random.default_rng([plan.seed, number])
    width, height = plan.size
    composition = compose(groups[split], _background(plan, (height, width), generator), generator)
    name = f"{split}/{number:08d}.jpg"
    written, data = cv2.imencode(".jpg", composition.picture, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    if not written:
        raise OSError(f"{name}: not encoded")
    (work / "images" / name).write_bytes(data.tobytes())
    annotations = []
    for one in composition.objects:
        runs, area, bbox = run_lengths(one.mask)
        annotations.append(
            {
                "category_id": one.cutout.category,
                "segmentation": runs,
                "area": area,
                "bbox": list(bbox),
                "iscrowd": 0,
                "item_id": one.cutout.item_id,
                "licence": one.cutout.licence,
                "size_mm": round(one.size_mm, 1),
                "size_of": one.cutout.axis,
                "visible_share": round(one.visible_share, 4),
            }
        )
    image = {"file_name": name, "width": width, "height": height, "px_per_mm": round(composition.px_per_mm, 6)}
    return split, image, annotations


def _background(plan: Plan, size: tuple[int, int], generator: np.random.Generator) -> Picture:
    """A random window, of the image's shape, of one of the user's images, else a made one."""
    import cv2

    if not plan.backgrounds:
        return random_background(size, generator)
    file = plan.backgrounds[int(generator.integers(len(plan.backgrounds)))]
    pixels = read_picture(file, cv2.IMREAD_COLOR)
    if pixels is None:
        raise BadAnnotations.at(file, "background", "a picture", "something else")
    height, width = size
    share = generator.uniform(0.6, 1.0) * min(pixels.shape[0] / height, pixels.shape[1] / width)
    h, w = max(int(height * share), 1), max(int(width * share), 1)
    top, left = int(generator.integers(pixels.shape[0] - h + 1)), int(generator.integers(pixels.shape[1] - w + 1))
    window = pixels[top : top + h, left : left + w]
    return np.asarray(
        cv2.resize(window, (width, height), interpolation=cv2.INTER_AREA if share > 1 else cv2.INTER_LINEAR)
    )


def _groups(cutouts: Sequence[Cutout]) -> list[list[Cutout]]:
    """Cut-outs by class; classes without any are left out."""
    groups: dict[int, list[Cutout]] = {}
    for one in cutouts:
        groups.setdefault(one.category, []).append(one)
    return [groups[number] for number in sorted(groups)]


def _matching_pictures(
    others: Iterable[tuple[tuple[str, ...], Iterable[AnnotatedPicture]]], classes: Classes, plan: Plan
) -> Iterator[tuple[str, tuple[dict[str, Any], list[dict[str, Any]]]]]:
    """Split and entry of every image of the other sets that has an object of our classes."""
    for lists, pictures in others:
        for picture in pictures:
            record = _match(picture, classes, lists)
            if record is not None:
                yield _split(picture.file.name, plan.val_share), record


def _match(
    picture: AnnotatedPicture, classes: Classes, lists: tuple[str, ...]
) -> tuple[dict[str, Any], list[dict[str, Any]]] | None:
    """An image of another set with its objects of our classes; None if it has none or is missing."""
    annotations = []
    for one in picture:
        category = classes.of_label(one.names, lists)
        if category is not None:
            annotations.append(
                {
                    "category_id": category,
                    "segmentation": one.segmentation,
                    "area": one.area,
                    "bbox": list(one.bbox),
                    "iscrowd": int(one.crowd),
                }
            )
    if not annotations or not picture.file.is_file():
        return None
    return {"file_name": str(picture.file.resolve()), "width": picture.width, "height": picture.height}, annotations


def _write(
    file: Path,
    entries: Sequence[tuple[dict[str, Any], list[dict[str, Any]]]],
    classes: Classes,
    plan: Plan,
    summary: DatasetSummary,
    split: str,
) -> None:
    images: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    for image, objects in entries:
        images.append({"id": len(images) + 1, **image})
        for one in objects:
            annotations.append({"id": len(annotations) + 1, "image_id": len(images), **one})
            summary.by_category[one["category_id"]] += 1
    summary.pictures[split] += len(images)
    summary.objects[split] += len(annotations)
    tree = classes.tree
    document = {
        "info": {"description": "Metric-Tree training set", "version": tree.version, "seed": plan.seed, "split": split},
        "licenses": [],
        "images": images,
        "annotations": annotations,
        "categories": classes.categories(),
    }
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(document, ensure_ascii=False) + "\n", encoding="utf-8")


def _split(name: str, val_share: float) -> str:
    """The split that a name belongs to, by its hash."""
    place = int(hashlib.sha256(name.encode()).hexdigest()[:8], 16) / 16**8
    return "val" if place < val_share else "train"


def background_files(folder: Path) -> tuple[Path, ...]:
    """The images of a folder, in the order of their paths; InputError if there are none."""
    files = tuple(path for path in sorted(folder.rglob("*")) if path.suffix.lower() in _SUFFIXES)
    if not files:
        raise InputError(f"{folder}: expected pictures to paste on; found none")
    return files
