"""The numbers of a text that are lengths, each with its unit, its axis and the words that lead to it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from crawler.text.tokens import Token
from crawler.text.units import UNIT_WORDS, millimetres

__all__ = ["METRIC", "Quantity", "is_same_length", "quantities", "unit_word"]

#: Two statements of one length in two systems agree within this share: pages round to a half centimetre or an inch.
AGREEMENT_SHARE = 0.06

#: ... or within this many millimetres, for small items rounded to a tenth of an inch.
AGREEMENT_MM = 6.0

METRIC = frozenset({"mm", "cm", "dm", "m"})

#: How much text around a length may say what it measures.
CONTEXT_WORDS = 5

_OTHER_UNITS = """
    kg g gr gramm gram grams grammes grammi gramos gramas lb lbs pound pounds oz ounce ounces ml l
    liter liters litre litres cl fl gal gallon gallons w watt watts kw v volt volts a mah hz khz ghz
    mhz db % ° c f k mp megapixel px pixels gb tb mb h hours hour min minutes s sec seconds years year
    days day pcs pack count stars star reviews sq m2 m² cm2 ft2 cu cm3 m3 ft3 btu lumens lm rpm bar psi
    dpi nm usd eur gbp euro euros dollars people persons personen
"""
_NOT_LENGTH_UNITS = frozenset(_OTHER_UNITS.split())


@dataclass(frozen=True, slots=True)
class Quantity:
    """A number that is a length: `low` to `high` in its unit, its place, whether an `x` joins it to the last."""

    low: float
    high: float
    unit: str | None
    axis: str | None
    start: int
    end: int
    joined: bool
    words: tuple[str, ...]


def quantities(run: Sequence[Token]) -> list[Quantity]:
    """The numbers of a text with their units, axes and the words that lead to them."""
    lengths: list[Quantity] = []
    words: list[str] = []
    joined = skipped = False
    leading = _axes_lead(run)
    place = 0
    while place < len(run):
        token = run[place]
        if token.kind == "number" and token.number is not None:
            number, place, is_length = _number(run, place, leading, tuple(words[-CONTEXT_WORDS:]), joined)
            if is_length:
                lengths.append(number)
                words = []
            joined, skipped = False, not is_length
            continue
        if token.kind == "times":
            joined = not skipped
        elif token.kind in {"word", "axis"} and not (token.kind == "axis" and len(token.text) == 1):
            if _kind(run, place - 1) != "open" or token.text != "max":  # `diameter: 17 cm (max), height: 24 cm`
                words.append(token.text)
        elif token.kind == "break" and token.text in ";|\n•":
            words = []
        place += 1
    return lengths


def _axes_lead(run: Sequence[Token]) -> bool:
    """Whether axis words come before their numbers (`W 30 x D 40`) and not behind (`30 W x 40 D`)."""
    first_axis = next((i for i, token in enumerate(run) if token.kind == "axis"), None)
    first_number = next((i for i, token in enumerate(run) if token.kind == "number"), None)
    return first_axis is not None and first_number is not None and first_axis < first_number


def _number(
    run: Sequence[Token], place: int, leading: bool, words: tuple[str, ...], joined: bool
) -> tuple[Quantity, int, bool]:
    """The number at a place, the place behind it, and whether it is a length at all."""
    token = run[place]
    low = high = float(token.number or 0.0)
    axis = _axis_before(run, place) if leading else None
    after = place + 1
    unit, after = _unit_at(run, after)
    if _kind(run, after) == "range" and _kind(run, after + 1) == "number":
        high = float(run[after + 1].number or 0.0)
        second, behind = _unit_at(run, after + 2)
        if high > low and (second or unit or leading):
            unit, after = second or unit, behind
        else:
            high = low
    if unit == "ft" and _kind(run, after) == "number":
        inches, behind = _unit_at(run, after + 1)
        if inches == "in" or (inches is None and run[place + 1].text in "'′’"):
            low = high = low * 12 + float(run[after].number or 0.0)
            unit, after = "in", behind
    if unit is not None and low == high and (aside := _aside(run, after, low, unit)):
        low = high = aside[0]
        unit, after = aside[1:]
    is_length = low > 0 and math.isfinite(high) and not _counts_other_objects(run, after, unit)
    if axis is None and not leading:
        axis, after = _axis_behind(run, after)
        if unit is None:
            unit, after = _unit_at(run, after)
    return Quantity(low, high, unit, axis, token.start, run[after - 1].end, joined, words), after, is_length


def _unit_at(run: Sequence[Token], place: int) -> tuple[str | None, int]:
    if _kind(run, place) == "open" and _kind(run, place + 2) == "close" and (key := unit_word(run[place + 1].text)):
        return key, place + 3  # `12.00 (in)`
    if [_kind(run, place + i) for i in range(4)] == ["open", "header", "close", "unit"]:
        return run[place + 3].key, place  # `60 x 40 x 75 (W x D x H) cm`: the header is read where it stands
    if _kind(run, place) == "unit":
        behind = place + 1
        if _kind(run, behind) == "other" and run[behind].text == "." and run[behind].start == run[place].end:
            behind += 1
        return run[place].key, behind
    return None, place


def _aside(run: Sequence[Token], place: int, value: float, unit: str) -> tuple[float, str, int] | None:
    """The same length again in brackets in another unit, `15.5 in. (39 cm)`: the metric one, and the place behind."""
    if [_kind(run, place + i) for i in range(4)] != ["open", "number", "unit", "close"]:
        return None
    again, other = float(run[place + 1].number or 0.0), run[place + 2].key or ""
    if other == unit or not is_same_length(millimetres(value, unit), millimetres(again, other)):
        return None
    return (value, unit, place + 4) if unit in METRIC else (again, other, place + 4)


def _counts_other_objects(run: Sequence[Token], place: int, unit: str | None) -> bool:
    if unit is not None:
        return _kind(run, place) in {"word", "other"} and run[place].text in {"²", "³", "2", "3"}
    return _kind(run, place) in {"word", "other"} and run[place].text in _NOT_LENGTH_UNITS


def _axis_before(run: Sequence[Token], place: int) -> str | None:
    for back in range(place - 1, max(place - 4, -1), -1):
        token = run[back]
        if token.kind == "axis":
            return token.key
        if token.kind not in {"colon", "open", "close", "other", "word"}:
            return None
    return None


def _axis_behind(run: Sequence[Token], place: int) -> tuple[str | None, int]:
    at = place + 1 if _kind(run, place) in {"open", "range"} or _is_of(run, place) else place
    if _kind(run, at) == "axis" and _kind(run, at + 1) not in {"colon", "number"}:
        closed = at + 1 if at > place and _kind(run, at + 1) == "close" else at
        return run[at].key, closed + 1
    return None, place


def _is_of(run: Sequence[Token], place: int) -> bool:
    """Whether the next word leads to an axis: `180 cm in length`, `90 cm de largo`."""
    return _kind(run, place) == "word" and run[place].text in {"in", "de", "di", "em"}


def _kind(run: Sequence[Token], place: int) -> str | None:
    return run[place].kind if 0 <= place < len(run) else None


def unit_word(text: str) -> str | None:
    """The unit that a whole word names, in words of two letters and more: a lone `m` or mark is not taken for one."""
    key = UNIT_WORDS.get(text.lower().rstrip("."))
    return key if key and len(text) > 1 else None


def is_same_length(one: float, other: float) -> bool:
    """Whether two lengths, mm, may be one stated twice and rounded (`AGREEMENT_SHARE`)."""
    return abs(one - other) <= max(AGREEMENT_SHARE * max(one, other), AGREEMENT_MM)
