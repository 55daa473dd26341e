"""A place: where an object stands and which way it looks, and the words of `--at` and `--facing` that ask for one."""

from __future__ import annotations

import math
from dataclasses import dataclass

from insertion.scene.supports import Surface
from metric_base.arrays import FloatArray
from metric_base.errors import InputError

__all__ = ["At", "NoPlace", "Place", "facing_of", "point_of"]


class NoPlace(InputError):
    """There is nothing to stand on where the object was asked to stand; the message says why."""


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """The bottom centre of an object on a support plane.

    position : (3,) in the scene; basis : (3, 3) rows two horizontal axes and up; camera : (3,) the camera that the
    place was chosen from; support : a name for a person; plane : its number, lowest first, None for a small level
    patch that is no plane, whose extent is `surface` if it is known.
    """

    position: FloatArray
    basis: FloatArray
    camera: FloatArray
    support: str
    plane: int | None = None
    surface: Surface | None = None


@dataclass(frozen=True, slots=True)
class At:
    """A point in one picture: its name or number, and the pixel (COLMAP's, from the upper left corner)."""

    frame: str
    x: float
    y: float


def point_of(words: str) -> At | None:
    """`frame=NAME_OR_INDEX,x=PX,y=PX`, or None for `auto`. Raises InputError for anything else."""
    if words == "auto":
        return None
    fields = dict(part.split("=", 1) for part in words.split(",") if "=" in part)
    try:
        x, y = float(fields.get("x", "nan")), float(fields.get("y", "nan"))
    except ValueError:
        x = y = math.nan
    if set(fields) != {"frame", "x", "y"} or not (math.isfinite(x) and math.isfinite(y)):
        raise InputError(f"--at: expected frame=NAME_OR_INDEX,x=PIXELS,y=PIXELS or auto; found {words!r}")
    return At(fields["frame"], x, y)


def facing_of(words: str) -> float | str:
    """`camera`, `wall`, or degrees turned from the camera. Raises InputError for anything else."""
    if words in ("camera", "wall"):
        return words
    try:
        degrees = float(words)
    except ValueError:
        degrees = math.nan
    if not math.isfinite(degrees):
        raise InputError(f"--facing: expected camera, wall or degrees; found {words!r}")
    return degrees
