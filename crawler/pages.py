"""A web page, parsed once: its tree, its language, its site. One reader for live and for saved pages."""

from __future__ import annotations

import gzip
import hashlib
import re
import zlib
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit, urlunsplit

import lxml.html
from lxml import etree
from w3lib.encoding import html_to_unicode

from crawler.faults import InputFault
from crawler.words import Language, language_of

__all__ = ["MAXIMUM_BYTES", "BadPage", "Page", "canonical_url", "page", "saved_page", "source_id", "squeezed"]

#: The largest page that is read, after decompression: ten times the largest product page we have seen (3.1 MB).
MAXIMUM_BYTES = 32_000_000

_INVISIBLE = re.compile("[\u00ad\u034f\u061c\u200b-\u200f\u202a-\u202e\u2060-\u2064\u2066-\u2069\ufeff\ufe0e\ufe0f]")


class BadPage(InputFault):
    """A file that is no page that can be read."""


@dataclass(frozen=True, slots=True, eq=False)
class Page:
    """A parsed page: `root` is lxml's html element, `text` the source that it was parsed from."""

    url: str
    text: str
    root: lxml.html.HtmlElement
    language: Language | None

    @property
    def host(self) -> str:
        """The site, in small letters, without port and leading `www.`."""
        return (urlsplit(self.url).hostname or "").removeprefix("www.")


def page(body: bytes, url: str, content_type: str | None = None) -> Page:
    """The page of a body.

    Raises
    ------
    BadPage
        The body is empty, larger than `MAXIMUM_BYTES`, or holds no element.
    """
    if not body.strip():
        raise BadPage(f"{url}: expected a page; found nothing")
    if len(body) > MAXIMUM_BYTES:
        raise BadPage(f"{url}: expected at most {MAXIMUM_BYTES} bytes; found {len(body)}")
    _, text = html_to_unicode(content_type, body, default_encoding="utf-8")
    text = text.replace("\x00", "")
    try:
        # A declaration of an encoding inside the text would be believed over the decoding that was done.
        root = lxml.html.document_fromstring(re.sub(r"^\s*<\?xml[^>]*\?>", "", text))
    except (etree.ParserError, ValueError) as error:
        raise BadPage(f"{url}: expected HTML; found {error}") from None
    declared = root.get("lang") or root.get("{http://www.w3.org/XML/1998/namespace}lang")
    return Page(url, text, root, language_of(declared, urlsplit(url).hostname or ""))


def saved_page(path: Path, url: str) -> Page:
    """The page of a file, gzipped or not.

    Raises
    ------
    BadPage
        The file is damaged, or unpacks to more than `MAXIMUM_BYTES`.
    """
    body = path.read_bytes()
    if body[:2] == b"\x1f\x8b":
        body = _unpacked(path, body)
    return page(body, url)


def canonical_url(url: str) -> str:
    """The address without fragment, port of the scheme, and tracking parameters; host in small letters."""
    parts = urlsplit(url)
    kept = "&".join(
        part
        for part in parts.query.split("&")
        if part and not re.match(r"(utm_\w+|ref_?|gclid|fbclid|psc|th|tag)=", part)
    )
    host = (parts.hostname or "") + (f":{parts.port}" if parts.port and parts.port not in {80, 443} else "")
    return urlunsplit((parts.scheme.lower(), host, parts.path or "/", kept, ""))


def source_id(url: str) -> str:
    """The id of a page that has none of its own: the sha256 of its canonical address (contracts.md, raw item)."""
    return hashlib.sha256(canonical_url(url).encode()).hexdigest()


def squeezed(text: str) -> str:
    """The text without invisible signs, with single spaces."""
    return " ".join(_INVISIBLE.sub("", text).split())


def _unpacked(path: Path, body: bytes) -> bytes:
    # One call with a bound: a small file may unpack to gigabytes.
    unpacker = zlib.decompressobj(wbits=31)
    try:
        unpacked = unpacker.decompress(body, MAXIMUM_BYTES + 1)
    except (zlib.error, gzip.BadGzipFile) as error:
        raise BadPage(f"{path}: expected a gzip file; found {error}") from None
    if len(unpacked) > MAXIMUM_BYTES:
        raise BadPage(f"{path}: expected at most {MAXIMUM_BYTES} bytes unpacked; found more")
    return unpacked
