"""A street with parked and moving cars, people and signs between two rows of houses, for a camera in a car."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from metric_base.arrays import FloatArray
from tests.synthetic.rooms.cameras import drive
from tests.synthetic.rooms.furnish import tilted_solid, turn_about_z
from tests.synthetic.rooms.knobs import Knobs
from tests.synthetic.rooms.layout import Footprint, apart
from tests.synthetic.rooms.sizes import Sizes, typical_sizes
from tests.synthetic.rooms.solids import Mesh, box, join, rotate
from tests.synthetic.rooms.world import Placed, World

__all__ = ["street"]

#: Distance between frames in metres.
STEP = 1.1
#: Half the width of the road, the width of a pavement, and the distance of parked cars from the centre line, in metres.
ROAD, PAVEMENT, PARKED = 5.2, 3.0, 4.0
LENGTH = 60.0
#: Maximum number of random positions for an object; if none is free, the object is omitted.
MAX_TRIES = 60

#: Category, minimum and maximum number, location: parked at the kerb, moving in a lane, or walking or standing on a
#: pavement.
_TRAFFIC = (
    ("car", 6, 12, "parked"), ("truck", 0, 1, "parked"), ("car", 1, 3, "moving"), ("bus", 0, 1, "moving"),
    ("person", 1, 4, "pavement"), ("person", 1, 2, "walking"), ("stop sign", 1, 3, "pavement"), ("bench", 0, 2,
    "pavement"), ("trash can", 0, 2, "pavement"), ("potted plant", 0, 2, "pavement"),
)  # fmt: skip


def street(seed: int, knobs: Knobs | None = None, sizes: Sizes = typical_sizes) -> World:
    """Return a street. The result depends only on seed, knobs and sizes; velocities are in metres per frame."""
    knobs = knobs or Knobs()
    generator = np.random.default_rng([seed, 99])
    poses = drive(STEP, knobs, generator)
    placed: list[Placed] = []
    prints: list[Footprint] = []
    for category, low, high, where in _TRAFFIC:
        for _ in range(int(generator.integers(low, high + 1))):
            _add(placed, prints, category, where, sizes(category, generator) / 1000.0, generator)
    objects = [_mislabel(item, knobs, generator) for item in _keep_some(placed, knobs.objects, generator)]
    return World("street", seed, tuple(objects), _surroundings(generator), poses)


def _add(
    placed: list[Placed],
    prints: list[Footprint],
    category: str,
    where: str,
    size: FloatArray,
    generator: np.random.Generator,
) -> None:
    mesh = tilted_solid(category, size, 0.0, 0.0)
    for _ in range(MAX_TRIES):
        side = float(generator.choice([-1.0, 1.0]))
        along = float(generator.uniform(5, LENGTH - 12))
        print_, velocity = _spot(where, side, along, size, generator)
        travelled = (
            Footprint(print_.centre, print_.half + np.abs(velocity[[1, 0]]) * 24, print_.yaw)
            if np.any(velocity)
            else print_
        )
        if all(apart(travelled, other, 0.3) for other in prints):
            track = f"{category.replace(' ', '_')}-{1 + sum(other.category == category for other in placed)}"
            world = rotate(mesh, turn_about_z(print_.yaw), np.array([*print_.centre, 0.0]))
            placed.append(Placed(track, category, category, size, world, velocity))
            prints.append(travelled)
            return


def _spot(
    where: str, side: float, along: float, size: FloatArray, generator: np.random.Generator
) -> tuple[Footprint, FloatArray]:
    """Return a footprint and a velocity for a location. Traffic drives on the right."""
    half, heading = size[:2] / 2, np.pi / 2 if side > 0 else -np.pi / 2
    still = np.zeros(3)
    if where == "parked":
        return Footprint(
            np.array([side * (PARKED + generator.normal(0, 0.1)), along]), half, heading + generator.normal(0, 0.02)
        ), still
    if where == "moving":
        speed = side * STEP * generator.uniform(0.5, 1.3)
        return Footprint(np.array([side * 1.6, max(along, 14.0)]), half, heading), np.array([0.0, speed, 0.0])
    offset = ROAD + generator.uniform(0.6, PAVEMENT - 0.6)
    if where == "walking":
        stride = np.array([0.0, side * generator.uniform(0.2, 0.5), 0.0])
        return Footprint(np.array([side * offset, along]), half, heading), stride
    return Footprint(
        np.array([side * offset, along]), half, float(generator.choice([0.0, np.pi / 2, np.pi, -np.pi / 2]))
    ), still


def _keep_some(placed: list[Placed], keep: int | None, generator: np.random.Generator) -> list[Placed]:
    if keep is None or keep >= len(placed):
        return placed
    chosen = sorted(generator.choice(len(placed), max(keep, 1), replace=False))
    return [placed[int(k)] for k in chosen]


def _mislabel(item: Placed, knobs: Knobs, generator: np.random.Generator) -> Placed:
    """Return the object with the label of another street object, or without points on its foot."""
    wrong, footless = generator.random(2) < (knobs.mislabelled, knobs.missing_feet)
    others = sorted({category for category, *_ in _TRAFFIC} - {item.category})
    return replace(
        item, label=others[int(generator.integers(len(others)))] if wrong else item.label, no_foot=bool(footless)
    )


def _surroundings(generator: np.random.Generator) -> Mesh:
    """Return road, pavements, a dashed centre line, and house fronts of different depth and height."""
    edge, end = ROAD + PAVEMENT, LENGTH + 30
    parts = [box((-ROAD, ROAD), (-10, end), (-0.1, 0), "road")]
    parts += [box(x, (-10, end), (-0.1, 0.0), "pavement") for x in ((-edge, -ROAD), (ROAD, edge))]
    parts += [box((-0.06, 0.06), (y, y + 1.5), (0, 0.003), "line") for y in np.arange(0, LENGTH, 4.0)]
    for side in (-1.0, 1.0):
        start = -10.0
        while start < end:
            width, back, tall = generator.uniform(6, 12), generator.uniform(0.0, 1.5), generator.uniform(5, 11)
            x = sorted((side * (edge + back), side * (edge + 8)))
            parts.append(box(x, (start, start + width), (-0.1, tall), "facade"))
            start += width + generator.choice([0.0, 0.0, 2.0])
    parts.append(box((-20, 20), (end, end + 1), (0, 9), "facade"))
    return join(parts)
