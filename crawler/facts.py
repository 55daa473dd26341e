"""Label and value pairs of a page: tables, definition lists, rows of boxes, lines with a colon.

The search runs from the value: only text with a digit is looked at, and from there up to its label and its heading.
That is the part of a page that could hold a size; the rest costs nothing.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from lxml.etree import XPath

from crawler.pages import Element, Page, squeezed
from crawler.regions import LABEL_LENGTH, SKIPPED, VALUE_LENGTH, Regions
from crawler.words import AXIS_WORDS, is_dimension_label, is_package, plain

__all__ = ["HAS_DIGIT", "Fact", "facts", "names_a_size"]

Place = Literal["table", "list", "row", "line", "json", "prose"]

#: So far up from its text a value's label is looked for; deeper nesting is decoration.
CLIMB = 5

#: Longer texts are articles.
LONGEST_TEXT = 2000

#: Text that is not blank; a digit is then found by a regular expression, which is faster than XPath's `translate`.
_TEXTS = XPath("/html/body//text()[normalize-space()]")

HAS_DIGIT = re.compile("[0-9¼½¾⅓-⅞]")


@dataclass(frozen=True, slots=True)
class Fact:
    """A label and what stands beside it; `section` is the heading above, `container` tells rows of one table."""

    label: str
    value: str
    section: str
    place: Place
    container: int


def facts(page: Page) -> Iterator[Fact]:
    """The pairs whose value holds a number, in the order of the page; those of other products are left out."""
    reader = _Reader()
    seen: set[tuple[str, str, str]] = set()
    for text in _TEXTS(page.root):
        if not HAS_DIGIT.search(text) or len(text) >= LONGEST_TEXT:
            continue
        element = text.getparent() if text.is_text else text.getparent().getparent()
        if element is None or reader.regions.is_elsewhere(element):
            continue
        for fact in reader.facts_of(element, squeezed(text)):
            key = (fact.label, fact.value, fact.section)
            if key not in seen:
                seen.add(key)
                yield fact


@dataclass(frozen=True, slots=True)
class _Pair:
    place: Place
    label: str
    value: str
    container: Element


class _Reader:
    """The pairs of one page; what was found for an element is kept, since its texts lead to it one by one."""

    def __init__(self) -> None:
        self.regions = Regions()
        self._text = self.regions.text
        self._pairs: dict[Element, _Pair | None] = {}
        self._containers: dict[Element, int] = {}

    def facts_of(self, element: Element, text: str) -> Iterator[Fact]:
        here = element
        for _ in range(CLIMB):
            parent = here.getparent()
            if parent is None or here.tag in {"body", "main"}:
                break
            if here not in self._pairs:
                self._pairs[here] = self._row(here) or self._definition(here) or self._pair(here, parent)
            found = self._pairs[here]
            if found is not None:
                if found.place == "table" and not found.label:
                    return  # a table of several products, or of sizes to choose from
                heading = self.regions.heading(found.container)
                yield from _split(found.label, found.value, heading, found.place, self._number(found.container))
                return
            here = parent
        whole = self._text(element) if len(text) < VALUE_LENGTH else text
        value = whole if len(whole) <= VALUE_LENGTH else text
        container = self._number(element.getparent())
        yield from _split("", value, self.regions.heading(element), "line", container)

    def _number(self, container: Element) -> int:
        return self._containers.setdefault(container, len(self._containers))

    def _row(self, here: Element) -> _Pair | None:
        if here.tag not in {"td", "th"}:
            return None
        row = here.getparent()
        filled = [cell for cell in row if cell.tag in {"td", "th"} and self._text(cell)]
        if len(filled) == 2 and here is filled[1]:
            return _Pair("table", self._text(filled[0]), self._text(here), row.getparent())
        if len(filled) == 4 and here in {filled[1], filled[3]}:
            return _Pair("table", self._text(filled[filled.index(here) - 1]), self._text(here), row.getparent())
        return _Pair("table", "", "", row) if len(filled) > 2 else None

    def _definition(self, here: Element) -> _Pair | None:
        if here.tag != "dd":
            return None
        term = next(here.itersiblings("dt", preceding=True), None)
        whole = next(here.iterancestors("dl"), here.getparent())
        return None if term is None else _Pair("list", self._text(term), self._text(here), whole)

    def _pair(self, here: Element, parent: Element) -> _Pair | None:
        """A box whose one neighbour before it is a short label: `<div>Width</div><div>4 cm</div>`."""
        before = here.getprevious()
        while before is not None and not self._text(before):
            before = before.getprevious()
        if before is None or before.tag in SKIPPED | {"td", "tr", "img"} or len(parent) > 12:
            return None
        label = self._text(before)
        if len(label) > LABEL_LENGTH or HAS_DIGIT.search(label):
            return None
        tail = squeezed(before.tail or "")
        if len(tail) > LABEL_LENGTH or not names_a_size(plain(f"{label} {tail}").strip(" :")):
            return None
        value = self._text(here)
        if len(value) > VALUE_LENGTH:
            return None
        above = parent.getparent()
        return _Pair("row", f"{label} {tail}".strip(), value, parent if above is None else above)


def names_a_size(letters: str) -> bool:
    """Whether a plain label without digits names a size, an axis or a package."""
    if HAS_DIGIT.search(letters):
        return False
    words = re.findall(r"[^\W\d_]+", letters)
    return is_dimension_label(letters) or any(word in AXIS_WORDS for word in words) or is_package(letters)


def _split(label: str, value: str, section: str, place: Place, container: int) -> Iterator[Fact]:
    """The pair, or the pairs of a value that has labels of its own: `Width: 3 cm`, one a line."""
    if not value or len(value) > VALUE_LENGTH * 2:
        return
    label = label.strip(" :\u00a0")
    if not label and (own := _OWN_LABEL.match(value)):
        label, value = own[1].strip(), own[2]
    yield Fact(label, value, section, place if label else "prose", container)


_OWN_LABEL = re.compile(rf"([^\d:]{{2,{LABEL_LENGTH}}}?)\s*:\s*(?=\S*\d|[^:]*\d)(.+)")
