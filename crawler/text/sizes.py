"""Free text to labelled lengths: `43'' H X 27'' W X 28'' D`, `Dimensões (LxAxP): 48,6 x 29,2 x 40,5 cm`.

The text is read as groups: lengths joined by `x` or following each other with axis words. A group that a word calls a
package, a part or a weight is kept apart from the whole. Nothing is guessed: a group without a unit is not a size.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise, zip_longest
from typing import Literal

from crawler.text.quantities import METRIC, Quantity, is_same_length, quantities, unit_word
from crawler.text.tokens import Token, tokens
from crawler.text.units import UNIT_MARKS, UNIT_WORDS, millimetres
from crawler.text.vocabulary import Language, is_component, is_package, plain

__all__ = ["Length", "Size", "consensus", "flags_of", "names_unit", "orders_axes", "sizes", "unit_in_brackets"]

Meaning = Literal["whole", "component", "package"]

#: A product of more than this, or less than that, is a misreading: a house has 30 m, a sequin 1 mm.
ABSURD_MM = (0.3, 60_000.0)


_UNIT_ALTERNATIVES = "|".join(re.escape(word) for word in UNIT_WORDS if word[-1].isalpha() or word[-1] == ")")
#: Whether a text can name a unit at all. Most texts with a number are prices, dates and counts; this rules them out.
_UNIT = re.compile(rf"(?<![^\W\d_])(?:{_UNIT_ALTERNATIVES})(?![^\W\d_xX])|{UNIT_MARKS}|`", re.IGNORECASE)


#: Metric lengths parted by strokes are a choice (`90/120/160 cm`), unless as many axes are announced.
_CHOICES = re.compile(r"(?<![\d/.,])\d{2,4}(?:[.,]\d)?(?:\s?/\s?\d{2,4}(?:[.,]\d)?)+\s?(?:cm|mm)\b")


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
    """Whether a text may name a unit of length; if neither text nor label names one, there is no size."""
    return bool(_UNIT.search(text))


@lru_cache(maxsize=4096)  # labels come again on every page
def orders_axes(label: str, language: Language | None = None) -> bool:
    """Whether a label announces a size by its axes alone: `H x W x D`, `Altura x Largura x Profundidade`."""
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


_BRACKETED = re.compile(r"[(\[]\s*(?:in\s+)?([^\W\d_]{2,12})\.?\s*[)\]]")


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
    """Whether words between two lengths turn to another item."""
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
