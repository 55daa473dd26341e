"""Exact masks of the visible objects of a frame, in memory and as a COCO dataset."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.ndimage import distance_transform_edt, gaussian_filter

from estimator.records.scene import Instance
from metric_base.arrays import IntArray
from tests.synthetic.rooms.world import World

__all__ = ["MIN_PIXELS", "blurred_masks", "coco_dataset", "instances_of"]

#: Minimum number of visible pixels of an object that a detector finds (about 8 x 8).
MIN_PIXELS = 64


def instances_of(world: World, ids: Sequence[IntArray]) -> tuple[Instance, ...]:
    """Return the masks of the visible part of all objects; ids : an image (h, w) of object numbers for each view."""
    instances = []
    for view, image in enumerate(ids):
        counts = np.bincount(image.ravel(), minlength=len(world.objects) + 1)
        for number in np.flatnonzero(counts[1:] >= MIN_PIXELS) + 1:
            mask = image == number
            rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
            crop = mask[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
            item = world.objects[number - 1]
            origin = (int(columns[0]), int(rows[0]))
            instances.append(Instance(f"{view}-{item.track}", view, item.label, crop, origin, 0.99, track=item.track))
    return tuple(instances)


def blurred_masks(
    instances: Sequence[Instance], size: tuple[int, int], sigma_px: float, generator: np.random.Generator
) -> tuple[Instance, ...]:
    """Return the masks with smooth errors of their borders of `sigma_px`; size : (width, height) of the image.

    Half of the variance is common to the complete border of a mask, which is then too wide or too narrow. Dilated masks
    overlap their neighbours, and masks that are eroded to fewer than `MIN_PIXELS` pixels are removed.
    """
    blurred = []
    pad = int(np.ceil(4 * sigma_px))
    for instance in instances:
        padded = np.pad(instance.mask, pad)
        # signed distance from the border, positive inside
        inside = distance_transform_edt(padded) - distance_transform_edt(~padded)
        field = gaussian_filter(generator.normal(size=padded.shape), 4 * sigma_px)
        shift = generator.normal() + field / max(field.std(), 1e-12)
        mask = inside + sigma_px / np.sqrt(2) * shift > 0
        left, top = instance.origin[0] - pad, instance.origin[1] - pad
        rows, columns = np.arange(padded.shape[0]) + top, np.arange(padded.shape[1]) + left
        mask &= ((rows >= 0) & (rows < size[1]))[:, None] & (columns >= 0) & (columns < size[0])
        if np.count_nonzero(mask) < MIN_PIXELS:
            continue
        y, x = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
        crop = mask[y[0] : y[-1] + 1, x[0] : x[-1] + 1]
        blurred.append(replace(instance, mask=crop, origin=(int(left + x[0]), int(top + y[0]))))
    return tuple(blurred)


def coco_dataset(world: World, ids: Sequence[IntArray], names: Sequence[str]) -> dict[str, Any]:
    """Return a COCO dataset with run-length masks, `score` and `track_id`; names : file name of each frame."""
    from pycocotools import mask as decode_segmentation

    labels = sorted({item.label for item in world.objects})
    annotations: list[dict[str, Any]] = []
    for instance in instances_of(world, ids):
        whole = np.zeros(ids[instance.view].shape, dtype=np.uint8, order="F")
        x, y = instance.origin
        height, width = instance.mask.shape
        whole[y : y + height, x : x + width] = instance.mask
        code = decode_segmentation.encode(whole)
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
        "info": {"description": f"synthetic room: {world.kind}, seed {world.seed}, exact masks of the visible parts"},
        "images": [
            {"id": k + 1, "file_name": name, "width": world.camera.width, "height": world.camera.height}
            for k, name in enumerate(names)
        ],
        "categories": [{"id": k + 1, "name": label} for k, label in enumerate(labels)],
        "annotations": annotations,
    }
