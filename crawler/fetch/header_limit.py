"""A bound on the headers of an answer; Twisted bounds the length of a line, and not how many there are."""

from __future__ import annotations

from typing import TYPE_CHECKING

from scrapy.core.downloader.handlers.http11 import HTTP11DownloadHandler, _LenientHTTP11ClientFactory
from twisted.python.failure import Failure
from twisted.web._newclient import HEADER, STATUS, HTTP11ClientProtocol
from twisted.web.client import ResponseFailed

if TYPE_CHECKING:
    from scrapy.crawler import Crawler
    from twisted.internet.interfaces import IAddress

__all__ = ["HEADER_BYTES", "HeaderLimitHandler"]

#: Servers themselves read 8 to 64 KiB of headers; no honest answer has more.
HEADER_BYTES = 256 * 1024


class HeaderLimitHandler(HTTP11DownloadHandler):
    """Scrapy's download handler, whose connections end where the headers of an answer are too long."""

    def __init__(self, crawler: Crawler) -> None:
        super().__init__(crawler)
        self._pool._factory = HeaderLimitFactory


class HeaderLimitFactory(_LenientHTTP11ClientFactory):
    """Builds connections that count the bytes of headers."""

    def buildProtocol(self, addr: IAddress | None) -> HTTP11ClientProtocol:  # noqa: N802 - Twisted's name
        """A connection with the bound."""
        connection = super().buildProtocol(addr)
        received, parser = connection.dataReceived, None
        count = 0

        def receive(data: bytes) -> None:
            nonlocal count, parser
            if connection._parser is not parser:  # of the next answer on this connection
                count, parser = 0, connection._parser
            if parser is not None and parser.state in (STATUS, HEADER):
                count += len(data)
                if count > HEADER_BYTES + len(data):  # the last piece may hold the body's beginning
                    connection._giveUp(Failure(ResponseFailed([Failure(ValueError("too many headers"))])))
                    return
            received(data)

        connection.dataReceived = receive
        return connection
