"""A synthetic web shop on loopback for tests and benchmarks of the crawl, with known sizes and with errors.

Every product page has one of several markups: an HTML table, a bullet list, a definition list, a German table or
schema.org data. Some pages have errors, which follow from the number of the page: a temporary or permanent server
error, a redirect, a link to another host, a duplicate under a tracking parameter, a page without a size or with the
size of the package only, a wrong encoding, deep nesting, a gzip bomb, an endless response, and a wrong content type.
Every page also links to an endless calendar.
"""

from __future__ import annotations

import gzip
import hashlib
import json
import socketserver
import struct
import threading
import time
import zlib
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from tests.synthetic.filler import filler

__all__ = ["FAULTS", "Shop", "SyntheticSite", "expected", "product_page"]

#: Pages with each error per 1,000 pages; the other pages have no error.
FAULTS = {
    "passing_503": 10, "passing_500": 15, "lasting_500": 5, "redirect": 15, "off_site": 8, "duplicate": 15,
    "no_size": 10, "package_only": 15, "latin1": 10, "deep": 8, "bomb": 4, "endless": 4, "lying_type": 6,
}  # fmt: skip

#: Header of a response whose body is repeated until the client closes the connection.
ENDLESS = "X-Endless"

#: Number of different images, which the products share.
PICTURES = 7

#: Number of products per listing.
PRODUCTS_PER_LISTING = 100


@dataclass(frozen=True, slots=True)
class Shop:
    """Number of products, page sizes in kB to draw from, whether pages have errors, and delay of a response in s."""

    products: int
    sizes: tuple[int, ...] = ()
    errors: bool = True
    delay: float = 0.0


def _draw(number: int, salt: str, modulus: int) -> int:
    return int.from_bytes(hashlib.sha256(f"{salt}{number}".encode()).digest()[:6]) % modulus


def error(number: int, shop: Shop) -> str | None:
    """Return the error of a product's page, or None."""
    drawn = _draw(number, "fault", 1000) if shop.errors else 1000
    for name, frequency in FAULTS.items():
        if drawn < frequency:
            return name
        drawn -= frequency
    return None


def size_mm(number: int) -> tuple[int, int, int]:
    """Return the true width, depth and height of a product in mm, multiples of 10."""
    return (200 + 10 * _draw(number, "w", 150), 150 + 10 * _draw(number, "d", 80), 300 + 10 * _draw(number, "h", 160))


def expected(shop: Shop) -> dict[str, tuple[int, ...]]:
    """Return the items of a perfect crawl: extents in mm, longest first, by title."""
    without = {"lasting_500", "no_size", "package_only", "bomb", "endless", "off_site", "lying_type"}
    return {
        f"Chair {number}": tuple(sorted(size_mm(number), reverse=True))
        for number in range(shop.products)
        if error(number, shop) not in without
    }


def page_bytes(number: int, shop: Shop) -> int:
    """Return the size of a product's page in bytes."""
    return 1000 * shop.sizes[_draw(number, "size", len(shop.sizes))] if shop.sizes else 0


def product_page(number: int, shop: Shop) -> str:
    """Return the HTML page of a product."""
    width, depth, height = (mm / 10 for mm in size_mm(number))
    case = error(number, shop)
    size = {"no_size": lambda *_: "<p>Very nice.</p>", "package_only": _package}.get(
        case or "", _MARKUPS[number % len(_MARKUPS)]
    )(width, depth, height)
    nested = "<div>" * 3000 if case == "deep" else ""
    around = filler(number, page_bytes(number, shop), shop.products)
    also = "".join(f'<a href="/item/{(number + step) % shop.products}">more</a>' for step in (1, 7, 31))
    return (
        f'<!doctype html><html lang="en"><head><title>Chair {number}</title>'
        f'<meta property="og:image" content="/picture/{number % PICTURES}"></head><body>'
        f'<nav class="breadcrumb"><a href="/">Home</a><a href="/list/0">Furniture</a><a href="/list/1">Chairs</a></nav>'
        f"<h1>Chair {number}</h1>{size}<table><tr><th>Package Dimensions</th><td>150 x 120 x 60 cm</td></tr></table>"
        f'<div class="carousel"><h3>Others bought</h3><dl><dt>Dimensions</dt><dd>9 x 9 x 9 cm</dd></dl>{also}</div>'
        f'{around}{nested}<a href="/calendar/{number}">dates</a></body></html>'
    )


def _table(w: float, d: float, h: float) -> str:
    return f'<table><tr><th>Product Dimensions</th><td>{d:g}"D x {w:g}"W x {h:g}"H</td></tr></table>'.replace(
        '"', " cm "
    )


def _bullets(w: float, d: float, h: float) -> str:
    return f"<ul><li><b>Item Dimensions (W x D x H)</b>: <span>{w:g} x {d:g} x {h:g} cm; 4.2 Kilograms</span></li></ul>"


def _definitions(w: float, d: float, h: float) -> str:
    return f"<dl><dt>Width</dt><dd>{w:g} cm</dd><dt>Depth</dt><dd>{d:g} cm</dd><dt>Height</dt><dd>{h:g} cm</dd></dl>"


def _german(w: float, d: float, h: float) -> str:
    numbers = " x ".join(f"{value:.1f}".replace(".", ",") for value in (w, d, h))
    return f"<table><tr><td>Maße (BxTxH)</td><td>{numbers} cm</td></tr></table>"


def _linked(w: float, d: float, h: float) -> str:
    data = {"@type": "Product", "name": "", "width": f"{w:g} cm", "depth": f"{d:g} cm", "height": f"{h:g} cm"}
    return f'<script type="application/ld+json">{json.dumps(data)}</script>'


def _package(*_: float) -> str:
    return "<p>Comes in a box.</p>"


