"""Statements of size on a page: which of its facts state the product's size, and which of them is believed.

From a page to a raw item: what the product is, and the size that the page states of it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime

from crawler.items import RawItem
from crawler.page.label_values import HAS_DIGIT, Fact, facts, names_a_size
from crawler.page.page import Page, squeeze
from crawler.page.product import Product, product
from crawler.page.urls import source_id as hashed_url
from crawler.text.sizes import Length, Size, consensus, flags_of, orders_axes, sizes, unit_in_brackets
from crawler.text.vocabulary import (
    Language,
    is_component,
    is_dimension_label,
    is_foreign,
    is_package,
    is_part_heading,
    is_part_name,
    is_stripped,
    is_whole,
    names_an_axis,
    plain,
)

#: How a statement is to be trusted: a labelled size of the whole, a labelled size, single axes in a table of
#: sizes, single axes elsewhere, what scripts carry, prose.
WHOLE, SIZE, AXES, LOOSE, SCRIPT, PROSE = 5, 4, 3, 2, 1, 0
#: Statements from here up are the page's own word; below it the item is flagged.
TRUSTED = LOOSE
#: Pairs in scripts: `"name":"Width","value":"30 cm"`, with plain or escaped quotes, names as sites use them.
_JSON_PAIR = re.compile(
    r'"(?:name|label|displayName|title|key|attributeName|specName|header)\\*"\s*:\s*\\*"(?P<label>[^"\\]{2,60})\\*"'
    r'(?:\s*,\s*\\*"\w+\\*"\s*:\s*(?:null|true|false|\d+|\\*"[^"\\]{0,40}\\*")){0,3}'
    r'\s*,\s*\\*"(?:value|displayValue|text|values|attributeValue|specValue|description|content)\\*"\s*:\s*\[?\s*'
    r'(?:\\*"(?P<value>(?:[^"\\]|\\\\?\\?"(?!\s*[,\]}])|\\u[0-9a-f]{4}|\\\\u[0-9a-f]{4}){1,160}?)\\*"(?=\s*[,\]}])|(?P<number>\d+(?:\.\d+)?))',
    re.IGNORECASE,
)
_NUMBERS = re.compile(r"\d+")
#: Most letters of a title or a statement, and of an id, a brand or a category, that an item keeps: a page may have
#: megabytes of them, shops have a hundred.
LONGEST_TEXT, LONGEST_WORD = 1000, 200


@dataclass(frozen=True, slots=True)
class Statement:
    """One statement of the product's size: the size, how far it is to be trusted, the text it was read from."""

    size: Size
    trust: int
    text: str


def statements(page: Page, structured: Sequence[tuple[str, str]] = (), title: str = "") -> list[Statement]:
    """All statements of the product's size on a page.

    Parameters
    ----------
    structured : label and text pairs of schema.org data.
    title : the product's; a label may repeat its words (`table height`).
    """
    own = plain(title)
    listed = _statements(list(facts(page)), page.language, own)
    declared = [Fact(label, text, "", "list", 0) for label, text in structured]
    listed += [
        replace(statement, trust=min(statement.trust, AXES)) for statement in _statements(declared, page.language, own)
    ]
    if not any(statement.trust >= TRUSTED for statement in listed):
        scripts = _statements(list(embedded_facts(page)), page.language, own)
        listed += [replace(statement, trust=SCRIPT) for statement in scripts]
    return listed


def _statements(pairs: Sequence[Fact], language: Language | None, title: str) -> list[Statement]:
    return _labelled_statements(pairs, language, title) + _by_axis(pairs, language, title)


def best_statement(candidates: Iterable[Statement]) -> Statement | None:
    """The statement to believe: trusted before untrusted, then the fullest, then the best labelled.

    Statements of equal standing that disagree mark it as contradictory.
    """
    ranked = sorted(candidates, key=_rank, reverse=True)
    if not ranked:
        return None
    best = ranked[0]
    peers = [
        s.size for s in ranked if s.trust >= min(best.trust, SIZE) and len(s.size.lengths) == len(best.size.lengths)
    ]
    size = consensus([best.size, *peers])
    return _with_third_axis(best if size is None else replace(best, size=size), ranked)


def _with_third_axis(best: Statement, ranked: Sequence[Statement]) -> Statement:
    """With the third axis where it has a row of its own: `Size (W x L): 140 x 200 cm`, `Height: 18 cm`."""
    axes = {length.axis for length in best.size.lengths}
    if best.trust < AXES or len(best.size.lengths) != 2 or not axes <= {"length", "width", "height", "depth"}:
        return best
    rows = [s for s in ranked if s.trust >= AXES and len(s.size.lengths) == 1 and s.size.lengths[0].axis not in axes]
    if not rows or rows[0].size.lengths[0].axis == "diameter":
        return best
    lengths = (*best.size.lengths, *rows[0].size.lengths)
    return replace(best, size=replace(best.size, lengths=lengths), text=f"{best.text}; {rows[0].text}")


