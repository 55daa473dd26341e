"""Lexer of size texts: numbers, units, axes, axis orders such as `L x W x H` (headers), separators and words."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from crawler.text.numbers import NUMBER, number
from crawler.text.vocabulary import Language, axis_of_word, plain
from metric_base.length_units import UNIT_MARKS, UNIT_WORDS

Kind = Literal["number", "unit", "axis", "header", "times", "range", "break", "open", "close", "colon", "word", "other"]

#: `1.234,5`, and `1 234` with a non-breaking space: numbers of languages with decimal commas.
_GROUPED = r"\d{1,3}(?:\.\d{3})+,\d+|\d{1,3}(?:[\u00a0\u202f]\d{3})+(?:,\d+)?"
_LETTER = r"(?:al|an|ab|pr|[lwhdbtpacef])"
_TIMES = r"[x×*✕✖хX]"

_TOKEN = re.compile(
    "|".join(
        (
            # an order of axes, as letters joined by x, slash or star: `LxWxH`, `L x B x H`, `W/D/H`
            rf"(?P<header>(?<![\w])(?:{_LETTER})(?:\s*(?:{_TIMES}|/|-)\s*(?:{_LETTER})){{1,2}}(?![^\W_]))",
            # a number may follow one letter (`H45`); two letters and a number are a code (`AB12`)
            rf"(?P<number>(?<![\d.,_])(?<![^\W\d_][^\W\d_xX])(?:{_GROUPED}|{NUMBER}))",
            rf"(?P<times>{_TIMES}(?![^\W\d_]{{2}})|\b(?:by|per|par|mal|op|por)\b)",
            rf"(?P<unit>{UNIT_MARKS}|``"
            # a word after a digit; no space is needed between a short unit, an x and the next number (`3cmx4cm`)
            r"|(?<=[\d\s)¼½¾⅛⅜⅝⅞])(?:inch\(es\)|(?:mm|cm|dm|in|ft|m)(?=[xX×]\s?\d)|[^\W\d_]+)"
            r"(?=[\s.,;:/()×*xXø-]|\d|$))",
            r"(?P<axis>[øØ⌀]|[^\W\d_]+)",
            r"(?P<range>[-–—~]|\.\.\.?)",
            r"(?P<open>[(\[{])",
            r"(?P<close>[)\]}])",
            r"(?P<colon>[:=])",
            r"(?P<break>[;|/•·\n]|,(?=\s))",
            r"(?P<other>\S)",
        )
    ),
    re.IGNORECASE,
)

#: The point after an axis letter is not a decimal point: `H.75 x L.90 x P.40 cm`.
_ABBREVIATED = re.compile(r"(?<=\b[lwhdbtp])\.(?=\d)", re.IGNORECASE)

_HUNDREDS = re.compile(r"\d{3}")
_THOUSANDS = re.compile(r"[1-9]\d{0,2}\.\d{3}")

#: Words between the two ends of a range.
_RANGE_WORDS = frozenset({"to", "bis", "a", "à", "tot", "hasta", "ate", "fino"})
#: Axes of letters, unless the language gives them another meaning.
_LETTERS = {
    "L": "length", "W": "width", "H": "height", "D": "depth", "B": "width", "T": "depth", "P": "depth",
    "A": "height", "AL": "height", "AN": "width", "AB": "width", "PR": "depth", "C": "length",
    "E": "depth", "F": "depth",
    "Ø": "diameter", "⌀": "diameter",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Token:
    """A token of a size text."""

    kind: Kind
    text: str
    start: int  #: Index of its first character.
    end: int  #: Index after its last character.
    number: float | None = None  #: Value of a number.
    key: str | None = None  #: Key of a unit, or name of an axis.
    axes: tuple[str, ...] = ()  #: Axes of a header, "" for unknown ones.


def tokens(text: str, language: Language | None = None) -> list[Token]:
    """Split a text into tokens; it may contain letters of any case, but no invisible characters."""
    run: list[Token] = []
    for match in _TOKEN.finditer(_ABBREVIATED.sub(" ", text)):
        run.append(_token(match, language, run))
    # 1. Next to hundreds of millimetres, points separate thousands: `1.000 x 1.200 x 300 mm`.
    numbers = [token.text for token in run if token.kind == "number"]
    pointed = [number for number in numbers if "." in number]
    units = {token.key for token in run if token.kind == "unit"}
    are_thousands = bool(pointed) and any(map(_HUNDREDS.fullmatch, numbers)) and all(map(_THOUSANDS.fullmatch, pointed))
    for index, token in enumerate(run) if are_thousands and units == {"mm"} else ():
        if token.kind == "number" and "." in token.text:
            run[index] = replace(token, number=float(token.text.replace(".", "")))
    # 2. Next to a P, L is a width (largeur, largura, larghezza): `H 75 x L 90 x P 40`.
    letters = {token.text.upper() for token in run if token.kind == "axis" and len(token.text) <= 2}
    if "L" in letters and {"P", "PR"} & letters and not {"W", "B"} & letters:
        is_width = [token.kind == "axis" and token.text.upper() == "L" for token in run]
        run = [replace(token, key="width") if width else token for token, width in zip(run, is_width, strict=True)]
    # 3. Axis words joined by x or slash are a header: `ancho x fondo x alto`.
    merged: list[Token] = []
    start = 0
    while start < len(run):
        end = start
        while [token.kind for token in run[end : end + 3]] in (["axis", "times", "axis"], ["axis", "break", "axis"]):
            end += 2
        words = run[start : end + 1]
        if len(words) > 1:
            axes = tuple(token.key or "" for token in words[::2])
            joined = " ".join(token.text for token in words)
            merged.append(Token("header", joined, words[0].start, words[-1].end, axes=axes))
        else:
            merged += words
        start = end + 1
    return merged


def _token(match: re.Match[str], language: Language | None, run: Sequence[Token]) -> Token:
    """Return the token of a match, given the tokens before it."""
    kind, text = match.lastgroup or "other", match[0]
    start, end = match.span()
    if kind == "number":
        value = number(text)
        if language not in {None, "en"}:
            if re.fullmatch(r"\d+,\d{3}", text):
                value = float(text.replace(",", "."))
            elif re.fullmatch(r"\d{1,3}\.\d{3}", text) and not text.startswith("0"):
                value = float(text.replace(".", ""))
        return Token("number", text, start, end, number=value)
    if kind == "header":
        return Token("header", text, start, end, axes=_header_axes(re.findall(_LETTER, text, re.IGNORECASE), language))
    if kind not in {"unit", "axis"}:
        return Token(kind, text, start, end)  # type: ignore[arg-type]  # the names of the groups are kinds
    if kind == "unit" and (key := UNIT_WORDS.get(text.lower().rstrip("."))) and _may_be_unit(text, run):
        return Token("unit", text, start, end, key=key)
    word = plain(text)
    axis = None if word == "large" and language == "en" else axis_of_word(word)
    axis = axis or (axis_of_letter(text, language) if len(word) <= 2 else None)
    is_range = word in _RANGE_WORDS and bool(run) and run[-1].kind in {"number", "unit"}
    return Token("axis" if axis else "range" if is_range else "word", word, start, end, key=axis)


def _may_be_unit(text: str, run: Sequence[Token]) -> bool:
    """Return True if a number or axes before a word can have a unit: `63H cm`, `75 (H) cm`, `(LxWxH) cm`."""
    is_closed = len(run) > 1 and run[-1].kind == "close"
    before = run[-2:-1] if is_closed else run[-1:]
    if not before or before[0].kind == "number":
        return bool(before) and not is_closed
    is_axis = before[0].kind == "axis" and (is_closed or len(before[0].text) <= 2)
    return len(text) > 1 and (is_axis or (before[0].kind == "header" and is_closed))


def _header_axes(letters: Sequence[str], language: Language | None) -> tuple[str, ...]:
    """Return the axes of the letters of a header; their combination resolves letters that are ambiguous alone."""
    upper = [letter.upper() for letter in letters]
    axes = []
    for index, letter in enumerate(letters):
        axis = axis_of_letter(letter, language)
        if upper[index] == "L" and "C" in upper and "L" in letters:
            axis = "width"  # comprimento x largura
        elif upper[index] == "L" and {"P", "PR"} & set(upper):
            axis = "width"  # largura x altura x profundidade, largeur x hauteur x profondeur
        elif letter == "l" and "L" in letters:
            axis = "width"  # Longueur x largeur
        elif upper[index] == "A" and "AN" not in upper:
            # the first of two is a width: largo x ancho x alto
            axis = "width" if upper.count("A") == 2 and upper.index("A") == index else "height"
        elif upper[index] == "P":
            axis = "depth"
        axes.append(axis or "")
    return tuple(axes)


def axis_of_letter(letter: str, language: Language | None) -> str | None:
    """Return the axis of a letter: `W` is a width, as is a German `B`; a Portuguese `C` is a length."""
    upper = letter.upper()
    if upper in {"A", "C", "P", "E", "F", "AL", "AN", "AB", "PR"} and language in {"en", "de", "nl"}:
        return None
    if upper in {"AL", "AN", "AB", "PR", "E", "A"} and language is None:
        return None
    return "width" if letter == "l" and language == "fr" else _LETTERS.get(upper)