_MARKUPS: tuple[Callable[[float, float, float], str], ...] = (_table, _bullets, _definitions, _german, _linked)


@dataclass
class SyntheticSite:
    """A running shop with the address `base`; a context manager.

    fetched : number of requests by path.
    unchanged : number of responses with status 304 by path.
    """

    shop: Shop
    fetched: Counter[str] = field(default_factory=Counter)
    unchanged: Counter[str] = field(default_factory=Counter)

    def __enter__(self) -> SyntheticSite:
        socketserver.TCPServer.allow_reuse_address = True
        self._server = ThreadingHTTPServer(("127.0.0.1", 0), _handler(self))
        self._server.daemon_threads = True
        self._server.handle_error = lambda *_: None  # type: ignore[method-assign]  # a killed crawler closes the connection
        self.base = f"http://127.0.0.1:{self._server.server_address[1]}"
        threading.Thread(target=self._server.serve_forever, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.shutdown()
        self._server.server_close()

    def answer(self, path: str) -> tuple[int, dict[str, str], bytes]:
        """Return status, headers and body of a path. A temporary error is returned for the first request only."""
        before = self.fetched[path]
        self.fetched[path] += 1
        bare = path.partition("?")[0]
        name, _, number = bare.strip("/").partition("/")
        if path == "/robots.txt":
            return 200, {"Content-Type": "text/plain"}, b"User-agent: *\nDisallow: /private/\n"
        if name == "list" and number.isdigit():
            return _html(self._listing(int(number)))
        if name == "item" and number.isdigit() and int(number) < self.shop.products:
            return self._item(int(number), "?" in path, before)
        if name == "picture" and number.isdigit():
            return 200, {"Content-Type": "image/png"}, _picture(int(number))
        if name == "calendar":
            return _html(f'<html><body><a href="/calendar/{number}/next">next</a></body></html>')
        return 404, {"Content-Type": "text/plain"}, b"nothing here"

    def _listing(self, number: int) -> str:
        first = number * PRODUCTS_PER_LISTING
        listed = range(first, min(first + PRODUCTS_PER_LISTING, self.shop.products))
        duplicates = [i for i in listed if error(i, self.shop) == "duplicate"]
        links = [f'<a href="/item/{i}">Chair {i}</a>' for i in listed]
        links += [f'<a href="/item/{i}?utm_source=list">again</a>' for i in duplicates]
        links += [
            '<a href="/private/1">private</a>',
            '<a href="mailto:x@example.org">mail</a>',
            '<a href="file:///etc/passwd">x</a>',
        ]
        if first + PRODUCTS_PER_LISTING < self.shop.products:
            links.append(f'<a href="/list/{number + 1}">next</a>')
        return f"<html><body>{''.join(links)}</body></html>"

    def _item(self, number: int, moved: bool, before: int) -> tuple[int, dict[str, str], bytes]:
        case = error(number, self.shop)
        if case == "lasting_500" or (case == "passing_500" and before == 0):
            return 500, {"Content-Type": "text/plain"}, b"sorry"
        if case == "passing_503" and before == 0:
            return 503, {"Content-Type": "text/plain", "Retry-After": "0"}, b"busy"
        if case == "redirect" and not moved:
            return 302, {"Location": f"/item/{number}?at=new"}, b""
        if case == "off_site":
            return 302, {"Location": "http://169.254.169.254/latest/meta-data/"}, b""
        page = product_page(number, self.shop)
        if case == "latin1":
            return (
                200,
                {"Content-Type": "text/html"},
                page.replace("<head>", '<head><meta charset="iso-8859-1">').encode("latin-1"),
            )
        if case == "bomb":
            return 200, {"Content-Type": "text/html", "Content-Encoding": "gzip"}, _bomb()
        if case == "endless":
            return 200, {"Content-Type": "text/html", ENDLESS: "yes"}, b"<p>and on, and on" * 4096
        if case == "lying_type":
            return 200, {"Content-Type": "image/png"}, page.encode()
        return _html(page)


def _html(text: str) -> tuple[int, dict[str, str], bytes]:
    return 200, {"Content-Type": "text/html; charset=utf-8"}, text.encode()


def _picture(number: int) -> bytes:
    """Return a grey PNG of 100 x 80 pixels."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    row = b"\x00" + bytes([10 + number]) * 100
    parts = (
        (b"IHDR", struct.pack(">IIBBBBB", 100, 80, 8, 0, 0, 0, 0)),
        (b"IDAT", zlib.compress(row * 80)),
        (b"IEND", b""),
    )
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunk(kind, data) for kind, data in parts)


_BOMB: list[bytes] = []


def _bomb() -> bytes:
    if not _BOMB:
        _BOMB.append(gzip.compress(b"<p>" + b"0" * 100_000_000, 9))
    return _BOMB[0]


def _handler(site: SyntheticSite) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def log_message(self, *_: object) -> None:
            pass

        def do_GET(self) -> None:
            if site.shop.delay:
                time.sleep(site.shop.delay)
            status, headers, body = site.answer(self.path)
            if status == 200 and ENDLESS not in headers:
                headers = headers | {"ETag": f'"{zlib.crc32(body):08x}"'}
                if self.headers.get("If-None-Match") == headers["ETag"]:
                    site.unchanged[self.path] += 1
                    status, body = 304, b""
            self.send_response(status)
            for name, value in headers.items():
                self.send_header(name, value)
            endless = ENDLESS in headers
            self.send_header(*(("Connection", "close") if endless else ("Content-Length", str(len(body)))))
            self.end_headers()
            try:
                self.wfile.write(body)
                while endless:
                    self.wfile.write(body)
            except OSError:  # the crawler closed the connection, as it does for a bomb
                self.close_connection = True

    return Handler
