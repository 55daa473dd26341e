"""An S3 server (moto) in a process of its own, and a proxy before it with errors, cut and slow answers."""

from __future__ import annotations

import http.client
import os
import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import pytest

from tests.support.processes import started

__all__ = ["faulty_proxy", "free_port", "s3_server", "wait_for_port"]

#: Maximum duration of the start of the server in seconds.
START_S = 120.0
#: Delay of a slow answer in seconds.
SLOW_S = 0.3


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def wait_for_port(port: int) -> None:
    end = time.monotonic() + START_S
    while True:
        try:
            socket.create_connection(("127.0.0.1", port), timeout=1).close()
        except OSError:
            assert time.monotonic() < end, "the S3 server has not started"
            time.sleep(0.05)
        else:
            return


@contextmanager
def s3_server(port: int | None = None) -> Iterator[int]:
    """Start the server on a port of loopback; the test is skipped if its packages are not installed."""
    pytest.importorskip("moto.server")
    pytest.importorskip("s3fs")
    port = port or free_port()
    words = [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)]
    # the server answers its own control page at this address, and logs each request
    with started(words, env=os.environ | {"MOTO_PORT": str(port)}, stderr=-3, stdout=-3) as process:
        try:
            wait_for_port(port)
            yield port
        finally:
            process.kill()


@contextmanager
def faulty_proxy(port: int, every: int) -> Iterator[tuple[int, list[str]]]:
    """Forward requests to a port; of `every` requests one is an error 500, one ends after half its body, one is slow.

    Yields
    ------
    tuple
        Port of the proxy, and the faults of the requests so far.
    """
    faults: list[str] = []
    count = threading.Lock()
    number = 0

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def log_message(self, *_: Any) -> None:
            pass

        def forward(self) -> None:
            nonlocal number
            with count:
                number += 1
                fault = {0: "error", every // 3: "cut", 2 * every // 3: "slow"}.get(number % every, "")
            body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
            if fault == "slow":
                faults.append(fault)
                time.sleep(SLOW_S)
            elif fault == "error":
                faults.append(fault)
                self.send_error(500)
                return
            connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
            connection.request(self.command, self.path, body, dict(self.headers))
            answer = connection.getresponse()
            content = answer.read()
            self.send_response_only(answer.status)
            for name, value in answer.getheaders():
                if name.lower() not in ("connection", "transfer-encoding", "content-length"):
                    self.send_header(name, value)
            length = answer.headers["Content-Length"] if self.command == "HEAD" else len(content)
            self.send_header("Content-Length", str(length or 0))
            self.end_headers()
            if fault == "cut" and self.command == "GET" and len(content) > 1:
                faults.append(fault)
                self.wfile.write(content[: len(content) // 2])
                self.close_connection = True
            elif self.command != "HEAD":
                self.wfile.write(content)
            connection.close()

        do_GET = do_PUT = do_HEAD = do_POST = do_DELETE = forward  # noqa: N815

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.daemon_threads = True
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield server.server_port, faults
    finally:
        server.shutdown()
        server.server_close()
