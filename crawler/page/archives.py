"""Pages of web archives: WARC files (ISO 28500) and N-Quads of schema.org products (Web Data Commons).

A search for bytes comes first, because most pages of an archive state no size; parsing a page costs a hundred times as
much.
"""

from __future__ import annotations

import gzip
import json
import re
import zlib
from collections.abc import Iterator
from http import HTTPStatus
from http.client import HTTPException, HTTPResponse, IncompleteRead, parse_headers
from io import BufferedIOBase, BytesIO
from itertools import groupby
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from urllib.parse import urlsplit

import brotli
from lxml import etree

from crawler.page.page import MAX_BYTES, BadPage, Page, other_content, page
from crawler.text.vocabulary import language_of
from metric_base.errors import InputError

#: Suffixes of archives; each may be followed by `.gz`.
ARCHIVE_SUFFIXES = (".warc", ".nq")
#: Maximum length of a line in bytes.
MAX_LINE = 1 << 20
#: Maximum depth of the objects of a product: a product, its property, and the value of that.
MAX_DEPTH = 3
#: Maximum number of values of the products of a page, with those of their objects; objects that refer to each other
#: would have the third power of their number.
MAX_VALUES = 100_000
#: Bytes of pages that may state a size: a number with a unit of length, a unit in brackets, or a code of a unit.
_NUMBER_WITH_UNIT = re.compile(
    rb"[0-9](?:(?:[\s>\\]|&nbsp;|\xc2\xa0|</?[A-Za-z][^<>]{0,80}>){0,8}(?:(?i:[mc]m\b|m\b|met[er]|[mc]illim|cent[i\xc3]|in\b"
    rb"|inch|f(?:oo|ee)?t\b|pouces|zoll|pol)|\xe2\x80\xb3|&quot;|&#34;|'')|\\?\"\s{0,4}(?:[(<,;x]|[DWHLT]\b|\xc3\x97|&times;))"
)
_UNIT_IN_BRACKETS = re.compile(rb"[\[(](?i:[mc]m|m|in|inch(?:es)?|ft)\.?[\])]")
_UNIT_CODES = (b"MMT", b"CMT", b"MTR", b"INH", b"FOT")
_QUAD = re.compile(
    r'\s*(<[^<>"{}|^`\\\s]*>|_:\S+)\s+<([^<>\s]*)>\s+(<[^<>\s]*>|_:\S+|"(?:[^"\\]|\\.)*"(?:@[\w-]+|\^\^<[^<>\s]*>)?)'
    r"\s+(?:<([^<>\s]*)>|_:\S+)\s*\.\s*"
)
#: Escapes of strings in N-Quads (RDF 1.1 N-Quads, ECHAR and UCHAR).
_ESCAPE = re.compile(r"\\(?:u([0-9A-Fa-f]{4})|U([0-9A-Fa-f]{8})|(.))")
_CHARACTERS = {"t": "\t", "b": "\b", "n": "\n", "r": "\r", "f": "\f"}


def archived_pages(path: Path) -> Iterator[Page | None]:
    """Yield the pages of an archive, and None for each page that states no size or cannot be read.

    Parameters
    ----------
    path : Path
        WARC file (`.warc`) or N-Quads (`.nq`), which may be compressed (`.gz`).

    Raises
    ------
    InputError
        The file is damaged or in another format.
    """
    with gzip.open(path) if path.suffix == ".gz" else path.open("rb") as file:
        try:
            yield from (_warc_pages if ".warc" in path.suffixes[-2:] else _quad_pages)(path, file)
        except (OSError, EOFError, zlib.error) as error:
            raise InputError(f"{path}: expected gzip data; found {error}") from None


def _warc_pages(path: Path, file: BufferedIOBase) -> Iterator[Page | None]:
    """Yield the pages of the responses with status 200 and a page as content."""
    number = 0
    while line := file.readline(MAX_LINE):
        if not line.strip():  # records end with two empty lines
            continue
        number += 1
        try:
            if not line.startswith(b"WARC/"):
                raise ValueError(f"{line[:20]!r}")
            fields = parse_headers(file)
            size = fields["Content-Length"] or "none"
            if not size.isdecimal():
                raise ValueError(f"Content-Length: {size}")
        except (HTTPException, ValueError) as error:
            raise InputError(f"{path}: record {number}: expected the header of a WARC record; found {error}") from None
        length = int(size)
        content = file.read(min(length, MAX_BYTES))
        for start in range(MAX_BYTES, length, MAX_BYTES):
            file.read(min(length - start, MAX_BYTES))
        url = (fields["WARC-Target-URI"] or "").strip("<>")
        if fields["WARC-Type"] != "response" or not url.startswith("http"):
            continue
        try:
            body, content_type = _page_body(content)
            if body and not other_content(body):
                is_wide = body[:2] in (b"\xff\xfe", b"\xfe\xff")  # UTF-16
                yield page(body, url, content_type) if is_wide or _may_state_size(body) else None
        except (BadPage, HTTPException, ValueError, brotli.error, zlib.error):
            yield None


