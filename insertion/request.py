"""What the caller asks for: one object, its size, its place."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from insertion.scene.supports import Surface
from metric_base.arrays import FloatArray


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


@dataclass(frozen=True, slots=True)
class ObjectRequest:
    """One object.

    model : its file; size : the words of `--size`; at : a point in a picture; on : a category; plane and xy_m : a plane
    and metres along its axes from its middle; without any of these, free space. facing : `camera`, `wall` or degrees;
    category : for `--size prior`.
    clip : name or number of the animation that plays, the first without, `none` for none; at_time_s : the pose of this
    time of it, and no other; path : points that the object follows, pixels of the picture of `at` or metres as xy_m;
    speed_m_s : metres a second on that way, else it takes the whole video.
    """

    model: Path
    size: str = "file"
    at: At | None = None
    on: str | None = None
    plane: int | None = None
    xy_m: tuple[float, float] = (0.0, 0.0)
    facing: float | str = "camera"
    category: str | None = None
    clip: str | None = None
    at_time_s: float | None = None
    path: tuple[tuple[float, float], ...] = ()
    speed_m_s: float | None = None
