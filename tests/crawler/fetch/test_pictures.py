from __future__ import annotations

import zlib
from io import BytesIO
from pathlib import Path

import pytest
from PIL import Image
from scrapy import Request
from scrapy.http import HtmlResponse

from crawler.fetch.crawl import spider_class
from crawler.fetch.item_images import Picture, picture
from crawler.items import RawItem


def _bytes(size: tuple[int, int] = (100, 80), kind: str = "PNG", **options: object) -> bytes:
    buffer = BytesIO()
    Image.new("RGB", size, (200, 30, 30)).save(buffer, kind, **options)
    return buffer.getvalue()


def _animated() -> bytes:
    frames = [Image.new("RGB", (100, 100), (shade, 0, 0)) for shade in (0, 255)]
    buffer = BytesIO()
    frames[0].save(buffer, "WEBP", save_all=True, append_images=frames[1:])
    return buffer.getvalue()


def _header_that_lies() -> bytes:
    """A PNG whose header states a hundred thousand pixels square."""
    body = bytearray(_bytes())
    body[16:24] = (100_000).to_bytes(4) * 2
    body[29:33] = zlib.crc32(bytes(body[12:29])).to_bytes(4)
    return bytes(body)


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "WEBP"])
def test_a_picture_is_stored_once_under_its_hash(tmp_path: Path, kind: str) -> None:
    found = picture(_bytes(kind=kind), "https://x.example/a", "shop:1", tmp_path)
    assert isinstance(found, Picture)
    assert (found.width_px, found.height_px) == (100, 80)
    assert (tmp_path / found.path).read_bytes() == _bytes(kind=kind)
    again = picture(_bytes(kind=kind), "https://x.example/b", "shop:2", tmp_path)
    assert isinstance(again, Picture)
    assert again.path == found.path
    assert again.identity != found.identity
    assert len([path for path in tmp_path.rglob("*") if path.is_file()]) == 1


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        (b"", "empty"),
        (b"<svg xmlns='http://www.w3.org/2000/svg'/>", "no_picture"),
        (b"GIF89a" + b"\x00" * 50, "no_picture"),
        (_bytes()[:60], "broken"),
        (_bytes(size=(30, 30)), "too_small"),
        (_bytes(size=(13_000, 64)), "too_large"),
        (_header_that_lies(), "no_picture"),  # Pillow calls it a bomb before we can
        (_animated(), "animated"),
        (b"\x00" * 20_000_001, "too_many_bytes"),
    ],
    ids=["empty", "svg", "gif", "truncated", "small", "large", "lying header", "animated", "bytes"],
)
def test_a_hostile_file_costs_one_picture(tmp_path: Path, body: bytes, reason: str) -> None:
    assert picture(body, "https://x.example/a", "shop:1", tmp_path) == reason
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "url", "image_url", "stored"),
    [
        ("amazon", "https://www.amazon.de/dp/B0ABCDEF01", "https://m.media-amazon.com/images/I/1.jpg", False),
        ("ikea", "https://www.ikea.com/gb/en/p/made-00123456/", "https://www.ikea.com/x.jpg", False),
        ("wikipedia", "https://en.wikipedia.org/wiki/A", "https://upload.wikimedia.org/wikipedia/en/a/ab/A.jpg", False),
        (
            "wikipedia",
            "https://en.wikipedia.org/wiki/A",
            "https://upload.wikimedia.org/wikipedia/commons/a/A.jpg",
            True,
        ),
        ("generic", "https://shop.example/p", "https://cdn.shop.example/1.jpg", True),
    ],
)
def test_the_link_alone_is_kept_where_terms_allow_no_more(
    tmp_path: Path, name: str, url: str, image_url: str, stored: bool
) -> None:
    body = f"""<html><body><h1>Made</h1><img id="landingImage" src="{image_url}"><table class="infobox"><tr>
    <td>Dimensions</td><td>1 x 2 x 3 m <img src="{image_url}"></td></tr></table></body></html>"""
    head = f'<meta property="og:image" content="{image_url}">'
    response = HtmlResponse(url, body=(head + body).encode(), request=Request(url))
    found = list(spider_class(name)(start=[url], pictures=tmp_path).parse(response))
    (item,) = (part for part in found if isinstance(part, RawItem))
    assert item.images == (image_url,)
    assert [part.url for part in found if isinstance(part, Request)] == ([image_url] if stored else [])
    assert found.count("picture_link_only") == (0 if stored else 1)
