"""Instance masks that are arrays in memory."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from estimator.instances.masks_in_views import ViewNames, joined_instances, mask_crop
from estimator.records.scene import Instance, Scene
from metric_base.arrays import BoolArray
from metric_base.errors import InputError, at_field, in_file

__all__ = ["MasksByImage", "instances_of_masks"]

#: The masks of each image by its file name: category, mask (h, w) bool, and a score from 0 to 1 where there is one.
MasksByImage = Mapping[str, Iterable[tuple[str, BoolArray] | tuple[str, BoolArray, float]]]

#: What an error names in place of a file.
SOURCE = Path("masks")


def instances_of_masks(masks: MasksByImage, scene: Scene) -> tuple[tuple[Instance, ...], tuple[str, ...]]:
    """The instances of masks by image name, numbered from 1, and warnings.

    A mask of another size than its camera is resampled; an empty one is left out.
    """
    rows = ViewNames(scene)
    instances: list[Instance | None] = []
    for name, entries in masks.items():
        row = rows.row(name)
        for entry in entries:
            instances.append(None if row is None else _instance(str(len(instances) + 1), name, row, entry, scene))
    return joined_instances(SOURCE, scene, list(masks), instances, ())


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
