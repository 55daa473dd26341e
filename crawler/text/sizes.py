"""Parse sizes in free text: `43'' H X 27'' W X 28'' D`, `Dimensões (LxAxP): 48,6 x 29,2 x 40,5 cm`.

Tokens become quantities (numbers with unit and axis), and quantities that are joined by `x`, or that follow each other
with different axes, become a size. Sizes of packages and of parts are marked as such by the words before them. Units
are never guessed: numbers without a unit are not a size.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import zip_longest
from typing import Literal

from crawler.text.tokens import Token, tokens
from crawler.text.vocabulary import OTHER_UNITS, Language, is_component, is_package, plain
from metric_base.length_units import UNIT_MARKS, UNIT_WORDS, filled_units, millimetres

#: Maximum relative difference of one length stated twice: pages round to half a centimetre or an inch.
MAX_RELATIVE_DIFFERENCE = 0.06
#: Difference in mm that is always accepted: small items are rounded to a quarter of an inch.
MAX_ROUNDING_MM = 6.0
#: Units of statements that are preferred to those in feet and inches, which are usually converted and rounded.
METRIC = frozenset({"mm", "cm", "dm", "m"})
#: Number of words before a length that are examined for a package or a part.
CONTEXT_WORDS = 5
#: Range of plausible lengths of products in mm: sequins have 1 mm, houses 30 m. Sizes outside of it are flagged.
PLAUSIBLE_MM = (0.3, 60_000.0)
#: Values that are entered into forms with a mandatory size, in their unit: `1 x 1 x 1 cm`, `0,1 x 0,1 x 0,1 cm`.
PLACEHOLDER_VALUES = (0.01, 0.1, 1.0)
#: Maximum number of lengths of a size.
MAX_LENGTHS = 3
INCHES_PER_FOOT = 12
_UNIT_ALTERNATIVES = "|".join(re.escape(word) for word in UNIT_WORDS if word[-1].isalpha() or word[-1] == ")")
#: Words and marks of units. Most texts with a number are prices, dates and counts; this test excludes them quickly.
_UNIT = re.compile(rf"(?<![^\W\d_])(?:{_UNIT_ALTERNATIVES})(?![^\W\d_xX])|{UNIT_MARKS}|`", re.IGNORECASE)
#: Metric lengths separated by slashes: a choice (`90/120/160 cm`), unless a header announces the same number of axes.
_CHOICES = re.compile(r"(?<![\d/.,])\d{2,4}(?:[.,]\d)?(?:\s?/\s?\d{2,4}(?:[.,]\d)?)+\s?(?:cm|mm)\b")
_BRACKETED = re.compile(r"[(\[]\s*(?:in\s+)?([^\W\d_]{2,12})\.?\s*[)\]]")

#: Kinds of the tokens of `(39 cm)`.
_LENGTH_IN_BRACKETS = ["open", "number", "unit", "close"]

Meaning = Literal["whole", "component", "package"]


@dataclass(frozen=True, slots=True)
class Length:
    """A length of a size."""

    low_mm: float
    high_mm: float  #: Equal to `low_mm` unless the text states a range.
    axis: str | None
    unit: str  #: Unit in the text.

    @property
    def mm(self) -> float:
        """Length; for a range, its centre."""
        return round((self.low_mm + self.high_mm) / 2, 1)


@dataclass(frozen=True, slots=True)
class Size:
    """Lengths of one object."""

    lengths: tuple[Length, ...]
    meaning: Meaning
    words: str  #: Words that determine the meaning.
    flags: tuple[str, ...] = ()

    def dimensions_mm(self) -> dict[str, float]:
        """Return the lengths by axis, without lengths of unknown axes."""
        return {length.axis: length.mm for length in self.lengths if length.axis}

    def extents_mm(self) -> tuple[float, ...]:
        """Return at most three lengths, longest first; a diameter is used twice if there are fewer than three."""
        sides = [length.mm for length in self.lengths]
        sides += [length.mm for length in self.lengths if length.axis == "diameter"][: max(0, 3 - len(sides))]
        return tuple(sorted(sides, reverse=True)[:3])


def sizes(text: str, label: str = "", language: Language | None = None, unit: str | None = None) -> tuple[Size, ...]:
    """Return the sizes in a text, in order.

    Parameters
    ----------
    text : str
    label : str
        Text before it (table cell, heading); it may name axes and a unit: `Size (LxWxH, cm)`.
    language : Language, optional
        Language of the text.
    unit : str, optional
        Unit to use if neither the text nor the label names one.
    """
    if unit is None and not (names_unit(text) or names_unit(label)):
        return ()
    label_axes, label_unit = _axes_and_unit_of(label, language)
    run = tokens(text, language)
    headers = [token for token in run if token.kind == "header"]
    first_number = next((token.start for token in run if token.kind == "number"), 0)
    announced = label_axes or next((header.axes for header in headers if header.end <= first_number), ())
    if len(announced) < 2 and _CHOICES.search(text):
        return ()
    stated = []
    for group in _groups(_quantities(run), announced):
        # `W x H x D 3 x 4 x 5 cm` or `3 x 4 x 5 cm (WxHxD)`: the first header of the text decides which order applies
        before = [header for header in headers if header.end <= group[0].start][-1:]
        after = [header for header in headers if header.start >= group[-1].end][:1]
        nearest = before or after if headers and headers[0].start < first_number else after or before
        axes = (nearest or headers)[0].axes if headers else ()
        lengths = _lengths(group, axes or label_axes, label_unit or unit)
        if lengths:
            words = plain(f"{label} {' '.join(word for quantity in group for word in quantity.words)}")
            meaning: Meaning = "package" if is_package(words) else "component" if is_component(words) else "whole"
            stated.append(Size(lengths, meaning, words, flags_of(lengths)))
    return tuple(stated)


def names_unit(text: str) -> bool:
    """Return True if a text contains a unit of length."""
    return bool(_UNIT.search(text))


@lru_cache(maxsize=4096)  # the labels of a site are the same on every page
def orders_axes(label: str, language: Language | None = None) -> bool:
    """Return True if a label contains an order of axes: `H x W x D`, `Altura x Largura x Profundidade`."""
    return len(label) > 2 and any(token.kind == "header" for token in tokens(label, language))


@lru_cache(maxsize=1024)
def unit_in_brackets(heading: str) -> str | None:
    """Return the unit in brackets in a heading (`Dimensions (mm)`), or None."""
    return next((key for match in _BRACKETED.finditer(heading) if (key := _unit_of_word(match[1]))), None)


def is_same_length(mm: float, other_mm: float) -> bool:
    """Return True if two lengths are equal within rounding (`MAX_RELATIVE_DIFFERENCE`, `MAX_ROUNDING_MM`)."""
    return abs(mm - other_mm) <= max(MAX_RELATIVE_DIFFERENCE * max(mm, other_mm), MAX_ROUNDING_MM)


def flags_of(lengths: Sequence[Length]) -> tuple[str, ...]:
    """Return the flags of lengths.

    Returns
    -------
    tuple of str
        `absurd_size` if a length is outside of `PLAUSIBLE_MM`, `range` if one is a range, and `placeholder` if all
        three are `PLACEHOLDER_VALUES`.
    """
    low, high = PLAUSIBLE_MM
    flags = []
    if any(not low <= length.mm <= high for length in lengths):
        flags.append("absurd_size")
    if any(length.high_mm > length.low_mm for length in lengths):
        flags.append("range")
    if len(lengths) == 3 and all(
        length.mm in {round(millimetres(value, length.unit), 1) for value in PLACEHOLDER_VALUES} for length in lengths
    ):
        flags.append("placeholder")
    return tuple(flags)


def consensus(statements: Sequence[Size]) -> Size:
    """Combine several statements of one size, at least one.

    Returns
    -------
    Size
        The statement with the most lengths, then with the most axes, then in metric units. Without axes, it takes those
        of a statement with the same lengths. The flag `contradicts_itself` is added if a statement differs.
    """

    def rank(size: Size) -> tuple[int, int, bool]:
        lengths = size.lengths
        return len(lengths), sum(bool(one.axis) for one in lengths), all(one.unit in METRIC for one in lengths)

    best = max(statements, key=rank)
    if not any(length.axis for length in best.lengths):
        for other in statements:
            if len(other.lengths) == len(best.lengths) and all(length.axis for length in other.lengths):
                pairs = list(zip(best.lengths, other.lengths, strict=True))
                if all(is_same_length(length.mm, named.mm) for length, named in pairs):
                    best = replace(best, lengths=tuple(replace(length, axis=named.axis) for length, named in pairs))
                    break
    if any(not _agrees(best, other) for other in statements):
        return replace(best, flags=(*best.flags, "contradicts_itself"))
    return best


def _agrees(size: Size, other: Size) -> bool:
    """Return True if a statement contains the lengths of the other: by axis, or in any order if an axis is missing."""
    longer, shorter = sorted((size.lengths, other.lengths), key=len, reverse=True)
    by_axis = {length.axis: length.mm for length in longer if length.axis}
    if all(length.axis in by_axis for length in shorter):
        return all(is_same_length(by_axis[length.axis or ""], length.mm) for length in shorter)
    return all(any(is_same_length(candidate.mm, length.mm) for candidate in longer) for length in shorter)


def _axes_and_unit_of(label: str, language: Language | None) -> tuple[tuple[str, ...], str | None]:
    """Return the axes and the unit in a label: `Size (LxWxH)`, `Height (in.)`, `Breite`."""
    run = tokens(label, language)
    axes = next((token.axes for token in reversed(run) if token.kind == "header"), ())
    if not axes:
        axes = tuple(
            token.key or "" for token in run if token.kind == "axis" and (len(token.text) > 1 or len(run) == 1)
        )
    unit = None
    for token, after in zip_longest(run, run[1:]):
        is_last = after is None or after.kind in {"close", "other"}
        if token.kind in {"word", "unit", "axis"} and is_last and (key := _unit_of_word(token.text)):
            unit = key
    return axes, unit


@dataclass(frozen=True, slots=True)
class _Quantity:
    """A number in a text that may be a length."""

    low: float
    high: float  #: Equal to `low` unless it is a range.
    unit: str | None
    axis: str | None
    start: int
    end: int
    is_joined: bool  #: An `x` joins it to the quantity before.
    words: tuple[str, ...]  #: At most `CONTEXT_WORDS` words since the quantity before.


def _quantities(run: Sequence[Token]) -> list[_Quantity]:
    """Return the numbers of a text that can be lengths."""
    first_axis = next((index for index, token in enumerate(run) if token.kind == "axis"), math.inf)
    first_number = next((index for index, token in enumerate(run) if token.kind == "number"), -1)
    axes_lead = first_axis < first_number  # `W 30 x D 40`, and not `30 W x 40 D`
    lengths: list[_Quantity] = []
    words: list[str] = []
    is_joined = is_skipped = False
    index = 0
    while index < len(run):
        token = run[index]
        if token.kind == "number" and token.number is not None:
            quantity, index, is_length = _quantity_at(run, index, axes_lead, tuple(words[-CONTEXT_WORDS:]), is_joined)
            if is_length:
                lengths.append(quantity)
                words = []
            is_joined, is_skipped = False, not is_length
            continue
        if token.kind == "times":
            is_joined = not is_skipped
        elif token.kind == "word" or (token.kind == "axis" and len(token.text) != 1):
            if _kind(run, index - 1) != "open" or token.text != "max":  # `diameter: 17 cm (max), height: 24 cm`
                words.append(token.text)
        elif token.kind == "break" and token.text in ";|\n•":
            words = []
        index += 1
    return lengths


def _quantity_at(
    run: Sequence[Token], index: int, axes_lead: bool, words: tuple[str, ...], is_joined: bool
) -> tuple[_Quantity, int, bool]:
    """Return the quantity of a number, the index of the token after it, and whether it can be a length."""
    low = high = float(run[index].number or 0.0)
    unit, after = _unit_at(run, index + 1)
    # 1. A range: `50-75 cm`.
    if _kind(run, after) == "range" and _kind(run, after + 1) == "number":
        end = float(run[after + 1].number or 0.0)
        end_unit, after_end = _unit_at(run, after + 2)
        if end > low and (end_unit or unit or axes_lead):
            high, unit, after = end, end_unit or unit, after_end
    # 2. Feet and inches: `5' 11"`.
    if unit == "ft" and _kind(run, after) == "number":
        inch, after_inches = _unit_at(run, after + 1)
        if inch == "in" or (inch is None and run[index + 1].text in "'′’"):
            low = high = low * INCHES_PER_FOOT + float(run[after].number or 0.0)
            unit, after = "in", after_inches
    # 3. The same length in brackets in another unit, `15.5 in. (39 cm)`: the metric one is used.
    if unit is not None and low == high and [_kind(run, after + i) for i in range(4)] == _LENGTH_IN_BRACKETS:
        other, other_unit = float(run[after + 1].number or 0.0), run[after + 2].key or ""
        if other_unit != unit and is_same_length(millimetres(low, unit), millimetres(other, other_unit)):
            low, high, unit = (low, high, unit) if unit in METRIC else (other, other, other_unit)
            after += len(_LENGTH_IN_BRACKETS)
    # 4. Weights, areas and counts are not lengths.
    other_units = OTHER_UNITS if unit is None else {"²", "³", "2", "3"}
    is_other = _kind(run, after) in {"word", "other"} and run[after].text in other_units
    # 5. The axis, before the number or after it: `W 30`, `30 W`, `30 cm (width)`, `30 cm in width`.
    axis = None
    if axes_lead:
        before = reversed(run[max(index - 3, 0) : index])
        token = next((t for t in before if t.kind not in {"colon", "open", "close", "other", "word"}), None)
        axis = token.key if token is not None and token.kind == "axis" else None
    else:
        is_of = _kind(run, after) == "word" and run[after].text in {"in", "de", "di", "em"}
        at = after + 1 if is_of or _kind(run, after) in {"open", "range"} else after
        if _kind(run, at) == "axis" and _kind(run, at + 1) not in {"colon", "number"}:
            axis, after = run[at].key, at + (2 if at > after and _kind(run, at + 1) == "close" else 1)
        if unit is None:
            unit, after = _unit_at(run, after)
    quantity = _Quantity(low, high, unit, axis, run[index].start, run[after - 1].end, is_joined, words)
    return quantity, after, low > 0 and math.isfinite(high) and not is_other


def _unit_at(run: Sequence[Token], index: int) -> tuple[str | None, int]:
    """Return the unit at an index, or None, and the index of the token after it."""
    if _kind(run, index) == "open" and _kind(run, index + 2) == "close" and (key := _unit_of_word(run[index + 1].text)):
        return key, index + 3  # `12.00 (in)`
    if [_kind(run, index + i) for i in range(4)] == ["open", "header", "close", "unit"]:
        return run[index + 3].key, index  # `60 x 40 x 75 (W x D x H) cm`: the header is read later
    if _kind(run, index) != "unit":
        return None, index
    is_abbreviated = (
        _kind(run, index + 1) == "other" and run[index + 1].text == "." and run[index + 1].start == run[index].end
    )
    return run[index].key, index + 1 + is_abbreviated


def _kind(run: Sequence[Token], index: int) -> str | None:
    return run[index].kind if 0 <= index < len(run) else None


def _unit_of_word(text: str) -> str | None:
    """Return the unit of a word of at least two letters, or None; `m` is too often something else."""
    return UNIT_WORDS.get(text.lower().rstrip(".")) if len(text) > 1 else None


def _groups(numbers: Sequence[_Quantity], announced: Sequence[str]) -> list[list[_Quantity]]:
    """Group quantities into sizes: those joined by `x`, those with different axes in a row, or as announced.

    Parameters
    ----------
    numbers : sequence of _Quantity
    announced : sequence of str
        Axes of the label or the header.
    """
    groups: list[list[_Quantity]] = []
    for quantity in numbers:
        group = groups[-1] if groups else []
        axes = {member.axis for member in group}
        is_next_axis = quantity.axis is not None and None not in axes and quantity.axis not in axes
        context = " ".join(quantity.words)
        is_same_object = is_next_axis and not (is_package(context) or is_component(context))
        if 0 < len(group) < MAX_LENGTHS and (quantity.is_joined or is_same_object):
            group.append(quantity)
        else:
            groups.append([quantity])
    # As many lengths as announced axes are one size, whatever separates them: `B/H/T`, `4 cm / 2 cm / 3 cm`. A missing
    # x leaves one of them separate; the same size in another system of units is not part of it.
    has_no_axes = all(quantity.axis is None for quantity in numbers)
    is_separate = all(len(group) == 1 for group in groups)
    has_one_unit = len({quantity.unit for quantity in numbers if quantity.unit}) == 1
    if has_no_axes and (is_separate or has_one_unit) and 2 <= len(numbers) == len(announced):
        return [list(numbers)]
    return groups


def _lengths(group: Sequence[_Quantity], header: Sequence[str], unit: str | None) -> tuple[Length, ...]:
    """Return the lengths of a group, empty if one has no unit.

    Quantities without a unit have that of a neighbour (`filled_units`), else `unit`. Axes of the header are used if the
    quantities have none; axes that occur twice are unreliable and omitted.
    """
    units = filled_units(quantity.unit for quantity in group)
    axes: list[str | None] = [quantity.axis for quantity in group]
    if not any(axes) and header and len(header) >= len(group):
        axes = [axis or None for axis in header[: len(group)]]
    if len({axis for axis in axes if axis}) < sum(bool(axis) for axis in axes):
        axes = [None] * len(group)
    lengths = tuple(
        Length(round(millimetres(quantity.low, key), 1), round(millimetres(quantity.high, key), 1), axis, key)
        for quantity, axis, own_unit in zip(group, axes, units, strict=True)
        if (key := own_unit or unit)
    )
    return lengths if len(lengths) == len(group) else ()
