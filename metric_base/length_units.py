"""Length units in millimetres, and the words and signs for them in seven languages."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path

from metric_base.text_tables import named_texts

#: Millimetres in one unit. The inch is 25.4 mm exactly (international yard and pound agreement, 1959).
MILLIMETRES: Mapping[str, float] = {
    "um": 1e-3, "mm": 1.0, "cm": 10.0, "dm": 100.0, "m": 1000.0, "km": 1e6,
    "in": 25.4, "ft": 304.8, "yd": 914.4, "mi": 1609344.0,
}  # fmt: skip

#: Keys of `MILLIMETRES` by unit word, in lower case and without a final full stop.
UNIT_WORDS: Mapping[str, str] = {
    word: key
    for key, words in named_texts(Path(__file__).with_name("unit_words.txt")).items()
    for word in words.split()
}

#: Unit words without letters (`″`, `''`), longest first, as alternatives of a regular expression.
UNIT_MARKS = "|".join(sorted((word for word in UNIT_WORDS if not re.search(r"\w", word)), key=len, reverse=True))


#: A number and its unit in a length that a user states.
_LENGTH_PART = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*([^\W\d_]+\.?|['\"′″’”]+)\s*")


def unit(word: str) -> str | None:
    """Return the key of `MILLIMETRES` for a unit word (`in` for `Inches`, `in.` and `″`), or None."""
    return UNIT_WORDS.get(word.strip().lower().rstrip("."))


def metres(text: str) -> float:
    """Return a length that a user states, such as `1.5`, `37.9cm`, `5 ft` or `5ft 3in`, in metres.

    A number without a unit is in metres.

    Raises
    ------
    ValueError
        The text is no length.

    Examples
    --------
    >>> metres("1.5"), metres("37.9cm"), round(metres("5 ft 3 in"), 3)
    (1.5, 0.379, 1.6)
    """
    with suppress(ValueError):
        return float(text)
    parts = _LENGTH_PART.findall(text)
    keys = [unit(word) for _, word in parts]
    if not parts or _LENGTH_PART.sub("", text).strip() or None in keys:
        raise ValueError(f"no length: {text!r}")
    return sum(float(number) * MILLIMETRES[key] / 1000 for (number, _), key in zip(parts, keys, strict=True) if key)


def filled_units(units: Iterable[str | None]) -> list[str | None]:
    """Return the units of numbers in a row: a number without a unit has the next one, else the previous one."""
    filled = list(units)
    for index in range(len(filled) - 2, -1, -1):
        filled[index] = filled[index] or filled[index + 1]
    for index in range(1, len(filled)):
        filled[index] = filled[index] or filled[index - 1]
    return filled


def millimetres(value: float, unit: str) -> float:
    """Convert a length to millimetres; `unit` is a key of `MILLIMETRES`."""
    return value * MILLIMETRES[unit]


def bar_length(mm_per_px: float, max_px: float = 200) -> float:
    """Return the longest length in mm of the form 1, 2 or 5 times a power of ten that is at most `max_px` pixels."""
    max_mm = mm_per_px * max_px
    power = 10.0 ** math.floor(math.log10(max_mm))
    return max(digit * power for digit in (1, 2, 5) if digit * power <= max_mm)
