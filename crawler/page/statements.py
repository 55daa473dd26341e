"""Size statements of a page, the best of them, and the raw item of the page.

This module alone decides which size of a page is used. A statement is a label and value pair, or a group of pairs
with one axis each, that states the size of the whole product. Statements are ranked by their trust and by their
number of lengths (`best_statement`); sizes of packages, parts and other products are not statements.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime

from crawler.items import RawItem
from crawler.page.label_values import HAS_DIGIT, LabelValue, label_values, names_a_size
from crawler.page.page import Page, squeeze
from crawler.page.product import Product
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

#: Trust in a statement: a labelled size of the whole, a labelled size, single axes in a table of sizes, single axes
#: elsewhere, JSON in a script, prose.
WHOLE, SIZE, AXES, LOOSE, SCRIPT, PROSE = 5, 4, 3, 2, 1, 0
#: Minimum trust of a statement of the page itself; items with a lower one are flagged.
TRUSTED = LOOSE
#: Pairs in scripts: `"name":"Width","value":"30 cm"`, with plain or escaped quotes and the names that sites use.
_JSON_PAIR = re.compile(
    r'"(?:name|label|displayName|title|key|attributeName|specName|header)\\*"\s*:\s*\\*"(?P<label>[^"\\]{2,60})\\*"'
    r'(?:\s*,\s*\\*"\w+\\*"\s*:\s*(?:null|true|false|\d+|\\*"[^"\\]{0,40}\\*")){0,3}'
    r'\s*,\s*\\*"(?:value|displayValue|text|values|attributeValue|specValue|description|content)\\*"\s*:\s*\[?\s*'
    r'(?:\\*"(?P<value>(?:[^"\\]|\\\\?\\?"(?!\s*[,\]}])|\\u[0-9a-f]{4}|\\\\u[0-9a-f]{4}){1,160}?)\\*"(?=\s*[,\]}])|(?P<number>\d+(?:\.\d+)?))',
    re.IGNORECASE,
)
_NUMBERS = re.compile(r"\d+")
#: Number of characters of a script within which its pairs belong to one container.
_SCRIPT_BLOCK = 4000
#: Maximum number of characters of a title or a statement in an item: a page may contain megabytes, shops use a hundred.
MAX_TEXT = 1000
#: Maximum number of characters of an id, a brand or a category in an item.
MAX_WORD = 200


@dataclass(frozen=True, slots=True)
class Statement:
    """A statement of the size of the product."""

    size: Size
    trust: int  #: One of the levels above.
    text: str  #: Text from which the size was read.


def page_item(page: Page, source: str, product: Product, now: datetime | None = None) -> RawItem:
    """Return the raw item of a product page.

    Parameters
    ----------
    page : Page
    source : str
        Name of the source (`Site.source`).
    product : Product
        Title, category and structured sizes of the page (`Site.product`).
    now : datetime, optional
        Time of retrieval.

    Returns
    -------
    RawItem
        `extents_mm` is None, with the flag `no_size`, if the page states no size of the product.
    """
    best = best_statement(size_statements(page, product.sizes, product.title))
    if best is None:
        flags: tuple[str, ...] = ("no_size",)
        named: dict[str, float] = {}
    else:
        origin = {PROSE: ("low_trust",), SCRIPT: ("from_script",)}.get(best.trust, ())
        flags = (*origin, *best.size.flags)
        named = best.size.dimensions_mm()
    axes = ("length", "width", "height", "diameter", "depth")
    return RawItem(
        source=source,
        source_id=product.id if product.id and len(product.id) <= MAX_WORD else hashed_url(page.url),
        url=page.url,
        title=product.title[:MAX_TEXT],
        category_path=tuple(step[:MAX_WORD] for step in product.category_path),
        brand=product.brand and product.brand[:MAX_WORD],
        dimensions_text=best.text[:MAX_TEXT] if best else None,
        dimensions_mm={axis: named.get(axis) for axis in axes} if named else {},
        extents_mm=best.size.extents_mm() if best else None,
        images=product.images,
        retrieved_at=(now or datetime.now(UTC)).isoformat(timespec="seconds"),
        flags=flags,
    )


def size_statements(page: Page, structured: Sequence[tuple[str, str]] = (), title: str = "") -> list[Statement]:
    """Return all statements of the size of the product on a page.

    Parameters
    ----------
    page : Page
    structured : sequence of tuple of str
        Label and text pairs of the schema.org data.
    title : str
        Title of the product; labels may repeat its words (`table height`).
    """
    words, language = plain(title), page.language
    statements = _statements(list(label_values(page)), language, words)
    declared = [LabelValue(label, text, "", "list", 0) for label, text in structured]
    statements += [
        replace(statement, trust=min(statement.trust, AXES)) for statement in _statements(declared, language, words)
    ]
    if not any(statement.trust >= TRUSTED for statement in statements):
        scripts = _statements(list(script_label_values(page)), language, words)
        statements += [replace(statement, trust=SCRIPT) for statement in scripts]
    return statements


def best_statement(candidates: Iterable[Statement]) -> Statement | None:
    """Return the statement to use: trusted before others, then with the most lengths, then with the best label.

    Statements of equal rank that differ mark its size as contradictory. A size of two axes is completed by a third axis
    that has its own row: `Size (W x L): 140 x 200 cm`, `Height: 18 cm`.
    """

    def rank(statement: Statement) -> tuple[bool, bool, int, int]:
        count = len(statement.size.lengths)
        return statement.trust >= TRUSTED, statement.trust > LOOSE and count > 1, count, statement.trust

    ranked = sorted(candidates, key=rank, reverse=True)
    if not ranked:
        return None
    best = ranked[0]
    peers = [
        s.size for s in ranked if s.trust >= min(best.trust, SIZE) and len(s.size.lengths) == len(best.size.lengths)
    ]
    size = consensus([best.size, *peers])
    if size is not None:
        best = replace(best, size=size)
    axes = {length.axis for length in best.size.lengths}
    if best.trust < AXES or len(best.size.lengths) != 2 or not axes <= {"length", "width", "height", "depth"}:
        return best
    rows = [s for s in ranked if s.trust >= AXES and len(s.size.lengths) == 1 and s.size.lengths[0].axis not in axes]
    if not rows or rows[0].size.lengths[0].axis == "diameter":
        return best
    lengths = (*best.size.lengths, *rows[0].size.lengths)
    return replace(best, size=replace(best.size, lengths=lengths), text=f"{best.text}; {rows[0].text}")


def _statements(pairs: Sequence[LabelValue], language: Language | None, title: str) -> list[Statement]:
    return [*_labelled_statements(pairs, language, title), *_axis_statements(pairs, language, title)]


def _labelled_statements(pairs: Iterable[LabelValue], language: Language | None, title: str) -> Iterator[Statement]:
    """Return the statements of pairs whose label, heading or text announces a size."""
    for pair in pairs:
        label = plain(f"{pair.label} {pair.section}")
        own = plain(pair.label)
        is_announced = is_dimension_label(own) or orders_axes(pair.label, language)
        if is_package(label) or _is_of_a_part(own) or (not is_announced and is_part_heading(plain(pair.section))):
            continue
        if not (
            is_announced
            or is_dimension_label(label)
            or _text_announces_size(pair)
            or _names_item_with_axes(pair, language, title)
        ):
            continue
        read = sizes(pair.value, pair.label, language, unit_in_brackets(pair.section))
        whole = [size for size in read if size.meaning == "whole"]
        longest = max((len(size.lengths) for size in whole), default=0)
        size = consensus([size for size in whole if len(size.lengths) == longest])
        if size is not None and _is_stated(size, pair):
            yield Statement(size, _trust(pair, is_announced, title), _text(pair))


def _trust(pair: LabelValue, is_announced: bool, title: str) -> int:
    own = plain(pair.label)
    if pair.place == "prose" or (pair.place == "line" and not is_announced):
        return PROSE
    if pair.place == "json":
        return SCRIPT
    if is_stripped(own):
        return LOOSE
    if is_announced:
        # a line of running text with a size is the description of a seller, not the table of the site
        return PROSE if pair.place == "line" else WHOLE if is_whole(own) else SIZE
    # parts with names of their own may be below a heading `dimensions`, too
    return SIZE if is_dimension_label(plain(pair.section)) and not is_foreign(own, title) else LOOSE


class _AxisGroup:
    """Rows with one axis each (`Width | 4 cm`) that belong to one item."""

    def __init__(self, pair: LabelValue, is_foreign_item: bool) -> None:
        self._first = pair
        self._is_foreign_item = is_foreign_item
        self._lengths: dict[str, tuple[Length, LabelValue]] = {}

    def accepts(self, pair: LabelValue, axis: str) -> bool:
        """Return True if a row continues the group: same heading, and no axis again in another container."""
        if (pair.section, pair.place) != (self._first.section, self._first.place):
            return False
        known = self._lengths.get(axis)
        is_scattered = pair.place == "json" and pair.container != self._first.container
        return not is_scattered and (known is None or known[1].container == pair.container)

    def add(self, length: Length, pair: LabelValue) -> None:
        """Add a row; the first row of an axis counts."""
        self._lengths.setdefault(length.axis or "", (length, pair))

    def statement(self) -> Statement | None:
        """Combine the rows; None for a single row that is a depth (of a board) or belongs to another item."""
        lengths = tuple(length for length, _ in self._lengths.values())
        if len(lengths) < 2 and (self._is_foreign_item or "depth" in self._lengths):
            return None
        place = self._first.place
        trust = SCRIPT if place == "json" else PROSE if place == "line" and len(lengths) < 2 else AXES
        text = "; ".join(_text(pair) for _, pair in self._lengths.values())
        size = Size(lengths, "whole", "", flags_of(lengths))
        return Statement(size, min(trust, LOOSE) if self._is_foreign_item else trust, text)


def _axis_statements(pairs: Iterable[LabelValue], language: Language | None, title: str) -> Iterator[Statement]:
    """Return statements of groups of rows with one axis each; rows of other names (`heel height`) form other groups."""
    groups: list[_AxisGroup] = []
    current: dict[bool, _AxisGroup] = {}
    for pair in pairs:
        length = _axis_length(pair, language, title)
        if length is None or not length.axis:
            continue
        is_other = is_foreign(plain(pair.label), title)
        if is_other and not names_an_axis(plain(pair.label)):
            continue  # `Saddle: 145 mm width` belongs to another item
        if is_other not in current or not current[is_other].accepts(pair, length.axis):
            current[is_other] = _AxisGroup(pair, is_other)
            groups.append(current[is_other])
        current[is_other].add(length, pair)
    return (statement for group in groups if (statement := group.statement()) is not None)


def _axis_length(pair: LabelValue, language: Language | None, title: str) -> Length | None:
    """Return the length with its axis that a row states; None if it is of a part or a package, or not a single one."""
    own = plain(pair.label)
    section = plain(pair.section)
    if not own or _is_of_a_part(own) or is_package(own) or is_package(section) or is_part_heading(section):
        return None
    if is_part_name(section, title):
        return None
    read = sizes(pair.value, pair.label, language, unit_in_brackets(pair.section))
    single = [size for size in read if size.meaning == "whole" and len(size.lengths) == 1]
    if not single or not single[0].lengths[0].axis:
        return None
    length = single[0].lengths[0]
    same = consensus([size for size in single if size.lengths[0].axis in {None, length.axis}])
    # of a length in two systems of units the metric one is used: the other was rounded
    return length if same is None or "contradicts_itself" in same.flags else replace(same.lengths[0], axis=length.axis)


def _is_of_a_part(label: str) -> bool:
    return is_component(label) and not (is_whole(label) and not is_component(label.replace("overall", "")))


def _text_announces_size(pair: LabelValue) -> bool:
    letters = plain(pair.value)
    if pair.place == "prose":
        return is_dimension_label(letters) or len(_NUMBERS.findall(letters)) > 2
    return is_dimension_label(letters) and is_whole(letters)


def _names_item_with_axes(pair: LabelValue, language: Language | None, title: str) -> bool:
    """Return True if the label is the name of the item and the text has three axes: `Desk: 71" L x 32" W x 30" H`."""
    if pair.place == "prose" or not pair.label or is_foreign(plain(pair.label), title):
        return False
    return any(len(size.dimensions_mm()) == 3 for size in sizes(pair.value, pair.label, language))


def _is_stated(size: Size, pair: LabelValue) -> bool:
    """Return True if a size is a statement.

    Prose without a size word must have three axes, or two axes and no other words.
    """
    if pair.place == "prose" and not is_dimension_label(plain(f"{pair.value} {pair.section}")):
        is_bare = not is_foreign(plain(pair.value))
        return len(size.dimensions_mm()) >= (2 if is_bare else 3)
    return len(size.lengths) > 1 or bool(size.lengths[0].axis)


def _text(pair: LabelValue) -> str:
    return squeeze(f"{pair.label}: {pair.value}" if pair.label else pair.value)


def script_label_values(page: Page) -> Iterator[LabelValue]:
    """Return the pairs of JSON in scripts of the page whose label names a size."""

    def unescaped(text: str) -> str:
        text = re.sub(r"\\+u([0-9a-fA-F]{4})", lambda match: chr(int(match[1], 16)), text)
        return squeeze(re.sub(r"\\+", "", text))

    for match in _JSON_PAIR.finditer(page.text):
        label = unescaped(match["label"])
        letters = plain(label)
        if names_a_size(letters) or is_component(letters):
            value = match["number"] or unescaped(match["value"])
            if HAS_DIGIT.search(value):
                yield LabelValue(label, value, "", "json", match.start() // _SCRIPT_BLOCK)
