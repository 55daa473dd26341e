"""Vocabulary of product pages: words for axes, sizes, the whole product, its parts and its package.

The words are in `vocabulary.txt`, in seven languages, in lower case and without accents (`plain`), because some pages
omit accents.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Literal, get_args

from metric_base.text_tables import text_sections

Axis = Literal["length", "width", "height", "depth", "diameter"]
Language = Literal["en", "de", "fr", "it", "es", "pt", "nl"]

#: Invisible characters: direction marks, zero-width spaces, soft hyphens, byte-order marks.
INVISIBLE = re.compile("[\u00ad\u034f\u061c\u200b-\u200f\u202a-\u202e\u2060-\u2064\u2066-\u2069\ufeff\ufe0e\ufe0f]")

#: Cache of the tests below: the labels of a site are the same on every page, and each is tested several times.
_cached = lru_cache(maxsize=4096)


@_cached
def plain(text: str) -> str:
    """Return a text in lower case, with single spaces and without accents and invisible characters."""
    if text.isascii():
        return " ".join(text.lower().split())
    letters = unicodedata.normalize("NFKD", INVISIBLE.sub("", text).casefold())
    return " ".join("".join(c for c in letters if not unicodedata.combining(c)).split())


_FILE = Path(__file__).with_name("vocabulary.txt")
#: Alternatives of a regular expression by the name of their list.
_LISTS = {name: words.replace("\n", "|") for name, words in text_sections(_FILE).items()}
#: Axes by word.
AXIS_WORDS: Mapping[str, str] = {word: axis for axis in get_args(Axis) for word in _LISTS[axis].split("|")}
#: Units of numbers that are no lengths.
OTHER_UNITS = frozenset(_LISTS["other units"].split("|"))
_SMALL_WORDS = frozenset(_LISTS["small words"].split("|"))
_PACKAGE, _OTHERS, _WHOLE, _COMPONENT, _DIMENSION = (
    re.compile(rf"\b({_LISTS[name]})\b") for name in ("package", "others", "whole", "component", "dimension")
)
_OF_THE_WHOLE = re.compile(rf"^({_LISTS['whole compound']})(?=.{{4}})")
#: `Size without packaging` is the size of the item.
_UNPACKED = re.compile(rf"\b({_LISTS['without']})( the| the product)? ({_LISTS['unpacked']})\b")
_STRIPPED = re.compile(rf"\b({_LISTS['without']}) (the )?({_LISTS['stand']})\b")
#: Parts that a size includes or excludes: `depth (excluding handles)`.
_ASIDE = re.compile(
    rf"\b({_LISTS['without']}|{_LISTS['including']})\b\.? \w+|\b({_LISTS['with']}) (the )?({_LISTS['stand']})\b"
)
_AND = rf"\b(?:{_LISTS['and']})\b"
#: Headings of sizes and weights: `dimensions & weight`, `Gewicht und Abmessungen`.
_AND_WEIGHT = re.compile(
    r"(?:[&/,+]|{and_})\s*(?:{weight})\b|\b(?:{weight})\s*(?:[&/,+]|{and_})".format(and_=_AND, weight=_LISTS["weight"])
)
#: An order of axes, and a word before it in the data of lenses: `max. diameter x length`.
_ORDER = re.compile(r"[^\W\d_]{2,} ?[x×] ?[^\W\d_]{2,}")
_MOST = re.compile(r"\bmax(?:imum)?\b\.?(?= [^\W\d_]{2,} ?[x×])")
#: Parts that a size includes: `(kettle + base)`.
_TOGETHER = re.compile(rf"\([^()]*(?:[&+]|{_AND})[^()]*\)")
#: The whole item, although its name is that of a part: `the complete model`.
_COMPLETE = re.compile(r"\b(?:complete|completed|finished|assembled|entire|whole) \w+")
_BRACKETS = re.compile(r"\([^)]*\)")
_WORD = re.compile(r"[^\W\d_]+")


@_cached
def is_package(label: str) -> bool:
    """Return True if a plain label names the package instead of the item."""
    return bool(_PACKAGE.search(_UNPACKED.sub(" ", label)))


def axis_of_word(word: str) -> str | None:
    """Return the axis of a plain word, which may be a compound: `hohe`, `gesamthohe`, `producthoogte`."""
    return AXIS_WORDS.get(word) or AXIS_WORDS.get(_OF_THE_WHOLE.sub("", word))


@_cached
def names_an_axis(label: str) -> bool:
    """Return True if a plain label contains the name of an axis: `heel height`."""
    return any(axis_of_word(word) for word in _WORD.findall(label))


@_cached
def is_foreign(label: str, title: str = "") -> bool:
    """Return True if a plain label contains a word for another object: `heel height`, `turntable diameter`.

    Words of the plain title belong to the item: a `table height` is the height of a table.
    """
    words = [word for word in _WORD.findall(_ASIDE.sub(" ", _BRACKETS.sub(" ", label))) if len(word) > 1]
    return any(
        not (axis_of_word(word) or word in _SMALL_WORDS or _WHOLE.search(word) or _DIMENSION.search(word))
        and (len(word) <= 2 or word not in title)
        for word in words
    )


@_cached
def is_component(label: str) -> bool:
    """Return True if a plain label names a part, an adjustment or another quantity.

    False for `depth without handles`, `dimensions & weight`, `size (kettle + base)` and `the complete model measures`.
    """
    if is_dimension_label(label) or _ORDER.search(label):
        label = _MOST.sub(" ", _AND_WEIGHT.sub(" ", _TOGETHER.sub(" ", label)))
    return bool(_COMPONENT.search(_COMPLETE.sub(" ", _ASIDE.sub(" ", label))))


@_cached
def is_stripped(label: str) -> bool:
    """Return True if a plain label excludes the stand or base of the item: `without stand`."""
    return bool(_STRIPPED.search(label))


@_cached
def is_part_heading(heading: str) -> bool:
    """Return True if a plain heading announces the size of a part: `seat dimensions`, not `dimensions and weight`."""
    single = not re.search(rf"[&,/+]|{_AND}", heading)
    return single and is_dimension_label(heading) and is_component(heading) and not is_whole(heading)


@_cached
def is_part_name(heading: str, title: str) -> bool:
    """Return True if a plain heading is just the name of a part (`seat`) that is not in the plain title."""
    return len(heading.split()) <= 2 and heading not in title and is_component(heading) and not is_whole(heading)


@_cached
def is_of_others(heading: str) -> bool:
    """Return True if a plain heading introduces other products: `you may also like`."""
    return bool(_OTHERS.search(heading))


@_cached
def is_whole(label: str) -> bool:
    """Return True if a plain label refers to the whole item."""
    return bool(_WHOLE.search(label))


@_cached
def is_dimension_label(label: str) -> bool:
    """Return True if a plain label contains a word for a size."""
    return bool(_DIMENSION.search(label))


_SITE_LANGUAGE = {
    "de": "de", "at": "de", "ch": "de", "fr": "fr", "it": "it", "es": "es", "mx": "es", "pt": "pt", "br": "pt",
    "nl": "nl", "uk": "en", "us": "en", "ca": "en", "au": "en", "ie": "en", "com": "en",
}  # fmt: skip


def language_of(declared: str | None, host: str = "") -> Language | None:
    """Return the declared language of a page (`de-DE`), else that of the top-level domain of its host, else None."""
    known: tuple[Language, ...] = get_args(Language)
    candidates = (re.split("[-_]", declared or "")[0].lower(), _SITE_LANGUAGE.get(host.rpartition(".")[2]))
    return next((language for candidate in candidates for language in known if candidate == language), None)
