"""Category text as it is written: folded so that spellings of one name meet, cut to the phrase that names the thing."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator
from functools import lru_cache
from itertools import pairwise

__all__ = ["Phrase", "fold_text", "noun_phrase", "singulars", "spelling_of"]

#: British to American, as WordNet's lemmas are spelt; whole words only, singular and plural.
_SPELLINGS = {
    "aluminium": "aluminum", "armour": "armor", "centre": "center", "colour": "color", "fibre": "fiber",
    "grey": "gray", "jewellery": "jewelry", "litre": "liter", "metre": "meter", "moulding": "molding",
    "mould": "mold", "plough": "plow", "pouffe": "pouf", "pyjama": "pajama", "sabre": "saber",
    "sceptre": "scepter", "theatre": "theater", "tyre": "tire", "woollen": "woolen", "yoghurt": "yogurt",
}  # fmt: skip

_CAMEL = re.compile(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")
_ASIDES = re.compile(r"\([^()]*\)|\[[^\[\]]*\]")
_QUOTED = re.compile(r"[\"“”][^\"“”]*[\"“”]|(?<!\w)['‘][^'’]+['’](?!\w)")
_SEPARATORS = re.compile(r"[^0-9a-z]+")

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


@lru_cache(maxsize=1 << 16)
def fold_text(text: str) -> str:
    """Lower case without accents, every separator one space, `CamelCase` apart, American spelling; idempotent."""
    apart = _CAMEL.sub(" ", text)
    plain = unicodedata.normalize("NFKD", apart.replace("ß", "ss").replace("ø", "o").replace("Ø", "O")).casefold()
    letters = "".join(c for c in plain if not unicodedata.combining(c) and c not in "'’‘`´")
    words = _SEPARATORS.sub(" ", letters.replace("&", " and ")).split()
    return " ".join(spelling_of(word) for word in words)


def spelling_of(word: str) -> str:
    """The American spelling of a folded word."""
    if word in _SPELLINGS:
        return _SPELLINGS[word]
    if word.endswith("s") and word[:-1] in _SPELLINGS:
        return _SPELLINGS[word[:-1]] + "s"
    return word


def singulars(word: str) -> Iterator[str]:
    """What the folded word may be the plural of by English rules, likeliest first; the word itself is not among them.

    A caller takes the first that a dictionary knows: `axes` is of `axe` and `axis`.
    """
    if len(word) < 3 or word.endswith("ss"):
        return
    if word.endswith("ies") and len(word) > 4:
        yield word[:-3] + "y"
    if word.endswith("ves"):
        yield from (word[:-3] + "f", word[:-3] + "fe")
    if word.endswith(("ses", "xes", "zes", "ches", "shes", "oes")):
        yield word[:-2]
    if word.endswith("s") and not word.endswith(("us", "is")):
        yield word[:-1]
    yield from _foreign_singulars(word)
    if word.endswith(("us", "is")):
        yield word[:-1]


def _foreign_singulars(word: str) -> Iterator[str]:
    """Greek, Latin, French and English plurals that end in no plain `s` (museums' amphorae, kraters, plateaux)."""
    for ending, singular in (
        ("men", "man"), ("ae", "a"), ("lekythoi", "lekythos"), ("oi", "os"), ("kes", "x"), ("ges", "x"),
        ("des", "s"), ("eaux", "eau"), ("aux", "al"), ("ia", "ium"), ("i", "us"), ("i", "o"), ("es", "is"), ("a", "um"),
    ):  # fmt: skip
        if word.endswith(ending) and (len(word) > len(ending) + 1 or word == "men"):
            yield word[: -len(ending)] + singular


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
