"""The HTTP application: the routes of every release, the scale of objects, images and the description of the server."""

from __future__ import annotations

import asyncio
import hashlib
import json
import logging
import re
import shutil
import time
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from urllib.parse import urlsplit

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.middleware.cors import CORSMiddleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.routing import Mount, Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from explorer.catalogue import ReleaseCatalogue
from explorer.pages.node_page import node_page
from explorer.queries import search_response
from explorer.route import MEDIA_TYPES
from explorer.route import Route as Address
from explorer.routes import find_route
from explorer.schemas import SearchQuery
from explorer.server.delivery import HEADERS, CompressionMiddleware, file_response, problem
from explorer.server.scale_jobs import ScaleJobs, ServiceUnavailable
from explorer.urls import page_of, slug
from metric_base.errors import InputError
from metric_base.files import write_whole
from metric_base.folders import taxonomy_directory
from metric_tree.node import Node, NoPrior, UnknownName
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

#: Addresses of tables of all nodes, which `ReleaseServer.prepare` writes once for each release.
PREPARED = ("index.html", "assets/names.js", "assets/sizes.js", "tree.html", "v1/sizes.csv", "v1/sizes.parquet")

_JSON = MEDIA_TYPES["json"]
_IMAGE = re.compile(rf"{FOLDER}/[0-9a-f]{{2}}/[0-9a-f]{{64}}\.(?:webp|jpg|png)")

log = logging.getLogger("metric-tree.serve")


class ReleaseServer:
    """A release of a server, with the files of its pages and the processes that estimate scales.

    The files are those of the static site. They are written to a folder of `files` when they are first requested, and
    remain there for the next server of the same release and the same program.
    """

    def __init__(self, catalogue: ReleaseCatalogue, files: Path) -> None:
        self.catalogue = catalogue
        self.version = catalogue.tree.version
        self.folder = files / f"{self.version}-{content_digest(catalogue)}"
        self.jobs = ScaleJobs(catalogue.tree.release.directory)
        self.routes = [
            Route("/v1/scale", self.scale, methods=["POST"]),
            Route("/{path:path}", self.get),
        ]

    def prepare(self) -> None:
        """Write the tables of all nodes, render a category and search once, so that no request waits for them.

        Folders of the same version of other programs are removed.
        """
        for folder in self.folder.parent.glob(f"{self.version}-*"):
            if folder != self.folder:
                shutil.rmtree(folder, ignore_errors=True)
        category = max(self.catalogue.nodes.values(), key=lambda node: node.level)
        node_page(self.catalogue, category)
        for address in (*PREPARED, page_of(self.catalogue.tree.root.node_id)):
            if (found := find_route(self.catalogue, address)) is not None:
                self.file(*found)
        search_response(self.catalogue, SearchQuery(f"how tall is a {category.name}"))

    async def get(self, request: Request) -> Response:
        """Return the content of a route, or an image."""
        address = request.path_params["path"]
        if _IMAGE.fullmatch(address):
            file = stored_file(self.catalogue.tree.release.directory, address)
            if file is None:
                return _nothing(request)
            max_age = f"public, max-age={IMAGE_MAX_AGE_S}"
            return file_response(request, file, MEDIA_TYPES[file.suffix[1:]], **{"cache-control": max_age})
        if address == "v1/scale":
            raise HTTPException(405, headers={"allow": "POST"})
        if address == "" or address.endswith("/"):
            address += "index.html"
        found = find_route(self.catalogue, address)
        if found is None:
            return _nothing(request)
        route, text, value = found
        query = route.parse_query(request.query_params)
        if route.is_static and not request.query_params:
            file = await run_in_threadpool(self.file, route, text, value)
            return _nothing(request) if file is None else file_response(request, file, route.media_type)
        render = partial(route.content, self.catalogue, value, query)
        # in another thread, unless rendering takes less time than that
        rendered = render() if route.is_quick else await run_in_threadpool(render)
        if rendered is None:
            return _nothing(request)
        return Response(rendered, headers={**HEADERS, "content-type": route.media_type})

    def file(self, route: Address, text: str, value: Any) -> Path | None:
        """Return the file with the content of a route, written if it does not exist; None without content."""
        name = slug(value.node_id) if isinstance(value, Node) else text
        file = self.folder / route.path.replace(f"{{{route.parameter}}}", name)
        if not file.is_file():
            rendered = route.content(self.catalogue, value)
            if rendered is None:
                return None
            file.parent.mkdir(parents=True, exist_ok=True)
            write_whole(file, rendered)
        return file

    async def scale(self, request: Request) -> Response:
        """Return the posterior of measured objects."""
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
        result = await self.jobs.result(bytes(body))
        return Response(result, media_type=_JSON, headers={"cache-control": "no-store"})


