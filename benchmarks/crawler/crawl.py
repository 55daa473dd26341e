"""Cost of a crawl: ours beside a bare Scrapy spider on the same links of the same synthetic site.

    python -m benchmarks.crawler.crawl --pages 1000 10000 [--real-sizes] [--shares]

The synthetic site (`tests/synthetic/synthetic_site.py`) runs in a process of its own; its time is not counted. CPU and
memory are the operating system's figures of the crawling process. `--real-sizes` gives product pages the sizes of the
sixteen saved real pages (235 to 3,149 kB, drawn evenly by number); `--shares` says where our time goes.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import resource
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

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


def _ours(base: str, out: Path, *words: str, shares: Path | None = None) -> list[str]:
    code = "from metric_cli.verbs import main; raise SystemExit(main())"
    program = ["-c", code] if shares is None else ["-m", "benchmarks.crawler.crawl_shares", str(shares)]
    fixed = ["crawl", "generic", "--out", str(out), "--start-url", f"{base}/list/0", "--contact", "bench@example.org"]
    return [sys.executable, *program, *fixed, "--delay", "0", "--private", "--json", *words]


def measured(command: list[str]) -> dict[str, float]:
    """Wall and CPU seconds and peak memory in MB of a command."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    started = time.monotonic()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    peak = 0
    while process.poll() is None:
        status = Path(f"/proc/{process.pid}/status").read_text()
        peak = max([peak, *(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmHWM"))])
        time.sleep(0.2)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {"wall_s": time.monotonic() - started, "cpu_s": cpu, "peak_mb": peak / 1024}


def compared(shop: Shop, with_shares: bool) -> list[dict[str, Any]]:
    """Ours and a bare spider over one synthetic site, and what ours brought home against truth."""
    rows: list[dict[str, Any]] = []
    asked: list[Counter[str]] = []
    with tempfile.TemporaryDirectory() as scratch:
        out, shares = Path(scratch) / "out", Path(scratch) / "shares.json"
        for name in ("bare", "ours"):
            served = ServedShop(shop)
            command = [sys.executable, "-m", "benchmarks.crawler.bare_spider", served.base]
            if name == "ours":
                command = _ours(served.base, out, shares=shares if with_shares else None)
            figures = measured(command)
            asked.append(served.asked())
            served.close()
            rows.append({"spider": name, **_rates(figures, asked[-1])})
        rows[-1] |= _against_truth(shop, out) | {"other_addresses": len(set(asked[0]) ^ set(asked[1]))}
        if with_shares:
            rows[-1]["cpu_s_by_part"] = json.loads(shares.read_text())
    return rows


def _rates(figures: dict[str, float], asked: Counter[str]) -> dict[str, float]:
    """A page is an answer that was asked for, of a product, a list or a calendar."""
    pages = asked.total()
    products = sum(path.startswith("/item/") for path in asked)
    rates = {"ms_per_page": 1000 * figures["cpu_s"] / pages, "ms_per_product": 1000 * figures["cpu_s"] / products}
    return {"products": products, "pages": pages, **figures, **rates, "pages_per_s": pages / figures["wall_s"]}


def _against_truth(shop: Shop, out: Path) -> dict[str, int]:
    truth, found = expected(shop), _items(out)
    right = sum(truth.get(title) == size for title, size in found)
    counts = {"expected": len(truth), "items": len(found), "right": right}
    return counts | {
        "missed": len(set(truth) - {title for title, _ in found}),
        "doubled": len(found) - len(dict(found)),
    }


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
    parser.add_argument("--shares", action="store_true")
    arguments = parser.parse_args()
    for pages in arguments.pages:
        shop = Shop(products=pages, sizes=REAL_SIZES if arguments.real_sizes else ())
        for row in compared(shop, arguments.shares):
            print(_rounded(row), flush=True)


if __name__ == "__main__":
    main()