def _rank(statement: Statement) -> tuple[bool, bool, int, int]:
    count = len(statement.size.lengths)
    return statement.trust >= TRUSTED, statement.trust > LOOSE and count > 1, count, statement.trust


def _labelled_statements(pairs: Iterable[Fact], language: Language | None, title: str) -> list[Statement]:
    statements = []
    for fact in pairs:
        label = plain(f"{fact.label} {fact.section}")
        own = plain(fact.label)
        announced = is_dimension_label(own) or orders_axes(fact.label, language)
        if is_package(label) or _is_of_a_part(own) or (not announced and is_part_heading(plain(fact.section))):
            continue
        if not (announced or is_dimension_label(label) or _says_size(fact) or _names_axes(fact, language, title)):
            continue
        read = sizes(fact.value, fact.label, language, unit_in_brackets(fact.section))
        whole = [size for size in read if size.meaning == "whole"]
        size = consensus(_fullest(whole))
        if size is not None and _is_stated(size, fact):
            statements.append(Statement(size, _trust(fact, announced, title), _shown(fact)))
    return statements


def _fullest(candidates: Sequence[Size]) -> list[Size]:
    """The sizes of one text that can be statements of one item: those with the most lengths."""
    most = max((len(size.lengths) for size in candidates), default=0)
    return [size for size in candidates if len(size.lengths) == most]


def _trust(fact: Fact, announced: bool, title: str) -> int:
    own = plain(fact.label)
    if fact.place == "prose" or (fact.place == "line" and not announced):
        return PROSE
    if fact.place == "json":
        return SCRIPT
    if is_stripped(own):
        return LOOSE
    if announced:
        # A line of running text that names a size is a seller's description, not the site's table.
        return PROSE if fact.place == "line" else WHOLE if is_whole(own) else SIZE
    # Below a heading `dimensions` there are parts, too, under names of their own.
    return SIZE if is_dimension_label(plain(fact.section)) and not is_foreign(own, title) else LOOSE


class _Axes:
    """Rows that name one axis each (`Width | 4 cm`), gathered as long as they speak of one item."""

    def __init__(self, fact: Fact, foreign: bool) -> None:
        self._first = fact
        self._foreign = foreign
        self._lengths: dict[str, tuple[Length, Fact]] = {}

    def takes(self, fact: Fact, axis: str) -> bool:
        """Whether a row goes on with the same item: below the same heading, no axis again in another container."""
        if (fact.section, fact.place) != (self._first.section, self._first.place):
            return False
        known = self._lengths.get(axis)
        scattered = fact.place == "json" and fact.container != self._first.container
        return not scattered and (known is None or known[1].container == fact.container)

    def add(self, length: Length, fact: Fact) -> None:
        """Take a row in; of one axis in one container the first counts."""
        self._lengths.setdefault(length.axis or "", (length, fact))

    def statement(self) -> Statement | None:
        """What the rows state together; one axis of something else is nothing."""
        lengths = tuple(length for length, _ in self._lengths.values())
        if len(lengths) < 2 and (self._foreign or "depth" in self._lengths):
            return None  # nor is a board's thickness alone
        place = self._first.place
        trust = SCRIPT if place == "json" else PROSE if place == "line" and len(lengths) < 2 else AXES
        text = "; ".join(_shown(fact) for _, fact in self._lengths.values())
        return Statement(
            Size(lengths, "whole", "", flags_of(lengths)), min(trust, LOOSE) if self._foreign else trust, text
        )


def _by_axis(pairs: Iterable[Fact], language: Language | None, title: str) -> list[Statement]:
    """Rows that name one axis each, gathered; those of other names (`heel height`) apart from the item's."""
    groups: list[_Axes] = []
    current: dict[bool, _Axes] = {}
    for fact in pairs:
        length = _axis_length(fact, language, title)
        if length is None or not length.axis:
            continue
        foreign = is_foreign(plain(fact.label), title)
        if foreign and not names_an_axis(plain(fact.label)):
            continue  # `Saddle: 145 mm width`: of another item
        if foreign not in current or not current[foreign].takes(fact, length.axis):
            current[foreign] = _Axes(fact, foreign)
            groups.append(current[foreign])
        current[foreign].add(length, fact)
    return [statement for group in groups if (statement := group.statement()) is not None]


