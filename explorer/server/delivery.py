"""HTTP responses: files with ETags and byte ranges, gzip, cross-origin access, and errors as problem details."""

from __future__ import annotations

from http import HTTPStatus
from pathlib import Path
from typing import Any

import msgspec
from starlette.datastructures import MutableHeaders
from starlette.middleware.gzip import DEFAULT_EXCLUDED_CONTENT_TYPES, GZipMiddleware
from starlette.requests import Request
from starlette.responses import FileResponse, Response
from starlette.staticfiles import NotModifiedResponse, StaticFiles
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from explorer.route import MEDIA_TYPES
from explorer.schemas import Problem

#: Seconds for which clients may keep a response.
MAX_AGE_S = 300
#: Level of gzip: higher ones take several times as long for 1 % fewer bytes.
GZIP_LEVEL = 6

#: Headers of every response: pages load nothing from other sites, and every site may read the data.
HEADERS = {
    "access-control-allow-origin": "*",
    "x-content-type-options": "nosniff",
    "referrer-policy": "strict-origin-when-cross-origin",
    "content-security-policy": "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'self'",
    "cache-control": f"public, max-age={MAX_AGE_S}",
    "vary": "accept-encoding",
}


class CompressionMiddleware(GZipMiddleware):  # type: ignore[misc]  # starlette is optional
    """Starlette's gzip, with three rules of RFC 9110 that Starlette 1.10 lacks.

    `gzip;q=0` forbids gzip, and `*` permits it (12.5.3); a compressed response has other bytes than the plain one, and
    therefore a weak ETag (8.8.1); ranges in other units than bytes are ignored (14.2).
    """

    def __init__(self, app: ASGIApp) -> None:
        compressed = (*DEFAULT_EXCLUDED_CONTENT_TYPES, MEDIA_TYPES["parquet"])
        super().__init__(app, compresslevel=GZIP_LEVEL, exclude_content_types=compressed)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle a request."""

        async def weaken(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                if "content-encoding" in headers and "etag" in headers:
                    headers["etag"] = f"W/{headers['etag']}"
            await send(message)

        if scope["type"] == "http":
            headers = MutableHeaders(scope=scope)
            headers["accept-encoding"] = "gzip" if accepts_gzip(headers.get("accept-encoding", "")) else "identity"
            if not headers.get("range", "bytes=").lower().startswith("bytes="):
                del headers["range"]
        await super().__call__(scope, receive, weaken)


def accepts_gzip(accepted: str) -> bool:
    """Return whether an `Accept-Encoding` header permits gzip: `gzip;q=0` and `*;q=0` forbid it."""
    weights = {}
    for entry in accepted.lower().split(","):
        coding, *parameters = (part.strip() for part in entry.split(";"))
        weights[coding] = next((part[2:] for part in parameters if part.startswith("q=")), "1")
    return bool(weights.get("gzip", weights.get("*", "0")).strip("0."))


def file_response(request: Request, file: Path, media_type: str, **headers: str) -> Response:
    """Return the response of a file, with status 304 if the client has this version, and 206 for a range of bytes."""
    response = FileResponse(file, headers=HEADERS | headers, media_type=media_type, stat_result=file.stat())
    if StaticFiles(check_dir=False).is_not_modified(response.headers, request.headers):
        return NotModifiedResponse(response.headers)
    return response


def problem(status: int, detail: str, instance: str | None = None, headers: dict[str, str] | None = None) -> Response:
    """Return an error as problem details (RFC 9457)."""
    body = Problem(title=HTTPStatus(status).phrase, status=status, detail=detail, instance=instance)
    own: dict[str, Any] = {**HEADERS, "cache-control": "no-store", **(headers or {})}
    return Response(msgspec.json.encode(body), status, own, media_type="application/problem+json")
