"""Serve a page to the local user, on loopback under a secret path, until the user has finished."""

from __future__ import annotations

import json
import re
import secrets
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from metric_base.errors import InputError, Unquoted

#: Maximum size of a request in bytes, enough for ten thousand corners.
MAX_BYTES = 1 << 20
#: Maximum duration of the transfer of a request.
REQUEST_SECONDS = 30.0
#: Interval at which the server checks whether to end.
POLL_SECONDS = 0.05
LOOPBACK = "127.0.0.1"


class LocalPage(ABC):
    """Server of a page; subclasses implement `answer` and `receive`.

    Parameters
    ----------
    option : str
        Option of the port, for messages.
    port : int
        Port; 0 for any free one.

    Attributes
    ----------
    url : str
        Address of the page; its secret part excludes other users of the machine and other pages.

    Raises
    ------
    InputError
        The port is in use.
    """

    def __init__(self, option: str, port: int = 0) -> None:
        self._finished, self._is_last = threading.Event(), False
        self._secret = secrets.token_urlsafe(12)
        try:
            self._server = _QuietServer((LOOPBACK, port), _handler(self))
        except OSError as error:
            raise InputError.at(option, "port", "one that is free", Unquoted(error.strerror or str(port))) from None
        self._server.daemon_threads = True
        self.url = f"http://{LOOPBACK}:{self._server.server_address[1]}/{self._secret}/"

    def serve(self) -> None:
        """Serve the page until the user has finished."""
        threading.Thread(target=self._server.serve_forever, args=(POLL_SECONDS,), daemon=True).start()
        try:
            while not self._finished.wait(0.2):  # a wait without a limit would block Ctrl-C
                continue
        finally:
            self._server.shutdown()
            self._server.server_close()

    def finish(self) -> None:
        """End the server after the response to the current request, because the program may end at once."""
        self._is_last = True

    def end_if_last(self) -> None:
        """End the server if the last response has been sent."""
        if self._is_last:
            self._finished.set()

    @abstractmethod
    def answer(self, path: str) -> tuple[str, bytes] | None:
        """Return content type and body of a path below the secret one, or None."""

    @abstractmethod
    def receive(self, path: str, body: bytes) -> tuple[int, dict[str, Any]] | None:
        """Process a request of the page; return the status and the JSON of the response, or None for unknown paths."""

    def below(self, path: str, host: str | None) -> str | None:
        """Return the path below the secret one; None if the request is not for this page."""
        port = self._server.server_address[1]
        if host not in {f"{LOOPBACK}:{port}", f"localhost:{port}"}:  # another name that resolves to this machine
            return None
        prefix = f"/{self._secret}/"
        return path[len(prefix) :] if path.startswith(prefix) else None


class _QuietServer(ThreadingHTTPServer):
    """A server that ignores connections that a browser closes."""

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore the error instead of printing it to the terminal."""


def is_count(text: str) -> bool:
    """Return True if a text is a number of few digits."""
    return re.fullmatch(r"[0-9]{1,12}", text) is not None


def json_answer(record: Mapping[str, Any]) -> tuple[str, bytes]:
    """Return content type and body of a record."""
    return "application/json", json.dumps(record).encode()


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
            known = path is not None and is_count(length) and int(length) <= MAX_BYTES
            answer = page.receive(path or "", self.rfile.read(int(length))) if known else None
            status, words = (404, {"error": "no such page"}) if answer is None else answer
            try:
                self._send(status, *json_answer(words))
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
            """Print no requests to the terminal."""

    return Handler
