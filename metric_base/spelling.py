"""Suggestions for unknown names."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

#: What precedes the names that may be meant, in a message about a name that is unknown.
ADVICE = "; did you mean "


def near_spellings(word: str, known: Iterable[str], n: int = 3, cutoff: float = 0.6) -> list[str]:
    """At most `n` known words that are spelt like `word`, the likeliest first; cutoff : least ratio of `difflib`.

    >>> near_spellings("--instnces", ["--instances", "--images", "--up"], n=1)
    ['--instances']
    """
    import difflib  # only a name that is unknown needs it

    return difflib.get_close_matches(word, list(known), n=n, cutoff=cutoff)


def advice(names: Sequence[str]) -> str:
    """Return the end of a message with suggested names, or an empty text.

    >>> advice(["mug", "cup"])
    "; did you mean 'mug' or 'cup'?"
    """
    return f"{ADVICE}{' or '.join(map(repr, names))}?" if names else ""
