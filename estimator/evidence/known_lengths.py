"""Known lengths: distances in the scene that someone measured in metres, as evidence beside the objects."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from estimator.records.result import ScaleEvidence
from estimator.records.scene import MAX_COORDINATE
from metric_base.arrays import FloatArray
from metric_base.errors import FieldError, Unquoted, at_field, in_file
from metric_base.input_files import read_text

#: How far off a length is whose points were picked by hand in a sparse cloud, where nothing else is stated.
DEFAULT_SIGMA = 0.01
#: Shorter or longer than anything that is measured beside a reconstruction: the orbit of the Moon, an atom.
MAX_METRES, MIN_METRES = 1e9, 1e-10


@dataclass(frozen=True, slots=True, eq=False)
class KnownLength:
    """The distance between two points of the scene.

    a, b : (3,) in scene units; metres : the true distance; sigma : one standard deviation of its natural log.
    """

    a: FloatArray
    b: FloatArray
    metres: float
    sigma: float = DEFAULT_SIGMA

    @property
    def distance(self) -> float:
        """Scene units between the points."""
        return float(np.linalg.norm(self.b - self.a))

    @property
    def log_scale(self) -> float:
        """Natural log of the scale (metres per scene unit) that this length alone gives."""
        return float(np.log(self.metres / self.distance))


def known_length_evidence(lengths: Sequence[KnownLength]) -> tuple[ScaleEvidence, ...]:
    """Each length as evidence without doubt: the user says so. The result says what contradicts it."""
    return tuple(
        ScaleEvidence("known_length", str(number), math.exp(length.log_scale), length.sigma, doubt=0.0)
        for number, length in enumerate(lengths, 1)
    )


def parse_known_lengths(words: Sequence[str]) -> tuple[KnownLength, ...]:
    """The lengths that the words of one `--known-length` state: two points and metres, or a file.

    A point is `x,y,z`, in brackets where it begins with a minus sign. A file holds a length a line, seven numbers
    (x y z of both points, metres) and, if known, an eighth, one standard deviation in metres; `#` begins a comment.
    """
    if len(words) == 1:
        return _lengths_of(Path(words[0]))
    with in_file("--known-length"):
        if len(words) != 3:
            raise FieldError("arguments", "A B metres, or a file", Unquoted(" ".join(words)))
        with at_field("point"):
            a, b = (_numbers(word, 3) for word in words[:2])
        with at_field("metres"):
            (metres,) = _numbers(words[2], 1)
        return (_length(np.array([*a, *b, metres])),)


def _lengths_of(file: Path) -> tuple[KnownLength, ...]:
    lines = [(number, line.partition("#")[0].strip()) for number, line in enumerate(read_text(file).split("\n"), 1)]
    with in_file(file):
        lengths = tuple(_line_length(number, line) for number, line in lines if line)
        if not lengths:
            raise FieldError("lengths", "at least one line", 0)
    return lengths


def _line_length(number: int, line: str) -> KnownLength:
    with at_field(f"line {number}"):
        return _length(_numbers(line, 7, 8))


def _length(numbers: FloatArray) -> KnownLength:
    """A known length of its seven numbers (7,): two points and metres."""
    a, b, metres = numbers[:3], numbers[3:6], float(numbers[6])
    if not MIN_METRES <= metres <= MAX_METRES:
        raise FieldError("metres", f"{MIN_METRES:g} to {MAX_METRES:g}", metres)
    if not np.linalg.norm(b - a) > 0:
        raise FieldError("points", "two points apart", a.tolist())
    sigma = float(numbers[7]) / metres if len(numbers) > 7 else DEFAULT_SIGMA
    if not 0 < sigma < 1:
        raise FieldError("sigma", "more than 0 and less than the length itself", sigma * metres)
    return KnownLength(a, b, metres, sigma)


def _numbers(text: str, least: int, most: int | None = None) -> FloatArray:
    """(n,) finite numbers, from `least` to `most`, apart by blanks or commas."""
    parts = text.strip().strip("()[]").replace(",", " ").split()
    try:
        numbers = np.array([float(part) for part in parts])
    except ValueError:
        raise FieldError("", "numbers", text) from None
    if not least <= len(numbers) <= (most or least) or not (np.abs(numbers) < MAX_COORDINATE).all():
        many = f"{least}" if most is None else f"{least} or {most}"
        raise FieldError("", f"{many} finite numbers", text)
    return numbers
