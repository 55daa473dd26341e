"""`metric-tree serve`: the explorer and its JSON over HTTP, or as tools of the Model Context Protocol."""

from __future__ import annotations

import argparse
import logging
import sys
from pathlib import Path

from metric_base.errors import InputError
from metric_tree.release.registry import cache_folder
from metric_tree.tree import open_tree

HELP = "Serve the explorer and its JSON over HTTP, or with --mcp as tools for agents over standard input and output."

#: Maximum time in seconds for active requests to finish after a stop.
GRACE_S = 10
#: Maximum number of connections and active requests; further ones receive status 503.
MAX_CONNECTIONS = 500
#: Names of this machine in the `Host` header, which pages of other sites cannot send (DNS rebinding).
LOCAL_HOSTS = ("localhost", "127.0.0.1", "[::1]")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the subcommand."""
    add = parser.add_argument
    add("--host", default="127.0.0.1", help="network address of the server (default: 127.0.0.1, only this machine)")
    add("--port", type=int, default=8000, help="port, 0 for a free port (default: 8000)")
    add("--tree", metavar="REF", action="append", help="release: version or folder; may be repeated (default: shipped)")
    add(
        "--allow-host",
        metavar="NAME",
        action="append",
        help="name of the server in the addresses of requests, *.example.org for subdomains; may be repeated "
        "(default: localhost, or any name if --host is not this machine)",
    )
    add("--prepare", action="store_true", help="write the tables of the pages to the cache and end, for an image")
    add("--mcp", action="store_true", help="serve the Model Context Protocol instead of HTTP")
    add("--quiet", action="store_true", help="do not log requests")


def run(arguments: argparse.Namespace) -> None:
    """Serve until the process is stopped."""
    if not 0 <= arguments.port <= 65535:
        raise InputError(f"--port: expected 0 to 65535; found {arguments.port}")
    trees = [open_tree(ref) for ref in arguments.tree or [None]]
    if arguments.mcp:
        from explorer.server.mcp_server import tool_server

        tool_server(trees).run("stdio")
        return
    import uvicorn

    from explorer.catalogue import ReleaseCatalogue
    from explorer.server.app import ReleaseServer, application
    from explorer.server.connections import TimedProtocol

    pages = cache_folder().with_name("pages")
    files: Path | None = pages
    try:
        pages.mkdir(parents=True, exist_ok=True)
    except OSError:  # a read-only system: a temporary folder
        files = None
    if arguments.prepare:
        if files is None:
            raise InputError(f"{pages}: expected a folder that can be written")
        for place in range(len(trees)):
            ReleaseServer(ReleaseCatalogue(trees, place), files).prepare()
        return
    is_local = arguments.host in {*LOCAL_HOSTS, "::1"}
    hosts = [*(arguments.allow_host or []), *LOCAL_HOSTS] if arguments.allow_host or is_local else ["*"]
    if odd := [host for host in hosts if host != "*" and "*" in host.removeprefix("*.")]:
        raise InputError(f"--allow-host: expected a name or *.NAME; found {odd[0]!r}")
    logging.basicConfig(
        stream=sys.stderr, level=logging.WARNING if arguments.quiet else logging.INFO, format="%(message)s"
    )
    uvicorn.run(
        application(trees, preload=True, allowed_hosts=hosts, files=files),
        host=arguments.host,
        port=arguments.port,
        access_log=False,
        server_header=False,
        log_level="info",
        timeout_graceful_shutdown=GRACE_S,
        limit_concurrency=MAX_CONNECTIONS,
        http=TimedProtocol,
        h11_max_incomplete_event_size=16_384,
    )
