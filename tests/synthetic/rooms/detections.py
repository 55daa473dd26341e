"""Simulate the boxes of a detector of COCO's 80 categories in a synthetic scene.

Boxes enclose the visible part of an object, with edge errors of a few per cent. Small objects are missed more often.
Objects of other categories are missed or labelled with similar categories, which differ from frame to frame.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from estimator.records.scene import Instance
from metric_base.arrays import FloatArray
from tests.synthetic.rooms.masks import MIN_PIXELS

__all__ = ["DetectorErrors", "detections_of"]

#: Labels of objects that are not among the 80 categories, with their probabilities; otherwise the object is missed. The
#: values are from common experience with such detectors, not from any scene.
SIMILAR_LABELS: Mapping[str, tuple[tuple[str, float], ...]] = {
    "alarm clock": (("clock", 0.6),),
    "armchair": (("chair", 0.5), ("couch", 0.4)),
    "bathtub": (("sink", 0.2), ("toilet", 0.1)),
    "bookcase": (("refrigerator", 0.05),),
    "cabinet": (("refrigerator", 0.2), ("oven", 0.15)),
    "coffee table": (("dining table", 0.5), ("bench", 0.1)),
    "desk": (("dining table", 0.7),),
    "dresser": (("refrigerator", 0.1), ("oven", 0.1)),
    "floor lamp": (("vase", 0.05),),
    "kettle": (("cup", 0.25), ("vase", 0.25), ("bottle", 0.1)),
    "lamp": (("vase", 0.2), ("cup", 0.1)),
    "monitor": (("tv", 0.9),),
    "nightstand": (("chair", 0.1),),
    "office chair": (("chair", 0.95),),
    "printer": (("microwave", 0.4), ("suitcase", 0.1)),
    "stool": (("chair", 0.4), ("dining table", 0.1)),
    "trash can": (("cup", 0.25), ("vase", 0.25), ("toilet", 0.1)),
    "tv stand": (("dining table", 0.1), ("bench", 0.1)),
    "wardrobe": (("refrigerator", 0.3),),
    "washing machine": (("oven", 0.3), ("microwave", 0.2)),
    "bench": (("bench", 0.9),),
}


@dataclass(frozen=True, slots=True)
class DetectorErrors:
    """Error model of a detector.

    edge_px, edge_fraction : standard deviation of an edge, in pixels plus a fraction of the box's side.
    gross_probability, gross_fraction : probability of a gross error of an edge, and its maximum as a fraction of the
        side.
    missed : fraction of large objects that are missed in a frame.
    small_px : area in pixels at which half of the other objects are missed too.
    """

    edge_px: float = 1.0
    edge_fraction: float = 0.02
    gross_probability: float = 0.05
    gross_fraction: float = 0.2
    missed: float = 0.15
    small_px: float = 900.0


def detections_of(
    instances: Sequence[Instance], size: tuple[int, int], seed: int, errors: DetectorErrors | None = None
) -> tuple[Instance, ...]:
    """Return the detected boxes of the masks of a scene; size : (width, height) of the images."""
    errors = errors or DetectorErrors()
    generator = np.random.default_rng([seed, 31])
    labels_of: dict[str, list[tuple[str, float]]] = {}
    boxes = []
    for instance in instances:
        area = int(np.count_nonzero(instance.mask))
        probability = (1 - errors.missed) * (1 - min(1.0, errors.small_px / max(area, 1)) / 2)
        # an object has the same probabilities in all frames
        labels = labels_of.setdefault(instance.track or instance.id, _labels(instance.category, generator))
        name = _drawn_label(labels, generator)
        score = float(np.clip(generator.beta(6, 3), 0.3, 0.97))
        box = _box(instance, size, errors, generator)
        if name is None or box is None or generator.random() > probability:
            continue
        left, top, right, bottom = box
        mask = np.ones((bottom - top, right - left), dtype=bool)
        boxes.append(replace(instance, category=name, mask=mask, origin=(left, top), score=score, from_box=True))
    return tuple(boxes)


def _labels(category: str, generator: np.random.Generator) -> list[tuple[str, float]]:
    """Return the labels of an object with their probabilities, a random variation of the category's."""
    labels = SIMILAR_LABELS.get(category)
    if labels is None:
        return [(category, 1.0)]
    probabilities = np.array([probability for _, probability in labels])
    varied = generator.dirichlet(2 * probabilities / probabilities.sum()) * probabilities.sum()
    return [(name, float(probability)) for (name, _), probability in zip(labels, varied, strict=True)]


def _drawn_label(labels: Sequence[tuple[str, float]], generator: np.random.Generator) -> str | None:
    """Draw a label, or None if the object is missed."""
    drawn = generator.random()
    for name, probability in labels:
        drawn -= probability
        if drawn < 0:
            return name
    return None


def _box(
    instance: Instance, size: tuple[int, int], errors: DetectorErrors, generator: np.random.Generator
) -> tuple[int, int, int, int] | None:
    """Return left, top, right and bottom in integer pixels, or None if the box is too small."""
    (height, width), (left, top) = instance.mask.shape, instance.origin
    sides = np.array([width, height, width, height], dtype=float)
    error = generator.normal(0, 1, 4) * (errors.edge_px + errors.edge_fraction * sides)
    gross = generator.random(4) < errors.gross_probability
    error[gross] = generator.uniform(-1, 1, int(gross.sum())) * (errors.gross_fraction * sides[gross])
    ends: FloatArray = np.array([left, top, left + width, top + height], dtype=float) + error
    # edges at the border of the image have no error
    limits = np.array([size[0], size[1], size[0], size[1]])
    at_border = np.array([left <= 1, top <= 1, left + width >= size[0] - 1, top + height >= size[1] - 1])
    ends = np.where(at_border, [0, 0, size[0], size[1]], ends)
    x0, y0, x1, y1 = np.clip(np.rint(ends), 0, limits).astype(int).tolist()
    if (x1 - x0) * (y1 - y0) < MIN_PIXELS or x1 <= x0 or y1 <= y0:
        return None
    return (x0, y0, x1, y1)
