"""Grammar of names: find the words that name an item, without counts, containers, modifiers and further text."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from functools import cache
from itertools import pairwise

from metric_base.folders import taxonomy_directory
from metric_base.text_tables import text_sections

# strings, because `re` compiles and caches a pattern at its first use, and most names need no pattern
_ASIDES = r"\([^()]*\)|\[[^\[\]]*\]"
_QUOTED = r"[\"“”][^\"“”]*[\"“”]|(?<!\w)['‘][^'’]+['’](?!\w)"
_ARTICLES = r"(?i)^(?:an?|the|his|her|one)\s+"
#: Counts in the words of people and detectors. In a catalogue, a number may be part of the name (a two-handled cup).
_COUNTED = r"(?i)^(?:an?|the|one|two|three|four|five|six|several|many|some|few|multiple)\s+"

_FOLLOWING = "with|without|in|on|at|by|from|for"
#: Beginnings of the description after the name of an item: appearance, content, material.
_AFTER_NOUN = (
    rf"(?i)\s*(?:[,;:|]|\s[-–—]\s|\s(?:{_FOLLOWING}|w|f|depicting|showing|containing|representing|decorated|inscribed|"
    r"commemorating|made|used|including|incl|based|after|to)\b|(?<=[a-z])\+|/(?=\s))"
)
#: Beginnings of the activity or the location of an item in an image caption: `man riding a bike`.
_AFTER_NAME = (
    rf"(?i)\s+(?:{_FOLLOWING}|near|next|beside|behind|under|against|above|below|inside|who|that|which|wearing|riding|"
    r"holding|carrying|sitting|standing|lying|walking|running|driving|parked|made|using|playing|eating|looking|"
    r"leaning|hanging|mounted|covered|filled|full|and)\b.*$"
)

_FEW = r"an?|the|one|two|three|four|five|six|eight|ten|twelve|\d+"
#: Words for counts and depictions before `of` and the name of the item.
_COUNTS = (
    r"(?i)^(?:(?:one|two|three|part|half|each)\s+of\s+)?(?:an?\s+)?(?:the\s+)?"
    r"(?:close[- ]?up|photo|picture|image|view|pair|set|nest|group|stack|pile|bunch|row|herd|flock|pack|piece|"
    r"collection|lot|roll|couple|heap|crowd|type|kind|part|cluster|number|slice)s?\s+of\s+"
    rf"(?:(?:{_FEW})\s+)?(?P<rest>.+)$"
)
#: Ratios and names of scales; beginnings of groups and of images; ends about an image, a mirror or a copy. "A photo of
#: a" is the prompt of detectors by text, and stays.
_NOT_FULL_SIZE = (
    r"(?i)\b1\s?:\s?\d|\b1\s?/\s?\d+\s+scale\b|\b(?:(?:half|quarter|small|reduced)[-\s]scale|half[-\s]size)d?\b"
    r"|\b(?:ho|oo|n|z|tt)[-\s](?:scale|gauge)\b|\bhot\s?wheels\b|\bremote[-\s]control(?:led)?\s+[a-z]"
    r"|^(?:photo|photograph|snapshot)s?\s+of\s|^(?:photo|photograph|picture|image)\s*:"
    r"|^(?:an?\s+|the\s+)?(?:stack|pile|heap|row|group|crowd|cluster|bunch|collection|line|fleet|part|half|reflection|"
    r"shadow|silhouette)s?\s+of\s"
    r"|\s(?:in|on)\s+(?:(?:an?|the|his|her)\s+)?(?:(?!front\b|top\b)[a-z-]+\s+)?(?:mirror|billboard|screen|poster|"
    r"painting|picture|photo|photograph|magazine(?:\s+cover)?|mural|advertisement|reflection|postcard|t-?shirt|tv|television)"
    r"s?\s*(?:$|\s(?:in|on|at)\s)"
    r"|\s(?:in\s+miniature|(?:is|as)\s+an?\s+(?:toy|replica|miniature)|for\s+(?:an?\s+)?(?:dolls?|doll\s?house|barbie)|"
    r"(?:from|of)\s+lego)\b"
)
#: Part of one item, `back of a chair`, and words before `of` that name no part.
_PART = r"(?:[a-z-]+\s+)?([a-z-]+)\s+of\s+(?:an?|the|his|her)\s"
_WHOLE = frozenset({"view", "close-up", "closeup", "pair", "set", "type", "kind", "one", "two", "three", "each", "all"})
_ONE_OF_A_PAIR = r"(?i)^one\s+of\s+(?:an?|the)\s+(?:pair|set)\s+of\s+"
_LEADING_NUMBER = r"^\d[\d.,/xX]*\s*(?:(?:cm|mm|m|in|inch|inches|ft|oz|ml|l)\b)?\s+(?=[A-Za-z])"
_NUMBER = r"(?<![\w/])[#(]?\d+(?:[.,x×]\d+)*(?:-|\s)?(?:inch|inches|in|cm|mm|m|ft|l|ml|oz)?\)?(?![\w/])"
# possessive quantifiers, because the number of ways to divide the digits is exponential
_SUFFIX = r"(?:\s*+[#(]\d++\)?+|[._ #-]*+\d++)++$"

#: Lists of `word_list` with words before a noun that do not change the object.
MODIFYING = ("colours", "materials", "sizes", "shapes", "states", "patterns", "places")


@cache
def word_list(name: str) -> frozenset[str]:
    """Return the words of a list in `data/taxonomy/word_lists.txt`, such as `colours`."""
    return frozenset(_word_lists()[name].split())


@cache
def _word_lists() -> dict[str, str]:
    return text_sections(taxonomy_directory() / "word_lists.txt")


def noun_phrase(text: str) -> str:
    """Return the name of the item in a title, not folded, without text in brackets, quotations and descriptions.

    >>> noun_phrase('Plate with floral decoration')
    'Plate'
    >>> noun_phrase('One of a pair of candlesticks, "Raleigh" pattern (frosted)')
    'candlesticks'
    """
    plain = re.sub(_QUOTED, " ", re.sub(_ASIDES, " ", text.replace("™", " ").replace("®", " "))).strip(" ,;:-–—")
    cut = re.split(_AFTER_NOUN, " " + plain, maxsplit=1)[0].strip() or plain.strip()
    cut = re.sub(_ONE_OF_A_PAIR, "", cut)
    cut = re.sub(_LEADING_NUMBER, "", after_counts(cut) or cut)
    return re.sub(_ARTICLES, "", cut).strip() or cut


def leading_phrase(text: str) -> str | None:
    """Return the name before a description (`man` in `man riding a bike`); None if there is no description.

    >>> leading_phrase("woman with umbrella")
    'woman'
    """
    cut = re.sub(_AFTER_NAME, "", text).strip()
    return cut if cut and cut != text.strip() else None


def after_counts(text: str) -> str | None:
    """Return the noun after a counting phrase (`scissors` in `pair of scissors`), or None."""
    counted = re.match(_COUNTS, text)
    return counted["rest"] if counted else None


def without_numbers(text: str) -> str:
    """Return a text without counts, sizes, running numbers and articles.

    >>> without_numbers("chair.001"), without_numbers("the 55-inch tv"), without_numbers("2 chairs")
    ('chair', 'tv', 'chairs')
    """
    plain = re.sub(_SUFFIX, "", text.strip()) or text
    plain = re.sub(_COUNTED, "", plain.strip())
    bare = " ".join(re.sub(_NUMBER, " ", plain).split())
    return re.sub(_COUNTED, "", bare).strip() or plain


def container_and_content(text: str) -> tuple[str, str] | None:
    """Return the container and the content in `a cup of coffee`; None if there is no container before `of`.

    >>> container_and_content("a glass of red wine")
    ('glass', 'red wine')
    """
    first, of, rest = re.sub(_COUNTED, "", text.strip()).partition(" of ")
    container = first.strip().lower()
    return (container, rest.strip()) if of and container in word_list("containers") and rest.strip() else None


def is_copy_or_part(text: str) -> bool:
    """Return True if a text names a copy at another scale, an image, a group or a part of an item, in any position.

    >>> is_copy_or_part("car (toy)"), is_copy_or_part("red mini car"), is_copy_or_part("chair in the mirror")
    (True, True, True)
    >>> is_copy_or_part("a photo of a chair"), is_copy_or_part("dog with toy"), is_copy_or_part("pair of scissors")
    (False, False, False)
    """
    part = re.match(_PART, re.sub(_COUNTED, "", text.strip().lower()))
    is_part = part is not None and part[1] not in word_list("containers") | word_list("depictions") | _WHOLE
    if is_part or re.search(_NOT_FULL_SIZE, text):
        return True
    name, *asides = re.split(r"[(\[,;]", re.split(r"(?i)\swith\s", text)[0].lower())
    words = re.findall(r"[a-z]+", name)[:-1] + re.findall(r"[a-z]+", " ".join(asides))
    ends = {word for aside in asides for word in re.findall(r"[a-z]+", aside)[-1:]}
    return not word_list("copies").isdisjoint(words) or not word_list("depictions").isdisjoint(ends)


def modifiers(words: Sequence[str]) -> int:
    """Return the number of leading modifiers: 1 for a colour, 2 for `wall-mounted`, otherwise 0."""
    if len(words) > 2 and words[1] in word_list("compounding"):
        return 2
    return int(bool(words) and any(words[0] in word_list(name) for name in MODIFYING))


def is_plain_adjective(word: str) -> bool:
    """Return True if a word is a colour, a size or an age; compounds that begin with it are rarely names."""
    return word in word_list("colours") or word in word_list("sizes") or word in {"old", "young", "new"}


def endings(words: Sequence[str]) -> Iterator[str]:
    """Return the phrases that end with the last word, longest first.

    >>> list(endings(["swivel", "office", "chair"]))
    ['swivel office chair', 'office chair', 'chair']
    """
    return (" ".join(words[start:]) for start in range(len(words)))


def pairs(words: Sequence[str]) -> Iterator[str]:
    """Return each modifier with the last word, nearest first: `swivel chair` for `swivel office chair`."""
    for modifier, following in reversed(list(pairwise(words[:-1]))):
        if following not in word_list("described"):
            yield f"{modifier} {words[-1]}"