def content_digest(catalogue: ReleaseCatalogue) -> str:
    """Return a digest of the release and of the program that renders it, by the sizes and times of their files."""
    program = Path(__file__).parents[2]
    packages = [program / name for name in ("explorer", "metric_base", "metric_tree", "taxonomy")]
    files = [file for folder in (*packages, taxonomy_directory()) for file in folder.rglob("*.*")]
    files += catalogue.tree.release.directory.glob("*.*")
    states = [(str(file), file.stat()) for file in sorted(files) if "__pycache__" not in file.parts]
    text = "".join(f"{name} {state.st_size} {int(state.st_mtime)}\n" for name, state in states)
    return hashlib.sha256((text + ",".join(tree.version for tree in catalogue.others)).encode()).hexdigest()[:16]


def application(
    trees: Sequence[Tree], preload: bool = False, allowed_hosts: Sequence[str] = ("*",), files: Path | None = None
) -> ASGIApp:
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
    files : Path, optional
        Folder of rendered files, which is kept; by default a temporary folder.

    Raises
    ------
    InputError
        Two releases have the same version.
    """
    temporary = TemporaryDirectory(prefix="metric-tree-")  # removed with the application
    folder = files or Path(temporary.name)
    servers = [ReleaseServer(ReleaseCatalogue(trees, place), folder) for place in range(len(trees))]
    main, *others = servers

    @asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        if preload:
            await run_in_threadpool(main.prepare)
            main.jobs.preload()
        yield
        for server in servers:
            server.jobs.stop()
        temporary.cleanup()

    async def health(_: Request) -> Response:
        state = {"status": "ok", "releases": {server.version: server.catalogue.etag for server in servers}}
        return Response(json.dumps(state), media_type=_JSON, headers={"cache-control": "no-store"})

    handlers = {
        **dict.fromkeys(_STATUSES, _request_error),
        HTTPException: _http_error,
        ClientDisconnect: _disconnected,
        Exception: _internal_error,
    }
    mounted = [Mount(f"/releases/{server.version}", routes=server.routes) for server in others]
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
    middleware.append(Middleware(CompressionMiddleware))
    all_routes = [Route("/healthz", health), *mounted, *main.routes]
    return Starlette(routes=all_routes, middleware=middleware, exception_handlers=handlers, lifespan=lifespan)


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
                entry = {"method": scope["method"], "path": scope["path"][:500], **state, "seconds": seconds}
                log.info(json.dumps(entry))


#: HTTP status of the errors of a request; `NoPrior` is an `UnknownName`, so it is first.
_STATUSES: dict[type[Exception], int] = {NoPrior: 422, UnknownName: 404, InputError: 422, ServiceUnavailable: 503}


async def _request_error(request: Request, error: Exception) -> Response:
    status = next(status for kind, status in _STATUSES.items() if isinstance(error, kind))
    return problem(status, str(error), request.url.path, {"retry-after": str(RETRY_AFTER_S)} if status == 503 else None)


async def _http_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    path = request.url.path[:200]
    return problem(error.status_code, f"{request.method} {path}", path, dict(error.headers or {}))


def _nothing(request: Request) -> Response:
    path = request.url.path[:200]
    return problem(404, f"nothing is at {path}", path)


async def _disconnected(_: Request, __: Exception) -> Response:
    return Response(status_code=400)  # the client is gone and does not read it


async def _internal_error(request: Request, error: Exception) -> Response:
    log.error(json.dumps({"path": request.url.path[:500], "error": f"{type(error).__name__}: {error}"}))
    return problem(500, "an internal error; see the log of the server", request.url.path)
