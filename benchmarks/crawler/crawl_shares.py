"""Run `metric-tree` with clocks around the parts of a crawl, and write where the processor's time went.

python -m benchmarks.crawler.crawl_shares SHARES.json crawl generic ...
"""

from __future__ import annotations

import functools
import json
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

SPENT: Counter[str] = Counter()


def clocked(owner: Any, name: str, part: str) -> None:
    """Replace a function by one that adds its processor time to `part`; a generator is run to its end within."""
    inner: Callable[..., Any] = getattr(owner, name)
    generates = inner.__name__ in {"_links", "_item"}

    @functools.wraps(inner)
    def outer(*words: Any, **named: Any) -> Any:
        started = time.thread_time()
        found = inner(*words, **named)
        found = list(found) if generates else found
        SPENT[part] += time.thread_time() - started
        return found

    setattr(owner, name, outer)


def main() -> int:
    """Set the clocks, crawl, write the shares."""
    from crawler.fetch import crawl, frontier_sqlite, site_spider
    from metric_tree.commands import main as metric_tree

    clocked(site_spider, "page", "parse")
    clocked(site_spider.SiteSpider, "_item", "own work")
    clocked(site_spider.SiteSpider, "_links", "links")
    for name in ("add", "lease", "put_back", "commit", "is_exhausted"):
        clocked(frontier_sqlite.SqliteFrontier, name, "frontier")
    clocked(crawl, "write_segments", "writing")
    status = metric_tree(sys.argv[2:])
    whole = time.process_time()
    SPENT["download, Scrapy and start"] = whole - sum(SPENT.values())
    Path(sys.argv[1]).write_text(json.dumps({part: round(seconds, 2) for part, seconds in SPENT.items()}))
    return status


if __name__ == "__main__":
    raise SystemExit(main())
