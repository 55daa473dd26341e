"""Numbers as people write them: decimal commas, thousands marks, vulgar and mixed fractions."""

from __future__ import annotations

import re
from typing import Literal

#: Which mark parts the decimals; None leaves it to the number's own look.
Decimal = Literal[".", ","] | None

_VULGAR = {
    "½": 1 / 2,
    "⅓": 1 / 3,
    "⅔": 2 / 3,
    "¼": 1 / 4,
    "¾": 3 / 4,
    "⅕": 1 / 5,
    "⅖": 2 / 5,
    "⅗": 3 / 5,
    "⅘": 4 / 5,
    "⅙": 1 / 6,
    "⅚": 5 / 6,
    "⅛": 1 / 8,
    "⅜": 3 / 8,
    "⅝": 5 / 8,
    "⅞": 7 / 8,
}
_MARKS = "".join(_VULGAR)
_SLASH = "[/⁄]"
#: What a fraction of a length is in: inches are halved, a foot has twelve. `120/75/60` is three numbers.
_PARTS = r"(?:2|3|4|5|6|8|10|12|16|32|64)(?![\d/])"

#: A regular expression of one number, without groups: `12 1/4`, `12-1/4`, `12½`, `3/4`, `1,234.5`, `33,5`, `.75`.
#: A space parts thousands only where the source declares it (`number` takes care); here it would glue two numbers.
NUMBER = (
    rf"(?:\d+(?:[ \u00a0]+|-)\d{{1,2}}{_SLASH}{_PARTS}|\d{{1,2}}{_SLASH}{_PARTS}|\d*[ \u00a0]?[{_MARKS}]"
    r"|\d{1,3}(?:,\d{3})+(?:\.\d+)?(?![\d,])|\d+(?:[.,]\d+)?|\.\d+)"
)

_MIXED = re.compile(rf"(?:(\d+)(?:[ \u00a0]+|-))?(\d+){_SLASH}(\d+)")
_MARKED = re.compile(rf"(\d*)[ \u00a0]?([{_MARKS}])")
_PLAIN = re.compile(r"[\d.,\s\u00a0\u202f']*\d[\d.,\s\u00a0\u202f']*")
_SPACES = re.compile(r"[\s\u00a0\u202f']")


def number(text: str, decimal: Decimal = None) -> float | None:
    """The number that `text` is, or None if it is not a number.

    With `decimal` None a single comma before exactly three digits parts thousands (`1,234`), any other comma
    decimals (`33,5`), and a single point always decimals.
    """
    text = text.strip()
    if mixed := _MIXED.fullmatch(text):
        whole, above, below = (int(part or 0) for part in mixed.groups())
        return whole + above / below if below else None
    if marked := _MARKED.fullmatch(text):
        return int(marked[1] or 0) + _VULGAR[marked[2]]
    if not _PLAIN.fullmatch(text):
        return None
    digits = _SPACES.sub("", text)
    return _value(digits, decimal or _decimal_mark(digits))


def _decimal_mark(digits: str) -> str:
    """The mark that parts the decimals of `digits`, by its look alone."""
    last = max(digits.rfind(","), digits.rfind("."))
    if last < 0 or digits[last] == ".":
        return "."
    head, tail = digits[:last], digits[last + 1 :]
    thousands = len(tail) == 3 and head.strip("0") != "" and len(head.split(",")[-1]) <= 3 and "." not in head
    return "." if thousands else ","


def _value(digits: str, decimal: str) -> float | None:
    other = "," if decimal == "." else "."
    plain = digits.replace(other, "").replace(decimal, ".")
    try:
        return float(plain)
    except ValueError:
        return None
