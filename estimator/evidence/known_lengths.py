"""Known lengths: distances in the scene that the user measured in metres, as evidence in addition to the objects."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from estimator.records.result import ScaleEvidence
from estimator.records.scene import MAX_COORDINATE
from metric_base.arrays import FloatArray
from metric_base.errors import FieldError, InputError, Unquoted, at_field, in_file
from metric_base.input_files import read_text

#: Default standard deviation of the log length, for points that are selected manually in a sparse cloud.
DEFAULT_SIGMA = 0.01
#: Range of valid lengths in metres, from an atom to the orbit of the Moon.
MIN_METRES = 1e-10
MAX_METRES = 1e9


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


def known_length_evidence(lengths: Sequence[KnownLength]) -> tuple[ScaleEvidence, ...]:
    """Return each length as certain evidence (doubt 0), because the user states it.

    The result reports contradictions (`results.estimate.known_length_conflict`).
    """
    return tuple(
        ScaleEvidence("known_length", str(number), math.exp(length.log_scale), length.sigma, doubt=0.0)
        for number, length in enumerate(lengths, 1)
    )


def parse_known_lengths(words: Sequence[str]) -> tuple[KnownLength, ...]:
    """Parse the arguments of one `--known-length`: two points and metres, or a file.

    A point is `x,y,z`, in brackets if it begins with a minus sign. A file has one length per line: seven numbers
    (x y z of both points, metres) and optionally an eighth, the standard deviation in metres; `#` begins a comment.
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
        if len(words) != 3:
            raise FieldError("arguments", "A B metres, or a file", Unquoted(" ".join(words)))
        with at_field("point"):
            a, b = (_numbers(word, 3) for word in words[:2])
        with at_field("metres"):
            (metres,) = _numbers(words[2], 1)
        return (_length(np.array([*a, *b, metres])),)


def _length(numbers: FloatArray) -> KnownLength:
    """Return the known length of numbers (7,) or (8,): two points, metres, and the standard deviation in metres."""
    a, b, metres = numbers[:3], numbers[3:6], float(numbers[6])
    if not MIN_METRES <= metres <= MAX_METRES:
        raise FieldError("metres", f"{MIN_METRES:g} to {MAX_METRES:g}", metres)
    if not np.linalg.norm(b - a) > 0:
        raise FieldError("points", "two points apart", a.tolist())
    sigma = float(numbers[7]) / metres if len(numbers) > 7 else DEFAULT_SIGMA
    if not 0 < sigma < 1:
        raise FieldError("sigma", "more than 0 and less than the length itself", sigma * metres)
    return KnownLength(a, b, metres, sigma)


def _numbers(text: str, min_count: int, max_count: int | None = None) -> FloatArray:
    """Parse finite numbers (n,) that are separated by blanks or commas; by default, n is `min_count`."""
    parts = text.strip().strip("()[]").replace(",", " ").split()
    try:
        numbers = np.array([float(part) for part in parts])
    except ValueError:
        raise FieldError("", "numbers", text) from None
    if not min_count <= len(numbers) <= (max_count or min_count) or not (np.abs(numbers) < MAX_COORDINATE).all():
        count = f"{min_count}" if max_count is None else f"{min_count} or {max_count}"
        raise FieldError("", f"{count} finite numbers", text)
    return numbers
