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
from metric_base.progress import NoticeCallback, ProgressCallback, no_notice, silent

INSTANCES = "instances.json"


def copy_dataset(file: Path, work: WorkFolder) -> bool:
    """Copy the part of a dataset that is about the chosen frames; whether it is one (bare results are not copied).

    A dataset of a video may name every frame of it.
    """
    document = read_json(file)
    if not isinstance(document, dict):  # bare results need their categories: they are read where they are
        work.discard("instances", [INSTANCES])
        return False
    if file.resolve() == (work.path / INSTANCES).resolve():
        return True
    names = read_frames(work.path).names

    def make(part: Path) -> None:
        kept = json.dumps(_of_frames(document, set(names)))
        (part / INSTANCES).write_text(kept + "\n", encoding="utf-8")

    work.stage("instances", {"file": content_digest(file), "frames": names}, [INSTANCES], make)
    return True


def detect_stage(
    model: str,
    labels: Path | None,
    work: WorkFolder,
    progress: ProgressCallback = silent,
    notice: NoticeCallback = no_notice,
) -> None:
    """The instances that a detector sees in the chosen frames.

    model, labels : as `load_detector` takes them; notice : is called with each warning.
    """
    from estimator.detectors.detect import detect_instances
    from estimator.detectors.detector import MAX_LABEL_BYTES, load_detector
    from estimator.reconstructions.colmap import read_colmap

    def make(part: Path) -> None:
        scene = read_colmap(work.path / "sparse" / "0")
        detector = load_detector(model, labels)
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


def save_drawing(document: dict[str, Any], work: WorkFolder) -> None:
    """Keep the instances that a person drew."""

    def make(part: Path) -> None:
        (part / INSTANCES).write_text(json.dumps(document) + "\n", encoding="utf-8")

    work.stage("instances", {"drawn": document}, [INSTANCES], make)


def write_instances(instances: Sequence[Instance], scene: Scene, file: Path) -> None:
    """One image for each view of the scene, one annotation for each instance; the caller makes the file whole."""
    names = sorted({instance.category for instance in instances})
    document = {
        "images": [
            {"id": k + 1, "file_name": view.name, "width": view.camera.width, "height": view.camera.height}
            for k, view in enumerate(scene.views)
        ],
        "categories": [{"id": k + 1, "name": name} for k, name in enumerate(names)],
        "annotations": [
            _annotation(k + 1, instance, scene, names.index(instance.category) + 1)
            for k, instance in enumerate(instances)
        ],
    }
    file.write_text(json.dumps(document) + "\n", encoding="utf-8")


def _of_frames(document: dict[str, Any], names: set[str]) -> dict[str, Any]:
    """The dataset without images of other frames; as it is where that would leave nothing, or it is no dataset."""
    images, annotations = document.get("images"), document.get("annotations")
    if not isinstance(images, list) or not isinstance(annotations, list):
        return document
    if not all(isinstance(row, dict) for row in (*images, *annotations)):
        return document
    kept = [image for image in images if str(image.get("file_name", "")).replace("\\", "/").split("/")[-1] in names]
    ids = [image.get("id") for image in kept]
    if not kept or not all(isinstance(number, int | str) for number in ids):
        return document
    others = [image.get("id") for image in images if image not in kept]
    about = [annotation for annotation in annotations if annotation.get("image_id") not in others]
    return document | {"images": kept, "annotations": about}


def _annotation(number: int, instance: Instance, scene: Scene, category: int) -> dict[str, Any]:
    from pycocotools import mask as decode_segmentation

    camera = scene.views[instance.view].camera
    height, width = instance.mask.shape
    x, y = instance.origin
    row: dict[str, Any] = {
        "id": number,
        "image_id": instance.view + 1,
        "category_id": category,
        "bbox": [x, y, width, height],
        "area": int(instance.mask.sum()),
        "iscrowd": 0,
        "score": instance.score,
    }
    if not instance.from_box:
        whole = np.zeros((camera.height, camera.width), dtype=np.uint8, order="F")
        whole[y : y + height, x : x + width] = instance.mask
        code = decode_segmentation.encode(whole)
        row["segmentation"] = {"size": [int(n) for n in code["size"]], "counts": code["counts"].decode("ascii")}
    return row
