"""Up: the vertical of a scene, from the cameras and then from the planes in it (paper section 4.2).

The paper takes the unit vector most orthogonal to all camera x axes. That is undefined when the cameras hardly turn, so
the eigen-gap decides: where it is too small only the direction across the x axes is known, the mean camera up fills in
the rest, and a level surface of the scene settles it where there is one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.records.scene import View
from metric_base.arrays import FloatArray
from metric_base.errors import InputError

__all__ = ["BELIEVED_SIGMAS", "OBSERVED_METHODS", "WRONG_UP_DEG", "Up", "camera_up", "given_up", "up_contradiction"]

# People hold a camera level within about two degrees from frame to frame; fewer views than would show that
# spread cannot prove a better one.
ROLL_DEG = 2.0
# Neighbouring frames of a video lean together: about four make one independent reading.
FRAMES_PER_READING = 4.0
# Beyond this the vertical from x axes is worse than the mean camera up with a level surface: a height of a metre-wide
# object is then off by a tenth.
OBSERVABLE_DEG = 6.0
# Pitch of hand-held cameras: they look down on objects by some 15 degrees, and the mean camera up leans by as much.
PITCH_DEG = 15.0
# Gravity by an inertial unit is good to some tenths of a degree at rest, and to about this on a moving hand.
GIVEN_DEG = 1.0
# Two verticals within this tilt, in their standard deviations, are believed to be one.
BELIEVED_SIGMAS = 3.0

#: How the methods begin by which the vertical is observed, or given: not guessed from how people hold cameras.
OBSERVED_METHODS = ("camera-x-axes", "given")
#: Heights along an up that is so far off are a seventh short, or take in the sides: no scale follows from them.
WRONG_UP_DEG = 30.0


@dataclass(frozen=True, slots=True, eq=False)
class Up:
    """The vertical: `vector` (3,) unit, pointing up; `method` its name; `sigma_deg` one standard deviation of its tilt.

    `known` (3,) is a horizontal direction known well (the mean camera x axis) where the tilt about it is not; else
    None.
    """

    vector: FloatArray
    method: str
    sigma_deg: float
    known: FloatArray | None = None


def camera_up(views: Sequence[View]) -> Up:
    """Up from the cameras alone.

    Equation: n = argmin |R x| over unit x, R the (v, 3) camera x axes; n is the eigenvector of the smallest eigenvalue
    of R^T R. Its tilt towards eigenvector j has variance k roll^2 / (lambda_j - lambda_1), k frames making one reading,
    so the gap to the second eigenvalue decides. The sign is that of the mean camera up. Without views: ValueError.
    """
    if not views:
        raise ValueError("up needs at least one view")
    x_axes = np.stack([view.rotation[0] for view in views])
    mean_up = -np.mean([view.rotation[1] for view in views], axis=0)
    values, vectors = np.linalg.eigh(x_axes.T @ x_axes)
    roll = max(np.sqrt(max(values[0], 0.0) / max(len(views) - 2, 1)), np.radians(ROLL_DEG))
    sigma = np.degrees(roll * np.sqrt(FRAMES_PER_READING / max(values[1] - values[0], 1e-12)))
    normal = vectors[:, 0]
    if sigma <= OBSERVABLE_DEG and abs(normal @ mean_up) > 0.5 * np.linalg.norm(mean_up):
        return Up(normal * np.sign(normal @ mean_up), "camera-x-axes", float(sigma))
    return _mean_up(mean_up, vectors[:, 2])


def given_up(vector: Sequence[float] | FloatArray) -> Up:
    """Up that is known from outside, such as from an inertial unit: a vector (3,) of any length but 0.

    Raises
    ------
    InputError
        It is not three finite numbers, or all are 0.
    """
    direction = np.asarray(vector, dtype=float)
    if direction.shape != (3,) or not np.isfinite(direction).all() or not direction.any():
        raise InputError.at("up", "direction", "three finite numbers, not all 0", tuple(vector))
    direction = direction / np.abs(direction).max()  # its square may be no number
    return Up(direction / np.linalg.norm(direction), "given", GIVEN_DEG)


def up_contradiction(given: Up, seen: Up) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """How a given up contradicts what the cameras and level surfaces show: sentences of doubt, and of rejection."""
    if seen.method == "none":
        return (), ()
    angle = float(np.degrees(np.arccos(np.clip(given.vector @ seen.vector, -1, 1))))
    limit = BELIEVED_SIGMAS * float(np.hypot(given.sigma_deg, seen.sigma_deg))
    if angle <= limit:
        return (), ()
    if 180 - angle <= limit:
        return (f"the given up points down ({seen.method}): gravity points down, up is its opposite",), ()
    sentence = f"the given up is {angle:.0f}° from what the scene shows ({seen.method}, ±{seen.sigma_deg:.1f}°)"
    return ((), (sentence,)) if min(angle, 180 - angle) > WRONG_UP_DEG + limit else ((sentence,), ())


def _mean_up(mean_up: FloatArray, x_axis: FloatArray) -> Up:
    """Mean camera up (3,) made orthogonal to the common x axis (3,); scattered cameras leave it wide open."""
    across = mean_up - (mean_up @ x_axis) * x_axis
    length = float(np.linalg.norm(across))
    if length < 0.1:
        return Up(
            np.cross(x_axis, [1.0, 0, 0]) if abs(x_axis[0]) < 0.9 else np.cross(x_axis, [0, 1.0, 0]), "none", 90.0
        )
    return Up(across / length, "mean-camera-up", PITCH_DEG, x_axis)
