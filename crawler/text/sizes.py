"""Free text to labelled lengths: `43'' H X 27'' W X 28'' D`, `Dimensões (LxAxP): 48,6 x 29,2 x 40,5 cm`.

The text is read as groups: lengths joined by `x` or following each other with axis words. A group that a word calls a
package, a part or a weight is kept apart from the whole. Nothing is guessed: a group without a unit is not a size.

The numbers of a text that are lengths, each with its unit, its axis and the words that lead to it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise, zip_longest
from typing import Literal

from crawler.text.tokens import Token, tokens
from crawler.text.units import UNIT_MARKS, UNIT_WORDS, millimetres
from crawler.text.vocabulary import Language, is_component, is_package, plain

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
Meaning = Literal["whole", "component", "package"]
#: A product of more than this, or less than that, is a misreading: a house has 30 m, a sequin 1 mm.
ABSURD_MM = (0.3, 60_000.0)
_UNIT_ALTERNATIVES = "|".join(re.escape(word) for word in UNIT_WORDS if word[-1].isalpha() or word[-1] == ")")
#: Whether a text can name a unit at all. Most texts with a number are prices, dates and counts; this rules them out.
_UNIT = re.compile(rf"(?<![^\W\d_])(?:{_UNIT_ALTERNATIVES})(?![^\W\d_xX])|{UNIT_MARKS}|`", re.IGNORECASE)
#: Metric lengths parted by strokes are a choice (`90/120/160 cm`), unless as many axes are announced.
_CHOICES = re.compile(r"(?<![\d/.,])\d{2,4}(?:[.,]\d)?(?:\s?/\s?\d{2,4}(?:[.,]\d)?)+\s?(?:cm|mm)\b")
_BRACKETED = re.compile(r"[(\[]\s*(?:in\s+)?([^\W\d_]{2,12})\.?\s*[)\]]")


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
    """Return True if axis words come before their numbers (`W 30 x D 40`) and not behind (`30 W x 40 D`)."""
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
    """Return True if the next word leads to an axis: `180 cm in length`, `90 cm de largo`."""
    return _kind(run, place) == "word" and run[place].text in {"in", "de", "di", "em"}


def _kind(run: Sequence[Token], place: int) -> str | None:
    return run[place].kind if 0 <= place < len(run) else None


def unit_word(text: str) -> str | None:
    """The unit that a whole word names, in words of two letters and more: a lone `m` or mark is not taken for one."""
    key = UNIT_WORDS.get(text.lower().rstrip("."))
    return key if key and len(text) > 1 else None


def is_same_length(one: float, other: float) -> bool:
    """Return True if two lengths, mm, may be one stated twice and rounded (`AGREEMENT_SHARE`)."""
    return abs(one - other) <= max(AGREEMENT_SHARE * max(one, other), AGREEMENT_MM)


@dataclass(frozen=True, slots=True)
class Length:
    """One length: `low_mm` to `high_mm` (equal where no range is stated), its axis or None, its unit on the page."""

    low_mm: float
    high_mm: float
    axis: str | None
    unit: str

    @property
    def mm(self) -> float:
        """The length; the middle of a range."""
        return round((self.low_mm + self.high_mm) / 2, 1)


@dataclass(frozen=True, slots=True)
class Size:
    """The lengths of one group, what they measure, and the words that say so."""

    lengths: tuple[Length, ...]
    meaning: Meaning
    words: str
    flags: tuple[str, ...] = ()

    def dimensions_mm(self) -> dict[str, float]:
        """The lengths by axis word; lengths without one are left out."""
        return {length.axis: length.mm for length in self.lengths if length.axis}

    def extents_mm(self) -> tuple[float, ...]:
        """Every outer length, longest first; a diameter counts twice where there is room for it."""
        sides = [length.mm for length in self.lengths]
        room = max(0, 3 - len(sides))
        sides += [length.mm for length in self.lengths if length.axis == "diameter"][:room]
        return tuple(sorted(sides, reverse=True)[:3])


def sizes(text: str, label: str = "", language: Language | None = None, unit: str | None = None) -> tuple[Size, ...]:
    """The sizes that a text states, in its order.

    Parameters
    ----------
    label : what comes before the text (a table's cell, a heading); it may name axes and a unit: `Size (LxWxH, cm)`.
    unit : the unit that the place itself implies, used where neither text nor label names one.
    """
    if unit is None and not (names_unit(text) or names_unit(label)):
        return ()
    label_axes, label_unit = _label_hints(label, language)
    run = tokens(text, language)
    stated = []
    announced = label_axes or _announced_in(run)
    if len(announced) < 2 and _CHOICES.search(text):
        return ()
    for group in _as_announced(list(_groups(quantities(run))), announced):
        header = _header_in(run, group) or label_axes
        lengths = _lengths(group, header, label_unit or unit)
        if lengths:
            words = plain(f"{label} {' '.join(word for number in group for word in number.words)}")
            stated.append(Size(lengths, _meaning(words), words, flags_of(lengths)))
    return tuple(stated)


def names_unit(text: str) -> bool:
    """Return True if a text may name a unit of length; if neither text nor label names one, there is no size."""
    return bool(_UNIT.search(text))


@lru_cache(maxsize=4096)  # labels come again on every page
def orders_axes(label: str, language: Language | None = None) -> bool:
    """Return True if a label announces a size by its axes alone: `H x W x D`, `Altura x Largura x Profundidade`."""
    return len(label) > 2 and any(token.kind == "header" for token in tokens(label, language))


def consensus(statements: Sequence[Size]) -> Size | None:
    """One size of several statements of it: the fullest, in metric where both are there; flagged if they contradict."""
    if not statements:
        return None
    best = max(
        statements, key=lambda size: (len(size.lengths), sum(bool(s.axis) for s in size.lengths), _is_metric(size))
    )
    best = _with_axes(best, statements)
    if any(not _agrees(best, other) for other in statements):
        return replace(best, flags=(*best.flags, "contradicts_itself"))
    return best


def _with_axes(best: Size, statements: Sequence[Size]) -> Size:
    """Axis words that another statement of the same lengths carries."""
    if any(length.axis for length in best.lengths):
        return best
    for other in statements:
        if len(other.lengths) == len(best.lengths) and all(length.axis for length in other.lengths):
            pairs = zip(best.lengths, other.lengths, strict=True)
            if all(is_same_length(mine.mm, theirs.mm) for mine, theirs in pairs):
                axes = [length.axis for length in other.lengths]
                named = tuple(replace(length, axis=axis) for length, axis in zip(best.lengths, axes, strict=True))
                return replace(best, lengths=named)
    return best


def _agrees(one: Size, other: Size) -> bool:
    longer, shorter = sorted((one.lengths, other.lengths), key=len, reverse=True)
    named = {length.axis: length.mm for length in longer if length.axis}
    if all(length.axis in named for length in shorter):
        return all(is_same_length(named[length.axis or ""], length.mm) for length in shorter)
    pool = [length.mm for length in longer]
    return all(any(is_same_length(mm, length.mm) for mm in pool) for length in shorter)


def _is_metric(size: Size) -> bool:
    return all(length.unit in METRIC for length in size.lengths)


def flags_of(lengths: Sequence[Length]) -> tuple[str, ...]:
    """What is to be said of lengths.

    `range` where one has two ends, `absurd_size` where one is beyond `ABSURD_MM`, `placeholder` for `1 x 1 x 1 cm`.
    """
    low, high = ABSURD_MM
    flags = []
    if any(not low <= length.mm <= high for length in lengths):
        flags.append("absurd_size")
    if any(length.high_mm > length.low_mm for length in lengths):
        flags.append("range")
    if len(lengths) == 3 and all(length.mm in _form_values(length.unit) for length in lengths):
        flags.append("placeholder")
    return tuple(flags)


def _form_values(unit: str) -> tuple[float, ...]:
    """What is typed into a form that asks for a size: `1 x 1 x 1 cm`, `0,1 x 0,1 x 0,1 cm`; in mm."""
    return tuple(round(millimetres(value, unit), 1) for value in (0.01, 0.1, 1.0))


def _meaning(words: str) -> Meaning:
    if is_package(words):
        return "package"
    return "component" if is_component(words) else "whole"


def _label_hints(label: str, language: Language | None) -> tuple[tuple[str, ...], str | None]:
    """The axes and the unit that a label names: `Size (LxWxH)`, `Height (in.)`, `Breite`."""
    axes: tuple[str, ...] = ()
    unit = None
    run = tokens(label, language)
    for token in run:
        if token.kind == "header":
            axes = token.axes
    if not axes:
        axes = tuple(token.key or "" for token in run if token.kind == "axis" and len(token.text) > 1)
    if not axes and len(run) == 1 and run[0].kind == "axis":
        axes = (run[0].key or "",)
    for token, after in zip_longest(run, run[1:]):
        bracketed = after is None or after.kind in {"close", "other"}
        if token.kind in {"word", "unit", "axis"} and bracketed and (key := unit_word(token.text)):
            unit = key
    return axes, unit


@lru_cache(maxsize=1024)
def unit_in_brackets(heading: str) -> str | None:
    """The unit that a heading gives to what is below it: `Dimensions (mm)`."""
    return next((key for match in _BRACKETED.finditer(heading) if (key := unit_word(match[1]))), None)


def _header_in(run: Sequence[Token], group: Sequence[Quantity]) -> tuple[str, ...]:
    """An order of axes right before or right behind a group: `W x H x D 3 x 4 x 5 cm`, `3 x 4 x 5 cm (WxHxD)`.

    Of several the text's own order decides which is meant: the last one before the group where the first number has one
    before it, else the first one behind the group.
    """
    headers = [token for token in run if token.kind == "header"]
    if not headers:
        return ()
    first = next((token.start for token in run if token.kind == "number"), 0)
    before = [token for token in headers if token.end <= group[0].start]
    behind = [token for token in headers if token.start >= group[-1].end]
    leads = headers[0].start < first
    meant = before[-1:] if leads else behind[:1]
    return (meant or before[-1:] or behind[:1] or headers)[0].axes


def _announced_in(run: Sequence[Token]) -> tuple[str, ...]:
    """The order of axes that the text itself puts before its first number: `B/H/T: ca. 200/85/95 cm`."""
    first = next((token.start for token in run if token.kind == "number"), 0)
    return next((token.axes for token in run if token.kind == "header" and token.end <= first), ())


def _groups(numbers: Sequence[Quantity]) -> Iterator[list[Quantity]]:
    """Numbers that belong together: joined by `x`, or carrying different axes one after another."""
    group: list[Quantity] = []
    for number in numbers:
        if group and not _continues(group, number):
            yield group
            group = []
        group.append(number)
    if group:
        yield group


def _as_announced(groups: list[list[Quantity]], axes: Sequence[str]) -> list[list[Quantity]]:
    """As many lengths as the label announces axes are one size, whatever parts them: `B/H/T`, `4 cm / 2 cm / 3 cm`."""
    every = [number for group in groups for number in group]
    # A forgotten x leaves one of them apart; in another system the same size would come again.
    bare = all(number.axis is None for number in every)
    parted = all(len(group) == 1 for group in groups) or len({number.unit for number in every if number.unit}) == 1
    return [every] if bare and parted and 2 <= len(every) == len(axes) else groups


def _continues(group: Sequence[Quantity], number: Quantity) -> bool:
    if len(group) >= 3:
        return False
    if number.joined:
        return True
    axes = {member.axis for member in group}
    distinct = number.axis is not None and None not in axes and number.axis not in axes
    return distinct and not _turns(number.words)


def _turns(words: Sequence[str]) -> bool:
    """Return True if words between two lengths turn to another item."""
    said = " ".join(words)
    return is_package(said) or is_component(said)


def _lengths(group: Sequence[Quantity], header: Sequence[str], unit: str | None) -> tuple[Length, ...]:
    units = _units(group, unit)
    if units is None:
        return ()
    axes: list[str | None] = [number.axis for number in group]
    if not any(axes) and header and len(header) >= len(group):
        axes = [axis or None for axis in header[: len(group)]]
    if len({axis for axis in axes if axis}) < sum(bool(axis) for axis in axes):
        axes = [None] * len(group)  # an axis named twice: the words are not to be trusted
    return tuple(
        Length(round(millimetres(number.low, key), 1), round(millimetres(number.high, key), 1), axis, key)
        for number, key, axis in zip(group, units, axes, strict=True)
    )


def _units(group: Sequence[Quantity], unit: str | None) -> list[str] | None:
    """The unit of each number: its own, else the next one's, else the last one's, else the place's."""
    own = [number.unit for number in group]
    for one, other in reversed(list(pairwise(range(len(own))))):
        own[one] = own[one] or own[other]
    for one, other in pairwise(range(len(own))):
        own[other] = own[other] or own[one]
    filled = [key or unit for key in own]
    return [key for key in filled if key] if all(filled) else None
