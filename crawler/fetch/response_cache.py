"""HTTP cache of a crawl: one JSON file per response. Scrapy's own storage unpickles its files, which could run code."""

from __future__ import annotations

import base64
import gzip
import json
import time
import zlib
from pathlib import Path
from typing import Any

from scrapy import Request, Spider
from scrapy.http import Headers, Response
from scrapy.responsetypes import responsetypes
from scrapy.settings import BaseSettings

from crawler.page.page import MAX_BYTES
from metric_base.files import whole_file

_SCHEMA = "metric-tree/cached-response/1"
#: Maximum size of a record in bytes: a body of the maximum size in base64, and as much for the headers.
_MAX_RECORD_BYTES = 2 * MAX_BYTES


class JsonCacheStorage:
    """Storage for Scrapy's cache (`HTTPCACHE_STORAGE`) below the folder `HTTPCACHE_DIR`."""

    def __init__(self, settings: BaseSettings) -> None:
        self._folder = Path(settings["HTTPCACHE_DIR"])
        self._fingerprinter: Any = None

    def open_spider(self, spider: Spider) -> None:
        """Start a crawl."""
        self._fingerprinter = spider.crawler.request_fingerprinter

    def close_spider(self, spider: Spider) -> None:
        """End a crawl."""

    def retrieve_response(self, spider: Spider, request: Request) -> Response | None:
        """Return the stored response; None if there is none, or if its file is damaged."""
        try:
            with gzip.open(self._file(spider, request)) as packed:
                record = json.loads(packed.read(_MAX_RECORD_BYTES))
            if record["schema"] != _SCHEMA:
                return None
            headers = Headers(record["headers"], encoding="latin-1")
            url, body = str(record["url"]), base64.b64decode(record["body"], validate=True)
            request.meta["cache_timestamp"] = float(record["timestamp"])
            kind = responsetypes.from_args(headers=headers, url=url, body=body)
            return kind(url, status=int(record["status"]), headers=headers, body=body)
        except (OSError, EOFError, zlib.error, ValueError, LookupError, TypeError, AttributeError, RecursionError):
            return None

    def store_response(self, spider: Spider, request: Request, response: Response) -> None:
        """Store a response with the current time."""
        headers = {
            name.decode("latin-1"): [value.decode("latin-1") for value in values]
            for name, values in response.headers.items()
        }
        record = {"schema": _SCHEMA, "url": response.url, "status": response.status, "timestamp": time.time()}
        record |= {"headers": headers, "body": base64.b64encode(response.body).decode("ascii")}
        file = self._file(spider, request)
        file.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(file) as work:
            work.write_bytes(gzip.compress(json.dumps(record).encode()))

    def _file(self, spider: Spider, request: Request) -> Path:
        key = self._fingerprinter.fingerprint(request).hex()
        return self._folder.joinpath(spider.name, key[:2], f"{key}.json.gz")
