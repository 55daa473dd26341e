"""The tokens of a text about sizes: numbers, units, axes, headers such as `L x W x H`, separators, other words."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Literal

from crawler.text.numbers import NUMBER, number
from crawler.text.units import UNIT_MARKS, UNIT_WORDS
from crawler.text.vocabulary import Language, axis_of_word, plain

Kind = Literal["number", "unit", "axis", "header", "times", "range", "break", "open", "close", "colon", "word", "other"]

#: `1.234,5` and `1 234` with a space that does not break are numbers of languages that part decimals by a comma.
_GROUPED = r"\d{1,3}(?:\.\d{3})+,\d+|\d{1,3}(?:[\u00a0\u202f]\d{3})+(?:,\d+)?"
_LETTER = r"(?:al|an|ab|pr|[lwhdbtpacef])"
_TIMES = r"[x×*✕✖хX]"

_TOKEN = re.compile(
    "|".join(
        (
            # Axis letters joined by x, slash or star: an order of axes, `LxWxH`, `L x B x H`, `W/D/H`.
            rf"(?P<header>(?<![\w])(?:{_LETTER})(?:\s*(?:{_TIMES}|/|-)\s*(?:{_LETTER})){{1,2}}(?![^\W_]))",
            # One letter may be glued before a number (`H45`), two are a code (`AB12`).
            rf"(?P<number>(?<![\d.,_])(?<![^\W\d_][^\W\d_xX])(?:{_GROUPED}|{NUMBER}))",
            rf"(?P<times>{_TIMES}(?![^\W\d_]{{2}})|\b(?:by|per|par|mal|op|por)\b)",
            rf"(?P<unit>{UNIT_MARKS}|``"
            # A word behind a digit; a short unit may be glued to the x and the number behind it (`3cmx4cm`).
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

#: The point of an axis letter is not one of a decimal: `H.75 x L.90 x P.40 cm`.
_ABBREVIATED = re.compile(r"(?<=\b[lwhdbtp])\.(?=\d)", re.IGNORECASE)

_HUNDREDS, _THOUSANDS = re.compile(r"\d{3}"), re.compile(r"[1-9]\d{0,2}\.\d{3}")

_RANGE_WORDS = frozenset({"to", "bis", "a", "à", "tot", "hasta", "ate", "fino"})


@dataclass(frozen=True, slots=True)
class Token:
    """One token: its kind, its text, its place, its value (a number, a unit's key, an axis, a header's axes)."""

    kind: Kind
    text: str
    start: int
    end: int
    number: float | None = None
    key: str | None = None
    axes: tuple[str, ...] = ()


def tokens(text: str, language: Language | None = None) -> list[Token]:
    """The tokens of a text; invisible signs must be gone already, letters may have any case."""
    run: list[Token] = []
    for match in _TOKEN.finditer(_ABBREVIATED.sub(" ", text)):
        run.append(_token(match, language, run))
    return _with_word_headers(_as_romance(_as_thousands(run)))


def _as_thousands(run: list[Token]) -> list[Token]:
    """`1.000 x 1.200 x 300 mm`: beside whole hundreds of millimetres a point before three digits parts thousands."""
    pointed = [token for token in run if token.kind == "number" and "." in token.text]
    units = {token.key for token in run if token.kind == "unit"}
    hundreds = any(token.kind == "number" and _HUNDREDS.fullmatch(token.text) for token in run)
    if not pointed or units != {"mm"} or not hundreds or not all(_THOUSANDS.fullmatch(t.text) for t in pointed):
        return run
    grouped = {token.start: float(token.text.replace(".", "")) for token in pointed}
    return [replace(token, number=grouped.get(token.start, token.number)) for token in run]


def _as_romance(run: list[Token]) -> list[Token]:
    """Beside a `P` an `L` is a width: largeur, largura, larghezza (`H 75 x L 90 x P 40`), as in a header."""
    letters = {token.text.upper() for token in run if token.kind == "axis" and len(token.text) <= 2}
    if "L" not in letters or not {"P", "PR"} & letters or {"W", "B"} & letters:
        return run
    return [
        replace(token, key="width") if token.kind == "axis" and token.text.upper() == "L" else token for token in run
    ]


def _with_word_headers(run: list[Token]) -> list[Token]:
    """Axis words joined by x or slash (`ancho x fondo x alto`) made one header."""
    merged: list[Token] = []
    place = 0
    while place < len(run):
        end = place
        while (
            _is(run, end, "axis")
            and (_is(run, end + 1, "times") or _is(run, end + 1, "break"))
            and _is(run, end + 2, "axis")
        ):
            end += 2
        if end > place:
            words = run[place : end + 1]
            axes = tuple(token.key or "" for token in words[::2])
            text = " ".join(token.text for token in words)
            merged.append(Token("header", text, words[0].start, words[-1].end, axes=axes))
            place = end + 1
        else:
            merged.append(run[place])
            place += 1
    return merged


def _is(run: list[Token], place: int, kind: Kind) -> bool:
    return place < len(run) and run[place].kind == kind


def _token(match: re.Match[str], language: Language | None, run: list[Token]) -> Token:
    kind, text = match.lastgroup or "other", match[0]
    start, end = match.span()
    if kind == "number":
        return Token("number", text, start, end, number=_value(text, language))
    if kind == "header":
        return _header(text, start, end, language)
    if kind == "unit" and (key := UNIT_WORDS.get(text.lower().rstrip("."))) and _may_carry(run, text):
        return Token("unit", text, start, end, key=key)
    if kind in {"unit", "axis"}:
        return _word(text, start, end, language, run[-1] if run else None)
    if kind == "times":
        return Token("times", text, start, end)
    return Token(kind, text, start, end)  # type: ignore[arg-type]  # the group names are the kinds


def _may_carry(run: list[Token], text: str) -> bool:
    """Return True if a unit may follow, after a number or the letters of axes.

    Examples: `63H cm`, `75 (H) cm`, `(L x W x H) cm`.
    """
    if not run:
        return False
    before = run[-2] if len(run) > 1 and run[-1].kind == "close" else run[-1]
    if before.kind == "number":
        return before is run[-1]
    if before.kind == "header":
        return before is not run[-1] and len(text) > 1
    return before.kind == "axis" and len(text) > 1 and (len(before.text) <= 2 or before is not run[-1])


def _word(text: str, start: int, end: int, language: Language | None, before: Token | None) -> Token:
    bare = plain(text)
    if (axis := axis_of_word(bare)) and not (bare == "large" and language == "en"):
        return Token("axis", bare, start, end, key=axis)
    if len(bare) <= 2 and (axis := axis_of_letter(text, language)):
        return Token("axis", bare, start, end, key=axis)
    if bare in _RANGE_WORDS and before is not None and before.kind in {"number", "unit"}:
        return Token("range", bare, start, end)
    return Token("word", bare, start, end)


def _header(text: str, start: int, end: int, language: Language | None) -> Token:
    letters = re.findall(_LETTER, text, re.IGNORECASE)
    return Token("header", text, start, end, axes=_header_axes(letters, language))


def _header_axes(letters: list[str], language: Language | None) -> tuple[str, ...]:
    """The axes that the letters of a header mean; the letters together tell more than each alone."""
    upper = [letter.upper() for letter in letters]
    axes = []
    for place, (letter, large) in enumerate(zip(letters, upper, strict=True)):
        axis = axis_of_letter(letter, language)
        if large == "L" and "C" in upper and "L" in letters:
            axis = "width"  # comprimento x largura
        elif large == "L" and ({"P", "PR"} & set(upper)):
            axis = "width"  # largura x altura x profundidade, largeur x hauteur x profondeur
        elif letter == "l" and "L" in letters:
            axis = "width"  # Longueur x largeur
        elif large == "A" and "AN" not in upper:
            # largo x ancho x alto: of two the first is the width
            axis = "width" if upper.count("A") == 2 and upper.index("A") == place else "height"
        elif large == "P":
            axis = "depth"
        axes.append(axis or "")
    return tuple(axes)


#: What one letter means where the language does not say otherwise.
_LETTERS = {
    "L": "length", "W": "width", "H": "height", "D": "depth", "B": "width", "T": "depth", "P": "depth",
    "A": "height", "AL": "height", "AN": "width", "AB": "width", "PR": "depth", "C": "length",
    "E": "depth", "F": "depth",
    "Ø": "diameter", "⌀": "diameter",
}  # fmt: skip


def axis_of_letter(letter: str, language: Language | None) -> str | None:
    """The axis that one letter means: `W` is a width, a German `B` too, a Portuguese `C` a length."""
    upper = letter.upper()
    if upper in {"A", "C", "P", "E", "F", "AL", "AN", "AB", "PR"} and language in {"en", "de", "nl"}:
        return None
    if upper in {"AL", "AN", "AB", "PR", "E", "A"} and language is None:
        return None
    if upper == "L" and language == "fr" and letter == "l":
        return "width"
    return _LETTERS.get(upper)


def _value(text: str, language: Language | None) -> float | None:
    comma = language is not None and language != "en"
    if comma and re.fullmatch(r"\d+,\d{3}", text):
        return float(text.replace(",", "."))
    if comma and re.fullmatch(r"\d{1,3}\.\d{3}", text) and not text.startswith("0"):
        return float(text.replace(".", ""))
    return number(text)
