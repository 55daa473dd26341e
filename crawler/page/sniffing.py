"""What a file really holds that should be a web page and is not."""

from __future__ import annotations

import re

__all__ = ["other_content"]

#: First bytes of what people save beside pages.
_SIGNATURES = {
    b"\xff\xd8\xff": "a JPEG picture",
    b"\x89PNG": "a PNG picture",
    b"GIF8": "a GIF picture",
    b"RIFF": "a WebP picture or another RIFF file",
    b"%PDF-": "a PDF",
    b"PK\x03\x04": "a ZIP archive or an office document",
    b"SQLite format 3": "an SQLite file",
}

#: Marks of UTF-16, whose zero bytes are text.
_MARKS = (b"\xff\xfe", b"\xfe\xff")

#: Bytes that no text holds, and how far to look for them (WHATWG MIME Sniffing, 3 and 5.1).
_BINARY = re.compile(rb"[\x00-\x08\x0b\x0e-\x1a\x1c-\x1f]")
SNIFFED_BYTES = 1445

#: An element of HTML; without any, a text is no page.
_ELEMENT = re.compile(
    rb"<(?:!doctype\s+html|html|head|body|title|meta|link|base|script|style|div|span|p|a|h[1-6]|table|t[rdh]|[uod]l|li|d[td]"
    rb"|main|article|section|header|footer|nav|form|img|b|i|br|center|font)[\s/>]",
    re.IGNORECASE,
)


def other_content(body: bytes) -> str | None:
    """What a body holds instead of HTML, in words; None where it may be HTML."""
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
