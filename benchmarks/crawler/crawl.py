"""Compare the cost of our crawl with a bare Scrapy spider on the same links of the same synthetic site.

    python -m benchmarks.crawler.crawl --pages 1000 10000 [--real-sizes]

The synthetic site (`tests/synthetic/synthetic_site.py`) runs in a separate process, whose time is not included. CPU
time and memory of the crawling process are measured by the operating system. With `--real-sizes` product pages have
the sizes of sixteen saved real pages (235 to 3,149 kB) in equal numbers.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

from benchmarks.child import ChildRun, ours, run_child
from tests.synthetic.filler import REAL_SIZES
from tests.synthetic.synthetic_site import Shop, SyntheticSite, expected


class ServedShop:
    """A synthetic site in another process, with its address and a log of the requested addresses."""

    def __init__(self, shop: Shop) -> None:
        self._pipe, site_pipe = multiprocessing.Pipe()
        self._process = multiprocessing.Process(target=_serve, args=(shop, site_pipe), daemon=True)
        self._process.start()
        self.base: str = self._pipe.recv()

    def request_counts(self) -> Counter[str]:
        """Return the number of requests per address."""
        self._pipe.send("request counts")
        counts: Counter[str] = self._pipe.recv()
        return counts

    def close(self) -> None:
        """End the process."""
        self._process.terminate()


def _serve(shop: Shop, pipe: Any) -> None:
    with SyntheticSite(shop) as site:
        pipe.send(site.base)
        while pipe.recv():
            pipe.send(site.fetched)


def _ours(base: str, out: Path) -> list[str]:
    words = ["crawl", "generic", "--out", out, "--start-url", f"{base}/list/0", "--contact", "bench@example.org"]
    return ours("metric-tree", *words, "--delay", 0, "--private", "--json")


def compared(shop: Shop) -> list[dict[str, Any]]:
    """Run a bare spider and ours on a synthetic site, and compare the collected items with the truth."""
    rows: list[dict[str, Any]] = []
    requested: list[Counter[str]] = []
    with tempfile.TemporaryDirectory() as scratch:
        out = Path(scratch) / "out"
        for name in ("bare", "ours"):
            served = ServedShop(shop)
            bare = [sys.executable, "-m", "benchmarks.crawler.bare_spider", served.base]
            run = run_child(bare if name == "bare" else _ours(served.base, out))
            requested.append(served.request_counts())
            served.close()
            rows.append({"spider": name, **_rates(run, requested[-1])})
        rows[-1] |= _against_truth(shop, out) | {"other_addresses": len(set(requested[0]) ^ set(requested[1]))}
    return rows


def _rates(run: ChildRun, requested: Counter[str]) -> dict[str, float]:
    """Return counts and rates. Every response (product, list or calendar) is a page."""
    pages = requested.total()
    products = sum(path.startswith("/item/") for path in requested)
    rates = {"ms_per_page": 1000 * run.cpu_s / pages, "ms_per_product": 1000 * run.cpu_s / products}
    counts = {"products": products, "pages": pages, "cpu_s": run.cpu_s, "peak_mb": run.peak_mib}
    return counts | rates | {"pages_per_s": pages / run.wall_s}


def _against_truth(shop: Shop, out: Path) -> dict[str, int]:
    truth = expected(shop)
    lines = [line for path in sorted(out.rglob("items-*.jsonl")) for line in path.read_text().splitlines()]
    found = [(item["title"], tuple(item["extents_mm"])) for item in map(json.loads, lines)]
    right = sum(truth.get(title) == size for title, size in found)
    counts = {"expected": len(truth), "items": len(found), "right": right}
    missed = len(set(truth) - {title for title, _ in found})
    return counts | {"missed": missed, "doubled": len(found) - len(dict(found))}


def main() -> None:
    """Print one line per crawl."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pages", type=int, nargs="*", default=[])
    parser.add_argument("--real-sizes", action="store_true")
    arguments = parser.parse_args()
    for pages in arguments.pages:
        shop = Shop(products=pages, sizes=REAL_SIZES if arguments.real_sizes else ())
        for row in compared(shop):
            rounded = {name: round(value, 2) if isinstance(value, float) else value for name, value in row.items()}
            print(rounded, flush=True)


if __name__ == "__main__":
    main()
