"""Known lengths that the user measured: between two points, of an object, or between the middles of two objects."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from estimator.evidence.source import skipped_evidence
from estimator.records.objects import MeasuredObject, Measurements
from estimator.records.result import ScaleEvidence
from estimator.records.scene import MAX_COORDINATE, Scene
from metric_base.arrays import FloatArray
from metric_base.errors import FieldError, InputError, Unquoted, at_field, expect, in_file
from metric_base.input_files import read_text
from metric_base.length_units import metres
from metric_tree.axes import AXES

KIND = "known_length"
#: Default standard deviation of the log length, for points that are selected manually in a sparse cloud.
DEFAULT_SIGMA = 0.01
#: Range of valid lengths in metres, from an atom to the orbit of the Moon.
MIN_METRES = 1e-10
MAX_METRES = 1e9


#: Error of the middle of an object that a person finds, relative to half its extent.
MIDDLE_ERROR = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class KnownLength:
    """The distance between two points of the scene."""

    a: FloatArray  #: (3,) in scene units.
    b: FloatArray  #: (3,) in scene units.
    metres: float  #: True distance.
    sigma: float = DEFAULT_SIGMA  #: Standard deviation of its natural log.

    @property
    def distance(self) -> float:
        """Distance of the points in scene units."""
        return float(np.linalg.norm(self.b - self.a))

    @property
    def log_scale(self) -> float:
        """Natural log of the scale by this length, in metres per scene unit."""
        return float(np.log(self.metres / self.distance))


@dataclass(frozen=True, slots=True)
class ObjectLength:
    """A measured dimension of an object, or the distance between the middles of two objects.

    Objects have the names of the printed table, such as `chair 3`.
    """

    name: str
    other: str  #: `length`, `width`, `height`, or the name of the other object.
    metres: float

    def observe(self, scene: Scene, measurements: Measurements) -> tuple[ScaleEvidence, ...]:  # noqa: ARG002
        """Return the scale by the dimension or the distance; skipped if it is not measured in the scene.

        Raises
        ------
        InputError
            The scene has no such object.
        """
        objects = {f"{item.category} {item.id}": item for item in measurements.objects if item.box is not None}
        for name in (self.name, *([] if self.other in AXES else [self.other])):
            if name not in objects:
                expected = f"one of {', '.join(sorted(objects)) or 'no objects'}"
                raise InputError.at("--known-length", "object", expected, name)
        label, item = f"{self.name} {self.other}", objects[self.name]
        if self.other in AXES:
            axis = AXES.index(self.other)
            units, sd = float(item.extents[axis]), float(item.sigma[axis])
            if item.truncated[axis] or not item.vertical_known:
                return skipped_evidence(KIND, label, f"the {self.other} of this object is not determined")
        else:
            units, sd = middle_distance(item, objects[self.other])
        if not (0 < units < math.inf and 0 < sd < 1):
            return skipped_evidence(KIND, label, "this length is not determined in the scene")
        return (ScaleEvidence(KIND, label, self.metres / units, math.hypot(sd, DEFAULT_SIGMA), doubt=0.0),)


def middle_distance(item: MeasuredObject, other: MeasuredObject) -> tuple[float, float]:
    """Return the distance of the middles of two objects with boxes in scene units, and the error of its log.

    The middle of a truncated object is unknown: the error is infinite.
    """
    assert item.box is not None
    assert other.box is not None
    distance = float(np.linalg.norm(item.box.centre - other.box.centre))
    errors = [one.extents / 2 * np.hypot(one.sigma, MIDDLE_ERROR) for one in (item, other)]
    if item.truncated.any() or other.truncated.any() or not distance > 0:
        return distance, math.inf
    return distance, float(np.sqrt(np.sum(np.square(errors)) / 3)) / distance  # along the line: one of three axes


def known_length_evidence(lengths: Iterable[KnownLength | ObjectLength]) -> tuple[ScaleEvidence, ...]:
    """Return each length between points as certain evidence (doubt 0), because the user states it.

    The result reports contradictions (`results.estimate.known_length_conflict`).
    """
    return tuple(
        ScaleEvidence(KIND, str(number), math.exp(length.log_scale), length.sigma, doubt=0.0)
        for number, length in enumerate((item for item in lengths if isinstance(item, KnownLength)), 1)
    )


def parse_known_lengths(words: Sequence[str]) -> tuple[KnownLength | ObjectLength, ...]:
    """Parse the arguments of one `--known-length`: A, B and a length, or a file.

    A and B are points `x,y,z` (in brackets if they begin with a minus sign), two names of objects, or the name of an
    object and one of its dimensions. The length is in metres or has a unit. A file has one length per line: six numbers
    (x y z of both points), the length, and optionally its standard deviation; `#` begins a comment.
    """
    if len(words) == 1:
        file = Path(words[0])
        lengths = []
        for number, line in enumerate(read_text(file).split("\n"), 1):
            text = line.partition("#")[0].strip()
            if text:
                with in_file(file), at_field(f"line {number}"):
                    lengths.append(_length(_numbers(text, 7, 8)))
        if not lengths:
            raise InputError.at(file, "lengths", "at least one line", 0)
        return tuple(lengths)
    with in_file("--known-length"):
        expect(len(words) >= 3, "arguments", "A B metres, or a file", Unquoted(" ".join(words)))
        with at_field("metres"):
            (length,) = _numbers(" ".join(words[2:]).replace(" ", ""), 1)
        if not any("," in word for word in words[:2]):
            return (ObjectLength(words[0], words[1], _checked_metres(float(length))),)
        with at_field("point"):
            a, b = (_numbers(word, 3) for word in words[:2])
        return (_length(np.array([*a, *b, length])),)


def _length(numbers: FloatArray) -> KnownLength:
    """Return the known length of numbers (7,) or (8,): two points, metres, and the standard deviation in metres."""
    a, b, length = numbers[:3], numbers[3:6], _checked_metres(float(numbers[6]))
    expect(np.linalg.norm(b - a) > 0, "points", "two points apart", a.tolist())
    sigma = float(numbers[7]) / length if len(numbers) > 7 else DEFAULT_SIGMA
    expect(0 < sigma < 1, "sigma", "more than 0 and less than the length itself", sigma * length)
    return KnownLength(a, b, length, sigma)


def _checked_metres(length: float) -> float:
    expect(MIN_METRES <= length <= MAX_METRES, "metres", f"{MIN_METRES:g} to {MAX_METRES:g}", length)
    return length


def _numbers(text: str, min_count: int, max_count: int | None = None) -> FloatArray:
    """Parse finite numbers (n,) that are separated by blanks or commas; by default, n is `min_count`.

    The seventh and eighth number of a line, and a single number, may have a unit of length.
    """
    parts = text.strip().strip("()[]").replace(",", " ").split()
    try:
        lengths = range(6, 8) if min_count > 1 else range(1)
        numbers = np.array([metres(part) if index in lengths else float(part) for index, part in enumerate(parts)])
    except ValueError:
        expected = "numbers" if min_count > 1 else "a length such as 1.25, 37.9cm or 5ft"
        raise FieldError("", expected, text) from None
    if not min_count <= len(numbers) <= (max_count or min_count) or not (np.abs(numbers) < MAX_COORDINATE).all():
        count = f"{min_count}" if max_count is None else f"{min_count} or {max_count}"
        raise FieldError("", f"{count} finite numbers", text)
    return numbers
