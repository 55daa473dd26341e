"""The regions of a page: the text of an element, its heading, whether it shows the product or something else.

The answers are kept: the facts of a page ask the same of the same elements again and again.
"""

from __future__ import annotations

import re
from functools import lru_cache
from itertools import islice

from crawler.page.page import Element, squeeze

__all__ = ["LABEL_LENGTH", "SKIPPED", "VALUE_LENGTH", "Regions"]

#: A label, and a value, are no longer than this; longer texts are prose.
LABEL_LENGTH, VALUE_LENGTH = 70, 260

#: So far up a heading is looked for.
HEADING_CLIMB = 9

#: The first texts of an element that are joined; a longer element is prose anyway.
MAX_JOINED_TEXTS = 80

#: Regions that show other items than the product, or opinions about it.
_ELSEWHERE = re.compile(
    r"(compar|carousel|similar|recommend|related|sponsor|also$|bought|upsell|review|question|answer|rating|advert|ads?$"
    r"|breadcrumb|nav$|navbar|footer|cookie|customer|faqs?$|bundle|accessor|recently|suggest)"
)

#: The words of a class or id: `itemValue_XPfaq` holds item, value and a hash, no frequent questions.
_NAME_WORDS = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])")

#: Regions about the package; their facts carry it in their heading, so that no later step takes them for the item.
_PACKAGE_REGION = re.compile(r"packag(?!e-?details-?page)|shipping|delivery|verpackung|emballage", re.IGNORECASE)

SKIPPED = frozenset({"script", "style", "noscript", "template", "select", "option", "nav", "footer", "head"})
_HEADINGS = frozenset({"h1", "h2", "h3", "h4", "h5", "h6", "legend", "summary", "caption", "dt"})
_BOLD, _BOXES = frozenset({"b", "strong"}), frozenset({"ul", "ol", "dl", "table", "p", "div"})
_HEADING_CLASS = re.compile(r"title|heading|header|group-?name|section-?name|caption", re.IGNORECASE)


class Regions:
    """The regions of one page. Elements are held, so that lxml's proxies and with them the answers stay."""

    def __init__(self, root: Element) -> None:
        #: What holds the page's title holds the product, whatever it is called: WooCommerce's is `shipping-taxable`.
        self._main = frozenset(box for title in islice(root.iter("h1"), 1) for box in title.iterancestors())
        self._texts: dict[Element, str] = {}
        self._elsewhere: dict[Element, bool] = {}
        self._titles: dict[Element, str] = {}
        self._titles_before: dict[Element, str] = {}

    def text(self, element: Element) -> str:
        """The visible text of an element, cut where it becomes prose."""
        known = self._texts.get(element)
        if known is None:
            known = squeeze(" ".join(islice(element.itertext(), MAX_JOINED_TEXTS))[: 4 * VALUE_LENGTH])
            self._texts[element] = known
        return known

    def is_elsewhere(self, element: Element) -> bool:
        """Whether an element is in a region of other products, opinions or navigation."""
        line = []
        here = element
        while here is not None and here not in self._elsewhere:
            line.append(here)
            here = here.getparent()
        answer = self._elsewhere[here] if here is not None else False
        for step in reversed(line):
            answer = answer or (step not in self._main and _points_elsewhere(step))
            self._elsewhere[step] = answer
        return answer

    def heading(self, element: Element) -> str:
        """The nearest heading above an element: a heading tag, or a box before it that calls itself a title."""
        heading = self._nearest_heading(element)
        here = element
        for _ in range(HEADING_CLIMB):
            if here not in self._main and _is_package_region(f"{here.get('id') or ''} {here.get('class') or ''}"):
                return f"{heading} (package)".strip()
            here = here.getparent()
            if here is None or here.tag in {"body", "main"}:
                break
        return heading

    def _nearest_heading(self, element: Element) -> str:
        here = element
        for _ in range(HEADING_CLIMB):
            if title := self._title_before(here):
                return title
            here = here.getparent()
            if here is None or here.tag == "body":
                break
        return ""

    def _title_before(self, element: Element) -> str:
        """The title of the nearest of the elements before this one that is a title or holds one."""
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
            title = self.text(inner) if inner is not None and len(self.text(element)) <= LABEL_LENGTH else ""
        return title if len(title) <= LABEL_LENGTH else ""


def _is_above(element: Element) -> bool:
    """Whether bold text is a heading: alone on its line, right above a box or a list."""
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


# A site uses some hundreds of class names, over and over.
@lru_cache(maxsize=4096)
def _names_elsewhere(names: str) -> bool:
    return any(_ELSEWHERE.match(word.lower()) for word in _NAME_WORDS.findall(names))


@lru_cache(maxsize=4096)
def _is_package_region(names: str) -> bool:
    return bool(_PACKAGE_REGION.search(names))


@lru_cache(maxsize=4096)
def _is_heading_class(names: str) -> bool:
    return bool(_HEADING_CLASS.search(names))
