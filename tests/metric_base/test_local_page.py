"""A page on loopback that ends with its last request."""

from __future__ import annotations

import http.client
import socket
import threading
from typing import Any
from urllib.parse import urlsplit

import pytest

from metric_base.errors import InputError
from metric_base.local_page import LocalPage


class _Page(LocalPage):
    """End with the request; `is_served` is whether the page is still served before the response."""

    def __init__(self, port: int = 0) -> None:
        super().__init__("--page", port)
        self.thread = threading.Thread(target=self.serve, daemon=True)
        self.is_served = False

    def answer(self, path: str) -> tuple[str, bytes] | None:
        return ("text/plain", b"here") if path == "" else None

    def receive(self, path: str, body: bytes) -> tuple[int, dict[str, Any]] | None:
        self.finish()
        self.thread.join(1)  # a page that ended here would let the program go before the answer
        self.is_served = self.thread.is_alive()
        return 200, {"got": body.decode(), "at": path}


def test_a_page_ends_after_its_last_answer() -> None:
    page = _Page()
    page.thread.start()
    url = urlsplit(page.url)
    connection = http.client.HTTPConnection(str(url.hostname), url.port, timeout=120)
    connection.request("POST", f"{url.path}done", body="x")
    answer = connection.getresponse()
    assert (answer.status, answer.read()) == (200, b'{"got": "x", "at": "done"}')
    page.thread.join(120)
    assert (page.is_served, page.thread.is_alive()) == (True, False)


def test_a_port_that_is_in_use_is_an_error_of_the_option() -> None:
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        server.listen()
        with pytest.raises(InputError, match="--page: port: expected one that is free, found Address already in use"):
            _Page(server.getsockname()[1])


@pytest.mark.parametrize(
    ("host", "path", "below"),
    [("localhost", "a", "a"), ("127.0.0.1", "a", "a"), ("evil.example", "a", None), ("localhost", "../a", None)],
)
def test_only_requests_for_the_page_are_answered(host: str, path: str, below: str | None) -> None:
    page = _Page()
    url = urlsplit(page.url)
    asked = f"{url.path}{path}" if path == "a" else "/other/a"
    assert page.below(asked, f"{host}:{url.port}") == below
    assert page.below(asked, host) is None
    page._server.server_close()


class _Form(_Page):
    def receive(self, path: str, body: bytes) -> tuple[int, dict[str, Any]] | None:
        return 200, {"at": path, "bytes": len(body)}


@pytest.mark.parametrize(("length", "status"), [("1048576", 200), ("1048577", 404), ("1e3", 404)])
def test_a_request_has_at_most_a_megabyte(length: str, status: int) -> None:
    page = _Form()
    page.thread.start()
    url = urlsplit(page.url)
    connection = http.client.HTTPConnection(str(url.hostname), url.port, timeout=120)
    connection.putrequest("POST", f"{url.path}done")
    connection.putheader("Content-Length", length)
    connection.endheaders(b"x" * int(length) if status == 200 else None)
    assert connection.getresponse().status == status
    page.finish()
    page.end_if_last()
    page.thread.join(120)
    assert not page.thread.is_alive()


def test_a_page_is_found_below_its_secret_path_only() -> None:
    page = _Form()
    page.thread.start()
    url = urlsplit(page.url)
    statuses = []
    for path in (url.path, f"{url.path}none", "/other/"):
        connection = http.client.HTTPConnection(str(url.hostname), url.port, timeout=120)
        connection.request("GET", path)
        statuses.append(connection.getresponse().status)
    assert statuses == [200, 404, 404]
    page.finish()
    page.end_if_last()
    page.thread.join(120)
