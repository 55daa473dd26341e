"""HTTP responses: ETags, cache headers, gzip, byte ranges, cross-origin access, and errors as problem details."""

from __future__ import annotations

import gzip
import re
from collections import OrderedDict
from functools import cached_property
from http import HTTPStatus

import msgspec
from starlette.requests import Request
from starlette.responses import Response

from explorer.route import Rendered
from explorer.schemas import Problem

#: Maximum size of the response cache in bytes: about 2,000 pages.
MAX_CACHE_BYTES = 64_000_000
#: Bytes of a response with its compressed form, relative to those of the response.
COMPRESSED_FACTOR = 1.4
#: Memory of an entry of the cache without the bodies, in bytes.
ENTRY_BYTES = 500
#: Minimum size of a compressed response in bytes.
MIN_GZIP_BYTES = 500

#: A request of one range of bytes; the response to several ranges is the whole content, as RFC 9110 permits.
_RANGE = re.compile(r"bytes=(?=.*\d)(\d{0,18})-(\d{0,18})")

#: Media types that are compressed already.
_COMPRESSED = {"image/webp", "image/jpeg", "image/png", "application/vnd.apache.parquet"}

#: Headers of every response: pages load nothing from other sites, and every site may read the data.
_HEADERS = {
    "access-control-allow-origin": "*",
    "x-content-type-options": "nosniff",
    "referrer-policy": "strict-origin-when-cross-origin",
    "content-security-policy": "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'self'",
}


class CachedResponse:
    """Content, and its compressed form once a client accepts it; empty if it is not compressed."""

    def __init__(self, content: Rendered) -> None:
        self.content = content

    @cached_property
    def compressed(self) -> bytes:
        """The compressed form; the same bytes each time."""
        if self.content.media_type in _COMPRESSED or len(self.content.body) < MIN_GZIP_BYTES:
            return b""
        return gzip.compress(self.content.body, 6, mtime=0)

    @property
    def size(self) -> int:
        """Estimated memory in bytes."""
        return int(len(self.content.body) * COMPRESSED_FACTOR) + ENTRY_BYTES


class ResponseCache:
    """Least-recently-used cache of responses, at most `MAX_CACHE_BYTES`."""

    def __init__(self) -> None:
        self._responses: OrderedDict[object, CachedResponse] = OrderedDict()
        self._bytes = 0

    def get(self, key: object) -> CachedResponse | None:
        """Return the response of a key, None if it is not cached."""
        cached = self._responses.get(key)
        if cached is not None:
            self._responses.move_to_end(key)
        return cached

    def put(self, key: object, response: CachedResponse) -> None:
        """Store a response, and remove the least recently used ones if the cache is full."""
        if key in self._responses:
            return
        self._responses[key] = response
        self._bytes += response.size
        while self._bytes > MAX_CACHE_BYTES:
            _, oldest = self._responses.popitem(last=False)
            self._bytes -= oldest.size


def accepts_gzip(accepted: str) -> bool:
    """Return whether an `Accept-Encoding` header permits gzip: `gzip;q=0` and `*;q=0` forbid it (RFC 9110, 12.5.3)."""
    weights = {}
    for entry in accepted.lower().split(","):
        coding, *parameters = (part.strip() for part in entry.split(";"))
        weights[coding] = next((part[2:] for part in parameters if part.startswith("q=")), "1")
    return bool(weights.get("gzip", weights.get("*", "0")).strip("0."))


def conditional_response(request: Request, cached: CachedResponse, etag: str, max_age_s: int = 300) -> Response:
    """Return the response to a conditional request.

    The status is 304 if the client has this version, 206 or 416 for a range of bytes. The response is compressed if
    the client accepts gzip and requests no range; the compressed form has an ETag of its own.
    """
    body, status = cached.content.body, 200
    span = _RANGE.fullmatch(request.headers.get("range", "")) if request.method == "GET" else None
    if span is not None:
        first, last = span.groups()
        is_valid = not (first and last) or int(first) <= int(last)
        span = span if is_valid and request.headers.get("if-range", f'"{etag}"') == f'"{etag}"' else None
    is_compressed = span is None and accepts_gzip(request.headers.get("accept-encoding", "")) and cached.compressed
    etag = f'"{etag}-gzip"' if is_compressed else f'"{etag}"'
    headers = {
        **_HEADERS,
        "accept-ranges": "bytes",
        "etag": etag,
        "cache-control": f"public, max-age={max_age_s}",
        "vary": "accept-encoding",
    }
    known = [tag.strip().removeprefix("W/") for tag in request.headers.get("if-none-match", "").split(",")]
    if etag in known or "*" in known:
        return Response(status_code=304, headers=headers)
    if is_compressed:
        body = cached.compressed
        headers["content-encoding"] = "gzip"
    elif span is not None:
        total = len(body)
        start = int(first) if first else max(total - int(last), 0)
        stop = min(int(last) + 1, total) if first and last else total
        if start >= stop:
            return problem(
                416, f"range: expected bytes below {total}", request.url.path, {"content-range": f"bytes */{total}"}
            )
        body, status = body[start:stop], 206
        headers["content-range"] = f"bytes {start}-{stop - 1}/{total}"
    headers["content-type"] = cached.content.media_type
    return Response(body, status, headers=headers)


def problem(status: int, detail: str, instance: str | None = None, headers: dict[str, str] | None = None) -> Response:
    """Return an error as problem details (RFC 9457)."""
    body = Problem(title=HTTPStatus(status).phrase, status=status, detail=detail, instance=instance)
    return Response(
        msgspec.json.encode(body), status, {**_HEADERS, **(headers or {})}, media_type="application/problem+json"
    )
