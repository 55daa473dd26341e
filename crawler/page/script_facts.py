"""Label and value pairs of the JSON that a page's scripts carry."""

from __future__ import annotations

import re
from collections.abc import Iterator

from crawler.page.facts import HAS_DIGIT, Fact, names_a_size
from crawler.page.page import Page, squeeze
from crawler.text.vocabulary import is_component, plain

__all__ = ["embedded_facts"]

#: Pairs in scripts: `"name":"Width","value":"30 cm"`, with plain or escaped quotes, names as sites use them.
_JSON_PAIR = re.compile(
    r'"(?:name|label|displayName|title|key|attributeName|specName|header)\\*"\s*:\s*\\*"(?P<label>[^"\\]{2,60})\\*"'
    r'(?:\s*,\s*\\*"\w+\\*"\s*:\s*(?:null|true|false|\d+|\\*"[^"\\]{0,40}\\*")){0,3}'
    r'\s*,\s*\\*"(?:value|displayValue|text|values|attributeValue|specValue|description|content)\\*"\s*:\s*\[?\s*'
    r'(?:\\*"(?P<value>(?:[^"\\]|\\\\?\\?"(?!\s*[,\]}])|\\u[0-9a-f]{4}|\\\\u[0-9a-f]{4}){1,160}?)\\*"(?=\s*[,\]}])|(?P<number>\d+(?:\.\d+)?))',
    re.IGNORECASE,
)


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
