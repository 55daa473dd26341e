"""Captures whose dense clouds mislead about the vertical: smeared, turned, with floaters, or steep (z is up)."""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from estimator.records.scene import View
from metric_base.arrays import FloatArray
from tests.synthetic.shapes import view_at

CAPTURES = ("vehicle-mounted", "forward-moving", "hand-held", "nadir")
DEFECTS = ("smeared", "floaters", "steep", "turned")
#: Number of views, and of points before floaters are added.
N_VIEWS, N_POINTS = 24, 4000
#: Gradients of steep streets.
MIN_GRADE, MAX_GRADE = 0.05, 0.12
#: Standard deviations of points along their rays, relative to the distance; one point in seven of a smeared cloud has
#: four times the error.
NOISE, SMEAR = 0.004, 0.03
#: Angle in degrees by which a dense cloud was once turned.
TURN_DEG = 5.8


def misleading_capture(capture: str, defect: str, seed: int) -> tuple[tuple[View, ...], tuple[FloatArray, FloatArray]]:
    """Return the views, the sparse and the dense points (n, 3) of one of `CAPTURES`, dense ones with one of `DEFECTS`.

    The sparse points are a third of the points. Their only defect is the steepness of the street.
    """
    generator = np.random.default_rng([seed, CAPTURES.index(capture), DEFECTS.index(defect)])
    grade = generator.uniform(MIN_GRADE, MAX_GRADE) if defect == "steep" else 0.0
    views = _views(capture, grade, generator)
    points = _room(generator) if capture == "hand-held" else _street(capture == "nadir", generator)
    points[:, 2] += grade * points[:, 1]  # walls remain vertical
    eyes = np.array([view.centre for view in views])[generator.integers(0, N_VIEWS, len(points))]
    error = generator.normal(0, SMEAR if defect == "smeared" else NOISE, (len(points), 1))
    if defect == "smeared":
        error *= np.where(generator.random((len(points), 1)) < 1 / 7, 4, 1)
    rays = points - eyes
    points = eyes + rays * (1 + error)
    if defect == "floaters":
        low, high = np.percentile(points, [1, 99], axis=0)
        count, margin = len(points) // 7, 0.3 * (high - low)
        blob = generator.uniform(low, high) + generator.normal(0, 0.03, (count // 2, 3)) * (high - low)
        points = np.vstack([points, generator.uniform(low - margin, high + margin, (count, 3)), blob])
    sparse = eyes + rays * (1 + generator.normal(0, NOISE, (len(rays), 1)))
    if defect == "turned":
        axis = generator.normal(size=2)
        points = Rotation.from_rotvec(np.radians(TURN_DEG) * np.array([*axis, 0]) / np.hypot(*axis)).apply(points)
    return views, (sparse[::3], np.asarray(points))


def _views(capture: str, grade: float, generator: np.random.Generator) -> tuple[View, ...]:
    time = np.linspace(0, 1, N_VIEWS)
    noise = generator.normal(0, 1, (4, N_VIEWS))
    if capture == "nadir":  # two strips; the flight turns, or it does not
        eyes = np.column_stack([40 * (2 * time % 1) - 20, np.where(time < 0.5, 10, 40), np.full(N_VIEWS, 45.0)])
        ahead = np.column_stack([0.05 * noise[0], 0.05 * noise[1], np.full(N_VIEWS, -1.0)])
        rolls = 4 * noise[2] + np.where(time < 0.5, 90, -90)
    else:
        speed, height, pitch_deg, roll_deg = {
            "vehicle-mounted": (30, 1.6, generator.normal(-2, 1), 0.5),
            "forward-moving": (12, 1.6, generator.normal(-12, 6), 1.25),
            "hand-held": (0.5, 1.5, generator.normal(-15, 6), 1.25),
        }[capture]
        turn_deg = generator.uniform(80, 300) if capture == "hand-held" else 6.0
        yaw = np.radians(turn_deg * time + 2 * noise[0])
        road = grade if capture == "vehicle-mounted" else 0.0  # a vehicle is tilted with its street
        slope = np.tan(np.radians(pitch_deg + noise[1])) + road
        ahead = np.column_stack([np.sin(yaw), np.cos(yaw), slope])
        eyes = np.column_stack([1.5 + 0.2 * noise[2], 2 + speed * time, height + grade * (2 + speed * time)])
        rolls = roll_deg * noise[3]
    return tuple(
        view_at(eye, eye + way, "v", roll=roll) for eye, way, roll in zip(eyes, ahead, rolls.tolist(), strict=True)
    )


def _street(is_seen_from_above: bool, generator: np.random.Generator) -> FloatArray:
    """Return points of a street with houses and parked cars, or of a field with the roofs of houses."""
    if is_seen_from_above:
        corners = generator.uniform([-40, 0, 3], [30, 50, 9], (8, 3))
        roofs = [_plane(corner, (9, 0, 0), (0, 9, 0), 0.05, generator) for corner in corners]
        return np.vstack([_plane((-45, -5, 0), (90, 0, 0), (0, 70, 0), 0.6, generator), *roofs])
    walls = [_plane((x, 0, 0), (0, 60, 0), (0, 0, 8), 0.15, generator) for x in (-6, 6)]
    roofs = [_plane((2.5, 4 + 7 * k, 1.5), (1.8, 0, 0), (0, 4.3, 0), 0.015, generator) for k in range(8)]
    doors = [_plane((2.5, 4 + 7 * k, 0), (0, 4.3, 0), (0, 0, 1.5), 0.02, generator) for k in range(8)]
    return np.vstack([_plane((-6, 0, 0), (12, 0, 0), (0, 60, 0), 0.45, generator), *walls, *roofs, *doors])


def _room(generator: np.random.Generator) -> FloatArray:
    """Return points of the floor, three walls and the tops and fronts of five objects of a room of 4 m."""
    parts = [_plane((0, 0, 0), (4, 0, 0), (0, 4, 0), 0.3, generator)]
    sides = (((0, 0, 0), (4, 0, 0)), ((0, 0, 0), (0, 4, 0)), ((4, 0, 0), (0, 4, 0)))
    parts += [_plane(corner, side, (0, 0, 2.5), 0.15, generator) for corner, side in sides]
    for _, is_top in product(range(5), (True, False)):
        length, width, height = generator.uniform(0.4, 1.2, 3)
        x, y = generator.uniform(0, 3, 2)
        other = (0, width, 0) if is_top else (0, 0, height)
        parts.append(_plane((x, y, height if is_top else 0), (length, 0, 0), other, 0.04, generator))
    return np.vstack(parts)


def _plane(
    corner: tuple[float, ...] | FloatArray,
    one: tuple[float, ...],
    other: tuple[float, ...],
    fraction: float,
    generator: np.random.Generator,
) -> FloatArray:
    """Return a fraction of `N_POINTS`, evenly distributed on a parallelogram."""
    u, v = generator.random((2, int(fraction * N_POINTS), 1))
    return np.asarray(np.asarray(corner) + u * np.asarray(one) + v * np.asarray(other))
