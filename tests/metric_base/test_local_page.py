"""A page on loopback that ends with its last request."""

from __future__ import annotations

import http.client
import threading
from typing import Any
from urllib.parse import urlsplit

from metric_base.local_page import LocalPage


class _Page(LocalPage):
    """End with the request; `is_served` is whether the page is still served before the response."""

    def __init__(self) -> None:
        super().__init__("--page")
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
