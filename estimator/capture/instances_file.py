"""Instances written as a COCO dataset with run-length masks."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from estimator.records.scene import Instance, Scene

__all__ = ["write_instances"]


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


def _annotation(number: int, instance: Instance, scene: Scene, category: int) -> dict[str, Any]:
    from pycocotools import mask as coco_mask

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
        code = coco_mask.encode(whole)
        row["segmentation"] = {"size": [int(n) for n in code["size"]], "counts": code["counts"].decode("ascii")}
    return row
