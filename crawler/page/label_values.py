"""Label and value pairs of a page: tables, definition lists, rows of boxes, lines with a colon.

The search starts at values: only text with a digit is examined, and from there the elements up to its label and its
heading. Other parts of the page cost nothing. Results for elements are cached, because texts of one table lead to the
same elements.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import islice
from typing import Literal

from lxml.etree import XPath

from crawler.page.page import Element, Page, squeeze
from crawler.text.sizes import consensus, names_unit, sizes
from crawler.text.vocabulary import is_dimension_label, is_of_others, is_package, is_whole, names_an_axis, plain

#: Maximum number of characters of a label; longer texts are prose.
MAX_LABEL = 70
#: Maximum number of characters of a value; longer texts are prose.
MAX_VALUE = 260
#: Number of ancestors that are searched for a heading.
MAX_HEADING_LEVELS = 9
#: Maximum number of texts of an element that are joined; an element with more is prose.
MAX_JOINED_TEXTS = 80
#: Regions that show other items than the product, or opinions about it.
_ELSEWHERE = re.compile(
    r"(compar|carousel|similar|recommend|related|sponsor|also$|bought|upsell|review|question|answer|rating|advert|ads?$"
    r"|breadcrumb|nav$|navbar|footer|cookie|customer|faqs?$|bundle|accessor|recently|suggest)"
)
#: Words of a class or id: `itemValue_XPfaq` contains item, value and a hash, and not the word `faq`.
_NAME_WORDS = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])")
#: Regions about the package; the headings of their pairs contain it, so that they are not taken for sizes of the item.
_PACKAGE_REGION = re.compile(r"packag(?!e-?details-?page)|shipping|delivery|verpackung|emballage", re.IGNORECASE)
SKIPPED = frozenset({"script", "style", "noscript", "template", "select", "option", "nav", "footer", "head"})
_HEADINGS = frozenset({"h1", "h2", "h3", "h4", "h5", "h6", "legend", "summary", "caption", "dt"})
_BOLD, _BOXES = frozenset({"b", "strong"}), frozenset({"ul", "ol", "dl", "table", "p", "div"})
_HEADING_CLASS = re.compile(r"title|heading|header|group-?name|section-?name|caption", re.IGNORECASE)
#: Place of a pair; an `entry` is a line of a list, or a line whose label is a separate element.
Place = Literal["table", "list", "row", "entry", "line", "json", "prose"]
#: Number of ancestors of a text that are searched for its label; deeper nesting is decoration.
MAX_LABEL_LEVELS = 5
#: Maximum number of child elements of a box of lines.
MAX_LINES = 120
#: Maximum number of characters of a line; a box with longer lines is prose.
MAX_LINE = 90
#: Maximum number of cells of a row of a table of sizes.
MAX_CELLS = 40
#: Maximum number of neighbouring boxes of which two are a label and its value.
MAX_BOXES = 12
#: Number of elements before a value that are searched for its label.
MAX_BEFORE = 8
#: Characters of a composed size, whose unit may be in its label or its heading.
_COMPOSED = re.compile(r"[x×X*:]")
#: Number of ancestors that are searched for the list of a line.
MAX_ENTRY_LEVELS = 3
_LABEL_TAGS = frozenset({"b", "strong", "span", "em"})
#: Maximum number of characters of a text; longer ones are articles.
MAX_TEXT = 2000
#: Texts that are not blank; a regular expression finds those with a digit faster than `translate` of XPath.
_TEXTS = XPath("/html/body//text()[normalize-space()]")
HAS_DIGIT = re.compile("[0-9¼½¾⅓-⅞]")
_INNER_LABEL = re.compile(r"(?<=[.;,!)•·|-])\s*([^\W\d_][^\d:.;,]{2,40}?)\s*:\s*(?=\S*\d|[^:]*:?[^:]*\d)(.+)")
_OWN_LABEL = re.compile(rf"([^\d:]{{2,{MAX_LABEL}}}?)\s*:\s*(?=\S*\d|[^:]*\d)(.+)")
#: A line with the letter of an axis: `H 84.5 cm`.
_LETTER_FIRST = re.compile(r"([HWDLBTØ])\.?\s*(\d[\d.,/ ]*\s?(?:[cm]?m|in|inches|[\"″]))\.?")
#: A label of a size before labels of its axes: `Medidas: Alto: 18 cm, Ancho: 61 cm`.
_SIZE_OF_AXES = re.compile(r"([^\d:]{2,40}?)\s*:\s*([^\d:]{1,20}:\s*\d.*)")
#: A line that begins with a word for a size, followed by the size.
_SIZE_FIRST = re.compile(r"([^\W\d_]+(?: [^\W\d_]{4,})?) ((?:[^\W\d_]{1,2} ?)?\d.*)")


class Regions:
    """Text, heading and kind of the elements of one page.

    The caches hold the elements, because lxml would otherwise discard their proxies and with them the keys.
    """

    def __init__(self, root: Element) -> None:
        # ancestors of the title contain the product, whatever their class is (WooCommerce: `shipping-taxable`)
        self._main = frozenset(box for title in islice(root.iter("h1"), 1) for box in title.iterancestors())
        self._texts: dict[Element, str] = {}
        self._elsewhere: dict[Element, bool] = {}
        self._titles: dict[Element, str] = {}
        self._titles_before: dict[Element, str] = {}

    def text(self, element: Element) -> str:
        """Return the visible text of an element, cut at the length of prose."""
        known = self._texts.get(element)
        if known is None:
            known = squeeze(" ".join(islice(element.itertext(), MAX_JOINED_TEXTS))[: 4 * MAX_VALUE])
            self._texts[element] = known
        return known

    def is_elsewhere(self, element: Element) -> bool:
        """Return True if an element is in a region of other products, opinions or navigation."""
        line = []
        here = element
        while here is not None and here not in self._elsewhere:
            line.append(here)
            here = here.getparent()
        found = self._elsewhere[here] if here is not None else False
        for step in reversed(line):
            found = found or (step not in self._main and _points_elsewhere(step))
            self._elsewhere[step] = found
        return found

    def heading(self, element: Element) -> str:
        """Return the nearest heading above an element: a heading tag, or a box before it with a class of titles."""
        heading = self._nearest_heading(element)
        here = element
        for _ in range(MAX_HEADING_LEVELS):
            if here not in self._main and _is_package_region(f"{here.get('id') or ''} {here.get('class') or ''}"):
                return f"{heading} (package)".strip()
            here = here.getparent()
            if here is None or here.tag in {"body", "main"}:
                break
        return heading

    def _nearest_heading(self, element: Element) -> str:
        here = element
        for _ in range(MAX_HEADING_LEVELS):
            if title := self._title_before(here):
                return title
            here = here.getparent()
            if here is None or here.tag == "body":
                break
        return ""

    def _title_before(self, element: Element) -> str:
        """Return the title of the nearest preceding element that is a title or contains one."""
        line = []
        title = ""
        here = element
        while here is not None and not title:
            if here in self._titles_before:
                title = self._titles_before[here]
                break
            line.append(here)
            here = here.getprevious()
            title = self._title(here) if here is not None else ""
        for step in line:
            self._titles_before[step] = title
        return title

    def _title(self, element: Element) -> str:
        known = self._titles.get(element)
        if known is None:
            known = self._titles[element] = self._own_title(element)
        return known

    def _own_title(self, element: Element) -> str:
        if element.tag in _HEADINGS or _is_heading_class(element.get("class") or ""):
            title = self.text(element)
        elif element.tag == "table":
            return ""
        elif _is_above(element):
            title = self.text(element)
        else:
            inner = next(element.iter("h2"), None)
            inner = inner if inner is not None else next(element.iter("h3"), None)
            title = self.text(inner) if inner is not None and len(self.text(element)) <= MAX_LABEL else ""
        return title if len(title) <= MAX_LABEL else ""


def _is_above(element: Element) -> bool:
    """Return True if bold text is a heading: the only text of its line, directly above a box or a list."""
    if element.tag not in _BOLD or (element.tail or "").strip():
        return False
    below = element.getnext()
    return below is not None and below.tag in _BOXES


def _points_elsewhere(element: Element) -> bool:
    if element.tag in SKIPPED:
        return True
    if element.tag in {"body", "html", "main"}:
        return False
    return _names_elsewhere(f"{element.get('id') or ''} {element.get('class') or ''}")


# cached, because a site uses the same few hundred class names on all pages
@lru_cache(maxsize=4096)
def _names_elsewhere(names: str) -> bool:
    return any(_ELSEWHERE.match(word.lower()) for word in _NAME_WORDS.findall(names))


@lru_cache(maxsize=4096)
def _is_package_region(names: str) -> bool:
    return bool(_PACKAGE_REGION.search(names))


@lru_cache(maxsize=4096)
def _is_heading_class(names: str) -> bool:
    return bool(_HEADING_CLASS.search(names))


@dataclass(frozen=True, slots=True)
class LabelValue:
    """A label and its value."""

    label: str
    value: str
    section: str  #: Heading above the pair.
    place: Place
    container: int  #: Number of the table or list of the pair.


def label_values(page: Page) -> Iterator[LabelValue]:
    """Return the pairs whose value has a number, in the order of the page, without those of other products."""
    reader = _PairReader(page.root)
    seen: set[tuple[str, str, str]] = set()
    for text in _TEXTS(page.root):
        if not HAS_DIGIT.search(text) or len(text) >= MAX_TEXT:
            continue
        element = text.getparent() if text.is_text else text.getparent().getparent()
        if element is None or reader.regions.is_elsewhere(element):
            continue
        for pair in reader.pairs_of(element, squeeze(text)):
            key = (pair.label, pair.value, pair.section)
            if key not in seen and not is_of_others(plain(pair.section)):
                seen.add(key)
                yield pair


@dataclass(frozen=True, slots=True)
class _Pair:
    place: Place
    label: str
    value: str
    container: Element


class _PairReader:
    """Reader of the pairs of one page, with a cache per element."""

    def __init__(self, root: Element) -> None:
        self.regions = Regions(root)
        self._text = self.regions.text
        self._pairs: dict[Element, _Pair | None] = {}
        self._containers: dict[Element, int] = {}
        self._lines_of: dict[Element, list[tuple[str, str]]] = {}
        self._cells_of: dict[Element, list[Element]] = {}
        self._first_rows_of: dict[Element, list[list[Element]]] = {}

    def pairs_of(self, element: Element, text: str) -> Iterator[LabelValue]:
        here = element
        for _ in range(MAX_LABEL_LEVELS):
            parent = here.getparent()
            if parent is None or here.tag in {"body", "main"}:
                break
            if here not in self._pairs:
                self._pairs[here] = self._row(here) or self._definition(here) or self._pair(here, parent)
            pair = self._pairs[here]
            if pair is not None:
                if pair.place == "table" and not pair.label:
                    return  # a table of several products, or of sizes to choose from
                heading = self.regions.heading(pair.container)
                if line := self._labelled_line(element, text):
                    yield from _split("", line, pair.label or heading, "line", self._number(element))
                    return
                yield from _split(pair.label, pair.value, heading, pair.place, self._number(pair.container))
                return
            here = parent
        whole = self._text(element) if len(text) < MAX_VALUE else text
        value = whole if len(whole) <= MAX_VALUE else text
        entry = self._entry(element, value)
        box = element.getparent() if entry is None else entry
        heading = ""
        if lines := self._lines(element):
            value, heading = next(((line, head) for line, head in lines if text in line), (value, ""))
            entry = box = element
        if not names_unit(value) and not _COMPOSED.search(value):
            return  # a price, a count, a date
        place: Place = "line" if entry is None else "entry"
        yield from _split("", value, heading or self.regions.heading(element), place, self._number(box))

    def _lines(self, element: Element) -> list[tuple[str, str]]:
        """Return the lines of a box with line breaks, each with its heading line: `Overall:`, then `Width: 3 cm`."""
        if element not in self._lines_of:
            lines = list(_parts(element)) if element.find("br") is not None else []
            listed = all(len(line) <= MAX_LINE for line, _ in lines)  # otherwise it is prose
            self._lines_of[element] = lines if listed else []
        return self._lines_of[element]

    def _labelled_line(self, element: Element, text: str) -> str | None:
        """Return the line with a label in a box with line breaks: `Height: 7.2 in<br>Width: 1.4 in`."""
        for line, _ in self._lines(element):
            if text in line and (own := _OWN_LABEL.match(line)) and names_a_size(plain(own[1])):
                return line
        return None

    def _entry(self, element: Element, value: str) -> Element | None:
        """Return the list of a line, or the parent of a line that begins with `<b>Label</b>`; None for other lines."""
        here = element
        for _ in range(MAX_ENTRY_LEVELS):
            if here is None or self._text(here) != value:
                break
            if here.tag == "li":
                return here.getparent()
            here = here.getparent()
        first = next(iter(element), None)
        begins = first is not None and first.tag in _LABEL_TAGS and not (element.text or "").strip()
        return element.getparent() if begins and value.startswith(self._text(first)) else None

    def _number(self, container: Element) -> int:
        return self._containers.setdefault(container, len(self._containers))

    def _row(self, here: Element) -> _Pair | None:
        if here.tag not in {"td", "th"}:
            return None
        row = here.getparent()
        filled = self._cells(row)
        if len(filled) > MAX_CELLS:
            return _Pair("table", "", "", row)
        if len(filled) > 2 and filled[0].get("rowspan", "1") != "1":
            filled = filled[1:]  # the name of the group whose first row this is
        if len(filled) == 2 and here is filled[1]:
            return _Pair("table", self._text(filled[0]), self._text(here), row.getparent())
        if len(filled) == 4 and here in {filled[1], filled[3]} and not HAS_DIGIT.search(self._text(filled[2])):
            return _Pair("table", self._text(filled[filled.index(here) - 1]), self._text(here), row.getparent())
        return self._grid(row, filled, filled.index(here)) if len(filled) > 2 and here in filled else None

    def _cells(self, row: Element) -> list[Element]:
        """Return the cells of a row that have text, at most one more than `MAX_CELLS`."""
        if row not in self._cells_of:
            filled = (cell for cell in row if cell.tag in {"td", "th"} and self._text(cell))
            self._cells_of[row] = list(islice(filled, MAX_CELLS + 1))
        return self._cells_of[row]

    def _first_rows(self, table: Element) -> list[list[Element]]:
        """Return the cells with text of the first three rows of a table that have any."""
        if table not in self._first_rows_of:
            self._first_rows_of[table] = list(islice(filter(None, map(self._cells, table.iter("tr"))), 3))
        return self._first_rows_of[table]

    def _grid(self, row: Element, filled: list[Element], column: int) -> _Pair:
        """Return the pair of a cell in a table of several columns.

        The columns are systems of units, or axes in a row above. Any other table lists several products or sizes to
        choose from: the pair has no label.
        """
        texts = [self._text(cell) for cell in filled]
        if column and names_a_size(plain(texts[0])) and _is_one_length(texts[1:], texts[0]):
            return _Pair("table", texts[0], " / ".join(texts[1:]), row.getparent())
        table = next(row.iterancestors("table"), row)
        first, *others = self._first_rows(table) or [[]]
        labels = [self._text(cell) for cell in first]
        if sum(names_a_size(plain(label)) for label in labels) > 1:
            alone = len(others) == 1 and row is others[0][0].getparent()
            if alone and len(labels) == len(texts):
                return _Pair("table", labels[column], texts[column], table)
            # rows with names: of a single item, or of the whole and its parts
            if column and len(labels) == len(texts) - 1 and (alone or is_whole(plain(texts[0]))):
                return _Pair("table", labels[column - 1], texts[column], table)
        return _Pair("table", "", "", row)

    def _definition(self, here: Element) -> _Pair | None:
        if here.tag != "dd":
            return None
        before = islice(here.itersiblings(preceding=True), MAX_BEFORE)
        term = next((element for element in before if element.tag == "dt"), None)
        whole = next(here.iterancestors("dl"), here.getparent())
        return None if term is None else _Pair("list", self._text(term), self._text(here), whole)

    def _pair(self, here: Element, parent: Element) -> _Pair | None:
        """Return the pair of a box after a short label: `<div>Width</div><div>4 cm</div>`."""
        if _is_longer(here.iter("li"), 1) or _is_longer(parent, MAX_BOXES):
            return None  # a list, whose entries have their own labels, or a long row of boxes
        before = next(filter(self._text, here.itersiblings(preceding=True)), None)
        if before is None or before.tag in SKIPPED | {"td", "tr", "img"}:
            return None
        label = self._text(before)
        if len(label) > MAX_LABEL or HAS_DIGIT.search(label):
            return None
        tail = squeeze(before.tail or "")
        if len(tail) > MAX_LABEL or not names_a_size(plain(f"{label} {tail}").strip(" :")):
            return None
        value = self._text(here)
        if len(value) > MAX_VALUE:
            return None
        above = parent.getparent()
        return _Pair("row", f"{label} {tail}".strip(), value, parent if above is None else above)


def _parts(element: Element) -> Iterator[tuple[str, str]]:
    lines = [[element.text or ""]]
    for child in islice(element, MAX_LINES):
        if child.tag == "br":
            lines.append([])
        else:
            lines[-1].extend(child.itertext())
        lines[-1].append(child.tail or "")
    head = ""
    for line in (squeeze(" ".join(parts)) for parts in lines):
        if line.endswith(":") and not HAS_DIGIT.search(line):
            head = line
        yield line, head


@lru_cache(maxsize=4096)
def names_a_size(letters: str) -> bool:
    """Return True if a plain label without digits names a size, an axis or a package."""
    if HAS_DIGIT.search(letters):
        return False
    return is_dimension_label(letters) or names_an_axis(letters) or is_package(letters)


def _is_longer(elements: Iterable[Element], maximum: int) -> bool:
    """Return True if there are more than `maximum` elements; `len` of lxml would count all of them."""
    return sum(1 for _ in islice(elements, maximum + 1)) > maximum


def _is_one_length(texts: list[str], label: str) -> bool:
    """Return True if cells state one length in several systems of units."""
    read = [sizes(text, label) for text in texts]
    if not all(len(stated) == 1 and len(stated[0].lengths) == 1 for stated in read):
        return False
    size = consensus([stated[0] for stated in read])
    units = {stated[0].lengths[0].unit for stated in read}
    return len(units) > 1 and size is not None and "contradicts_itself" not in size.flags


def _split(label: str, value: str, section: str, place: Place, container: int) -> Iterator[LabelValue]:
    """Return the pair, or that within a value with its own label: `Width: 3 cm`, `Size H75, W120 cm`."""
    if not value or len(value) > MAX_VALUE * 2:
        return
    label = label.strip(" :\u00a0")
    if place == "row" and (own := _OWN_LABEL.match(value)) and is_dimension_label(plain(own[1])):
        section, label, value = label, own[1].strip(), own[2]  # the outer label is the heading
    own = None if label else _OWN_LABEL.match(value) or _LETTER_FIRST.fullmatch(value) or _size_first(value)
    if own:
        label, value = own[1].strip(), own[2]
    if label and not names_a_size(plain(label)) and (inner := _inner_label(value)):
        label, value, place = inner[1].strip(), inner[2], "prose"
    named = label or (place == "entry" and is_dimension_label(plain(section)))
    yield LabelValue(label, value, section, place if named else "prose", container)


def _size_first(value: str) -> re.Match[str] | None:
    own = _SIZE_FIRST.match(value) or _SIZE_OF_AXES.match(value)
    return own if own and is_dimension_label(plain(own[1])) else None


def _inner_label(value: str) -> re.Match[str] | None:
    """Find a label of a size within a text: `Material: MDF. Medidas: alto: 83 cm, ancho: 120 cm`."""
    return next((match for match in _INNER_LABEL.finditer(value) if is_dimension_label(plain(match[1]))), None)
