"""Find the size statements of a page, choose the best one, and build the raw item of the page.

A statement is a label and value pair, or a group of pairs with one axis each, that states the size of the whole
product. `best_statement` defines their ranking. Sizes of packages, parts and other products
are not statements.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from enum import IntEnum

from crawler.items import RawItem
from crawler.page.label_values import HAS_DIGIT, LabelValue, label_values, names_a_size
from crawler.page.page import Page, squeeze
from crawler.page.product import Product
from crawler.page.urls import source_id as hashed_url
from crawler.text import vocabulary
from crawler.text.sizes import Length, Size, consensus, flags_of, orders_axes, sizes, unit_in_brackets
from crawler.text.vocabulary import Language, plain

#: Maximum number of characters of a title or a statement in an item. Shops use about 100 characters; broken pages may
#: contain megabytes.
MAX_TEXT = 1000
#: Maximum number of characters of an id, a brand or a category in an item.
MAX_WORD = 200
#: Prose without a size word is searched for axes only if it contains at least this many numbers.
MIN_NUMBERS_OF_PROSE = 3
#: Length in characters of the blocks of a script; the pairs in a block share a container.
_SCRIPT_BLOCK = 4000
#: Pairs in scripts: `"name":"Width","value":"30 cm"`, with plain or escaped quotes and the names that sites use.
_JSON_PAIR = re.compile(
    r'"(?:name|label|displayName|title|key|attributeName|specName|header)\\*"\s*:\s*\\*"(?P<label>[^"\\]{2,60})\\*"'
    r'(?:\s*,\s*\\*"\w+\\*"\s*:\s*(?:null|true|false|\d+|\\*"[^"\\]{0,40}\\*")){0,3}'
    r'\s*,\s*\\*"(?:value|displayValue|text|values|attributeValue|specValue|description|content)\\*"\s*:\s*\[?\s*'
    r'(?:\\*"(?P<value>(?:[^"\\]|\\\\?\\?"(?!\s*[,\]}])|\\u[0-9a-f]{4}|\\\\u[0-9a-f]{4}){1,160}?)\\*"(?=\s*[,\]}])|(?P<number>\d+(?:\.\d+)?))',
    re.IGNORECASE,
)
_NUMBERS = re.compile(r"\d+")


class Trust(IntEnum):
    """Trust in a statement, from its place on the page and its label."""

    PROSE = 0
    SCRIPT = 1  #: JSON in a script.
    LOOSE = 2  #: A size, or single axes, without a label or heading.
    AXES = 3  #: Single axes in a table of sizes.
    SIZE = 4  #: A labelled size.
    WHOLE = 5  #: A size with a label for the whole product.


@dataclass(frozen=True, slots=True)
class Statement:
    """A statement of the size of the product."""

    size: Size
    trust: Trust
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
        origin = {Trust.PROSE: ("low_trust",), Trust.SCRIPT: ("from_script",)}.get(best.trust, ())
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
    pairs = [pair for pair in label_values(page) if not vocabulary.is_of_others(plain(pair.section))]
    statements = list(_statements(pairs, language, words))
    declared = [LabelValue(label, text, "", "list", 0) for label, text in structured]
    statements += [
        replace(statement, trust=min(statement.trust, Trust.AXES))
        for statement in _statements(declared, language, words)
    ]
    if not any(statement.trust >= Trust.LOOSE for statement in statements):
        scripts = _statements(list(script_label_values(page)), language, words)
        statements += [replace(statement, trust=Trust.SCRIPT) for statement in scripts]
    return statements


def best_statement(candidates: Iterable[Statement]) -> Statement | None:
    """Return the statement to use.

    Statements are ranked by four criteria in this order: whether they are from tables and labels, and not from scripts
    and prose; whether they have a label or heading and several lengths; their number of lengths; and their `Trust`.
    If trusted statements with the same number of lengths disagree, the size has the flag `contradicts_itself`. A size
    of two axes is completed by a third axis that has a separate row: `Size (W x L): 140 x 200 cm`, `Height: 18 cm`.
    """

    def rank(statement: Statement) -> tuple[bool, bool, int, int]:
        count = len(statement.size.lengths)
        return statement.trust >= Trust.LOOSE, statement.trust > Trust.LOOSE and count > 1, count, statement.trust

    ranked = sorted(candidates, key=rank, reverse=True)
    if not ranked:
        return None
    best = ranked[0]
    peers = [
        statement.size
        for statement in ranked
        if statement.trust >= min(best.trust, Trust.SIZE) and len(statement.size.lengths) == len(best.size.lengths)
    ]
    best = replace(best, size=consensus([best.size, *peers]))
    axes = {length.axis for length in best.size.lengths}
    if best.trust < Trust.AXES or len(best.size.lengths) != 2 or not axes <= {"length", "width", "height", "depth"}:
        return best
    rows = [statement for statement in ranked if statement.trust >= Trust.AXES and len(statement.size.lengths) == 1]
    third = next((row for row in rows if row.size.lengths[0].axis not in axes), None)
    if third is None or third.size.lengths[0].axis == "diameter":
        return best
    lengths = (*best.size.lengths, *third.size.lengths)
    return replace(best, size=replace(best.size, lengths=lengths), text=f"{best.text}; {third.text}")


def _statements(pairs: Sequence[LabelValue], language: Language | None, title: str) -> Iterator[Statement]:
    """Return the statements of pairs that announce a size, then those of groups of rows with one axis each."""
    for pair in pairs:
        label, section = plain(pair.label), plain(pair.section)
        is_announced = vocabulary.is_dimension_label(label) or orders_axes(pair.label, language)
        is_package_size = vocabulary.is_package(plain(f"{pair.label} {pair.section}"))
        if is_package_size or _is_of_part(label) or (not is_announced and vocabulary.is_part_heading(section)):
            continue
        if not (is_announced or _announces_size(pair, language, title)):
            continue
        read = sizes(pair.value, pair.label, language, unit_in_brackets(pair.section))
        whole = [size for size in read if size.meaning == "whole"]
        if not whole:
            continue
        max_lengths = max(len(size.lengths) for size in whole)
        size = consensus([size for size in whole if len(size.lengths) == max_lengths])
        if pair.place == "prose" and not vocabulary.is_dimension_label(plain(f"{pair.value} {pair.section}")):
            # prose without a word for a size must state three axes, or two axes and no other words
            is_stated = len(size.dimensions_mm()) >= (3 if vocabulary.is_foreign(plain(pair.value)) else 2)
        else:
            is_stated = len(size.lengths) > 1 or bool(size.lengths[0].axis)
        if is_stated:
            yield Statement(size, _trust(pair, is_announced, title), _text(pair))
    yield from _axis_statements(pairs, language, title)


def _announces_size(pair: LabelValue, language: Language | None, title: str) -> bool:
    """Return True if a pair announces a size of the product.

    The label, the heading or the text announces it, or the label names the product and the text states three axes.
    Examples: `Table: overall size 3 x 4 cm`, `Desk: 71" L x 32" W x 30" H`.
    """
    if vocabulary.is_dimension_label(plain(f"{pair.label} {pair.section}")):
        return True
    text = plain(pair.value)
    if pair.place == "prose":
        return vocabulary.is_dimension_label(text) or len(_NUMBERS.findall(text)) >= MIN_NUMBERS_OF_PROSE
    if vocabulary.is_dimension_label(text) and vocabulary.is_whole(text):
        return True
    if not pair.label or vocabulary.is_foreign(plain(pair.label), title):
        return False
    return any(len(size.dimensions_mm()) == 3 for size in sizes(pair.value, pair.label, language))


def _trust(pair: LabelValue, is_announced: bool, title: str) -> Trust:
    """Return the trust in the size of a pair; `is_announced` if its label announces a size."""
    label = plain(pair.label)
    if pair.place == "prose" or (pair.place == "line" and not (is_announced and vocabulary.is_stripped(label))):
        # a line of running text with a size is the seller's description, not the site's table
        return Trust.PROSE
    if vocabulary.is_stripped(label):
        return Trust.LOOSE
    if is_announced:
        return Trust.WHOLE if vocabulary.is_whole(label) else Trust.SIZE
    # a size heading may also stand above parts, which a label with other words names
    is_named = vocabulary.is_dimension_label(plain(pair.section)) and not vocabulary.is_foreign(label, title)
    return Trust.SIZE if is_named else Trust.LOOSE


def _axis_statements(pairs: Iterable[LabelValue], language: Language | None, title: str) -> Iterator[Statement]:
    """Return the statements of groups of rows with one axis each: `Width | 4 cm`, `Height | 3 cm`.

    The rows of a group share a heading. If an axis occurs twice in one container, its first row is used; an axis that
    another container repeats starts a new group. Rows with words for other objects (`heel height`) form groups of
    their own.
    """
    groups: list[tuple[bool, dict[str, tuple[Length, LabelValue]]]] = []
    current: dict[bool, dict[str, tuple[Length, LabelValue]]] = {}
    for pair in pairs:
        length = _axis_length(pair, language, title)
        if length is None or not length.axis:
            continue
        label = plain(pair.label)
        is_other = vocabulary.is_foreign(label, title)
        if is_other and not vocabulary.names_an_axis(label):
            continue  # `Saddle: 145 mm width` belongs to another item
        rows = current.get(is_other, {})
        first = next((row for _, row in rows.values()), None)
        known = rows.get(length.axis)
        if (
            first is None
            or (pair.section, pair.place) != (first.section, first.place)
            or (pair.place == "json" and pair.container != first.container)
            or (known is not None and known[1].container != pair.container)
        ):
            rows = current[is_other] = {}
            groups.append((is_other, rows))
        rows.setdefault(length.axis, (length, pair))
    for is_other, rows in groups:
        lengths = tuple(length for length, _ in rows.values())
        if len(lengths) < 2 and (is_other or "depth" in rows):
            continue  # a depth without other axes is often the thickness of a board
        place = next(row.place for _, row in rows.values())
        trust = Trust.PROSE if place == "line" and len(lengths) < 2 else Trust.AXES
        text = "; ".join(_text(row) for _, row in rows.values())
        size = Size(lengths, "whole", "", flags_of(lengths))
        yield Statement(size, min(trust, Trust.LOOSE) if is_other else trust, text)


def _axis_length(pair: LabelValue, language: Language | None, title: str) -> Length | None:
    """Return the single length of a row and its axis, or None. Rows of parts and packages are ignored."""
    label, section = plain(pair.label), plain(pair.section)
    if not label or _is_of_part(label) or vocabulary.is_package(label) or vocabulary.is_package(section):
        return None
    if vocabulary.is_part_heading(section) or vocabulary.is_part_name(section, title):
        return None
    read = sizes(pair.value, pair.label, language, unit_in_brackets(pair.section))
    single = [size for size in read if size.meaning == "whole" and len(size.lengths) == 1]
    if not single or not single[0].lengths[0].axis:
        return None
    length = single[0].lengths[0]
    same = consensus([size for size in single if size.lengths[0].axis in {None, length.axis}])
    # if a length is stated in two systems of units, prefer the metric value; the other is rounded
    return length if "contradicts_itself" in same.flags else replace(same.lengths[0], axis=length.axis)


def _is_of_part(label: str) -> bool:
    """Return True if a normalised label names a part, and not the whole (`overall ...`)."""
    is_still_part = vocabulary.is_component(label.replace("overall", ""))
    return vocabulary.is_component(label) and (is_still_part or not vocabulary.is_whole(label))


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
        if names_a_size(letters) or vocabulary.is_component(letters):
            value = match["number"] or unescaped(match["value"])
            if HAS_DIGIT.search(value):
                yield LabelValue(label, value, "", "json", match.start() // _SCRIPT_BLOCK)
