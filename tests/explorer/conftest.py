"""One small release, its catalogue, its site and its server for all tests of the explorer."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
import uvicorn

from explorer.catalogue import ReleaseCatalogue
from explorer.server.app import application
from explorer.server.connections import TimedProtocol
from explorer.static_site import write_site
from metric_tree.tree import Tree, open_tree
from tests.synthetic import minitree

#: Patient on a slow machine, and without connections that the server may close meanwhile.
WEB = httpx.Client(timeout=300, limits=httpx.Limits(max_keepalive_connections=0))


def two_releases(folder: Path) -> list[Tree]:
    """A release, and an earlier one that lacks a node, has another name for one, and a size 20 % larger."""
    minitree.release(folder / "new", manifest=lambda fields: fields.update(version="0.0.2"))
    rows = minitree.rows()
    gone = "rat.n.01"
    for name in ("nodes.parquet", "priors.parquet", "items.parquet"):
        rows[name] = [row for row in rows[name] if row["node_id"] != gone]
    for row in rows["priors.parquet"]:
        if row["node_id"] == "mt:bar_stool":
            row["means"] = [[value + 0.2 for value in row["means"][0]]]
    for row in rows["nodes.parquet"]:
        if row["node_id"] == "trackball.n.01":
            row["name"] = "track ball"
    minitree.release(folder / "old", rows)
    return [open_tree(folder / "new"), open_tree(folder / "old")]


@pytest.fixture(scope="session")
def trees(tmp_path_factory: pytest.TempPathFactory) -> list[Tree]:
    return two_releases(tmp_path_factory.mktemp("releases"))


@pytest.fixture(scope="session")
def catalogue(trees: list[Tree]) -> ReleaseCatalogue:
    return ReleaseCatalogue(trees)


@pytest.fixture(scope="session")
def site(trees: list[Tree], tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("site") / "site"
    write_site(out, trees, workers=1)
    return out


@pytest.fixture(scope="session")
def base(trees: list[Tree]) -> Iterator[str]:
    """The address of a running server."""
    with running(trees) as address:
        yield address


class running:  # noqa: N801 - a context manager
    """A server in a thread, on a free port."""

    def __init__(self, trees: list[Tree]) -> None:
        config = uvicorn.Config(
            application(trees), port=0, http=TimedProtocol, log_level="error", timeout_graceful_shutdown=30
        )
        self._server = uvicorn.Server(config)
        self._thread = threading.Thread(target=self._server.run, daemon=True)

    def __enter__(self) -> str:
        self._thread.start()
        until = time.monotonic() + 120
        while not self._server.started:
            assert self._thread.is_alive(), "the server ended before it was ready"
            assert time.monotonic() < until, "the server is not ready after 120 s"
            time.sleep(0.01)
        return f"http://127.0.0.1:{self._server.servers[0].sockets[0].getsockname()[1]}"

    def __exit__(self, *_: object) -> None:
        self._server.should_exit = True
        self._thread.join(120)
        assert not self._thread.is_alive(), "the server has not ended after 120 s"
