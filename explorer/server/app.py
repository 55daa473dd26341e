"""The HTTP application: the files of the site at their addresses, and the questions that no file answers."""

from __future__ import annotations

import hashlib
import json
import logging
import re
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from contextlib import asynccontextmanager
from functools import partial
from importlib.resources import files

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from explorer.catalogue import ReleaseCatalogue
from explorer.responses import asked_items, asked_prior, asked_search, numbers
from explorer.routes import Answer, answer
from explorer.server.delivery import Delivered, Shelf, problem, response_of
from explorer.server.openapi import description
from explorer.server.scale_jobs import Busy, ScaleJobs
from explorer.urls import slug
from metric_base.errors import InputError
from metric_tree.node import NoPrior, UnknownName
from metric_tree.prior import QUANTILES
from metric_tree.release.images import FOLDER, stored_file
from metric_tree.tree import Tree

#: Bytes of a request's body: 500 objects take some 100 kB.
MOST_BODY = 1_000_000

#: Seconds for which an image, whose name is its content, is kept.
PICTURE_S = 31_536_000

_JSON = "application/json"
_NODE = re.compile(r"v1/nodes/(?P<id>.+?)(?:/(?P<what>prior|items|images))?(?:\.json)?$")
_PICTURE = re.compile(rf"{FOLDER}/[0-9a-f]{{2}}/[0-9a-f]{{64}}\.(?:webp|jpg|png)")
_RELEASE = re.compile(r"releases/(?P<version>[^/]+)/(?P<rest>.*)")

log = logging.getLogger("metric-tree.serve")


