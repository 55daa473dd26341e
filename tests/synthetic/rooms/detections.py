"""What a detector of COCO's 80 categories makes of a synthetic scene: boxes and no masks, in some of the frames.

Boxes are drawn around what is visible. Edges are off by a few per cent, small objects are missed more often, and one
that is none of the 80 is missed or called what it looks like, by one name in one frame and another in the next.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from estimator.records.scene import Instance
from metric_base.arrays import FloatArray
from tests.synthetic.rooms.masks import MIN_PIXELS

__all__ = ["DetectorErrors", "detections_of"]

#: What objects that are none of the 80 are called, and how often; the rest of the time they are missed. From common
#: experience with such detectors, not from any scene.
LOOKS_LIKE: Mapping[str, tuple[tuple[str, float], ...]] = {
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
    """How far a detector's boxes are off.

    edge_px, edge_share : one sigma of an edge, in pixels and as a share of the box's side; wild : share of edges that
    are off by up to `wild_share` of the side; missed : share of large objects that a frame misses; small_px : area
    in pixels at which half of the rest are missed too.
    """

    edge_px: float = 1.0
    edge_share: float = 0.02
    wild: float = 0.05
    wild_share: float = 0.2
    missed: float = 0.15
    small_px: float = 900.0


def detections_of(
    instances: Sequence[Instance], size: tuple[int, int], seed: int, errors: DetectorErrors | None = None
) -> tuple[Instance, ...]:
    """Boxes of the masks of a scene as a detector draws them; size : (width, height) of the pictures."""
    errors = errors or DetectorErrors()
    generator = np.random.default_rng([seed, 31])
    habits: dict[str, list[tuple[str, float]]] = {}
    boxes = []
    for instance in instances:
        area = int(np.count_nonzero(instance.mask))
        seen = (1 - errors.missed) * (1 - min(1.0, errors.small_px / max(area, 1)) / 2)
        # an object that is seen in many frames has one habit
        habit = habits.setdefault(instance.track or instance.id, _habit(instance.category, generator))
        name = _name(habit, generator)
        score = float(np.clip(generator.beta(6, 3), 0.3, 0.97))
        box = _box(instance, size, errors, generator)
        if name is None or box is None or generator.random() > seen:
            continue
        left, top, right, bottom = box
        mask = np.ones((bottom - top, right - left), dtype=bool)
        boxes.append(replace(instance, category=name, mask=mask, origin=(left, top), score=score, from_box=True))
    return tuple(boxes)


def _habit(category: str, generator: np.random.Generator) -> list[tuple[str, float]]:
    """Names of one object and their shares: its usual ones, each object leaning to one of them."""
    names = LOOKS_LIKE.get(category)
    if names is None:
        return [(category, 1.0)]
    shares = np.array([share for _, share in names])
    lean = generator.dirichlet(2 * shares / shares.sum()) * shares.sum()
    return [(name, float(share)) for (name, _), share in zip(names, lean, strict=True)]


def _name(habit: Sequence[tuple[str, float]], generator: np.random.Generator) -> str | None:
    drawn = generator.random()
    for name, share in habit:
        drawn -= share
        if drawn < 0:
            return name
    return None


def _box(
    instance: Instance, size: tuple[int, int], errors: DetectorErrors, generator: np.random.Generator
) -> tuple[int, int, int, int] | None:
    """Left, top, right, bottom in whole pixels; None where nothing is left."""
    (height, width), (left, top) = instance.mask.shape, instance.origin
    sides = np.array([width, height, width, height], dtype=float)
    error = generator.normal(0, 1, 4) * (errors.edge_px + errors.edge_share * sides)
    wild = generator.random(4) < errors.wild
    error[wild] = generator.uniform(-1, 1, int(wild.sum())) * (errors.wild_share * sides[wild])
    ends: FloatArray = np.array([left, top, left + width, top + height], dtype=float) + error
    # an edge at the border of the picture stays there
    limits = np.array([size[0], size[1], size[0], size[1]])
    at_border = np.array([left <= 1, top <= 1, left + width >= size[0] - 1, top + height >= size[1] - 1])
    ends = np.where(at_border, [0, 0, size[0], size[1]], ends)
    whole = np.clip(np.rint(ends), 0, limits).astype(int).tolist()
    if (whole[2] - whole[0]) * (whole[3] - whole[1]) < MIN_PIXELS or whole[2] <= whole[0] or whole[3] <= whole[1]:
        return None
    return (whole[0], whole[1], whole[2], whole[3])
