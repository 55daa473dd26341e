"""How bytes go out: ETag of the release, caching, gzip, reading from other origins, and errors in one shape."""

from __future__ import annotations

import gzip
from collections import OrderedDict
from functools import cached_property
from http import HTTPStatus

import msgspec
from starlette.requests import Request
from starlette.responses import Response

from explorer.routes import Answer
from explorer.schemas import Problem

#: Bytes of answers that are kept ready; some 2,000 pages.
SHELF_BYTES = 64_000_000

#: Bytes of an answer with its compressed form over those of the answer alone.
WITH_GZIP = 1.4

#: Shorter answers are sent as they are.
LEAST_GZIP = 500

_PLAIN = {"image/webp", "image/jpeg", "image/png", "application/vnd.apache.parquet"}

#: Headers of every answer: pages load nothing from outside, and anybody may read the data.
_HEADERS = {
    "access-control-allow-origin": "*",
    "x-content-type-options": "nosniff",
    "referrer-policy": "strict-origin-when-cross-origin",
    "content-security-policy": "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'self'",
}


class Delivered:
    """An answer, and the same compressed once a client takes it so; empty where that is no shorter."""

    def __init__(self, answer: Answer) -> None:
        self.answer = answer

    @cached_property
    def compressed(self) -> bytes:
        """The compressed form; the same bytes each time."""
        if self.answer.media_type in _PLAIN or len(self.answer.body) < LEAST_GZIP:
            return b""
        return gzip.compress(self.answer.body, 6, mtime=0)


class Shelf:
    """Answers that were made, the latest used; at most `SHELF_BYTES`."""

    def __init__(self) -> None:
        self._answers: OrderedDict[object, Delivered] = OrderedDict()
        self._bytes = 0

    def get(self, key: object) -> Delivered | None:
        """The answer of a key, if it is there."""
        found = self._answers.get(key)
        if found is not None:
            self._answers.move_to_end(key)
        return found

    def put(self, key: object, answer: Delivered) -> None:
        """Keep an answer; the ones that were used longest ago make room."""
        if key in self._answers:
            return
        self._answers[key] = answer
        self._bytes += _weight(answer)
        while self._bytes > SHELF_BYTES:
            _, old = self._answers.popitem(last=False)
            self._bytes -= _weight(old)


def response_of(request: Request, made: Delivered, etag: str, seconds: int = 300) -> Response:
    """The response: 304 where the client has it, compressed where it takes that."""
    headers = {
        **_HEADERS,
        "etag": f'"{etag}"',
        "cache-control": f"public, max-age={seconds}",
        "vary": "accept-encoding",
    }
    if f'"{etag}"' in request.headers.get("if-none-match", ""):
        return Response(status_code=304, headers=headers)
    body = made.answer.body
    if "gzip" in request.headers.get("accept-encoding", "") and made.compressed:
        body = made.compressed
        headers["content-encoding"] = "gzip"
    headers["content-type"] = made.answer.media_type
    return Response(body, headers=headers)


def problem(status: int, detail: str, instance: str | None = None, headers: dict[str, str] | None = None) -> Response:
    """An error as RFC 9457 has it."""
    body = Problem(title=HTTPStatus(status).phrase, status=status, detail=detail, instance=instance)
    return Response(
        msgspec.json.encode(body), status, {**_HEADERS, **(headers or {})}, media_type="application/problem+json"
    )


def _weight(made: Delivered) -> int:
    return int(len(made.answer.body) * WITH_GZIP) + 500
