"""Connections of the HTTP server with a time limit for the head of a request."""

from __future__ import annotations

import asyncio

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

#: Maximum time in seconds between the start of a connection, or the first byte of a further request, and the end of
#: the request's head.
MAX_HEAD_S = 10.0


class TimedProtocol(H11Protocol):  # type: ignore[misc]  # uvicorn is optional
    """HTTP/1.1 protocol of uvicorn that closes connections whose request head takes longer than `MAX_HEAD_S`."""

    _head_timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:
        """Start the time limit of the first request."""
        super().connection_made(transport)
        self._head_timer = self.loop.call_later(MAX_HEAD_S, self.timeout_keep_alive_handler)

    def data_received(self, data: bytes) -> None:
        """Parse data; stop the time limit at the end of a head, or start it for the next request."""
        super().data_received(data)
        if self.conn.their_state is not h11.IDLE:
            self._stop_head_timer()
        elif self._head_timer is None:
            self._head_timer = self.loop.call_later(MAX_HEAD_S, self.timeout_keep_alive_handler)

    def connection_lost(self, error: Exception | None) -> None:
        """Stop the time limit."""
        self._stop_head_timer()
        super().connection_lost(error)

    def _stop_head_timer(self) -> None:
        if self._head_timer is not None:
            self._head_timer.cancel()
            self._head_timer = None
