"""`instances.json` of a work folder: copied from a dataset, detected, or drawn."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from capture.sources.frames import read_frames
from capture.work_folder import WorkFolder, content_digest
from estimator.records.scene import Instance, Scene
from metric_base.input_files import read_json, read_text
from metric_base.progress import NoticeCallback, ProgressCallback

INSTANCES = "instances.json"


def coco_document(
    images: Sequence[tuple[str, int, int]], annotations: Sequence[tuple[int, str, dict[str, Any]]]
) -> dict[str, Any]:
    """Return a COCO dataset of images (name, width, height) and annotations (image index, category, other fields)."""
    names = sorted({category for _, category, _ in annotations})
    return {
        "images": [
            {"id": k + 1, "file_name": name, "width": width, "height": height}
            for k, (name, width, height) in enumerate(images)
        ],
        "categories": [{"id": k + 1, "name": name} for k, name in enumerate(names)],
        "annotations": [
            {"id": k + 1, "image_id": image + 1, "category_id": names.index(category) + 1, **fields}
            for k, (image, category, fields) in enumerate(annotations)
        ],
    }


def copy_dataset(file: Path, work: WorkFolder) -> bool:
    """Copy the part of a COCO dataset about the chosen frames to the work folder; return False for bare results.

    A dataset of a video may name every frame of it. It is copied whole if it is no valid dataset or names no chosen
    frame, so that its reader reports the error.
    """
    document = read_json(file)
    if not isinstance(document, dict):  # bare results need their categories and are read in place
        work.discard("instances", [INSTANCES])
        return False
    if file.resolve() == (work.path / INSTANCES).resolve():
        return True
    names = read_frames(work.path).names
    images, annotations = document.get("images"), document.get("annotations")
    if isinstance(images, list) and isinstance(annotations, list):
        rows = [*images, *annotations]
        if all(isinstance(row, dict) for row in rows):
            base = {k: str(row.get("file_name", "")).replace("\\", "/").split("/")[-1] for k, row in enumerate(images)}
            kept = [row for k, row in enumerate(images) if base[k] in names]
            if kept and all(isinstance(row.get("id"), int | str) for row in kept):
                others = [row.get("id") for row in images if row not in kept]
                about = [row for row in annotations if row.get("image_id") not in others]
                document = document | {"images": kept, "annotations": about}
    _write_stage(work, {"file": content_digest(file), "frames": names}, document)
    return True


def save_drawing(document: dict[str, Any], work: WorkFolder) -> None:
    """Write the instances that a person drew to the work folder."""
    _write_stage(work, {"drawn": document}, document)


def _write_stage(work: WorkFolder, inputs: dict[str, Any], document: dict[str, Any]) -> None:
    def make(part: Path) -> None:
        (part / INSTANCES).write_text(json.dumps(document) + "\n", encoding="utf-8")

    work.stage("instances", inputs, [INSTANCES], make)


def detect_stage(
    model: str, labels: Path | None, work: WorkFolder, progress: ProgressCallback, notice: NoticeCallback
) -> None:
    """Write the instances that a detector finds in the chosen frames to the work folder.

    Parameters
    ----------
    model, labels : str, Path or None
        Arguments of `load_detector`.
    work : WorkFolder
    progress : callable
    notice : callable
        Called with each warning.
    """
    from estimator.detectors.detect import detect_instances
    from estimator.detectors.detector import MAX_LABEL_BYTES, load_detector
    from estimator.reconstructions.colmap import read_colmap

    def make(part: Path) -> None:
        scene = read_colmap(work.path / "sparse" / "0")
        detector = load_detector(model, labels, notice)
        instances, warnings = detect_instances(scene, work.path / "frames", detector, progress)
        for line in warnings:
            notice(line)
        write_instances(instances, scene, part / INSTANCES)

    inputs = {
        "detector": content_digest(Path(model)) if Path(model).is_file() else model,
        "labels": None if labels is None else read_text(labels, MAX_LABEL_BYTES),
        "model": content_digest(work.path / "sparse"),
    }
    work.stage("instances", inputs, [INSTANCES], make)


def write_instances(instances: Sequence[Instance], scene: Scene, file: Path) -> None:
    """Write a COCO dataset with an image per view and an annotation per instance."""
    from pycocotools import mask as decode_segmentation

    rows = []
    for instance in instances:
        camera = scene.views[instance.view].camera
        height, width = instance.mask.shape
        x, y = instance.origin
        box = {"bbox": [x, y, width, height], "area": int(instance.mask.sum()), "iscrowd": 0, "score": instance.score}
        if not instance.from_box:
            full = np.zeros((camera.height, camera.width), dtype=np.uint8, order="F")
            full[y : y + height, x : x + width] = instance.mask
            code = decode_segmentation.encode(full)
            box["segmentation"] = {"size": [int(n) for n in code["size"]], "counts": code["counts"].decode("ascii")}
        rows.append((instance.view, instance.category, box))
    images = [(view.name, view.camera.width, view.camera.height) for view in scene.views]
    file.write_text(json.dumps(coco_document(images, rows)) + "\n", encoding="utf-8")