def _page_body(content: bytes) -> tuple[bytes, str | None]:
    """Return body and content type of a response with status 200, decoded; an empty body if it is not HTML."""
    response = HTTPResponse(SimpleNamespace(makefile=lambda *_: BytesIO(content)))  # type: ignore[arg-type]
    response.begin()
    content_type = response.headers["Content-Type"]
    if response.status != HTTPStatus.OK or "html" not in (content_type or "html"):
        return b"", content_type
    try:
        body = response.read()
    except IncompleteRead as error:  # archives may keep the length of a body that they have unpacked
        body = error.partial
    if body[:2] == b"\x1f\x8b":
        body = zlib.decompressobj(wbits=31).decompress(body, MAX_BYTES + 1)
    elif response.headers["Content-Encoding"] == "br" and not body.lstrip().startswith(b"<"):
        body = brotli.Decompressor().process(body, output_buffer_limit=MAX_BYTES + 1)
    return body, content_type


def _may_state_size(body: bytes) -> bool:
    """Return False if a text has neither a number with a unit of length nor a unit in brackets nor its code."""
    has_unit = _NUMBER_WITH_UNIT.search(body) or _UNIT_IN_BRACKETS.search(body)
    return bool(has_unit) or any(code in body for code in _UNIT_CODES)


def _quad_pages(path: Path, file: BufferedIOBase) -> Iterator[Page | None]:
    """Yield a page without text for each graph of N-Quads; consecutive lines of a graph are one page."""

    def quads() -> Iterator[tuple[str, str, str, str]]:
        number = 0
        while line := file.readline(MAX_LINE):
            number += 1
            text = line.decode("utf-8", "replace")
            found = _QUAD.fullmatch(text)
            if found is not None:
                yield found[4] or "", found[1], found[2], found[3]
            elif number == 1 and not text.lstrip().startswith("#"):
                raise InputError(f"{path}:1: expected a quad (subject, predicate, object, graph); found another line")

    for url, group in groupby(quads(), key=lambda quad: quad[0]):
        if not url.startswith("http"):
            continue
        nodes: dict[str, dict[str, list[str]]] = {}
        n_characters = 0
        for _, subject, predicate, value in group:
            n_characters += len(subject) + len(predicate) + len(value)
            if n_characters <= MAX_BYTES:  # as of any page; the remainder is omitted
                nodes.setdefault(subject, {}).setdefault(re.split("[/#]", predicate)[-1], []).append(value)
        languages = [value.rpartition("@")[2] for node in nodes.values() for value in node.get("name", ())]
        language = language_of(next(iter(languages), None), urlsplit(url).hostname or "")
        budget = iter(range(MAX_VALUES))
        subjects = [name for name, node in nodes.items() if any("Product" in kind for kind in node.get("type", ()))]
        text = json.dumps([_linked_data(nodes, subject, budget) for subject in subjects], ensure_ascii=False)
        is_sized = any(axis in text for axis in ('"width"', '"height"', '"depth"', '"length"', "additionalProperty"))
        is_sized = is_sized or _may_state_size(text.encode())
        yield Page(url, "", etree.Element("html"), language, (text,)) if is_sized else None


def _linked_data(
    nodes: dict[str, dict[str, list[str]]], subject: str, budget: Iterator[int], depth: int = 0
) -> dict[str, Any]:
    """Return a node of N-Quads as JSON-LD; objects below `MAX_DEPTH`, and values after the `budget`, are omitted."""

    def value(text: str) -> Any:
        if text in nodes and depth < MAX_DEPTH:
            return _linked_data(nodes, text, budget, depth + 1)
        if text.startswith('"'):
            return _ESCAPE.sub(_character, text[1 : text.rindex('"')])
        return text.strip("<>")

    record: dict[str, Any] = {"@type": [kind.strip("<>") for kind in nodes[subject].get("type", ())]}
    for name, texts in nodes[subject].items():
        values = [value(text) for text in texts if next(budget, None) is not None]
        if values:
            record[name] = values[0] if len(values) == 1 else values
    return record


def _character(escape: re.Match[str]) -> str:
    number = escape[1] or escape[2]
    return chr(int(number, 16)) if number else _CHARACTERS.get(escape[3], escape[3])
