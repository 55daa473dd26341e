"""Fold text, so that different spellings of a name are equal, and form singulars."""

from __future__ import annotations

import re
import string
import unicodedata
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path

from metric_base.arrays import grouped
from metric_base.text_tables import named_texts

#: American spelling, as in WordNet, by British spelling; complete words, singular and plural.
SPELLINGS = named_texts(Path(__file__).with_name("spellings.txt"))
SPELLINGS |= {f"{british}s": f"{american}s" for british, american in SPELLINGS.items()}

#: First letters that differ in American spelling: `kerb`.
_CHANGED = {american[0]: british[0] for british, american in SPELLINGS.items() if british[0] != american[0]}

#: Singulars by plural without a rule.
IRREGULAR = {
    plural: (single,) for plural, single in named_texts(Path(__file__).with_name("irregular_plurals.txt")).items()
}

#: Endings of Greek, Latin, French and English plurals without a plain `s` (amphorae, kraters, plateaux in museums).
_FOREIGN_ENDINGS = (
    ("men", "man"), ("ae", "a"), ("lekythoi", "lekythos"), ("oi", "os"), ("kes", "x"), ("ges", "x"),
    ("des", "s"), ("eaux", "eau"), ("aux", "al"), ("ia", "ium"), ("i", "us"), ("i", "o"), ("es", "is"), ("a", "um"),
)  # fmt: skip

#: Minimum number of characters of names that are compared without spaces; shorter names coincide by chance.
MIN_COMPACT_CHARS = 5

_CAMEL = re.compile(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")
_SEPARATORS = re.compile(r"[^0-9a-z]+")

#: Translation of ASCII characters: lower case, no apostrophes, spaces in place of all other separators.
_ASCII = {code: chr(code).lower() if chr(code).isalnum() else " " for code in range(128)} | {
    ord("'"): None,
    ord("`"): None,
    ord("&"): " and ",
}


@lru_cache(maxsize=1 << 16)
def fold_text(text: str) -> str:
    """Return a text in lower case and American spelling, with single spaces and without accents; idempotent.

    `CamelCase` becomes two words.

    >>> fold_text("Grey T-Shirt's"), fold_text("TrafficLight")
    ('gray t shirts', 'traffic light')
    """
    return plain_fold(_CAMEL.sub(" ", text))


def plain_fold(text: str) -> str:
    """Return the result of `fold_text`, but with `iPhone` and `CamelCase` as one word.

    >>> plain_fold("iPhone")
    'iphone'
    """
    if text.isascii():
        return " ".join([SPELLINGS.get(word, word) for word in text.translate(_ASCII).split()])
    letters = "".join(c for c in without_accents(text) if not unicodedata.combining(c) and c not in "'’‘`´")
    return " ".join(SPELLINGS.get(word, word) for word in _SEPARATORS.sub(" ", letters.replace("&", " and ")).split())


def without_accents(text: str) -> str:
    """Return a text in lower case, with accents as separate characters after their letters."""
    return unicodedata.normalize("NFKD", text.replace("ß", "ss").replace("ø", "o").replace("Ø", "O")).casefold()


def passed_initials(initial: str) -> str:
    """Return the letters and digits with which no text begins whose folded form begins with `initial`.

    >>> "k" in passed_initials("t"), "k" in passed_initials("c"), "é" in passed_initials("t")
    (True, False, False)
    """
    kept = {initial, _CHANGED.get(initial, initial)}
    return "".join(c for c in string.ascii_letters + string.digits if c.lower() not in kept)


def singulars(word: str) -> Iterator[str]:
    """Return the possible singulars of a folded word, most likely first, without the word itself.

    A caller uses the first one in its dictionary: `axes` is the plural of `axe` and of `axis`.
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
    for ending, singular in _FOREIGN_ENDINGS:
        if word.endswith(ending) and (len(word) > len(ending) + 1 or word == "men"):
            yield word[: -len(ending)] + singular
    if word.endswith(("us", "is")):
        yield word[:-1]


def singular_phrases(phrase: str, irregular: Mapping[str, Sequence[str]] = IRREGULAR) -> Iterator[str]:
    """Return a folded phrase with its last word, or the word before `of`, in the singular; irregular ones first.

    >>> list(singular_phrases("wine glasses"))[0]
    'wine glass'
    """
    head, _, last = phrase.rpartition(" ")
    for single in dict.fromkeys((*irregular.get(last, ()), *singulars(last))):
        yield f"{head} {single}".strip()
    first, of, rest = phrase.partition(" of ")
    if of:
        yield from (f"{single} of {rest}" for single in singular_phrases(first, irregular))


def one_edit(word: str, other: str) -> bool:
    """Return True if two words differ by one inserted, deleted or replaced letter, or by two swapped neighbours.

    >>> one_edit("televison", "television"), one_edit("chiar", "chair"), one_edit("cat", "dog")
    (True, True, False)
    """
    if abs(len(word) - len(other)) > 1 or word == other:
        return False
    start = next((at for at, (a, b) in enumerate(zip(word, other)) if a != b), min(len(word), len(other)))  # noqa: B905
    rest, of_other = word[start:], other[start:]
    swapped = rest[:2][::-1] == of_other[:2] and rest[2:] == of_other[2:]
    return swapped or rest[1:] == of_other[1:] or rest[1:] == of_other or rest == of_other[1:]


def by_letters(names: Iterable[str]) -> Mapping[str, tuple[str, ...]]:
    """Return folded names by their spelling without spaces: `bar stool` by `barstool`."""
    spaced = grouped((name.replace(" ", ""), name) for name in names)
    return {letters: tuple(forms) for letters, forms in spaced.items()}


def written_forms(
    phrase: str,
    letters: Callable[[], Mapping[str, tuple[str, ...]]],
    irregular: Mapping[str, Sequence[str]] = IRREGULAR,
) -> Iterator[str]:
    """Return the possible names of a folded phrase: itself, its singulars, then names that differ in spaces.

    Parameters
    ----------
    phrase : str
        Folded phrase.
    letters : callable
        Return the known names by their spelling without spaces (`by_letters`).
    irregular : mapping of str to sequence of str
        Singulars by irregular plural.
    """
    yield phrase
    singles = tuple(singular_phrases(phrase, irregular))
    yield from singles
    for compact in dict.fromkeys(one.replace(" ", "") for one in (phrase, *singles)):
        if len(compact) >= MIN_COMPACT_CHARS:
            yield from letters().get(compact, ())
