"""ADE20K in the form of the Places Challenge 2017, which most of its users have (ADEChallengeData2016).

`annotations_instance/<split>/<name>.png`: red is one of 100 classes, green the number of the instance, whatever its
class; 0 is neither. The pictures are `images/<split>/<name>.jpg`, beside `annotations_instance`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from metric_tree.training.annotations import (
    AnnotatedObject,
    AnnotatedPicture,
    BadAnnotations,
    coded_picture,
    run_lengths,
)

__all__ = ["CLASSES", "files", "picture"]

_FOLDER = "annotations_instance"

#: The challenge's classes 1 to 100, in the order of its `instanceInfo100_train.txt` and `imgCatIds.json`.
CLASSES = (
    "bed", "windowpane", "cabinet", "person", "door", "table", "curtain", "chair", "car", "painting",
    "sofa", "shelf", "mirror", "armchair", "seat", "fence", "desk", "wardrobe", "lamp", "bathtub",
    "railing", "cushion", "box", "column", "signboard", "chest of drawers", "counter", "sink", "fireplace",
    "refrigerator", "stairs", "case", "pool table", "pillow", "screen door", "bookcase", "coffee table", "toilet",
    "flower", "book", "bench", "countertop", "stove", "palm", "kitchen island", "computer", "swivel chair", "boat",
    "arcade machine", "bus", "towel", "light", "truck", "chandelier", "awning", "streetlight", "booth",
    "television receiver", "airplane", "apparel", "pole", "bannister", "ottoman", "bottle", "van", "ship", "fountain",
    "washer", "plaything", "stool", "barrel", "basket", "bag", "minibike", "oven", "ball", "food", "step",
    "trade name", "microwave", "pot", "animal", "bicycle", "dishwasher", "screen", "sculpture", "hood", "sconce",
    "vase", "traffic light", "tray", "ashcan", "fan", "plate", "monitor", "bulletin board", "radiator", "glass",
    "clock", "flag",
)  # fmt: skip


def files(folder: Path) -> list[Path]:
    """The instance pictures of a folder."""
    return sorted(file for file in folder.rglob("*.png") if file.parent.parent.name == _FOLDER)


def picture(file: Path) -> AnnotatedPicture:
    """The picture of an instance picture.

    Raises
    ------
    BadAnnotations
        The picture does not have three channels, or a class is not one of the hundred.
    """
    coded = coded_picture(file)
    classes, instances = coded[:, :, 0], coded[:, :, 1]
    objects = []
    for instance in np.unique(instances[instances > 0]):
        mask = instances == instance
        number = int(np.bincount(classes[mask]).argmax())
        if not 1 <= number <= len(CLASSES):
            raise BadAnnotations.at(file, "red", f"a class from 1 to {len(CLASSES)}", number)
        objects.append(AnnotatedObject((CLASSES[number - 1],), *run_lengths(mask)))
    height, width = instances.shape
    seen = file.parent.parent.parent / "images" / file.parent.name / f"{file.stem}.jpg"
    return AnnotatedPicture(seen, width, height, tuple(objects))
