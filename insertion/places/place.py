"""A place: where an object is to stand and which way it looks."""

from __future__ import annotations

from dataclasses import dataclass

from metric_base.arrays import FloatArray
from metric_base.errors import InputError

__all__ = ["NoPlace", "Place"]


class NoPlace(InputError):
    """There is nothing to stand on where the object was asked to stand; the message says why."""


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """The bottom centre of an object on a support plane.

    position : (3,) in the scene; basis : (3, 3) rows two horizontal axes and up; camera : (3,) the camera that the
    place was chosen from; support : a name for a person; plane : its number, lowest first, None for a small level
    patch that is no plane.
    """

    position: FloatArray
    basis: FloatArray
    camera: FloatArray
    support: str
    plane: int | None = None
