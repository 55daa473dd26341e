"""Label and value pairs of a page: tables, definition lists, rows of boxes, lines with a colon.

The search starts at the values: for each text with a digit, the elements around it are searched for a label and a
heading. The rest of the page costs no time. Results for elements are cached, because the texts of a table lead to the
same elements.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import islice
from typing import Literal

from lxml.etree import XPath

from crawler.page.page import Element, Page, squeeze
from crawler.text.sizes import consensus, names_unit, sizes
from crawler.text.vocabulary import is_dimension_label, is_package, is_whole, names_an_axis, plain

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
_BOLD = frozenset({"b", "strong"})
#: Elements below a line of bold text that make it a heading.
_BOXES = frozenset({"ul", "ol", "dl", "table", "p", "div"})
#: Elements that contain the whole page.
_PAGE_TAGS = frozenset({"body", "html", "main"})
#: Elements before a value that are not its label.
_NO_LABEL_TAGS = SKIPPED | {"td", "tr", "img"}
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
#: Maximum number of characters of a text; longer ones are articles, which have no values but take time (1 s for 3 MB).
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


@dataclass(frozen=True, slots=True)
class LabelValue:
    """A label and its value."""

    label: str
    value: str
    section: str  #: Heading above the pair.
    place: Place
    container: int  #: Number of the table or list of the pair.


#: A cell of a table of several products, or of sizes to choose from.
_UNLABELLED_CELL = LabelValue("", "", "", "table", -1)


def label_values(page: Page) -> Iterator[LabelValue]:
    """Return the pairs whose value has a number, in the order of the page, outside of regions of other products."""
    reader = _PairReader(page.root)
    seen: set[tuple[str, str, str]] = set()
    for text in _TEXTS(page.root):
        if not HAS_DIGIT.search(text) or len(text) >= MAX_TEXT:
            continue
        element = text.getparent() if text.is_text else text.getparent().getparent()
        if element is None or reader.regions.is_elsewhere(element):
            continue
        pair = reader.pair_of_text(element, squeeze(text))
        if pair is not None and (key := (pair.label, pair.value, pair.section)) not in seen:
            seen.add(key)
            yield pair


@lru_cache(maxsize=4096)
def names_a_size(letters: str) -> bool:
    """Return True if a plain label without digits names a size, an axis or a package."""
    if HAS_DIGIT.search(letters):
        return False
    return is_dimension_label(letters) or names_an_axis(letters) or is_package(letters)


class PageRegions:
    """Text, heading and kind of the elements of one page.

    The caches hold the elements, because lxml would otherwise discard their proxies and with them the keys.
    """

    def __init__(self, root: Element) -> None:
        # ancestors of the title contain the product, whatever their class is (WooCommerce: `shipping-taxable`)
        self._main = frozenset(box for title in islice(root.iter("h1"), 1) for box in title.iterancestors())
        self._texts: dict[Element, str] = {}
        self._elsewhere: dict[Element, bool] = {}
        self._titles_before: dict[Element, str] = {}

    def text(self, element: Element) -> str:
        """Return the visible text of an element, cut at the length of prose."""
        text = self._texts.get(element)
        if text is None:
            text = squeeze(" ".join(islice(element.itertext(), MAX_JOINED_TEXTS))[: 4 * MAX_VALUE])
            self._texts[element] = text
        return text

    def is_elsewhere(self, element: Element) -> bool:
        """Return True if an element is in a region of other products, opinions or navigation."""
        path = []
        current = element
        while current is not None and current not in self._elsewhere:
            path.append(current)
            current = current.getparent()
        is_elsewhere = self._elsewhere[current] if current is not None else False
        for step in reversed(path):
            if not is_elsewhere and step not in self._main:
                names = f"{step.get('id') or ''} {step.get('class') or ''}"
                is_elsewhere = step.tag in SKIPPED or (step.tag not in _PAGE_TAGS and _names_elsewhere(names))
            self._elsewhere[step] = is_elsewhere
        return is_elsewhere

    def heading(self, element: Element) -> str:
        """Return the nearest title before an element or one of its ancestors, with a note in regions of packages."""
        heading = ""
        current = element
        for _ in range(MAX_HEADING_LEVELS):
            heading = self._title_before(current)
            current = current.getparent()
            if heading or current is None or current.tag == "body":
                break
        current = element
        for _ in range(MAX_HEADING_LEVELS):
            names = f"{current.get('id') or ''} {current.get('class') or ''}"
            if current not in self._main and _contains(_PACKAGE_REGION, names):
                return f"{heading} (package)".strip()
            current = current.getparent()
            if current is None or current.tag in {"body", "main"}:
                break
        return heading

    def _title_before(self, element: Element) -> str:
        """Return the title of the nearest preceding element that is a title or contains one."""
        path = []
        title = ""
        current = element
        while current is not None and not title:
            if current in self._titles_before:
                title = self._titles_before[current]
                break
            path.append(current)
            current = current.getprevious()
            title = self._title(current) if current is not None else ""
        for step in path:
            self._titles_before[step] = title
        return title

    def _title(self, element: Element) -> str:
        """Return the text of a title, of bold text above a box or a list, or of the title in a short element."""
        below = element.getnext()
        is_above_box = below is not None and below.tag in _BOXES and not (element.tail or "").strip()
        title = ""
        is_heading = element.tag in _HEADINGS or _contains(_HEADING_CLASS, element.get("class") or "")
        if is_heading or (element.tag in _BOLD and is_above_box):
            title = self.text(element)
        elif element.tag != "table":
            inner = next(element.iter("h2"), None)
            inner = inner if inner is not None else next(element.iter("h3"), None)
            title = self.text(inner) if inner is not None and len(self.text(element)) <= MAX_LABEL else ""
        return title if len(title) <= MAX_LABEL else ""


# the tests of names are cached, because a site uses the same few hundred class names on all pages
@lru_cache(maxsize=4096)
def _names_elsewhere(names: str) -> bool:
    return any(_ELSEWHERE.match(word.lower()) for word in _NAME_WORDS.findall(names))


@lru_cache(maxsize=8192)
def _contains(pattern: re.Pattern[str], names: str) -> bool:
    return bool(pattern.search(names))


class _PairReader:
    """Reader of the pairs of one page, with a cache per element."""

    def __init__(self, root: Element) -> None:
        self.regions = PageRegions(root)
        self._text = self.regions.text
        self._pairs: dict[Element, LabelValue | None] = {}
        self._containers: dict[Element, int] = {}
        self._lines_of: dict[Element, list[tuple[str, str]]] = {}
        self._cells_of: dict[Element, list[Element]] = {}
        self._first_rows_of: dict[Element, list[list[Element]]] = {}

    def pair_of_text(self, element: Element, text: str) -> LabelValue | None:
        """Return the pair whose value contains a text of an element, or the text without a label."""
        current = element
        for _ in range(MAX_LABEL_LEVELS):
            parent = current.getparent()
            if parent is None or current.tag in {"body", "main"}:
                break
            if current not in self._pairs:
                self._pairs[current] = self._pair_of_element(current, parent)
            pair = self._pairs[current]
            if pair is not None:
                for line, _ in self._lines(element) if pair.label or pair.place != "table" else ():
                    # a line with its own label in a box of lines: `Height: 7.2 in<br>Width: 1.4 in`
                    if text in line and (own := _OWN_LABEL.match(line)) and names_a_size(plain(own[1])):
                        return _split(LabelValue("", line, pair.label or pair.section, "line", self._number(element)))
                return _split(pair)
            current = parent
        return self._line_of_text(element, text)

    def _line_of_text(self, element: Element, text: str) -> LabelValue | None:
        """Return the line of a text, with its label if it has one; None for prices, counts and dates."""
        full_text = self._text(element) if len(text) < MAX_VALUE else text
        value = full_text if len(full_text) <= MAX_VALUE else text
        # 1. A line of a list is an entry of the list, a line that begins with `<b>Label</b>` one of its parent.
        entries = None
        current: Element | None = element
        for _ in range(MAX_ENTRY_LEVELS):
            if current is None or self._text(current) != value:
                break
            if current.tag == "li":
                entries = current.getparent()
                break
            current = current.getparent()
        first = next(iter(element), None)
        is_label = first is not None and first.tag in _LABEL_TAGS and not (element.text or "").strip()
        if entries is None and is_label and value.startswith(self._text(first)):
            entries = element.getparent()
        container = element.getparent() if entries is None else entries
        # 2. In a box of lines, each line is an entry of the box.
        heading = ""
        if lines := self._lines(element):
            value, heading = next(((line, head) for line, head in lines if text in line), (value, ""))
            entries = container = element
        if not names_unit(value) and not _COMPOSED.search(value):
            return None
        section = heading or self.regions.heading(element)
        return _split(LabelValue("", value, section, "line" if entries is None else "entry", self._number(container)))

    def _lines(self, element: Element) -> list[tuple[str, str]]:
        """Return the lines of a box with line breaks, each with its heading line: `Overall:`, then `Width: 3 cm`."""
        if element not in self._lines_of:
            lines: list[tuple[str, str]] = []
            if element.find("br") is not None:
                parts = [[element.text or ""]]
                for child in islice(element, MAX_LINES):
                    if child.tag == "br":
                        parts.append([])
                    else:
                        parts[-1].extend(child.itertext())
                    parts[-1].append(child.tail or "")
                heading = ""
                for line in (squeeze(" ".join(texts)) for texts in parts):
                    heading = line if line.endswith(":") and not HAS_DIGIT.search(line) else heading
                    lines.append((line, heading))
            is_list = all(len(line) <= MAX_LINE for line, _ in lines)  # otherwise it is prose
            self._lines_of[element] = lines if is_list else []
        return self._lines_of[element]

    def _number(self, container: Element) -> int:
        return self._containers.setdefault(container, len(self._containers))

    def _pair_of_element(self, element: Element, parent: Element) -> LabelValue | None:
        """Return the pair whose value is an element: a cell, a definition, or a box after its label."""
        if element.tag in {"td", "th"} and (pair := self._pair_of_cell(element)) is not None:
            return pair
        if element.tag == "dd":
            before = islice(element.itersiblings(preceding=True), MAX_BEFORE)
            term = next((sibling for sibling in before if sibling.tag == "dt"), None)
            if term is not None:
                whole = next(element.iterancestors("dl"), parent)
                return self._pair(self._text(term), self._text(element), "list", whole)
        # `<div>Width</div><div>4 cm</div>`
        if _is_longer(element.iter("li"), 1) or _is_longer(parent, MAX_BOXES):
            return None  # a list, whose entries have their own labels, or a long row of boxes
        label_box = next(filter(self._text, element.itersiblings(preceding=True)), None)
        if label_box is None or label_box.tag in _NO_LABEL_TAGS:
            return None
        label, tail = self._text(label_box), squeeze(label_box.tail or "")
        is_short = max(len(label), len(tail)) <= MAX_LABEL and not HAS_DIGIT.search(label)
        is_label = is_short and names_a_size(plain(f"{label} {tail}").strip(" :"))
        if not is_label or len(self._text(element)) > MAX_VALUE:
            return None
        above = parent.getparent()
        return self._pair(f"{label} {tail}".strip(), self._text(element), "row", parent if above is None else above)

    def _pair(self, label: str, value: str, place: Place, container: Element) -> LabelValue:
        return LabelValue(label, value, self.regions.heading(container), place, self._number(container))

    def _pair_of_cell(self, cell: Element) -> LabelValue | None:
        """Return the pair of a table cell; None if the cell has no label."""
        row = cell.getparent()
        cells = self._cells(row)
        if len(cells) > MAX_CELLS:
            return _UNLABELLED_CELL
        if len(cells) > 2 and cells[0].get("rowspan", "1") != "1":
            cells = cells[1:]  # the first one is the name of a group of rows
        if cell not in cells or len(cells) < 2 or (len(cells) == 2 and cell is cells[0]):
            return None
        column = cells.index(cell)
        texts = [self._text(cell) for cell in cells]
        if len(cells) == 2 or (len(cells) == 4 and column % 2 and not HAS_DIGIT.search(texts[2])):
            return self._pair(texts[column - 1], texts[column], "table", row.getparent())
        # 1. The columns are systems of units.
        if column and names_a_size(plain(texts[0])) and _is_one_length(texts[1:], texts[0]):
            return self._pair(texts[0], " / ".join(texts[1:]), "table", row.getparent())
        # 2. The columns are axes, named in the first row, of one item or of an item and its parts.
        table = next(row.iterancestors("table"), row)
        if table not in self._first_rows_of:
            self._first_rows_of[table] = list(islice(filter(None, map(self._cells, table.iter("tr"))), 3))
        header, *others = self._first_rows_of[table] or [[]]
        labels = [self._text(cell) for cell in header]
        if sum(names_a_size(plain(label)) for label in labels) > 1:
            is_only_row = len(others) == 1 and row is others[0][0].getparent()
            n_names = len(texts) - len(labels)
            is_named = n_names == 1 and column and (is_only_row or is_whole(plain(texts[0])))
            if (n_names == 0 and is_only_row) or is_named:
                return self._pair(labels[column - n_names], texts[column], "table", table)
        return _UNLABELLED_CELL

    def _cells(self, row: Element) -> list[Element]:
        """Return the cells of a row that have text, at most one more than `MAX_CELLS`."""
        if row not in self._cells_of:
            filled = (cell for cell in row if cell.tag in {"td", "th"} and self._text(cell))
            self._cells_of[row] = list(islice(filled, MAX_CELLS + 1))
        return self._cells_of[row]


def _is_longer(elements: Iterable[Element], maximum: int) -> bool:
    """Return True if there are more than `maximum` elements; `len` of lxml would count all of them."""
    return sum(1 for _ in islice(elements, maximum + 1)) > maximum


def _is_one_length(texts: Sequence[str], label: str) -> bool:
    """Return True if cells state one length in several systems of units."""
    read = [sizes(text, label) for text in texts]
    if not all(len(stated) == 1 and len(stated[0].lengths) == 1 for stated in read):
        return False
    size = consensus([stated[0] for stated in read])
    return len({stated[0].lengths[0].unit for stated in read}) > 1 and "contradicts_itself" not in size.flags


def _split(pair: LabelValue) -> LabelValue | None:
    """Return a pair, or the pair in its value (`Width: 3 cm`, `Size H75, W120 cm`); None for no or too long values."""
    label, value, section, place = pair.label.strip(" :\u00a0"), pair.value, pair.section, pair.place
    if not value or len(value) > MAX_VALUE * 2:
        return None
    if place == "row" and (own := _OWN_LABEL.match(value)) and is_dimension_label(plain(own[1])):
        section, label, value = label, own[1].strip(), own[2]  # the outer label is the heading
    own = None if label else _OWN_LABEL.match(value) or _LETTER_FIRST.fullmatch(value)
    if not label and own is None:
        size = _SIZE_FIRST.match(value) or _SIZE_OF_AXES.match(value)
        own = size if size and is_dimension_label(plain(size[1])) else None
    if own:
        label, value = own[1].strip(), own[2]
    if label and not names_a_size(plain(label)):
        # the label of a size within the text: `Material: MDF. Medidas: alto: 83 cm, ancho: 120 cm`
        inner = next((match for match in _INNER_LABEL.finditer(value) if is_dimension_label(plain(match[1]))), None)
        if inner:
            label, value, place = inner[1].strip(), inner[2], "prose"
    is_named = label or (place == "entry" and is_dimension_label(plain(section)))
    return LabelValue(label, value, section, place if is_named else "prose", pair.container)
