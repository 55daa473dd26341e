"""Parse numbers with decimal commas, thousands separators, and vulgar or mixed fractions."""

from __future__ import annotations

import re
import unicodedata
from typing import Literal

#: Decimal separator; None infers it from each number.
Decimal = Literal[".", ","] | None

_MARKS = "½⅓⅔¼¾⅕⅖⅗⅘⅙⅚⅛⅜⅝⅞"
_SLASH = "[/⁄]"
#: Denominators of fractions of inches and feet. `120/75/60` contains three numbers and no fraction.
_PARTS = r"(?:2|3|4|5|6|8|10|12|16|32|64)(?![\d/])"

#: Regular expression for a number, without groups: `12 1/4`, `12-1/4`, `12½`, `3/4`, `1,234.5`, `33,5`, `.75`.
#: Spaces are not thousands separators here, because they also separate numbers; `number` accepts them.
NUMBER = (
    rf"(?:\d+(?:[ \u00a0]+|-)\d{{1,2}}{_SLASH}{_PARTS}|\d{{1,2}}{_SLASH}{_PARTS}|\d*[ \u00a0]?[{_MARKS}]"
    r"|\d{1,3}(?:,\d{3})+(?:\.\d+)?(?![\d,])|\d+(?:[.,]\d+)?|\.\d+)"
)

_MIXED = re.compile(rf"(?:(\d+)(?:[ \u00a0]+|-))?(\d+){_SLASH}(\d+)")
_MARKED = re.compile(rf"(\d*)[ \u00a0]?([{_MARKS}])")
_PLAIN = re.compile(r"[\d.,\s\u00a0\u202f']*\d[\d.,\s\u00a0\u202f']*")
_SPACES = re.compile(r"[\s\u00a0\u202f']")


def number(text: str, decimal: Decimal = None) -> float | None:
    """Parse a text that is one number.

    Parameters
    ----------
    text : str
    decimal : {".", ","}, optional
        Decimal separator. By default, a point separates decimals, and so does a comma, except a comma that is followed
        by exactly three digits and preceded by others than zero (`1,234`): it separates thousands.

    Returns
    -------
    float or None
        None if the text is not a number.
    """
    text = text.strip()
    if mixed := _MIXED.fullmatch(text):
        integer, numerator, denominator = (int(part or 0) for part in mixed.groups())
        return integer + numerator / denominator if denominator else None
    if marked := _MARKED.fullmatch(text):
        return int(marked[1] or 0) + unicodedata.numeric(marked[2])
    if not _PLAIN.fullmatch(text):
        return None
    digits = _SPACES.sub("", text)
    if decimal is None:
        integers, comma, decimals = digits.rpartition(",")
        is_one_to_three_digits = len(integers.rpartition(",")[2]) <= 3 and "." not in integers
        is_grouped = len(decimals) == 3 and integers.strip("0") != "" and is_one_to_three_digits
        decimal = "," if comma and "." not in decimals and not is_grouped else "."
    try:
        return float(digits.replace("," if decimal == "." else ".", "").replace(decimal, "."))
    except ValueError:
        return None
