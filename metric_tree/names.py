"""Names as people and detectors write them, folded so that spellings of one name meet."""

from __future__ import annotations

import difflib
import unicodedata
from collections import defaultdict
from collections.abc import Iterable, Mapping
from functools import cached_property

__all__ = ["NameIndex", "fold_name", "singular_form"]

_IRREGULAR = {
    "children": "child", "feet": "foot", "geese": "goose", "halves": "half", "knives": "knife", "leaves": "leaf",
    "lice": "louse", "loaves": "loaf", "men": "man", "mice": "mouse", "oxen": "ox", "people": "person",
    "scarves": "scarf", "shelves": "shelf", "teeth": "tooth", "wolves": "wolf", "women": "woman",
}  # fmt: skip

#: What becomes of each ASCII character: letters small, apostrophes gone, all but letters and digits a space.
_ASCII = {code: chr(code).lower() if chr(code).isalnum() else " " for code in range(128)} | {ord("'"): None}

#: Endings of singular nouns that look like plurals (glass, bus, basis, series, corps).
_SINGULAR_ENDINGS = ("ss", "us", "is", "series", "species", "corps")

#: Endings after which English adds `es`; the two letters go together.
_ES_ENDINGS = ("ses", "xes", "zes", "ches", "shes", "oes")


def fold_name(name: str) -> str:
    """The name in lower case, without accents, with every separator as one space."""
    if name.isascii():
        return " ".join(name.translate(_ASCII).split())
    plain = unicodedata.normalize("NFKD", name).casefold()
    letters = "".join(c if c.isalnum() else " " for c in plain if not unicodedata.combining(c) and c not in "'’")
    return " ".join(letters.split())


def singular_form(name: str) -> str:
    """The folded name with its last word made singular by English rules; idempotent on singular words."""
    head, _, last = name.rpartition(" ")
    return f"{head} {_singular_word(last)}".strip()


def _singular_word(word: str) -> str:
    if word in _IRREGULAR:
        return _IRREGULAR[word]
    if len(word) < 4 or not word.endswith("s") or word.endswith(_SINGULAR_ENDINGS):
        return word
    if word.endswith("ies"):
        return word[:-3] + "y"
    return word[:-2] if word.endswith(_ES_ENDINGS) else word[:-1]


class NameIndex:
    """Which ids bear a name: as written first, its singular second.

    Parameters
    ----------
    names : ids and all the names each bears.
    """

    def __init__(self, names: Iterable[tuple[str, Iterable[str]]]) -> None:
        exact: defaultdict[str, dict[str, None]] = defaultdict(dict)
        for id_, spellings in names:
            for spelling in spellings:
                exact[fold_name(spelling)][id_] = None
        self._exact: Mapping[str, dict[str, None]] = dict(exact)

    @cached_property
    def _loose(self) -> Mapping[str, dict[str, None]]:
        """By singulars; most names are found as written and never ask for it."""
        loose: defaultdict[str, dict[str, None]] = defaultdict(dict)
        for key, ids in self._exact.items():
            loose[singular_form(key)].update(ids)
        return dict(loose)

    def ids(self, name: str) -> tuple[str, ...]:
        """Ids that bear the name, in the order they were given; empty where none does."""
        key = fold_name(name)
        return tuple(self._exact.get(key) or self._loose.get(singular_form(key)) or ())

    def nearest(self, name: str, count: int = 3) -> list[str]:
        """The known names most like an unknown one."""
        return difflib.get_close_matches(fold_name(name), list(self._exact), n=count)
