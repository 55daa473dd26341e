"""Parse web pages, live or saved: element tree, language, links."""

from __future__ import annotations

import gzip
import re
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias
from urllib.parse import urlsplit

from lxml import etree
from w3lib.encoding import html_to_unicode

from crawler.text.vocabulary import INVISIBLE, Language, language_of
from metric_base.errors import InputError

#: Element of lxml; the classes of `lxml.html` would cost a Python call each.
Element: TypeAlias = etree._Element
#: Maximum size of a page in bytes after decompression: ten times the largest product page seen (3.1 MB).
MAX_BYTES = 32_000_000
#: Maximum number of attributes of a tag: libxml2 takes quadratic time, and cannot be interrupted (200 s for 100,000
#: attributes). Stored pages have at most 42.
MAX_ATTRIBUTES = 250
#: Tags of the root element, whose attributes libxml2 merges, and their name in the count of attributes.
_ROOT_TAG, _ROOT_NAME = re.compile(rb"<html(?=[\s/])", re.IGNORECASE), "mt-root"
#: Control characters (C0 and C1) that are not white space.
_CONTROLS = re.compile("[\x00-\x1f\x7f-\x9f]")
#: Tags of invisible elements, which are removed from the tree.
_INVISIBLE_TAGS = ("script", "style", "template", "noscript", "select")
_LINKS = etree.XPath("//a/@href", smart_strings=False)
_LINKED_DATA = etree.XPath("//script[contains(@type, 'ld+json')]/text()", smart_strings=False)
#: First bytes of other files that users save with pages.
_SIGNATURES = {
    b"\xff\xd8\xff": "a JPEG image",
    b"\x89PNG": "a PNG image",
    b"GIF8": "a GIF image",
    b"RIFF": "a WebP image or another RIFF file",
    b"%PDF-": "a PDF",
    b"PK\x03\x04": "a ZIP archive or an office document",
    b"SQLite format 3": "an SQLite file",
}
#: Byte order marks of UTF-16, in which zero bytes are text.
_MARKS = (b"\xff\xfe", b"\xfe\xff")
#: Bytes that no text contains, and number of bytes that are examined (WHATWG MIME Sniffing, 3 and 5.1).
_BINARY = re.compile(rb"[\x00-\x08\x0b\x0e-\x1a\x1c-\x1f]")
SNIFFED_BYTES = 1445
#: An element of HTML; a text without an element is not a page.
_ELEMENT = re.compile(
    rb"<(?:!doctype\s+html|html|head|body|title|meta|link|base|script|style|div|span|p|a|h[1-6]|table|t[rdh]|[uod]l|li|d[td]"
    rb"|main|article|section|header|footer|nav|form|img|b|i|br|center|font)[\s/>]",
    re.IGNORECASE,
)


class BadPage(InputError):
    """A file is not a readable page."""


@dataclass(frozen=True, slots=True, eq=False)
class Page:
    """A parsed page."""

    url: str
    text: str  #: Source text.
    root: Element  #: The html element, without scripts, styles, comments and other invisible elements.
    language: Language | None
    linked_data: tuple[str, ...] = ()  #: Texts of the JSON-LD.
    links: tuple[str, ...] = ()  #: Addresses of the links, as written.

    @property
    def host(self) -> str:
        """Host in lower case, without port and leading `www.`."""
        return (urlsplit(self.url).hostname or "").removeprefix("www.")


class _AttributeCheck:
    """Target of a parser, which builds no tree and takes linear time: BadPage if a tag has too many attributes."""

    def __init__(self, url: str) -> None:
        self._url = url
        self._n_of_root = 0

    def start(self, tag: str, attributes: Mapping[str, str]) -> None:
        """Count the attributes of a tag."""
        if tag == _ROOT_NAME:
            self._n_of_root += len(attributes)
        if max(len(attributes), self._n_of_root) > MAX_ATTRIBUTES:
            raise BadPage(f"{self._url}: expected at most {MAX_ATTRIBUTES} attributes of a tag; found more")

    def close(self) -> None:
        """End the page."""


