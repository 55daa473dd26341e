"""Parse lengths in table cells and museum texts: `12 1/4 x 3 in (31 x 8 cm)`, `H: 4,5 cm; Diam. 3`, `5 ft 11 in`.

These texts contain little else than lengths. `sizes` parses the prose of web pages.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from crawler.text.numbers import NUMBER, Decimal, number
from crawler.text.sizes import INCHES_PER_FOOT
from metric_base.errors import InputError
from metric_base.length_units import UNIT_WORDS, filled_units, millimetres, unit

#: Axes of a raw item.
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
_WORD, _UNIT = (
    "(?:"
    + "|".join(
        re.escape(word) + (r"(?![^\W\d_])" if word[-1].isalpha() else "")
        for word in sorted(words, key=lambda word: (-len(word), word))
    )
    + ")"
    for words in (_AXIS_WORDS, UNIT_WORDS)
)
#: Not followed by a unit of weight, volume or percentage, or by the rest of such a number.
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
#: Separators of feet and inches.
_BETWEEN = re.compile(r"\s*(?:,|-|and)?\s*")
#: Cells without a value.
_MISSING = frozenset({"", "-", "–", "--", "na", "n/a", "nan", "none", "null", "?", "unknown", "not available"})


class UnreadableLength(InputError):
    """A text that is not one length."""


@dataclass(frozen=True, slots=True)
class Measure:
    """A length in a text."""

    low: float
    high: float  #: Equal to `low` unless the text states a range.
    unit: str  #: Key of `MILLIMETRES`.
    axis: str | None
    start: int  #: Index of its first character in the text.
    end: int  #: Index after its last character.

    @property
    def low_mm(self) -> float:
        """Lower end of the range."""
        return millimetres(min(self.low, self.high), self.unit)

    @property
    def high_mm(self) -> float:
        """Upper end of the range."""
        return millimetres(max(self.low, self.high), self.unit)

    @property
    def mm(self) -> float:
        """Length; for a range, its centre."""
        return (self.low_mm + self.high_mm) / 2

    @property
    def is_range(self) -> bool:
        """Return True if the text states two different lengths."""
        return self.low_mm != self.high_mm


def measures(text: str, default_unit: str | None = None, decimal: Decimal = None) -> tuple[Measure, ...]:
    """Return the lengths in a text, in order.

    Parameters
    ----------
    text : str
        Text in brackets is ignored if there are lengths outside of them: it repeats the size in another unit.
    default_unit : str, optional
        Unit of lengths if the text names none. A length without a unit has the unit of the next length, else of the
        previous one; lengths without any unit are omitted.
    decimal : {".", ","}, optional
        Decimal separator (see `number`).
    """
    outside = _ASIDE.sub(lambda aside: " " * len(aside[0]), text)
    lengths = _lengths(outside, decimal) or _lengths(text, decimal)
    pairs = zip(lengths, filled_units(length.unit for length in lengths), strict=True)
    return tuple(replace(length, unit=key) for length, unit in pairs if (key := unit or default_unit))


def _lengths(text: str, decimal: Decimal) -> list[Measure]:
    """Return the numbers with unit ("" if missing) and axis; feet and inches in a row are one length in inches."""
    lengths: list[Measure] = []
    for match in _LENGTH.finditer(text):
        low = number(match["low"], decimal)
        high = number(match["high"], decimal) if match["high"] else low
        if low is None or high is None:
            continue
        word = match["before"] or match["after"]
        key = unit(match["unit"]) or "" if match["unit"] else ""
        length = Measure(low, high, key, _AXIS_WORDS[word.lower()] if word else None, *match.span())
        feet = lengths[-1] if lengths and lengths[-1].unit == "ft" else None
        if feet is not None and length.unit == "in" and _BETWEEN.fullmatch(text[feet.end : length.start]):
            low, high = (INCHES_PER_FOOT * f + i for f, i in ((feet.low, length.low), (feet.high, length.high)))
            lengths[-1] = Measure(low, high, "in", feet.axis or length.axis, feet.start, length.end)
        else:
            lengths.append(length)
    return lengths


def length_mm(text: str, default_unit: str, decimal: Decimal = None) -> float | None:
    """Return the length in a table cell in mm; None if the cell is empty, marked as missing, or zero.

    Raises
    ------
    UnreadableLength
        The cell contains no length, several, or a negative one.
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


def dimensions_mm(lengths: Sequence[Measure], order: Sequence[str] = ()) -> dict[str, float]:
    """Return lengths by axis, in mm.

    Parameters
    ----------
    lengths : sequence of Measure
        Of several lengths along one axis the largest is used, because it is the outer size.
    order : sequence of str
        Axes of the lengths if none has an axis, at least one for each length.
    """
    axes = [length.axis for length in lengths]
    if not any(axes) and len(lengths) <= len(order):
        axes = list(order[: len(lengths)])
    by_axis: dict[str, float] = {}
    for axis, length in zip(axes, lengths, strict=True):
        if axis:
            by_axis[axis] = max(length.mm, by_axis.get(axis, 0.0))
    return by_axis


def extents_mm(by_axis: Mapping[str, float | None]) -> tuple[float, ...] | None:
    """Return at most three sizes, longest first; a diameter is used twice if there are fewer than two other sizes."""
    sides = [value for axis, value in by_axis.items() if value and axis != "diameter"]
    diameter = by_axis.get("diameter")
    if diameter:
        sides += [diameter] * min(2, 3 - len(sides))
    return tuple(sorted(sides, reverse=True)[:3]) or None
