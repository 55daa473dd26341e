"""Files that a server of this machine gives slowly, in pieces, so that a kill meets a download."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import TracebackType

__all__ = ["SlowFiles"]

PIECES = 5


class SlowFiles:
    """A running server; use it as a context manager. `base` is its address.

    files : bytes by name; seconds : how long each takes.
    """

    def __init__(self, files: Mapping[str, bytes], seconds: float) -> None:
        self.files = dict(files)
        self.seconds = seconds

    def __enter__(self) -> SlowFiles:
        self._server = ThreadingHTTPServer(("127.0.0.1", 0), _handler(self))
        self.base = f"http://127.0.0.1:{self._server.server_address[1]}"
        threading.Thread(target=self._server.serve_forever, daemon=True).start()
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._server.shutdown()
        self._server.server_close()


def _handler(site: SlowFiles) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            data = site.files.get(self.path.lstrip("/"))
            self.send_response(404 if data is None else 200)
            self.send_header("Content-Length", str(len(data or b"")))
            self.end_headers()
            step = -(-len(data or b"") // PIECES) or 1
            for start in range(0, len(data or b""), step):
                time.sleep(site.seconds / PIECES)
                try:
                    self.wfile.write((data or b"")[start : start + step])
                except OSError:  # the other side was killed
                    return

        def log_message(self, *_: object) -> None:
            """Say nothing."""

    return Handler
