"""Limits of network access: only public addresses, the delay of a site over all workers, and the size of headers.

The resolver checks the address that the connection uses, because a second lookup of a name may return another address
(DNS rebinding). Twisted limits the length of a header line, but not the number of lines.
"""

from __future__ import annotations

import ipaddress
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from scrapy.core.downloader.handlers.http11 import HTTP11DownloadHandler, _LenientHTTP11ClientFactory
from scrapy.resolver import CachingThreadedResolver
from scrapy.utils.defer import maybe_deferred_to_future
from twisted.internet.error import DNSLookupError
from twisted.internet.task import deferLater
from twisted.python.failure import Failure
from twisted.web._newclient import HEADER, STATUS, HTTP11ClientProtocol
from twisted.web.client import ResponseFailed

if TYPE_CHECKING:
    from scrapy import Request
    from scrapy.crawler import Crawler
    from scrapy.http import Response
    from twisted.internet.interfaces import IAddress

    from crawler.fetch.frontier import Frontier

#: Names that the resolver refused in this process, which runs one crawl; Scrapy passes no crawler to a resolver.
REFUSED: set[str] = set()
#: Global networks whose addresses contain another address or are not used by web hosts.
_NOT_PUBLIC = [
    ipaddress.ip_network(text)
    for text in (
        "::/96",  # IPv4-compatible, deprecated (RFC 4291, 2.5.5.1)
        "::ffff:0:0/96",  # IPv4-mapped (RFC 4291, 2.5.5.2)
        "64:ff9b::/96",  # NAT64 (RFC 6052)
        "64:ff9b:1::/48",  # NAT64 for local use (RFC 8215)
        "2001::/32",  # Teredo (RFC 4380)
        "2002::/16",  # 6to4 (RFC 3056)
        "fec0::/10",  # site-local, deprecated (RFC 3879)
        "192.88.99.0/24",  # relays of 6to4 (RFC 7526)
    )
]
#: Maximum size of the headers of a response in bytes; servers accept 8 to 64 KiB.
HEADER_BYTES = 256 * 1024


def is_public(address: str) -> bool:
    """Return True if an IP address is public and contains no other address."""
    parsed = ipaddress.ip_address(address.partition("%")[0])
    if not parsed.is_global or parsed.is_multicast or parsed.is_reserved:
        return False
    return not any(parsed.version == network.version and parsed in network for network in _NOT_PUBLIC)


def is_literal(host: str) -> bool:
    """Return True if a host is an IP address instead of a name."""
    try:
        ipaddress.ip_address(host.partition("%")[0])
    except ValueError:
        return False
    return True


class PublicResolver(CachingThreadedResolver):
    """Caching resolver of Scrapy that accepts only public addresses."""

    def getHostByName(self, name: str, timeout: Any = ()) -> Any:  # noqa: N802 - Twisted's name
        """Return the address of a name as a Deferred that fails if the address is not public."""
        return super().getHostByName(name, timeout).addCallback(self._public, name)

    def _public(self, address: str, name: str) -> str:
        if not is_public(address):
            REFUSED.add(name)
            raise DNSLookupError(f"{name}: {address} is not public")
        return address


class LimitedHandler(HTTP11DownloadHandler):
    """Download handler of Scrapy that waits for the other workers, and closes connections with too long headers.

    The delay of Scrapy has passed before, so that the workers together respect it, too.
    """

    def __init__(self, crawler: Crawler) -> None:
        super().__init__(crawler)
        self._pool._factory = HeaderLimitFactory
        self._frontier: Frontier = crawler.frontier
        self._delay = crawler.settings.getfloat("DOWNLOAD_DELAY")

    async def download_request(self, request: Request) -> Response:
        """Download a request at the moment that the frontier reserves for it."""
        from twisted.internet import reactor

        if self._delay and (seconds := self._frontier.reserve(urlsplit(request.url).hostname or "", self._delay)) > 0:
            await maybe_deferred_to_future(deferLater(reactor, seconds))
        return await super().download_request(request)


class HeaderLimitFactory(_LenientHTTP11ClientFactory):
    """Factory of connections that count the bytes of headers."""

    def buildProtocol(self, addr: IAddress | None) -> HTTP11ClientProtocol:  # noqa: N802 - Twisted's name
        """Return a connection with the limit."""
        connection = super().buildProtocol(addr)
        received, parser = connection.dataReceived, None
        count = 0

        def receive(data: bytes) -> None:
            nonlocal count, parser
            if connection._parser is not parser:  # the next response of this connection
                count, parser = 0, connection._parser
            if parser is not None and parser.state in (STATUS, HEADER):
                count += len(data)
                if count > HEADER_BYTES + len(data):  # the last piece may contain the start of the body
                    connection._giveUp(Failure(ResponseFailed([Failure(ValueError("too many headers"))])))
                    return
            received(data)

        connection.dataReceived = receive
        return connection
