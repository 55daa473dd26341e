"""Cost of a crawl: ours beside a bare Scrapy spider on the same links of the same synthetic site.

    python -m benchmarks.crawler.crawl --pages 1000 10000 [--real-sizes]

The synthetic site (`tests/synthetic/synthetic_site.py`) runs in a process of its own; its time is not counted. CPU and
memory are the operating system's figures of the crawling process. `--real-sizes` gives product pages the sizes of the
sixteen saved real pages (235 to 3,149 kB, drawn evenly by number).
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
    """A synthetic site in another process: its address, and the addresses that were asked for."""

    def __init__(self, shop: Shop) -> None:
        self._here, there = multiprocessing.Pipe()
        self._process = multiprocessing.Process(target=_serve, args=(shop, there), daemon=True)
        self._process.start()
        self.base: str = self._here.recv()

    def asked(self) -> Counter[str]:
        """How often each address was asked for."""
        self._here.send("asked")
        found: Counter[str] = self._here.recv()
        return found

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
    """Ours and a bare spider over one synthetic site, and what ours collected against the truth."""
    rows: list[dict[str, Any]] = []
    asked: list[Counter[str]] = []
    with tempfile.TemporaryDirectory() as scratch:
        out = Path(scratch) / "out"
        for name in ("bare", "ours"):
            served = ServedShop(shop)
            bare = [sys.executable, "-m", "benchmarks.crawler.bare_spider", served.base]
            run = run_child(bare if name == "bare" else _ours(served.base, out))
            asked.append(served.asked())
            served.close()
            rows.append({"spider": name, **_rates(run, asked[-1])})
        rows[-1] |= _against_truth(shop, out) | {"other_addresses": len(set(asked[0]) ^ set(asked[1]))}
    return rows


def _rates(run: ChildRun, asked: Counter[str]) -> dict[str, float]:
    """A page is an answer that was asked for, of a product, a list or a calendar."""
    pages = asked.total()
    products = sum(path.startswith("/item/") for path in asked)
    rates = {"ms_per_page": 1000 * run.cpu_s / pages, "ms_per_product": 1000 * run.cpu_s / products}
    counts = {"products": products, "pages": pages, "cpu_s": run.cpu_s, "peak_mb": run.peak_mib}
    return counts | rates | {"pages_per_s": pages / run.wall_s}


def _against_truth(shop: Shop, out: Path) -> dict[str, int]:
    truth, found = expected(shop), _items(out)
    right = sum(truth.get(title) == size for title, size in found)
    counts = {"expected": len(truth), "items": len(found), "right": right}
    missed = len(set(truth) - {title for title, _ in found})
    return counts | {"missed": missed, "doubled": len(found) - len(dict(found))}


def _items(out: Path) -> list[tuple[str, tuple[float, ...]]]:
    lines = [line for path in sorted(out.rglob("items-*.jsonl")) for line in path.read_text().splitlines()]
    return [(item["title"], tuple(item["extents_mm"])) for item in map(json.loads, lines)]


def _rounded(row: dict[str, Any]) -> dict[str, Any]:
    return {name: round(value, 2) if isinstance(value, float) else value for name, value in row.items()}


def main() -> None:
    """Print a line per crawl."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pages", type=int, nargs="*", default=[])
    parser.add_argument("--real-sizes", action="store_true")
    arguments = parser.parse_args()
    for pages in arguments.pages:
        shop = Shop(products=pages, sizes=REAL_SIZES if arguments.real_sizes else ())
        for row in compared(shop):
            print(_rounded(row), flush=True)


if __name__ == "__main__":
    main()
