"""The HTTP application: the routes of every release, the scale of objects, images and the description of the server."""

from __future__ import annotations

import asyncio
import hashlib
import json
import logging
import re
import time
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from functools import partial
from importlib.resources import files
from urllib.parse import urlsplit

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.middleware.cors import CORSMiddleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from explorer.catalogue import ReleaseCatalogue
from explorer.routes import MEDIA_TYPES, Rendered, find_route
from explorer.server.delivery import CachedResponse, ResponseCache, conditional_response, problem
from explorer.server.openapi import description
from explorer.server.scale_jobs import ScaleJobs, ServiceUnavailable
from explorer.urls import page_of
from metric_base.errors import InputError
from metric_tree.node import NoPrior, UnknownName
from metric_tree.release.images import FOLDER, stored_file
from metric_tree.tree import Tree

#: Maximum size of a request body in bytes: 500 objects take about 100 kB.
MAX_BODY_BYTES = 1_000_000
#: Maximum time in seconds in which a client sends a request body; slower clients would keep connections.
MAX_BODY_S = 10.0
#: Seconds for which clients may keep an image (one year): its name is the digest of its content.
IMAGE_MAX_AGE_S = 31_536_000
#: Seconds for which clients may keep the response to a preflight request (one day).
PREFLIGHT_MAX_AGE_S = 86_400
#: Seconds after which a client may repeat a request that was refused because of load.
RETRY_AFTER_S = 5

#: Addresses that `Explorer.prepare` renders.
PREPARED = ("index.html", "assets/names.js", "assets/sizes.js", "tree.html")

_JSON = MEDIA_TYPES["json"]
_IMAGE = re.compile(rf"{FOLDER}/[0-9a-f]{{2}}/[0-9a-f]{{64}}\.(?:webp|jpg|png)")
_RELEASE = re.compile(r"releases/(?P<version>[^/]+)/(?P<address>.*)")

log = logging.getLogger("metric-tree.serve")


class Explorer:
    """The releases of a server, its response cache and the processes that estimate scales."""

    def __init__(self, trees: Sequence[Tree]) -> None:
        self.catalogues = {tree.version: ReleaseCatalogue(trees, index) for index, tree in enumerate(trees)}
        self.main = self.catalogues[trees[0].version]
        self.jobs = {version: ScaleJobs(one.tree.release.directory) for version, one in self.catalogues.items()}
        self.cache = ResponseCache()
        self.assets = assets_digest()

    def resolve_release(self, path: str) -> tuple[ReleaseCatalogue, str] | None:
        """Return the release of a path and the address in it, None if the release is not served there."""
        match = _RELEASE.fullmatch(path)
        if match is None:
            return self.main, path
        catalogue = self.catalogues.get(match["version"])
        return None if catalogue is None or catalogue is self.main else (catalogue, match["address"])

    def prepare(self) -> None:
        """Render the home page, the indices of the search and a category, so that no request waits for tables."""
        for address in (*PREPARED, page_of(max(self.main.nodes.values(), key=lambda node: node.level).node_id)):
            found = find_route(self.main, address)
            if found is not None:
                route, text, value = found
                rendered = route.content(self.main, value)
                if rendered is not None:
                    self.cache.put((self.main.tree.version, (route.path, text, None)), CachedResponse(rendered))

    async def get(self, request: Request) -> Response:
        """Return the content of a route, an image or the OpenAPI description."""
        path = request.path_params["path"]
        if path == "openapi.json":
            return await self._cached(request, self.main, path, lambda: Rendered(description(self.main), _JSON))
        resolved = self.resolve_release(path)
        if resolved is None:
            return problem(404, f"no release is served at /{path[:200]}", request.url.path)
        catalogue, address = resolved
        if _IMAGE.fullmatch(address):
            file = stored_file(catalogue.tree.release.directory, address)
            if file is None:
                return problem(404, f"nothing is at /{address}", request.url.path)
            image = CachedResponse(Rendered(file.read_bytes(), MEDIA_TYPES[file.suffix[1:]]))
            return conditional_response(request, image, file.stem, IMAGE_MAX_AGE_S)
        if address == "" or address.endswith("/"):
            address += "index.html"
        found = find_route(catalogue, address)
        if found is None:
            return problem(404, f"nothing is at /{address[:200]}", request.url.path)
        route, text, value = found
        query = route.parse_query(request.query_params)
        content = partial(route.content, catalogue, value, query)
        return await self._cached(request, catalogue, (route.path, text, query), content, route.is_quick)

    async def _cached(
        self,
        request: Request,
        catalogue: ReleaseCatalogue,
        key: object,
        render: Callable[[], Rendered | None],
        is_quick: bool = False,
    ) -> Response:
        """Return the cached response of a key, or render it: in another thread unless it takes less time than that."""
        release_key = (catalogue.tree.version, key)
        cached = self.cache.get(release_key)
        if cached is None:
            rendered = render() if is_quick else await run_in_threadpool(render)
            if rendered is None:
                return problem(404, f"nothing is at {request.url.path[:200]}", request.url.path)
            cached = CachedResponse(rendered)
            self.cache.put(release_key, cached)
        return conditional_response(request, cached, f"{catalogue.etag}-{self.assets}")

    async def scale(self, request: Request) -> Response:
        """Return the posterior of measured objects."""
        resolved = self.resolve_release(request.url.path.lstrip("/"))
        if resolved is None:
            return problem(404, "no such release is served", request.url.path)
        origin, host = request.headers.get("origin"), request.headers.get("host", "")
        if origin is not None and urlsplit(origin).netloc.lower() != host.lower():
            return problem(403, f"origin: expected the host of this server; found {origin[:200]}", request.url.path)
        # only this media type requires a preflight request, which other origins do not pass
        media_type = request.headers.get("content-type", "").partition(";")[0].strip().lower()
        if media_type != _JSON:
            found = media_type[:60] or "none"
            return problem(415, f"content-type: expected application/json; found {found}", request.url.path)
        body = bytearray()
        try:
            async with asyncio.timeout(MAX_BODY_S):
                async for chunk in request.stream():
                    body += chunk
                    if len(body) > MAX_BODY_BYTES:
                        return problem(413, f"body: expected at most {MAX_BODY_BYTES:,} bytes", request.url.path)
        except TimeoutError:
            detail = f"body: expected within {MAX_BODY_S:g} s; found {len(body):,} bytes by then"
            return problem(408, detail, request.url.path, {"connection": "close"})
        result = await self.jobs[resolved[0].tree.version].result(bytes(body))
        return Response(result, media_type=_JSON, headers={"cache-control": "no-store"})

    async def health(self, _: Request) -> Response:
        """Return the state of the server and the digests of its releases."""
        releases = {version: catalogue.etag for version, catalogue in self.catalogues.items()}
        return Response(
            json.dumps({"status": "ok", "releases": releases}), media_type=_JSON, headers={"cache-control": "no-store"}
        )


