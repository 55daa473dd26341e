"""A page for the local user: served on loopback under a secret path until the user has finished."""

from __future__ import annotations

import json
import re
import secrets
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from metric_base.errors import InputError, Unquoted

#: Maximum size of a request in bytes: ten thousand corners.
MOST_BYTES = 1 << 20
#: How long a request may take to arrive.
REQUEST_SECONDS = 30.0
#: How often the server looks whether it shall end.
POLL_SECONDS = 0.05
LOOPBACK = "127.0.0.1"


class LocalPage(ABC):
    """Server of a page; subclasses implement `answer` and `receive`.

    url : address of the page; its secret part excludes other users of the machine and other pages.
    """

    def __init__(self, option: str, port: int = 0) -> None:
        """Option : that names the port, in messages; port : 0 takes a free one. Raises InputError for one in use."""
        self._finished, self._is_last = threading.Event(), False
        self._secret = secrets.token_urlsafe(12)
        try:
            self._server = _QuietServer((LOOPBACK, port), _handler(self))
        except OSError as error:
            raise InputError.at(option, "port", "one that is free", Unquoted(error.strerror or str(port))) from None
        self._server.daemon_threads = True
        self.url = f"http://{LOOPBACK}:{self._server.server_address[1]}/{self._secret}/"

    def serve(self) -> None:
        """Serve until the person is done."""
        thread = threading.Thread(target=self._server.serve_forever, args=(POLL_SECONDS,), daemon=True)
        thread.start()
        try:
            while not self._finished.wait(0.2):  # a wait without a limit would block Ctrl-C
                continue
        finally:
            self._server.shutdown()
            self._server.server_close()

    def finish(self) -> None:
        """End the page with the request at hand, when its answer is sent: the program may be gone a moment later."""
        self._is_last = True

    def end_if_last(self) -> None:
        """End the page if the request that was just answered is the last one."""
        if self._is_last:
            self._finished.set()

    @abstractmethod
    def answer(self, path: str) -> tuple[str, bytes] | None:
        """Content type and body for a path below the secret one, or None."""

    @abstractmethod
    def receive(self, path: str, body: bytes) -> tuple[int, dict[str, Any]] | None:
        """Take what the page sends to a path; status and words of the answer, or None where there is no such path."""

    def below(self, path: str, host: str | None) -> str | None:
        """The path below the secret one, None where the request is not for this page."""
        port = self._server.server_address[1]
        if host not in {
            f"{LOOPBACK}:{port}",
            f"localhost:{port}",
        }:  # the host name of another site that resolves to this machine
            return None
        prefix = f"/{self._secret}/"
        return path[len(prefix) :] if path.startswith(prefix) else None


class _QuietServer(ThreadingHTTPServer):
    """A server that ignores connections that a browser closes."""

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Let the connection go: the terminal is for the person."""


def is_count(text: str) -> bool:
    """Return True if a text is a number of few digits."""
    return re.fullmatch(r"[0-9]{1,12}", text) is not None


def _handler(page: LocalPage) -> Callable[..., BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        timeout = REQUEST_SECONDS

        def do_GET(self) -> None:
            path = page.below(self.path, self.headers.get("Host"))
            answer = None if path is None else page.answer(path)
            if answer is None:
                self._send(404, "text/plain", b"no such page")
            else:
                self._send(200, *answer)

        def do_POST(self) -> None:
            path = page.below(self.path, self.headers.get("Host"))
            length = self.headers.get("Content-Length", "")
            known = path is not None and is_count(length) and int(length) <= MOST_BYTES
            answer = page.receive(path or "", self.rfile.read(int(length))) if known else None
            status, words = (404, {"error": "no such page"}) if answer is None else answer
            try:
                self._send(status, "application/json", json.dumps(words).encode())
            finally:
                page.end_if_last()

        def _send(self, status: int, kind: str, body: bytes) -> None:
            self.send_response(status)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(body)))
            self.send_header("Cache-Control", "no-store")
            self.send_header("X-Content-Type-Options", "nosniff")
            policy = "default-src 'self'; style-src 'unsafe-inline'; script-src 'unsafe-inline'"
            self.send_header("Content-Security-Policy", policy)
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_: Any) -> None:
            """The terminal is for the person."""

    return Handler
