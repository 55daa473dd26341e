"""What a file of a 3-D model states: its bodies with their extents in metres, its up axis, and its words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from metric_base.arrays import FloatArray
from metric_base.errors import Unquoted
from metric_base.schema import expect

__all__ = ["AXES", "Asset", "Body", "Box", "Up", "Word", "body_of", "joined_body"]

Up = Literal["x", "y", "z"]
AXES: tuple[Up, ...] = ("x", "y", "z")

#: A box is centred where its middle is this share of its longest side from the origin, or nearer.
CENTRED_SHARE = 0.005
#: Two boxes overlap from this share of the smaller one on each axis.
OVERLAP_SHARE = 0.05

#: The lower and the upper corner (3,) of a box.
Box = tuple[FloatArray, FloatArray]


@dataclass(frozen=True, slots=True)
class Word:
    """A text of the file that may name the object, and where it is from: `title`, `node`, `file name`, ..."""

    source: str
    text: str


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """One object of a file.

    low_m, high_m : (3,) corners of its box along x, y, z of the file, in metres as the file states them; words : what
    the file calls it.
    """

    name: str
    low_m: FloatArray
    high_m: FloatArray
    words: tuple[Word, ...] = ()

    @property
    def extents_m(self) -> FloatArray:
        """(3,) metres."""
        return self.high_m - self.low_m

    @property
    def centred(self) -> bool:
        """Whether the box is centred on the origin, as normalised meshes are."""
        middle = np.abs(self.high_m + self.low_m) / 2
        return bool(np.all(middle <= CENTRED_SHARE * max(float(self.extents_m.max()), 1e-300)))

    def overlaps(self, other: Body) -> bool:
        """Whether the boxes of two bodies have a volume in common, more than their edges."""
        inner = np.minimum(self.high_m, other.high_m) - np.maximum(self.low_m, other.low_m)
        least = np.minimum(self.extents_m, other.extents_m)
        return bool(np.all(inner > OVERLAP_SHARE * least))


@dataclass(frozen=True, slots=True, eq=False)
class Asset:
    """A file.

    unit_m : metres per unit of the file, None where neither the file nor its format says; up : the axis that points up,
    None where neither says. Extents are in metres with `unit_m`, with 1 where it is None.
    """

    file: Path
    format: str
    unit_m: float | None
    up: Up | None
    bodies: tuple[Body, ...]
    words: tuple[Word, ...] = ()


def body_of(name: str, box: Box, unit_m: float, words: tuple[Word, ...] = ()) -> Body:
    """The body of a box in units of the file.

    Raises
    ------
    FieldError
        Its corners are no finite numbers.
    """
    low, high = (np.asarray(corner, dtype=float) * unit_m for corner in box)
    expect(bool(np.isfinite(low).all() and np.isfinite(high).all()), "vertices", "finite numbers", Unquoted("others"))
    return Body(name, low, high, words)


def joined_body(bodies: Sequence[Body], name: str) -> Body:
    """One body of several: the box around all of them, with all of their words."""
    low = np.min([body.low_m for body in bodies], axis=0)
    high = np.max([body.high_m for body in bodies], axis=0)
    return Body(name, low, high, tuple(word for body in bodies for word in body.words))