class Explorer:
    """The releases of a server, its ready answers and its computing processes."""

    def __init__(self, trees: Sequence[Tree]) -> None:
        self.catalogues = {tree.version: ReleaseCatalogue(trees, place) for place, tree in enumerate(trees)}
        self.main = self.catalogues[trees[0].version]
        self.jobs = {version: ScaleJobs(one.tree.release.directory) for version, one in self.catalogues.items()}
        self.shelf = Shelf()
        self.edition = _edition()

    def place(self, path: str) -> tuple[ReleaseCatalogue, str] | None:
        """The release that an address is of, and the address in it."""
        if (match := _RELEASE.fullmatch(path)) is None:
            return self.main, path
        catalogue = self.catalogues.get(match["version"])
        return None if catalogue is None or catalogue is self.main else (catalogue, match["rest"])

    async def get(self, request: Request) -> Response:
        """A page, a file, or the answer to a question."""
        path = request.path_params["path"]
        if path == "openapi.json":
            return await self._made(request, self.main, path, partial(description, self.main))
        placed = self.place(path)
        if placed is None:
            return problem(404, f"no release is served at /{path[:200]}", request.url.path)
        catalogue, address = placed
        if address == "v1/search":
            return await self._search(request, catalogue)
        if _PICTURE.fullmatch(address):
            return self._picture(request, catalogue, address)
        if address.startswith("v1/nodes/"):
            return await self._node(request, catalogue, address)
        if address in {"v1/releases"} or (
            re.fullmatch(r"v1/vocabularies/[\w.-]+", address) and not address.endswith(".json")
        ):
            address += ".json"
        address = f"{address}index.html" if address == "" or address.endswith("/") else address
        return await self._file(request, catalogue, address)

    async def scale(self, request: Request) -> Response:
        """The posterior of measured objects."""
        placed = self.place(request.url.path.lstrip("/"))
        if placed is None:
            return problem(404, "no such release is served", request.url.path)
        if "json" not in request.headers.get("content-type", ""):
            return problem(415, "content-type: expected application/json", request.url.path)
        body = bytearray()
        async for piece in request.stream():
            body += piece
            if len(body) > MOST_BODY:
                return problem(413, f"body: expected at most {MOST_BODY:,} bytes", request.url.path)
        made = await self.jobs[placed[0].tree.version].answer(bytes(body))
        return Response(made, media_type=_JSON, headers={"cache-control": "no-store"})

    async def health(self, _: Request) -> Response:
        """That the server answers, and for which releases."""
        releases = {version: one.etag for version, one in self.catalogues.items()}
        return Response(
            json.dumps({"status": "ok", "releases": releases}), media_type=_JSON, headers={"cache-control": "no-store"}
        )

    async def _search(self, request: Request, catalogue: ReleaseCatalogue) -> Response:
        _see_parameters(request, {"q", "limit"})
        query, limit = request.query_params.get("q", ""), request.query_params.get("limit", "10")
        if not limit.isascii() or not limit.isdigit() or len(limit) > 6:
            raise InputError(f"limit: expected a number; found {limit[:40]!r}")
        key = ("search", query, int(limit))
        return await self._made(request, catalogue, key, partial(asked_search, catalogue, query, int(limit)))

    async def _node(self, request: Request, catalogue: ReleaseCatalogue, address: str) -> Response:
        """A node's JSON by its id or slug, with or without `.json`; with parameters a question about it."""
        if address.endswith((".csv", ".parquet")):
            return await self._file(request, catalogue, address)
        match = _NODE.fullmatch(address)
        if match is None:
            return problem(404, f"nothing is at /{address[:200]}", request.url.path)
        node, what = catalogue.node(match["id"]), match["what"]
        asked = request.query_params
        if what == "prior" and asked:
            _see_parameters(request, {"dims", "where", "quantiles", "q", "density_at"})
            dims = tuple(dim.strip() for dim in asked.get("dims", "").split(",") if dim.strip())
            text = asked.get("quantiles", asked.get("q"))
            quantiles = QUANTILES if text is None else tuple(numbers(text, "quantiles"))
            sizes = tuple(numbers(asked.get("density_at", ""), "density_at"))
            where = asked.get("where") or None
            question = partial(asked_prior, catalogue, node, dims, where, quantiles, sizes)
            key = (node.node_id, dims, where, quantiles, sizes)
            return await self._made(request, catalogue, key, question, quick=True)
        if what == "items" and asked:
            _see_parameters(request, {"cursor", "page"})
            made = await run_in_threadpool(asked_items, catalogue, node, asked.get("cursor") or asked.get("page"))
            if made is None:
                return problem(404, "cursor: no such page", request.url.path)
            return response_of(request, Delivered(Answer(made, _JSON)), self._etag(catalogue))
        _see_parameters(request, set())
        return await self._file(request, catalogue, f"v1/nodes/{slug(node.node_id)}{f'/{what}' if what else ''}.json")

    async def _file(self, request: Request, catalogue: ReleaseCatalogue, address: str) -> Response:
        key, etag = (catalogue.tree.version, address), self._etag(catalogue)
        found = self.shelf.get(key)
        if found is None:
            made = await run_in_threadpool(answer, catalogue, address)
            if made is None:
                return problem(404, f"nothing is at /{address[:200]}", request.url.path)
            found = Delivered(made)
            self.shelf.put(key, found)
        return response_of(request, found, etag)

    async def _made(
        self,
        request: Request,
        catalogue: ReleaseCatalogue,
        what: object,
        question: Callable[[], bytes],
        quick: bool = False,
    ) -> Response:
        """The answer to a question, from the shelf where it was asked before.

        quick : whether it takes less time than the way to another thread and back
        """
        key = (catalogue.tree.version, what)
        found = self.shelf.get(key)
        if found is None:
            found = Delivered(Answer(question() if quick else await run_in_threadpool(question), _JSON))
            self.shelf.put(key, found)
        return response_of(request, found, self._etag(catalogue))

    def _picture(self, request: Request, catalogue: ReleaseCatalogue, address: str) -> Response:
        path = stored_file(catalogue.tree.release.directory, address)
        if path is None:
            return problem(404, f"nothing is at /{address}", request.url.path)
        kind = {"webp": "image/webp", "jpg": "image/jpeg", "png": "image/png"}[path.suffix[1:]]
        return response_of(request, Delivered(Answer(path.read_bytes(), kind)), path.stem, PICTURE_S)

    def _etag(self, catalogue: ReleaseCatalogue) -> str:
        return f"{catalogue.etag}-{self.edition}"