def page(body: bytes, url: str, content_type: str | None = None) -> Page:
    """Parse a page.

    Parameters
    ----------
    body : bytes
        HTML in the encoding of `content_type`, of its byte order mark or declaration, else UTF-8.
    url : str
        Address of the page.
    content_type : str, optional
        HTTP header of this name.

    Raises
    ------
    BadPage
        The body is empty, larger than `MAX_BYTES`, or contains no element, or a tag has more than `MAX_ATTRIBUTES`.
    """
    if not body or body.isspace():
        raise BadPage(f"{url}: expected a page; found nothing")
    if len(body) > MAX_BYTES:
        raise BadPage(f"{url}: expected at most {MAX_BYTES} bytes; found {len(body)}")
    try:
        encoding, text = html_to_unicode(content_type, body, default_encoding="utf-8")
    except (LookupError, UnicodeError):  # it declares a codec of Python that is no encoding of pages, such as rot13
        encoding, text = "", body.decode("utf-8", "replace")
    if encoding != "utf-8" or "\ufffd" in text or "\x00" in text:
        text = text.replace("\x00", "")
        body = text.encode(errors="replace")
    # the encoding is given to the parser, because declarations in pages may be wrong
    parser = etree.HTMLParser(encoding="utf-8", remove_comments=True, remove_pis=True)
    counter = etree.HTMLParser(encoding="utf-8", target=_AttributeCheck(url))
    try:
        etree.fromstring(_ROOT_TAG.sub(f"<{_ROOT_NAME}".encode(), body), counter)
        root = etree.fromstring(body, parser)
    except BadPage:
        raise
    except (etree.XMLSyntaxError, ValueError) as error:
        raise BadPage(f"{url}: expected HTML; found {error}") from None
    if root is None:
        raise BadPage(f"{url}: expected HTML; found no element")
    linked_data, links = tuple(_LINKED_DATA(root)), tuple(_LINKS(root))
    etree.strip_elements(root, *_INVISIBLE_TAGS, with_tail=False)
    declared = root.get("lang") or root.get("{http://www.w3.org/XML/1998/namespace}lang")
    return Page(url, text, root, language_of(declared, urlsplit(url).hostname or ""), linked_data, links)


def saved_page(path: Path, url: str) -> Page:
    """Read and parse a page from a file, which may be compressed by gzip.

    Raises
    ------
    BadPage
        The file does not exist, is damaged or not HTML, or has more than `MAX_BYTES`, also after decompression.
    """
    if not path.is_file():
        raise BadPage(f"{path}: expected an HTML page; found {'a folder' if path.is_dir() else 'no file'}")
    if path.stat().st_size > MAX_BYTES:
        raise BadPage(f"{path}: expected at most {MAX_BYTES} bytes; found {path.stat().st_size}")
    body = path.read_bytes()
    if body[:2] == b"\x1f\x8b":
        try:  # with a bound, because a small file may decompress to gigabytes
            body = zlib.decompressobj(wbits=31).decompress(body, MAX_BYTES + 1)
        except (zlib.error, gzip.BadGzipFile) as error:
            raise BadPage(f"{path}: expected a gzip file; found {error}") from None
        if len(body) > MAX_BYTES:
            raise BadPage(f"{path}: expected at most {MAX_BYTES} bytes unpacked; found more")
    if other := other_content(body):
        raise BadPage(f"{path}: expected an HTML page; found {other}")
    return page(body, url)


def squeeze(text: str) -> str:
    """Return a text with single spaces, and without invisible characters and control characters."""
    text = " ".join(text.split() if text.isascii() else INVISIBLE.sub("", text).split())
    return text if text.isprintable() else _CONTROLS.sub("", text)


def other_content(body: bytes) -> str | None:
    """Return the kind of content of a body that is not HTML, or None."""
    if not body or body.isspace():
        return "nothing"
    for start, name in _SIGNATURES.items():
        if body.startswith(start):
            return name
    if body.startswith(_MARKS):
        return None
    if _BINARY.search(body[:SNIFFED_BYTES]):
        return "binary data"
    if body.lstrip()[:1] in {b"{", b"["}:
        return "JSON"
    return None if _ELEMENT.search(body) else "no element of HTML"
