"""Exact masks of a frame's visible objects, in memory and as a COCO dataset."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from estimator.records.scene import Instance
from metric_base.arrays import IntArray
from tests.made.rooms.world import World

__all__ = ["MIN_PIXELS", "coco_dataset", "instances_of"]

#: Visible pixels below which a detector would not find the thing (about eight by eight).
MIN_PIXELS = 64


def instances_of(world: World, ids: Sequence[IntArray]) -> tuple[Instance, ...]:
    """The visible part of every object in every frame; ids : one (h, w) image of object numbers per view."""
    instances = []
    for view, image in enumerate(ids):
        counts = np.bincount(image.ravel(), minlength=len(world.objects) + 1)
        for number in np.flatnonzero(counts[1:] >= MIN_PIXELS) + 1:
            mask = image == number
            rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
            crop = mask[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
            thing = world.objects[number - 1]
            origin = (int(columns[0]), int(rows[0]))
            instances.append(
                Instance(f"{view}-{thing.track}", view, thing.label, crop, origin, 0.99, track=thing.track)
            )
    return tuple(instances)


def coco_dataset(world: World, ids: Sequence[IntArray], names: Sequence[str]) -> dict[str, Any]:
    """A COCO dataset with run-length masks, `score` and `track_id`; names : file name of each frame."""
    from pycocotools import mask as coco_mask

    labels = sorted({thing.label for thing in world.objects})
    annotations: list[dict[str, Any]] = []
    for instance in instances_of(world, ids):
        whole = np.zeros(ids[instance.view].shape, dtype=np.uint8, order="F")
        x, y = instance.origin
        height, width = instance.mask.shape
        whole[y : y + height, x : x + width] = instance.mask
        code = coco_mask.encode(whole)
        annotations.append(
            {
                "id": len(annotations) + 1,
                "image_id": instance.view + 1,
                "category_id": labels.index(instance.category) + 1,
                "segmentation": {"size": [int(n) for n in code["size"]], "counts": code["counts"].decode("ascii")},
                "bbox": [x, y, width, height],
                "area": int(instance.mask.sum()),
                "iscrowd": 0,
                "score": instance.score,
                "track_id": instance.track,
            }
        )
    return {
        "info": {"description": f"made room: {world.kind}, seed {world.seed}, exact masks of what is visible"},
        "images": [
            {"id": k + 1, "file_name": name, "width": world.camera.width, "height": world.camera.height}
            for k, name in enumerate(names)
        ],
        "categories": [{"id": k + 1, "name": label} for k, label in enumerate(labels)],
        "annotations": annotations,
    }