def application(trees: Sequence[Tree], warm: bool = False) -> ASGIApp:
    """The application of releases, the first at the root, each other under `/releases/VERSION/`.

    warm : whether the processes that compute scales of the first release start with it, rather than when they are asked

    Raises
    ------
    InputError
        Two releases have one version.
    """
    if len({tree.version for tree in trees}) != len(trees):
        raise InputError(
            f"--tree: expected releases of different versions; found {', '.join(t.version for t in trees)}"
        )
    explorer = Explorer(trees)

    @asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        if warm:
            explorer.jobs[explorer.main.tree.version].warm()
        yield
        for jobs in explorer.jobs.values():
            jobs.stop()

    routes = [
        Route("/healthz", explorer.health),
        Route("/v1/scale", explorer.scale, methods=["POST"]),
        Route("/releases/{version}/v1/scale", explorer.scale, methods=["POST"]),
        Route("/{path:path}", explorer.get),
    ]
    return Logged(Starlette(routes=routes, exception_handlers=_HANDLERS, lifespan=lifespan))


class Logged:
    """A line of JSON for each request: method, path, status, seconds, bytes."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, then log; a preflight of another origin is answered with what it may do."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        if scope["method"] == "OPTIONS":
            await _preflight()(scope, receive, send)
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


def _preflight() -> Response:
    allowed = {
        "access-control-allow-origin": "*",
        "access-control-allow-methods": "GET, HEAD, OPTIONS",
        "allow": "GET, HEAD, OPTIONS",
    }
    return Response(status_code=204, headers={**allowed, "access-control-max-age": "86400"})


async def _unknown(request: Request, error: Exception) -> Response:
    return problem(404, str(error), request.url.path)


async def _invalid(request: Request, error: Exception) -> Response:
    return problem(422, str(error), request.url.path)


async def _busy(request: Request, error: Exception) -> Response:
    return problem(503, str(error), request.url.path, {"retry-after": "5"})


async def _http(request: Request, error: Exception) -> Response:
    status = error.status_code if isinstance(error, HTTPException) else 500
    headers = dict(error.headers or {}) if isinstance(error, HTTPException) else {}
    return problem(status, f"{request.method} {request.url.path[:200]}", request.url.path[:200], headers)


async def _gone(_: Request, __: Exception) -> Response:
    return Response(status_code=400)  # nobody reads it


async def _internal(request: Request, error: Exception) -> Response:
    log.error(json.dumps({"path": request.url.path[:500], "error": f"{type(error).__name__}: {error}"}))
    return problem(500, "an internal error; the server's log has it", request.url.path)


_HANDLERS: dict[type[Exception], Callable[[Request, Exception], Awaitable[Response]]] = {
    HTTPException: _http,
    NoPrior: _invalid,
    UnknownName: _unknown,
    InputError: _invalid,
    Busy: _busy,
    ClientDisconnect: _gone,
    Exception: _internal,
}


def _see_parameters(request: Request, known: set[str]) -> None:
    """InputError for a parameter that the address does not take: a typing error would be lost in silence."""
    for name in request.query_params:
        if name not in known:
            takes = ", ".join(sorted(known)) or "none"
            raise InputError(f"{name[:40]!r}: expected a parameter that this address takes ({takes})")


def _edition() -> str:
    """A name of the pages' own content: templates, scripts, styles."""
    digest = hashlib.sha256()
    for folder in ("templates", "assets"):
        for entry in sorted(files("explorer.pages").joinpath(folder).iterdir(), key=lambda entry: entry.name):
            digest.update(entry.read_bytes())
    return digest.hexdigest()[:8]
