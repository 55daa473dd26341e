"""What reading a saved page costs beside one parse of it.

    python -m benchmarks.crawler.page_cost [FOLDER] [--repeats 5]

FOLDER holds `truth.json` and pages (default: the saved real pages beside the repository). Processor time, the least of
several runs; what a process remembers of labels and class names is forgotten before each. `parse` is lxml on the
decoded text, `own` everything else between a body and a raw item: decoding, cleaning, links, product, facts, sizes.
"""

from __future__ import annotations

import argparse
import gzip
import json
import time
from collections.abc import Callable
from pathlib import Path

import lxml.html
from bs4 import BeautifulSoup

from crawler.page import facts, regions
from crawler.page.page import page
from crawler.sites import item_of
from crawler.text import vocabulary

PAGES = Path(__file__).resolve().parents[3] / "shared" / "data" / "pages"


def least_ms(work: Callable[[], object], repeats: int) -> float:
    """The least processor time of some runs, milliseconds."""
    spent = []
    for _ in range(repeats):
        _forget()
        started = time.process_time()
        work()
        spent.append(time.process_time() - started)
    return 1000 * min(spent)


def _forget() -> None:
    for module in (vocabulary, regions, facts):
        for value in vars(module).values():
            if hasattr(value, "cache_clear"):
                value.cache_clear()


def cost(body: bytes, url: str, repeats: int) -> tuple[float, float, float]:
    """Milliseconds of lxml's parse, of our own work, and of BeautifulSoup's parse."""
    text = body.decode("utf-8", errors="replace")
    parse = least_ms(lambda: lxml.html.document_fromstring(text), repeats)
    whole = least_ms(lambda: item_of(page(body, url)), repeats)
    soup = least_ms(lambda: BeautifulSoup(text, "lxml"), max(1, repeats // 2))
    return parse, whole - parse, soup


def main() -> None:
    """Print a line a page, and the sum."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=PAGES)
    parser.add_argument("--repeats", type=int, default=5)
    arguments = parser.parse_args()
    truths = json.loads((arguments.folder / "truth.json").read_text(encoding="utf-8"))["pages"]
    costs = []
    print(f"{'page':<42} {'kB':>5} {'parse ms':>9} {'own ms':>7} {'own/parse':>9} {'soup ms':>8}")
    for truth in truths:
        body = gzip.decompress((arguments.folder / truth["file"]).read_bytes())
        costs.append(cost(body, truth["url"], arguments.repeats))
        _show(truth["file"], len(body), costs[-1])
    _show("all", 0, tuple(map(sum, zip(*costs, strict=True))))
    ratios = sorted(own / parse for parse, own, _ in costs)
    print(f"own/parse: least {ratios[0]:.2f}, median {ratios[len(ratios) // 2]:.2f}, most {ratios[-1]:.2f}")


def _show(name: str, size: int, found: tuple[float, ...]) -> None:
    parse, own, soup = found
    print(f"{name:<42} {size // 1000:>5} {parse:9.1f} {own:7.1f} {own / parse:9.2f} {soup:8.1f}", flush=True)


if __name__ == "__main__":
    main()
