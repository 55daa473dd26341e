"""The HTTP cache: responses come back as they were, and files of strangers run no code."""

from __future__ import annotations

import gzip
import json
import pickle
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from scrapy import Request
from scrapy.extensions.httpcache import FilesystemCacheStorage
from scrapy.http import HtmlResponse
from scrapy.settings import Settings
from scrapy.utils.misc import load_object
from scrapy.utils.request import RequestFingerprinter

from crawler.fetch.response_cache import JsonCacheStorage
from crawler.fetch.settings import crawl_settings

URL = "https://shop.example/p/1"
SPIDER: Any = SimpleNamespace(name="shop", crawler=SimpleNamespace(request_fingerprinter=RequestFingerprinter()))
RESPONSE = HtmlResponse(
    URL,
    status=203,
    headers={b"Content-Type": [b"text/html; charset=latin-1"], b"Set-Cookie": [b"a=1", "b=é".encode("latin-1")]},
    body="<p>Maße".encode("latin-1"),
)


class Payload:
    def __init__(self, file: Path) -> None:
        self.file = file

    def __reduce__(self) -> tuple[Any, tuple[str]]:
        return Path.touch, (self.file,)  # type: ignore[return-value]


def storage(folder: Path) -> Any:
    """Return the storage of a crawl with `--cache`."""
    settings = Settings(crawl_settings(contact="me@example.org", cache=folder))
    opened = load_object(settings["HTTPCACHE_STORAGE"])(settings)
    opened.open_spider(SPIDER)
    return opened


def test_a_response_comes_back_as_it_was(tmp_path: Path) -> None:
    storage(tmp_path).store_response(SPIDER, Request(URL), RESPONSE)
    request = Request(URL)
    again = storage(tmp_path).retrieve_response(SPIDER, request)
    assert (type(again), again.url, again.status, again.body) == (HtmlResponse, URL, 203, RESPONSE.body)
    assert dict(again.headers.items()) == dict(RESPONSE.headers.items())
    assert again.text == "<p>Maße"
    assert request.meta["cache_timestamp"] > 0
    assert storage(tmp_path).retrieve_response(SPIDER, Request(f"{URL}1")) is None


def test_a_pickle_in_the_folder_is_not_loaded(tmp_path: Path) -> None:
    old = FilesystemCacheStorage(Settings({"HTTPCACHE_DIR": str(tmp_path), "HTTPCACHE_GZIP": True}))
    old.open_spider(SPIDER)
    old.store_response(SPIDER, Request(URL), RESPONSE)
    for file in tmp_path.rglob("*"):
        if file.is_file():
            file.write_bytes(gzip.compress(pickle.dumps(Payload(tmp_path / "was run"))))
    assert storage(tmp_path).retrieve_response(SPIDER, Request(URL)) is None
    assert not (tmp_path / "was run").exists()


@pytest.mark.parametrize(
    "change", [{"schema": "x"}, {"headers": 5}, {"body": "%"}, {"status": "a"}, {"timestamp": None}]
)
def test_a_damaged_record_is_fetched_again(tmp_path: Path, change: dict[str, object]) -> None:
    cache = storage(tmp_path)
    assert isinstance(cache, JsonCacheStorage)
    cache.store_response(SPIDER, Request(URL), RESPONSE)
    (file,) = (file for file in tmp_path.rglob("*") if file.is_file())
    record = json.loads(gzip.decompress(file.read_bytes()))
    for content in (gzip.compress(json.dumps(record | change).encode()), file.read_bytes()[:-9], b"{"):
        file.write_bytes(content)
        assert cache.retrieve_response(SPIDER, Request(URL)) is None
