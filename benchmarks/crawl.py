"""Cost of a crawl: ours beside a bare Scrapy spider that follows the same links of the same made site in the same run.

    python -m benchmarks.crawl --pages 1000 10000 --padding 235000 [--kills 10]

The made site (`benchmarks/made_site.py`) runs in a process of its own; its time is not counted. CPU and memory are the
operating system's figures of the crawling process. `--padding` gives pages the size of real ones (235 to 3,149 kB).
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from benchmarks.made_site import MadeSite, Shop, expected

BARE = """
import sys, scrapy
from scrapy.crawler import CrawlerProcess
class Bare(scrapy.Spider):
    name = "bare"
    start_urls = [sys.argv[1] + "/list/0"]
    def parse(self, response):
        if hasattr(response, "xpath"):
            for link in response.xpath("//a/@href").getall():
                if link.startswith(("/item", "/list")):
                    yield response.follow(link, self.parse)
process = CrawlerProcess({"LOG_ENABLED": False, "ROBOTSTXT_OBEY": True, "CONCURRENT_REQUESTS_PER_DOMAIN": 16,
    "RETRY_TIMES": 3, "TELNETCONSOLE_ENABLED": False, "DOWNLOAD_MAXSIZE": 32_000_000, "DOWNLOAD_WARNSIZE": 0})
process.crawl(Bare)
process.start()
"""


@contextmanager
def shop_process(shop: Shop) -> Iterator[str]:
    """A made site in another process; yields its address."""
    here, there = multiprocessing.Pipe()
    process = multiprocessing.Process(target=_serve, args=(shop, there), daemon=True)
    process.start()
    yield here.recv()
    process.terminate()


def _serve(shop: Shop, pipe: Any) -> None:
    with MadeSite(shop) as site:
        pipe.send(site.base)
        time.sleep(86_400)


def _ours(base: str, out: Path, *words: str) -> list[str]:
    code = "from metric_tree.commands import main; raise SystemExit(main())"
    fixed = ["crawl", "generic", "--out", str(out), "--start-url", f"{base}/list/0", "--contact", "bench@example.org"]
    return [sys.executable, "-c", code, *fixed, "--delay", "0", "--private", "--json", *words]


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


def compared(pages: int, padding: int) -> list[dict[str, Any]]:
    """Ours and a bare spider over one made site, and what ours brought home against truth."""
    shop = Shop(products=pages, padding=padding)
    rows = []
    with tempfile.TemporaryDirectory() as scratch:
        for name in ("bare", "ours"):
            with shop_process(shop) as base:
                command = [sys.executable, "-c", BARE, base] if name == "bare" else _ours(base, Path(scratch) / "out")
                figures = measured(command)
            rate = {"ms_per_page": 1000 * figures["cpu_s"] / pages, "pages_per_s": pages / figures["wall_s"]}
            rows.append({"spider": name, "pages": pages, **figures, **rate})
        truth, found = expected(shop), _items(Path(scratch) / "out")
        right = sum(truth.get(title) == size for title, size in found)
        rows[-1] |= {
            "expected": len(truth),
            "items": len(found),
            "right": right,
            "doubled": len(found) - len(dict(found)),
        }
    return rows


def killed(pages: int, kills: int) -> dict[str, int]:
    """Kill a crawl at random moments, resume it, and count what was lost or doubled."""
    generator = random.Random(7)  # noqa: S311 - moments of kills, not secrets
    shop = Shop(products=pages, faults=False, delay=0.01)
    out = Path(tempfile.mkdtemp())
    with shop_process(shop) as base:
        for number in range(kills):
            process = subprocess.Popen(_ours(base, out, *(["--resume"] if number else [])), stdout=subprocess.DEVNULL)
            time.sleep(1.0 + 3.0 * generator.random())
            process.send_signal(signal.SIGKILL)
            process.wait()
        subprocess.run(_ours(base, out, "--resume"), stdout=subprocess.DEVNULL, check=True)
    found = _items(out)
    shutil.rmtree(out)
    return {"kills": kills, "lost": pages - len(dict(found)), "doubled": len(found) - len(dict(found))}


def _items(out: Path) -> list[tuple[str, tuple[float, ...]]]:
    lines = [line for path in sorted(out.rglob("items-*.jsonl")) for line in path.read_text().splitlines()]
    return [(item["title"], tuple(item["extents_mm"])) for item in map(json.loads, lines)]


def main() -> None:
    """Print a line per crawl."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pages", type=int, nargs="+", default=[1000])
    parser.add_argument("--padding", type=int, default=235_000)
    parser.add_argument("--kills", type=int, default=0)
    arguments = parser.parse_args()
    for pages in arguments.pages:
        for row in compared(pages, arguments.padding):
            print(
                {name: round(value, 2) if isinstance(value, float) else value for name, value in row.items()},
                flush=True,
            )
    if arguments.kills:
        print(killed(300, arguments.kills))


if __name__ == "__main__":
    main()
