"""Camera paths: a walk on an arc in front of the furniture, and a straight drive."""

from __future__ import annotations

import numpy as np

from tests.synthetic.rooms.knobs import Knobs
from tests.synthetic.rooms.world import Pose, pose_towards

__all__ = ["drive", "walk"]

#: Angle of the arc of an ordinary walk around the furniture.
WALK_DEG = 150.0
#: Standard deviation of the roll of a hand-held camera.
ROLL_DEG = 2.0


def walk(radius: float, centre: tuple[float, float], knobs: Knobs, generator: np.random.Generator) -> tuple[Pose, ...]:
    """Return the poses of a hand-held walk on an arc of `radius` metres around `centre`.

    Height and viewing direction vary slowly. With `knobs.turn_deg` the camera moves sideways instead, and its heading
    stays within this range.
    """
    time = np.linspace(0, knobs.coverage, knobs.views)
    wander = 0.25 * np.sin(2 * np.pi * (time + generator.random()))
    height = (
        1.45 + 0.22 * np.sin(2 * np.pi * (1.5 * time + generator.random())) + generator.normal(0, 0.02, knobs.views)
    )
    roll = np.radians(generator.normal(0, ROLL_DEG, knobs.views))
    if knobs.turn_deg is not None:
        heading = np.pi / 2 + np.radians(knobs.turn_deg) * (time / knobs.coverage - 0.5)
        eye = np.column_stack(
            [1.3 * radius * (time - knobs.coverage / 2) + centre[0], np.full(knobs.views, centre[1] - radius), height]
        )
        gaze = eye + np.column_stack([np.cos(heading), np.sin(heading), np.full(knobs.views, -0.3)])
    else:
        angle = np.radians(-90 + WALK_DEG * (time - 0.5))
        distance = radius * (1 - 0.12 * np.sin(3 * np.pi * time))
        eye = np.column_stack([centre[0] + distance * np.cos(angle), centre[1] + distance * np.sin(angle), height])
        gaze = np.column_stack(
            [centre[0] + wander, np.full(knobs.views, centre[1] + 0.3), 0.55 + 0.15 * np.cos(7 * time)]
        )
    return tuple(pose_towards(a, b, c) for a, b, c in zip(eye, gaze, roll, strict=True))


def drive(step: float, knobs: Knobs, generator: np.random.Generator) -> tuple[Pose, ...]:
    """Return the poses of a camera in a car: along +y at `step` metres per frame, 1.6 m high, with small yaw."""
    turn = np.radians(knobs.turn_deg if knobs.turn_deg is not None else 6.0)
    time = np.linspace(0, 1, knobs.views)
    heading = np.pi / 2 + turn * np.sin(2 * np.pi * time) / 2
    eye = np.column_stack(
        [0.15 * np.sin(2 * np.pi * time), step * np.arange(knobs.views), 1.6 + generator.normal(0, 0.01, knobs.views)]
    )
    gaze = eye + np.column_stack([np.cos(heading), np.sin(heading), np.full(knobs.views, -0.03)])
    roll = np.radians(generator.normal(0, ROLL_DEG / 3, knobs.views))  # a car's suspension is stiffer than a hand
    return tuple(pose_towards(a, b, c) for a, b, c in zip(eye, gaze, roll, strict=True))
