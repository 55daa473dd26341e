"""Lengths in the cells of tables and in museum texts: `12 1/4 x 3 in (31 x 8 cm)`, `H: 4,5 cm; Diam. 3`, `5 ft 11 in`.

A small reader for texts that hold little but lengths; `sizes` reads the free prose of web pages.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from crawler.text.numbers import NUMBER, Decimal, number
from crawler.text.units import UNIT_WORDS, millimetres, unit
from metric_base.errors import InputError

#: The axis words a raw item may use.
AXES = ("length", "width", "height", "diameter", "depth")

_AXIS_WORDS = {
    word: axis
    for axis, words in {
        "length": "length long len l",
        "width": "width wide w breadth broad b",
        "height": "height high ht h",
        "depth": "depth deep dp d thickness thick th",
        "diameter": "diameter diam dia ø",
    }.items()
    for word in words.split()
}


def _alternatives(words: Mapping[str, str]) -> str:
    longest_first = sorted(words, key=lambda word: (-len(word), word))
    return "|".join(re.escape(word) + (r"(?![^\W\d_])" if word[-1].isalpha() else "") for word in longest_first)


_WORD = rf"(?:{_alternatives(_AXIS_WORDS)})"
_UNIT = rf"(?:{_alternatives(UNIT_WORDS)})"
# Weights, volumes and shares are mixed with sizes: their numbers are not lengths, nor is a part of their digits.
_NO_LENGTH = r"(?!\d|[.,]\d|\s*(?:cc|cm3|kg|g|lbs?|oz|ounces?|pounds?|ml|%|°)(?![^\W\d_]))"
_LENGTH = re.compile(
    rf"(?:(?<![^\W\d_])(?P<before>{_WORD})[.:=\s]*)?"
    rf"(?P<low>(?<![\d.,]){NUMBER}){_NO_LENGTH}"
    rf"(?:\s*(?:-|–|—|to)\s*(?P<high>{NUMBER}){_NO_LENGTH})?"
    rf"\s*(?P<unit>{_UNIT})?\.?"
    rf"(?:\s*\(?(?P<after>{_WORD})\)?(?!\s*[.:=]\s*\d))?",
    re.IGNORECASE,
)
_ASIDE = re.compile(r"\([^()]*\)|\[[^\[\]]*\]")
#: What may be between feet and their inches.
_BETWEEN = re.compile(r"\s*(?:,|-|and)?\s*")
INCHES_PER_FOOT = 12
_MISSING = frozenset({"", "-", "–", "--", "na", "n/a", "nan", "none", "null", "?", "unknown", "not available"})


class UnreadableLength(InputError):
    """A text that states something, but no single length."""


@dataclass(frozen=True, slots=True)
class Measure:
    """One length of a text: `low_mm` to `high_mm` (equal where no range is stated), the axis word, its place."""

    low_mm: float
    high_mm: float
    axis: str | None
    start: int
    end: int

    @property
    def mm(self) -> float:
        """The length, the middle of a range."""
        return (self.low_mm + self.high_mm) / 2

    @property
    def is_range(self) -> bool:
        """Return True if two different lengths are stated."""
        return self.low_mm != self.high_mm


@dataclass(frozen=True, slots=True)
class _Reading:
    """A length before its unit is known."""

    low: float
    high: float
    unit: str | None
    axis: str | None
    start: int
    end: int


def measures(text: str, default_unit: str | None = None, decimal: Decimal = None) -> tuple[Measure, ...]:
    """The lengths of `text` in its order; one without a unit takes the next unit, else the last, else the default.

    The same size again in brackets, in another unit, is passed over. Lengths that have no unit at all are left out.
    """
    plain = _ASIDE.sub(lambda aside: " " * len(aside[0]), text)
    readings = tuple(_join_feet(plain, decimal)) or tuple(_join_feet(text, decimal))
    units = _units(readings, default_unit)
    return tuple(_measure(reading, key) for reading, key in zip(readings, units, strict=True) if key)


def length_mm(text: str, default_unit: str, decimal: Decimal = None) -> float | None:
    """The one length that a cell states, in mm; None where the cell is empty, says so, or is zero.

    Raises
    ------
    UnreadableLength
        The cell states something else: no length, several, a negative one.
    """
    if text.strip().lower() in _MISSING:
        return None
    value = number(text, decimal)
    if value is None:
        lengths = measures(text, default_unit, decimal)
        if len(lengths) != 1 or "-" in text[: lengths[0].start]:
            raise UnreadableLength(f"expected one length; found {text!r}")
        return lengths[0].mm or None
    return millimetres(value, default_unit) or None


def words_mm(lengths: Sequence[Measure], order: Sequence[str] = ()) -> dict[str, float]:
    """The lengths by axis word: by their own words, else by `order` where all are wordless and `order` is long enough.

    Of one word stated twice the longer length counts: the outer size.
    """
    axes = [measure.axis for measure in lengths]
    if not any(axes) and len(lengths) <= len(order):
        axes = list(order[: len(lengths)])
    words: dict[str, float] = {}
    for axis, measure in zip(axes, lengths, strict=True):
        if axis:
            words[axis] = max(measure.mm, words.get(axis, 0.0))
    return words


def extents_mm(words: Mapping[str, float | None]) -> tuple[float, ...] | None:
    """The outer size, longest first; a diameter fills the two sides that no other word has named."""
    sides = [value for axis, value in words.items() if value and axis != "diameter"]
    diameter = words.get("diameter")
    if diameter:
        sides += [diameter] * min(2, 3 - len(sides))
    return tuple(sorted(sides, reverse=True)[:3]) or None


def _readings(text: str, decimal: Decimal) -> Iterator[_Reading]:
    for match in _LENGTH.finditer(text):
        low = number(match["low"], decimal)
        high = number(match["high"], decimal) if match["high"] else low
        if low is not None and high is not None:
            word = match["before"] or match["after"]
            axis = _AXIS_WORDS[word.lower()] if word else None
            yield _Reading(low, high, unit(match["unit"]) if match["unit"] else None, axis, *match.span())


def _units(readings: Sequence[_Reading], default_unit: str | None) -> list[str | None]:
    units = [reading.unit for reading in readings]
    for i in range(len(units) - 2, -1, -1):
        units[i] = units[i] or units[i + 1]
    for i in range(1, len(units)):
        units[i] = units[i] or units[i - 1]
    return [u or default_unit for u in units]


def _measure(reading: _Reading, key: str) -> Measure:
    low, high = sorted((millimetres(reading.low, key), millimetres(reading.high, key)))
    return Measure(low, high, reading.axis, reading.start, reading.end)


def _join_feet(text: str, decimal: Decimal) -> Iterator[_Reading]:
    """The lengths of a text, with feet and the inches right behind them made one, in inches."""
    feet: _Reading | None = None
    for here in _readings(text, decimal):
        if feet and here.unit == "in" and _BETWEEN.fullmatch(text[feet.end : here.start]):
            low, high = (INCHES_PER_FOOT * f + i for f, i in ((feet.low, here.low), (feet.high, here.high)))
            yield _Reading(low, high, "in", feet.axis or here.axis, feet.start, here.end)
            feet = None
            continue
        if feet:
            yield feet
        feet = here if here.unit == "ft" else None
        if not feet:
            yield here
    if feet:
        yield feet
