"""A small web shop on loopback with product images: chairs, tables and computer mice on white.

One image has a cluttered background, and one file is not an image.
"""

from __future__ import annotations

import json
import threading
from functools import cached_property
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from io import BytesIO
from types import TracebackType

import numpy as np
from PIL import Image, ImageDraw

__all__ = ["PRODUCTS", "PictureShop"]

#: By breadcrumb: size in mm (width, depth, height), and relative width and height of the drawing.
KINDS = {
    "Dining Chairs": ((460, 520, 860), (0.55, 1.0)),
    "Dining Tables": ((1600, 900, 750), (1.0, 0.5)),
    "Computer Mice": ((62, 110, 38), (0.6, 1.0)),
}
EACH = 8
PRODUCTS = tuple((kind, number) for kind in KINDS for number in range(EACH))


class PictureShop:
    """A running shop with the address `base`; a context manager."""

    def __enter__(self) -> PictureShop:
        self._server = ThreadingHTTPServer(("127.0.0.1", 0), _handler(self))
        self.base = f"http://127.0.0.1:{self._server.server_address[1]}"
        threading.Thread(target=self._server.serve_forever, daemon=True).start()
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._server.shutdown()
        self._server.server_close()

    @cached_property
    def pages(self) -> dict[str, tuple[str, bytes]]:
        """Content type and body of each path."""
        links = "".join(f'<a href="/item/{row}">item</a>' for row in range(len(PRODUCTS)))
        pages = {"/list": ("text/html", f"<html><body>{links}</body></html>".encode())}
        for row, (kind, number) in enumerate(PRODUCTS):
            pages[f"/item/{row}"] = ("text/html", _page(kind, number, f"{self.base}/photo/{row}.jpg").encode())
            pages[f"/photo/{row}.jpg"] = ("image/jpeg", _photo(kind, number))
        return pages


def size_mm(kind: str, number: int) -> tuple[int, int, int]:
    """Return width, depth and height of a product in mm."""
    factor = 1 + 0.03 * (number - EACH / 2)
    width, depth, height = (round(side * factor) for side in KINDS[kind][0])
    return width, depth, height


def _page(kind: str, number: int, photo: str) -> str:
    width, depth, height = size_mm(kind, number)
    data = {"@context": "https://schema.org", "@type": "Product", "name": f"{kind[:-1]} {number}", "image": [photo]}
    return (
        f'<!doctype html><html lang="en"><head><title>{kind} {number}</title>'
        f'<script type="application/ld+json">{json.dumps(data)}</script><meta property="og:image" content="{photo}">'
        "</head><body>"
        f'<nav class="breadcrumb"><a href="/">Home</a><a href="/list">Furniture</a><a href="/list">{kind}</a></nav>'
        f"<h1>{kind[:-1]} {number}</h1><dl><dt>Width</dt><dd>{width} mm</dd><dt>Depth</dt><dd>{depth} mm</dd>"
        f"<dt>Height</dt><dd>{height} mm</dd></dl></body></html>"
    )


def _photo(kind: str, number: int) -> bytes:
    """Return an image of a rectangle on white; chair 1 has a cluttered background, and chair 2 has text as image."""
    if (kind, number) == ("Dining Chairs", 2):
        return b"sorry, no photograph" * 50
    generator = np.random.default_rng([number, *kind.encode()])
    if (kind, number) == ("Dining Chairs", 1):
        patches = generator.integers(0, 256, (30, 30, 3), dtype=np.uint8)
        return _jpeg(Image.fromarray(patches).resize((300, 300), Image.Resampling.NEAREST))
    image = Image.new("RGB", (300, 300), "white")
    wide, high = (round(220 * side) for side in KINDS[kind][1])
    colour = tuple(int(c) for c in generator.integers(20, 170, 3))
    corner = ((300 - wide) // 2, (300 - high) // 2)
    ImageDraw.Draw(image).rectangle((*corner, corner[0] + wide - 1, corner[1] + high - 1), fill=colour)
    return _jpeg(image)


def _jpeg(image: Image.Image) -> bytes:
    sink = BytesIO()
    image.save(sink, "JPEG", quality=92)
    return sink.getvalue()


def _handler(shop: PictureShop) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        def log_message(self, *_: object) -> None:
            pass

        def do_GET(self) -> None:
            kind, body = shop.pages.get(self.path, ("", b""))
            self.send_response(200 if body else 404)
            self.send_header("Content-Type", kind or "text/plain")
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

    return Handler
