"""Label and value pairs of a page: tables, definition lists, rows of boxes, lines with a colon, embedded JSON.

The search runs from the value: only text with a digit is looked at, and from there up to its label and its heading.
That is the part of a page that could hold a size; the rest costs nothing.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from lxml.etree import XPath
from lxml.html import HtmlElement

from crawler.pages import Page, squeezed
from crawler.words import AXIS_WORDS, is_component, is_dimension_label, is_package, plain

__all__ = ["Fact", "embedded_facts", "facts"]

Place = Literal["table", "list", "row", "line", "json", "prose"]

#: A label, and a value, are no longer than this; longer texts are prose.
LABEL_LENGTH, VALUE_LENGTH = 70, 260

#: So far up from its text a value's label is looked for; deeper nesting is decoration.
CLIMB = 5

#: So far up a heading is looked for.
HEADING_CLIMB = 9

#: Text with a digit, found in C: of tens of thousands of texts some hundreds are left for Python.
_NUMBERED_TEXT = XPath(
    "/html/body/descendant::text()[not(parent::script or parent::style or parent::noscript)]"
    "[string-length() < 2000][translate(., '0123456789½⅓⅔¼¾⅛⅜⅝⅞', '') != .]"
)

#: The first texts of an element that a person sees; a longer element is prose anyway.
_VISIBLE_TEXTS = XPath(
    "(descendant::text()[not(parent::script or parent::style or parent::noscript or parent::select or parent::option"
    " or parent::template)])[position() <= 80]",
    smart_strings=False,
)

_HAS_DIGIT = re.compile(r"\d|[½⅓⅔¼¾⅛⅜⅝⅞]")

#: Regions that show other things than the product, or opinions about it.
_ELSEWHERE = re.compile(
    r"(compar|carousel|similar|recommend|related|sponsor|also$|bought|upsell|review|question|answer|rating|advert|ads?$"
    r"|breadcrumb|nav$|navbar|footer|cookie|customer|faqs?$|bundle|accessor|recently|suggest)"
)

#: The words of a class or id: `itemValue_XPfaq` holds item, value and a hash, no frequent questions.
_NAME_WORDS = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])")

#: Regions about the package; their facts carry it in their heading, so that no later step takes them for the thing.
_PACKAGE_REGION = re.compile(r"packag(?!e-?details-?page)|shipping|delivery|verpackung|emballage", re.IGNORECASE)

_SKIPPED = frozenset({"script", "style", "noscript", "template", "select", "option", "nav", "footer", "head"})
_HEADINGS = frozenset({"h1", "h2", "h3", "h4", "h5", "h6", "legend", "summary", "caption", "dt"})
_HEADING_CLASS = re.compile(r"title|heading|header|group-?name|section-?name|caption", re.IGNORECASE)


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
    seen: set[tuple[str, str, str]] = set()
    elsewhere: dict[HtmlElement, bool] = {}
    containers: dict[HtmlElement, int] = {}  # held, so that lxml's proxies and with them the numbers stay
    for text in _NUMBERED_TEXT(page.root):
        element = text.getparent() if text.is_text else text.getparent().getparent()
        if element is None or not isinstance(element.tag, str) or _is_elsewhere(element, elsewhere):
            continue
        for fact in _facts_of(element, squeezed(text), containers):
            key = (fact.label, fact.value, fact.section)
            if key not in seen:
                seen.add(key)
                yield fact


def _facts_of(element: HtmlElement, text: str, containers: dict[HtmlElement, int]) -> Iterator[Fact]:
    here = element
    for _ in range(CLIMB):
        parent = here.getparent()
        if parent is None or here.tag in {"body", "main"}:
            break
        found = _row(here) or _definition(here) or _pair(here, parent)
        if found is not None:
            place, label, value, container = found
            if place == "table" and not label:
                return  # a table of several products, or of sizes to choose from
            number = containers.setdefault(container, len(containers))
            yield from _split(label, value, _heading(container), place, number)
            return
        here = parent
    whole = _text(element) if len(text) < VALUE_LENGTH else text
    value = whole if len(whole) <= VALUE_LENGTH else text
    number = containers.setdefault(element.getparent(), len(containers))
    yield from _split("", value, _heading(element), "line", number)


def _row(here: HtmlElement) -> tuple[Place, str, str, HtmlElement] | None:
    if here.tag not in {"td", "th"}:
        return None
    row = here.getparent()
    cells = [cell for cell in row if cell.tag in {"td", "th"}]
    filled = [cell for cell in cells if _text(cell)]
    if len(filled) == 2 and here is filled[1]:
        return "table", _text(filled[0]), _text(here), row.getparent()
    if len(filled) == 4 and filled.index(here) in {1, 3} if here in filled else False:
        return "table", _text(filled[filled.index(here) - 1]), _text(here), row.getparent()
    return ("table", "", "", row) if len(filled) > 2 else None


def _definition(here: HtmlElement) -> tuple[Place, str, str, HtmlElement] | None:
    if here.tag != "dd":
        return None
    term = next((before for before in here.itersiblings(preceding=True) if before.tag == "dt"), None)
    whole = next(here.iterancestors("dl"), here.getparent())
    return None if term is None else ("list", _text(term), _text(here), whole)


def _pair(here: HtmlElement, parent: HtmlElement) -> tuple[Place, str, str, HtmlElement] | None:
    """A box whose one neighbour before it is a short label: `<div>Width</div><div>4 cm</div>`."""
    before = here.getprevious()
    while before is not None and (not isinstance(before.tag, str) or not _text(before)):
        before = before.getprevious()
    if before is None or before.tag in _SKIPPED | {"td", "tr", "img"} or len(parent) > 12:
        return None
    label, value = _text(before), _text(here)
    tail = squeezed(before.tail or "")
    if not label or len(label) > LABEL_LENGTH or len(value) > VALUE_LENGTH or len(tail) > LABEL_LENGTH:
        return None
    letters = plain(f"{label} {tail}").strip(" :")
    if not _names_a_size(letters):
        return None
    return "row", f"{label} {tail}".strip(), value, parent.getparent() if parent.getparent() is not None else parent


def _names_a_size(letters: str) -> bool:
    if _HAS_DIGIT.search(letters):
        return False
    words = re.findall(r"[^\W\d_]+", letters)
    return is_dimension_label(letters) or any(word in AXIS_WORDS for word in words) or is_package(letters)


def _split(label: str, value: str, section: str, place: Place, container: int) -> Iterator[Fact]:
    """The pair, or the pairs of a value that has labels of its own: `Width: 3 cm`, one a line."""
    if not value or len(value) > VALUE_LENGTH * 2:
        return
    label = label.strip(" :\u00a0")
    own = re.match(rf"([^\d:]{{2,{LABEL_LENGTH}}}?)\s*:\s*(?=\S*\d|[^:]*\d)(.+)", value)
    if own and not label:
        label, value = own[1].strip(), own[2]
    yield Fact(label, value, section, place if label else "prose", container)


def _heading(element: HtmlElement) -> str:
    """The nearest heading above an element: a heading tag, or a box before it that calls itself a title."""
    heading = _nearest_heading(element)
    here = element
    for _ in range(HEADING_CLIMB):
        if _PACKAGE_REGION.search(f"{here.get('id') or ''} {here.get('class') or ''}"):
            return f"{heading} (package)".strip()
        here = here.getparent()
        if here is None or here.tag in {"body", "main"}:
            break
    return heading


def _nearest_heading(element: HtmlElement) -> str:
    here = element
    for _ in range(HEADING_CLIMB):
        for before in here.itersiblings(preceding=True):
            if not isinstance(before.tag, str):
                continue
            if before.tag in _HEADINGS or _HEADING_CLASS.search(before.get("class") or ""):
                title = _text(before)
            else:
                inner = before.find(".//h2") if before.tag != "table" else None
                inner = inner if inner is not None else before.find(".//h3")
                title = _text(inner) if inner is not None and len(_text(before)) <= LABEL_LENGTH else ""
            if title and len(title) <= LABEL_LENGTH:
                return title
        here = here.getparent()
        if here is None or here.tag == "body":
            return ""
    return ""


def _is_elsewhere(element: HtmlElement, known: dict[HtmlElement, bool]) -> bool:
    line = []
    here = element
    while here is not None and here not in known:
        line.append(here)
        here = here.getparent()
    answer = known[here] if here is not None else False
    for step in reversed(line):
        answer = answer or _points_elsewhere(step)
        known[step] = answer
    return answer


def _points_elsewhere(element: HtmlElement) -> bool:
    if element.tag in _SKIPPED:
        return True
    if element.tag in {"body", "html", "main"}:
        return False
    names = f"{element.get('id') or ''} {element.get('class') or ''}"
    return len(names) > 1 and any(_ELSEWHERE.match(word.lower()) for word in _NAME_WORDS.findall(names))


def _text(element: HtmlElement) -> str:
    """The visible text of an element, cut where it becomes prose."""
    return squeezed(" ".join(_VISIBLE_TEXTS(element))[: 4 * VALUE_LENGTH])


#: Pairs in scripts: `"name":"Width","value":"30 cm"`, with plain or escaped quotes, names as sites use them.
_JSON_PAIR = re.compile(
    r'\\*"(?:name|label|displayName|title|key|attributeName|specName|header)\\*"\s*:\s*\\*"(?P<label>[^"\\]{2,60})\\*"'
    r'(?:\s*,\s*\\*"\w+\\*"\s*:\s*(?:null|true|false|\d+|\\*"[^"\\]{0,40}\\*")){0,3}'
    r'\s*,\s*\\*"(?:value|displayValue|text|values|attributeValue|specValue|description|content)\\*"\s*:\s*\[?\s*'
    r'(?:\\*"(?P<value>(?:[^"\\]|\\\\?\\?"(?!\s*[,\]}])|\\u[0-9a-f]{4}|\\\\u[0-9a-f]{4}){1,160}?)\\*"(?=\s*[,\]}])|(?P<number>\d+(?:\.\d+)?))',
    re.IGNORECASE,
)


def embedded_facts(page: Page) -> Iterator[Fact]:
    """Pairs of the JSON that scripts of the page carry, where their label speaks of a size."""
    for match in _JSON_PAIR.finditer(page.text):
        label = _unescaped(match["label"])
        letters = plain(label)
        if _names_a_size(letters) or is_component(letters):
            value = match["number"] or _unescaped(match["value"])
            if _HAS_DIGIT.search(value):
                yield Fact(label, value, "", "json", match.start() // 4000)


def _unescaped(text: str) -> str:
    text = re.sub(r"\\+u([0-9a-fA-F]{4})", lambda match: chr(int(match[1], 16)), text)
    return squeezed(re.sub(r"\\+", "", text))
