"""Category text as it is written: folded so that spellings of one name meet, cut to the phrase that names the thing."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import pairwise

__all__ = ["Phrase", "noun_phrase"]

_ASIDES = re.compile(r"\([^()]*\)|\[[^\[\]]*\]")
_QUOTED = re.compile(r"[\"“”][^\"“”]*[\"“”]|(?<!\w)['‘][^'’]+['’](?!\w)")

#: What begins the part of a title that says how a thing looks and not what it is.
_AFTER = re.compile(
    r"\s*(?:[,;:|]|\s[-–—]\s|\s(?:with|without|w|from|for|f|in|on|at|by|depicting|showing|containing|representing|"
    r"decorated|inscribed|commemorating|made|used|including|incl|based|after|to)\b|(?<=[a-z])\+|/(?=\s))",
    re.IGNORECASE,
)

#: Words before `of` that count or hold the thing named after it.
_COUNTS = re.compile(
    r"^(?:(?:one|two|three|part|half|each)\s+of\s+)?(?:an?\s+)?(?:the\s+)?(?:pair|set|nest|group|stack|pack)\s+of\s+"
    r"(?:(?:two|three|four|five|six|eight|ten|twelve|\d+)\s+)?(?P<rest>.+)$",
    re.IGNORECASE,
)
_ONE_OF_A_PAIR = re.compile(r"^one\s+of\s+(?:an?|the)\s+(?:pair|set)\s+of\s+", re.IGNORECASE)
_ARTICLES = re.compile(r"^(?:an?|the|his|her|one)\s+", re.IGNORECASE)
_LEADING_NUMBER = re.compile(r"^\d[\d.,/xX]*\s*(?:(?:cm|mm|m|in|inch|inches|ft|oz|ml|l)\b)?\s+(?=[A-Za-z])")


#: What the word before it describes, in place of the thing: a high-back chair is no high chair.
_DESCRIBED = frozenset(["back", "backed", "based", "seat", "seated", "shaped", "style"])


class Phrase(tuple[str, ...]):
    """The words of a folded noun phrase, head last."""

    __slots__ = ()

    def endings(self) -> Iterator[str]:
        """Every run of words that ends with the head, longest first."""
        for start in range(len(self)):
            yield " ".join(self[start:])

    def pairs(self) -> Iterator[str]:
        """Each modifier with the head alone, nearest first: `swivel office chair` has `swivel chair`."""
        for modifier, following in reversed(list(pairwise(self[:-1]))):
            if following not in _DESCRIBED:
                yield f"{modifier} {self[-1]}"


def noun_phrase(text: str) -> str:
    """The part of a title that names the thing, not yet folded: asides, quotations and what follows are cut.

    >>> noun_phrase('Plate with floral decoration')
    'Plate'
    >>> noun_phrase('One of a pair of candlesticks, "Raleigh" pattern (frosted)')
    'candlesticks'
    """
    plain = _QUOTED.sub(" ", _ASIDES.sub(" ", text.replace("™", " ").replace("®", " ")))
    plain = plain.strip(" ,;:-–—")
    cut = _AFTER.split(" " + plain, maxsplit=1)[0].strip() or plain.strip()
    cut = _ONE_OF_A_PAIR.sub("", cut)
    if counted := _COUNTS.match(cut):
        cut = counted["rest"]
    cut = _LEADING_NUMBER.sub("", cut)
    return _ARTICLES.sub("", cut).strip() or cut