def assets_digest() -> str:
    """Return a digest of templates, scripts and styles: eight hexadecimal digits."""
    digest = hashlib.sha256()
    for folder in ("templates", "assets"):
        for entry in sorted(files("explorer.pages").joinpath(folder).iterdir(), key=lambda entry: entry.name):
            digest.update(entry.read_bytes())
    return digest.hexdigest()[:8]


def application(trees: Sequence[Tree], preload: bool = False, allowed_hosts: Sequence[str] = ("*",)) -> ASGIApp:
    """Return the application of releases: the first at the root, the others under `/releases/VERSION/`.

    Parameters
    ----------
    trees : sequence of Tree
        Releases of different versions.
    preload : bool, default False
        Prepare the tables of the first release, and start the processes that estimate scales with it, before the first
        request.
    allowed_hosts : sequence of str, default ("*",)
        Names in the `Host` header that are served; `*.example.org` means all subdomains, `*` any name.

    Raises
    ------
    InputError
        Two releases have the same version.
    """
    explorer = Explorer(trees)

    @asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        if preload:
            await run_in_threadpool(explorer.prepare)
            explorer.jobs[explorer.main.tree.version].preload()
        yield
        for jobs in explorer.jobs.values():
            jobs.stop()

    handlers = {
        **dict.fromkeys(_STATUSES, _request_error),
        HTTPException: _http_error,
        ClientDisconnect: _disconnected,
        Exception: _internal_error,
    }
    routes = [
        Route("/healthz", explorer.health),
        Route("/v1/scale", explorer.scale, methods=["POST"]),
        Route("/releases/{version}/v1/scale", explorer.scale, methods=["POST"]),
        *(Route(f"{release}/v1/scale", _post_only) for release in ("", "/releases/{version}")),
        Route("/{path:path}", explorer.get),
    ]
    middleware = [
        Middleware(AccessLogMiddleware),
        Middleware(TrustedHostMiddleware, allowed_hosts=list(allowed_hosts), www_redirect=False),
        Middleware(
            CORSMiddleware,
            allow_origins=["*"],
            allow_methods=["GET", "HEAD"],
            allow_headers=["range", "if-range", "if-none-match"],
            max_age=PREFLIGHT_MAX_AGE_S,
            expose_headers=["accept-ranges", "content-range", "etag"],
        ),
    ]
    return Starlette(routes=routes, middleware=middleware, exception_handlers=handlers, lifespan=lifespan)


class AccessLogMiddleware:
    """Log a line of JSON for each request: method, path, status, seconds, bytes."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle and log a request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        started, state = time.perf_counter(), {"status": 500, "bytes": 0}

        async def count_bytes(message: Message) -> None:
            if message["type"] == "http.response.start":
                state["status"] = message["status"]
            else:
                state["bytes"] += len(message.get("body", b""))
            await send(message)

        try:
            await self._app(scope, receive, count_bytes)
        finally:
            if log.isEnabledFor(logging.INFO):
                seconds = round(time.perf_counter() - started, 5)
                log.info(
                    json.dumps({"method": scope["method"], "path": scope["path"][:500], **state, "seconds": seconds})
                )


#: HTTP status of the errors of a request; `NoPrior` is an `UnknownName`, so it is first.
_STATUSES: dict[type[Exception], int] = {NoPrior: 422, UnknownName: 404, InputError: 422, ServiceUnavailable: 503}


async def _request_error(request: Request, error: Exception) -> Response:
    status = next(status for kind, status in _STATUSES.items() if isinstance(error, kind))
    return problem(status, str(error), request.url.path, {"retry-after": str(RETRY_AFTER_S)} if status == 503 else None)


async def _http_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    path = request.url.path[:200]
    return problem(error.status_code, f"{request.method} {path}", path, dict(error.headers or {}))


async def _post_only(_: Request) -> Response:
    raise HTTPException(405, headers={"allow": "POST"})


async def _disconnected(_: Request, __: Exception) -> Response:
    return Response(status_code=400)  # the client is gone and does not read it


async def _internal_error(request: Request, error: Exception) -> Response:
    log.error(json.dumps({"path": request.url.path[:500], "error": f"{type(error).__name__}: {error}"}))
    return problem(500, "an internal error; see the log of the server", request.url.path)