def _axis_length(fact: Fact, language: Language | None, title: str) -> Length | None:
    own = plain(fact.label)
    section = plain(fact.section)
    if not own or _is_of_a_part(own) or is_package(own) or is_package(section) or is_part_heading(section):
        return None
    if is_part_name(section, title):
        return None
    read = sizes(fact.value, fact.label, language, unit_in_brackets(fact.section))
    alone = [size for size in read if size.meaning == "whole" and len(size.lengths) == 1]
    if not alone or not alone[0].lengths[0].axis:
        return None
    same = consensus([size for size in alone if size.lengths[0].axis in {None, alone[0].lengths[0].axis}])
    length = alone[0].lengths[0]
    # Of one length in two systems the metric one: the other was rounded.
    return length if same is None or "contradicts_itself" in same.flags else replace(same.lengths[0], axis=length.axis)


def _is_of_a_part(label: str) -> bool:
    return is_component(label) and not (is_whole(label) and not is_component(label.replace("overall", "")))


def _says_size(fact: Fact) -> bool:
    letters = plain(fact.value)
    if fact.place == "prose":
        return is_dimension_label(letters) or len(_NUMBERS.findall(letters)) > 2
    return is_dimension_label(letters) and is_whole(letters)


def _names_axes(fact: Fact, language: Language | None, title: str) -> bool:
    """Whether a label is the item's own name, and its text names three axes: `Desk: 71" L x 32" W x 30" H`."""
    if fact.place == "prose" or not fact.label or is_foreign(plain(fact.label), title):
        return False
    return any(len(size.dimensions_mm()) == 3 for size in sizes(fact.value, fact.label, language))


def _is_stated(size: Size, fact: Fact) -> bool:
    """Whether a reading is a statement: prose that announces no size must name three axes, or two and nothing else."""
    if fact.place == "prose" and not is_dimension_label(plain(f"{fact.value} {fact.section}")):
        bare = not is_foreign(plain(fact.value))
        return len(size.dimensions_mm()) >= (2 if bare else 3)
    return len(size.lengths) > 1 or bool(size.lengths[0].axis)


def _shown(fact: Fact) -> str:
    return squeeze(f"{fact.label}: {fact.value}" if fact.label else fact.value)


def embedded_facts(page: Page) -> Iterator[Fact]:
    """Pairs of the JSON that scripts of the page carry, where their label speaks of a size."""
    for match in _JSON_PAIR.finditer(page.text):
        label = _unescape(match["label"])
        letters = plain(label)
        if names_a_size(letters) or is_component(letters):
            value = match["number"] or _unescape(match["value"])
            if HAS_DIGIT.search(value):
                yield Fact(label, value, "", "json", match.start() // 4000)


def _unescape(text: str) -> str:
    text = re.sub(r"\\+u([0-9a-fA-F]{4})", lambda match: chr(int(match[1], 16)), text)
    return squeeze(re.sub(r"\\+", "", text))


def raw_item(page: Page, source: str, own: Product | None = None, now: datetime | None = None) -> RawItem:
    """The raw item of a page; `extents_mm` is None where the page states no product size.

    Parameters
    ----------
    source : the name of the spider that owns the page's site.
    own : what the site's own rules say of the product; what they leave out is read from the page's structured data.
    """
    known = product(page) if own is None else own
    best = best_statement(statements(page, known.sizes, known.title))
    flags = _flags(best)
    return RawItem(
        source=source,
        source_id=known.id if known.id and len(known.id) <= LONGEST_WORD else hashed_url(page.url),
        url=page.url,
        title=known.title[:LONGEST_TEXT],
        category_path=tuple(step[:LONGEST_WORD] for step in known.category_path),
        brand=known.brand and known.brand[:LONGEST_WORD],
        dimensions_text=best.text[:LONGEST_TEXT] if best else None,
        dimensions_mm=_words(best.size) if best else {},
        extents_mm=best.size.extents_mm() if best else None,
        images=known.images,
        retrieved_at=(now or datetime.now(UTC)).isoformat(timespec="seconds"),
        flags=flags,
    )


def _words(size: Size) -> dict[str, float | None]:
    named = size.dimensions_mm()
    return {axis: named.get(axis) for axis in ("length", "width", "height", "diameter", "depth")} if named else {}


def _flags(best: Statement | None) -> tuple[str, ...]:
    if best is None:
        return ("no_size",)
    low = ("low_trust",) if best.trust == PROSE else ()
    script = ("from_script",) if best.trust == SCRIPT else ()
    return (*low, *script, *best.size.flags)
