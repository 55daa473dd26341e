"""Reference spider of the crawl benchmark: it fetches pages and follows the same links as ours, without extraction.

    python -m benchmarks.crawler.bare_spider http://127.0.0.1:PORT

The link rules are ours: same host, no tracking parameters, no fragments, no path segment more than twice, at most 120
links deep.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from typing import Any
from urllib.parse import urlsplit

import scrapy
from scrapy.crawler import CrawlerProcess

SETTINGS = {
    "LOG_ENABLED": False, "ROBOTSTXT_OBEY": True, "CONCURRENT_REQUESTS_PER_DOMAIN": 16, "DOWNLOAD_DELAY": 0,
    "RETRY_TIMES": 3, "TELNETCONSOLE_ENABLED": False, "DOWNLOAD_MAXSIZE": 32_000_000, "DOWNLOAD_WARNSIZE": 0,
    "DOWNLOAD_TIMEOUT": 30, "COOKIES_ENABLED": False, "DEPTH_LIMIT": 120,
}  # fmt: skip


class Bare(scrapy.Spider):  # type: ignore[misc]  # Scrapy has no types
    """Follow links without storing any item."""

    name = "bare"
    allowed_domains = ("127.0.0.1",)

    def parse(self, response: Any, **_: Any) -> Iterator[Any]:
        """Yield requests for the links of a page."""
        if not hasattr(response, "xpath"):
            return
        for address in set(response.xpath("//a/@href").getall()):
            link = re.sub(r"[?&]utm_\w+=[^&]*", "", address)
            parts = [part for part in urlsplit(link).path.split("/") if part]
            if link.startswith("/") and not any(parts.count(part) > 2 for part in parts):
                yield response.follow(link, self.parse)


if __name__ == "__main__":
    Bare.start_urls = [f"{sys.argv[1]}/list/0"]
    process = CrawlerProcess(SETTINGS)
    process.crawl(Bare)
    process.start()
