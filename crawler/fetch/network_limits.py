"""Which addresses are public, and a resolver that answers with those alone.

The check is made on the answer that the connection uses. A name that is looked up twice may answer with a public
address the first time and with this machine's the second (DNS rebinding).

A bound on the headers of an answer; Twisted bounds the length of a line, and not how many there are.
"""

from __future__ import annotations

import ipaddress
from typing import TYPE_CHECKING, Any

from scrapy.core.downloader.handlers.http11 import HTTP11DownloadHandler, _LenientHTTP11ClientFactory
from scrapy.resolver import CachingThreadedResolver
from twisted.internet.error import DNSLookupError
from twisted.python.failure import Failure
from twisted.web._newclient import HEADER, STATUS, HTTP11ClientProtocol
from twisted.web.client import ResponseFailed

if TYPE_CHECKING:
    from scrapy.crawler import Crawler
    from twisted.internet.interfaces import IAddress

#: Names that the resolver refused in this process, which runs one crawl: Scrapy hands a resolver no crawler.
REFUSED: set[str] = set()
#: Networks that contain another address, or that no web host has, although they are global.
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
#: Servers themselves read 8 to 64 KiB of headers; no honest answer has more.
HEADER_BYTES = 256 * 1024


def is_public(address: str) -> bool:
    """Return True if an IP address is of the public internet and carries no other address inside."""
    parsed = ipaddress.ip_address(address.partition("%")[0])
    if not parsed.is_global or parsed.is_multicast or parsed.is_reserved:
        return False
    return not any(parsed.version == network.version and parsed in network for network in _NOT_PUBLIC)


def is_literal(host: str) -> bool:
    """Return True if a host is an IP address and no name."""
    try:
        ipaddress.ip_address(host.partition("%")[0])
    except ValueError:
        return False
    return True


class PublicResolver(CachingThreadedResolver):
    """Scrapy's resolver, which keeps its answers for the whole crawl, for public addresses alone."""

    def getHostByName(self, name: str, timeout: Any = ()) -> Any:  # noqa: N802 - Twisted's name
        """Return the address of a name as a Deferred that fails if the address is not public."""
        return super().getHostByName(name, timeout).addCallback(self._public, name)

    def _public(self, address: str, name: str) -> str:
        if not is_public(address):
            REFUSED.add(name)
            raise DNSLookupError(f"{name}: {address} is not public")
        return address


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
